"""What to measure next (placeholder until candidates are ranked)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calibration.gap.result import Candidate
from calibration.gap.search import Explanation


def candidates(
    found: Explanation, ranking: Mapping[str, float], equivalent: Sequence[str], not_tested: Mapping[str, str]
) -> tuple[Candidate, ...]:
    """Additions to the campaign, the most informative a minute first."""
    return ()
