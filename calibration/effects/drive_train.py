"""What lies between an encoder's count and the slider: cumulative and periodic errors, interpolation."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, varied
from calibration.effects.basis_functions import smooth

LEAD_M = (4.0e-3, 4.0e-2)
PITCH_M = (1.0e-5, 2.0e-3)
FEWEST_POSITIONS = 30


def cumulative(s: Setting, drive: int) -> Forms:
    """A smooth error along the travel; its straight part is the drive's scale."""
    f, travel, q = Forms(), f"travel.{s.drive(drive)}", s.moments.drives[:, drive]
    columns = f.add((travel, smooth(q, 14, roughness=1.5)))
    f.form(columns[:4])
    f.form(columns)
    return f


def screw_periodic(s: Setting, drive: int) -> Forms:
    """An error that repeats with every turn of the screw."""
    return _periodic(s, drive, LEAD_M)


def interpolation(s: Setting, drive: int) -> Forms:
    """An error within one period of the encoder's signals, or twice in it."""
    return _periodic(s, drive, PITCH_M)


def _periodic(s: Setting, drive: int, limits: tuple[float, float]) -> Forms:
    """Sine and cosine; their harmonics; larger at one end, in the middle, or under load."""
    f, travel, q = Forms(), f"travel.{s.drive(drive)}", s.moments.drives[:, drive]
    u = s.along(drive)
    for period, prior in s.periods(drive, *limits):
        wave = _pair(q, period)
        main = f.add((travel, wave))
        harmonics = [f.add((travel, _pair(q, period / k))) for k in (2.0, 3.0)]
        changing = [f.add((travel, wave * by[:, None])) for by in (u, u**2 - 0.5, s.load - 0.5)]
        rest = [c for columns in (*harmonics, *changing) for c in columns]
        f.form(main, rest, share=0.5, weight=prior, period_m=period)
    return f


def _pair(q: Array, period: float) -> Array:
    phase = 2.0 * np.pi * q / period
    return np.stack([np.sin(phase), np.cos(phase)], axis=1)


def _few_positions(s: Setting) -> str | None:
    for column in s.moments.drives.T:
        if len(np.unique(np.round(column, 7))) < FEWEST_POSITIONS:
            return f"fewer than {FEWEST_POSITIONS} different drive positions; measure off a grid"
    return None


def _short_travel(s: Setting) -> str | None:
    return None if all(varied(q, 0.05) for q in s.moments.drives.T) else "the drives hardly moved"


_PERIOD = Parameter("period_m", PITCH_M[0], LEAD_M[1], "m", "period of the error")

EFFECTS = (
    Effect(
        "screw_cumulative_error", "drive", Parameter("amplitude_m", 1e-6, 5e-4, "m", "RMS along the travel"),
        "drive coordinate, reflectors on the sliders", ("axis_coupling", "guide_straightness"), cumulative, (),
        _short_travel, measured="rms",
    ),
    Effect(
        "screw_periodic_error", "drive", Parameter("amplitude_m", 5e-7, 3e-4, "m", "of the sine"),
        "many drive positions off a grid, reflectors on the sliders", ("encoder_interpolation",), screw_periodic,
        (_PERIOD,), _few_positions,
    ),
    Effect(
        "encoder_interpolation", "drive", Parameter("amplitude_m", 2e-7, 3e-4, "m", "of the sine"),
        "many drive positions off a grid, reflectors on the sliders", ("screw_periodic_error",), interpolation,
        (_PERIOD,), _few_positions,
    ),
)  # fmt: skip
