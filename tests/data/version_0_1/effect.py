"""A slide on rollers falls short after a long way, and creeps home while it rests."""

import numpy as np
from calibration.effects.base import Effect, Forms, Parameter

REFERENCE_WAY_M = 0.5
REST_S = 5.0


def roller_creep(s, drive):
    """One unit of the size is a shortfall of one metre after half a metre of way."""
    f, travel = Forms(), f"travel.{s.drive(drive)}"
    way = np.abs(s.moments.drives - s.moments.former)[:, drive] / REFERENCE_WAY_M
    main = f.add((travel, -way))
    at_rest = f.add((travel, -way * np.exp(-s.moments.dwell_s / REST_S)))
    f.form(main, at_rest, share=0.5)
    return f


def same_way(s):
    """Why a campaign cannot show it, or None."""
    way = np.abs(s.moments.drives - s.moments.former)
    return None if np.all(np.ptp(way, axis=0) > 0.05) else "every way was about as long; vary the order of poses"


EFFECTS = (
    Effect(
        name="roller_creep",
        place="drive",
        size=Parameter("creep_m", 1e-6, 1e-3, "m", "shortfall after 0.5 m of way"),
        reveals="ways of different length between poses, reflectors on the sliders",
        confounded=("backlash", "servo_settling"),
        forms=roller_creep,
        untested=same_way,
    ),
)
