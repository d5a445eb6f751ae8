"""Homing mode (CiA 402, mode 6) of a mock drive: which mark it goes to, and whether its position means anything.

There is an index mark wherever the drive's true position is a whole number of revolutions. Methods 33 and 34 go to the
next one in negative or positive direction, 35 and 37 take the present position. On the mark the position is
the home offset (0x607C). Not modelled: switches and their methods, a separate speed for the last part of the way
(0x6099:02 is only stored), an index that is passed and approached again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mock_devices.can.sdo_abort import VALUE_RANGE, RefusedWrite

INDEX_INC = 1_000_000
TO_INDEX_BELOW, TO_INDEX_ABOVE, WHERE_IT_STANDS = 33, 34, (35, 37)


@dataclass
class Homing:
    """Settings, in increments and seconds, and progress."""

    method: int = 37
    offset_inc: int = 0
    speed: int = 200_000
    zero_speed: int = 100_000
    acceleration: int = 10_000_000
    referenced: bool = True
    attained: bool = False
    failed: bool = False
    begun_s: float | None = None  # while it is under way

    def set_method(self, method: int) -> None:
        """Object 0x6098. Raises RefusedWrite."""
        if method not in (TO_INDEX_BELOW, TO_INDEX_ABOVE, *WHERE_IT_STANDS):
            raise RefusedWrite(VALUE_RANGE)
        self.method = method

    def way_inc(self, true_position_inc: float) -> float:
        """How far the mark is from a true position; an index at the present position does not count."""
        if self.method == TO_INDEX_ABOVE:
            return INDEX_INC * (math.floor(round(true_position_inc) / INDEX_INC) + 1) - true_position_inc
        if self.method == TO_INDEX_BELOW:
            return INDEX_INC * (math.ceil(round(true_position_inc) / INDEX_INC) - 1) - true_position_inc
        return 0.0

    def begin(self, t_s: float) -> None:
        """Start: the old reference is lost."""
        self.referenced = self.attained = self.failed = False
        self.begun_s = t_s

    def arrive(self) -> None:
        """The mark is reached."""
        self.referenced = self.attained = True
        self.begun_s = None

    def abort(self, *, failed: bool = False) -> None:
        """It is aborted or cannot be started, or the mode is left."""
        self.attained, self.failed, self.begun_s = False, failed, None
