"""What is anew at each visit: whether it is seen where that is."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.diagnosis.non_parametric import NonParametricEffect
from calibration.diagnosis.ranking import Cause, differs_by_visit
from calibration.diagnosis.settings import VERDICT


def told_from_other_channels(
    causes: Sequence[Cause], ranking: Sequence[Cause], functions: Sequence[NonParametricEffect]
) -> bool:
    """Whether the effects among some causes that are anew at each visit act where they say.

    ranking: all effects, each alone; functions: arbitrary ones without any cause. Numbers for the visits explain
    anything that stays as it is during one, at whatever channel that is; at the true one they explain clearly more
    than anything does elsewhere. What acts at a reflector, no other channel does.
    """
    anew = {cause.effect.name for cause in causes if cause.effect.anew_by_visit and differs_by_visit(cause)}
    for alone in (cause for cause in ranking if cause.effect.name in anew and cause.effect.place != "smr"):
        own = {channel for part in alone.parts for column in part.contributions for channel, _ in column}
        here, elsewhere = alone.log_evidence, 0.0
        for function in functions:
            if {name for name, _ in function.channels} <= own:
                here = max(here, function.log_evidence)
            else:
                elsewhere = max(elsewhere, function.log_evidence)
        if here < elsewhere + VERDICT.least_gain_of_channel:
            return False
    return True
