"""The following error of a servo: a first-order position loop with velocity feed-forward, in closed form."""

from __future__ import annotations

import math

TIME_S = 0.010
SHARE = 0.05  # of the following error without feed-forward


def following_error_after(v: float, a: float, following_error: float, dt_s: float) -> float:
    """Following error after dt_s of constant acceleration a from velocity v: e' = SHARE v - e / TIME_S."""

    def forced(t_s: float) -> float:
        return SHARE * TIME_S * (v + a * t_s - a * TIME_S)

    return forced(dt_s) + (following_error - forced(0.0)) * decay(dt_s)


def decay(dt_s: float) -> float:
    """What is left of a following error after dt_s at rest."""
    return math.exp(-dt_s / TIME_S)
