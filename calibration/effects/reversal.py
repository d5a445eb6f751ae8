"""What depends on the side that a drive came from: backlash, and friction that winds up its screw."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, ladder, varied
from calibration.effects.basis_functions import smooth

REST_S = ladder(1.5, 15.0, 3)
RATED_N = 6000.0  # force at rated torque, for the plausible range only: the torque's own scale is unknown


def _one_side(s: Setting) -> str | None:
    both = all(np.any(column > 0.0) and np.any(column < 0.0) for column in s.moments.direction.T)
    return None if both else "every pose was approached from one side; measure both directions"


def backlash(s: Setting, drive: int) -> Forms:
    """Half the play, against the side of approach; its width may depend on place, load and rest."""
    f, travel = Forms(), f"travel.{s.drive(drive)}"
    side = -0.5 * s.moments.direction[:, drive]
    rest = np.stack([np.exp(-s.moments.dwell_s / tau) for tau in REST_S], axis=1)
    main = f.add((travel, side))
    place = f.add((travel, side[:, None] * smooth(s.moments.drives[:, drive], 6, roughness=1.0)))
    load = f.add((travel, side * (s.load - 0.5)))
    resting = [f.add((travel, side * column)) for column in rest.T]
    f.form(main)
    f.form(main, place, share=0.5)
    f.form(main, load, share=0.7)
    for column in resting:
        f.form((*main, *column))
    f.form(main, (*place, *load, *resting[1]), share=0.3)
    return f


def friction_windup(s: Setting, drive: int) -> Forms:
    """The screw is wound up by its torque: weight, and the friction that was left when the drive stopped."""
    f, travel = Forms(), f"travel.{s.drive(drive)}"
    force = _torque_at_rest(s, drive) * RATED_N
    force = force - force.mean()
    size = max(float(np.std(force)), 1.0)
    main = f.add((travel, -force))
    bent = f.add((travel, np.stack([force**2 / size, force**3 / size**2], axis=1)))
    f.form(main)
    f.form(main, bent, share=0.2)
    return f


def _torque_at_rest(s: Setting, drive: int) -> Array:
    """Torque (n,); of readings on the fly, whose torque also moves the drive, what load and side of approach tell."""
    m = s.moments
    torque, rest = m.torque[:, drive], ~m.moving
    if np.all(rest) or not np.any(rest):
        return torque
    known = np.stack([np.ones(len(torque)), s.load, m.direction[:, drive]], axis=1)
    found = np.linalg.lstsq(known[rest], torque[rest], rcond=None)[0]
    return np.where(rest, torque, known @ found)


def _no_torque(s: Setting) -> str | None:
    if not varied(s.moments.torque, 1e-3):
        return "the recording holds no varied torque"
    return _one_side(s)


EFFECTS = (
    Effect(
        "backlash", "drive", Parameter("width_m", 1e-6, 5e-4, "m", "whole play of the drive"),
        "both directions of approach", ("friction_windup", "servo_settling"), backlash, (), _one_side,
        lambda n: 2.0 * n.reversal_m,
    ),
    Effect(
        "friction_windup", "drive",
        Parameter("windup_m_per_n", 5e-10, 2e-7, "m/N", "axial displacement a force, at 6 kN rated force"),
        "torque: both directions and payloads", ("backlash", "column_compliance"), friction_windup, (), _no_torque,
    ),
)  # fmt: skip
