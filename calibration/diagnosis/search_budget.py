"""How many searches a diagnosis makes, so that it does not take too long.

Work is counted, not timed: the same recording has the same diagnosis on any computer.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from calibration.diagnosis.settings import VERDICT

COLUMNS_OF_A_STEP = 200.0  # whose information takes as long as what a step takes however few columns it adds
SHARE_OF_LEADERS = 2.0 / 3.0  # of all work, that may be done before a search begins with one more effect of the ranking
SHARE_OF_WEAK = 1.0 / 3.0  # the same for one that explains less, so that enough is left for others
BY_VISIT = "effects that are another at each visit"


class SearchBudget:
    """The searches of one diagnosis, by what they begin with: an effect, or BY_VISIT.

    found: those that have found something in the same readings, with other weights: they are made again in any case.
    left_out: those that were not made since there had been work enough; one with BY_VISIT that explains most is made
    without being asked for. limit, spent: in readings times columns; an infinite limit leaves out nothing (`thorough`).
    """

    def __init__(self, *, found: Collection[str] = (), limit: float = VERDICT.search_work) -> None:
        self.limit, self.spent = limit, 0.0
        self.left_out: dict[str, None] = {}
        self._found, self._in_vain = frozenset(found), set[str]()

    def anew(self) -> SearchBudget:
        """The same for searches under another assumption, of which nothing is spent."""
        return SearchBudget(found=self._found, limit=self.limit)

    @property
    def thorough(self) -> bool:
        """Whether nothing is left out to save time: no effect that would be enough for a cause goes unrefined either,
        and searches begin with every effect that explains enough."""
        return math.isinf(self.limit)

    @staticmethod
    def work(readings: int, columns: int) -> float:
        """Of a step in which so many columns are added to the model."""
        return readings * (COLUMNS_OF_A_STEP + columns)

    def allows(self, begins_with: str, expected: float) -> bool:
        """Whether a search may begin, of which so much work is expected; otherwise it is noted as left out.

        What numbers for the visits explain nothing else does, so that these may take all that is left.
        """
        share = 1.0 if begins_with == BY_VISIT else SHARE_OF_LEADERS
        if begins_with in self._found or self.spent + expected <= share * self.limit:
            return True
        self.left_out[begins_with] = None
        return False

    def has_room_for_weak(self, expected: float) -> bool:
        """Whether a search may begin with an effect that explains little."""
        return self.spent + expected <= SHARE_OF_WEAK * self.limit

    def was_in_vain(self, begins_with: str) -> None:
        """Note that a search found nothing, which at other levels of the disturbances it will not either."""
        self._in_vain.add(begins_with)

    def is_in_vain(self, begins_with: str) -> bool:
        """Whether a search has found nothing."""
        return begins_with in self._in_vain
