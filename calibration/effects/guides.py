"""Guides that are not straight, a foundation that settles."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, strongest_onset, varied
from calibration.effects.basis_functions import brownian, smooth

SHORTEST_WAVE_M = 0.06
ONSETS = 14
SETTLING_S = (600.0, 3000.0)


def straightness(s: Setting, drive: int) -> Forms:
    """The slider goes beside its axis along its way."""
    return _along_the_way(s, drive, s.of_drive("sideways", drive))


def angular(s: Setting, drive: int) -> Forms:
    """The slider turns along its way."""
    return _along_the_way(s, drive, s.of_drive("turn", drive))


def _along_the_way(s: Setting, drive: int, channels: tuple[str, ...]) -> Forms:
    f, q = Forms(), s.moments.drives[:, drive]
    span = float(np.ptp(q))
    fine = int(np.clip(2.0 * span / SHORTEST_WAVE_M, 6, 28))
    for channel in channels:
        curve = f.add((channel, smooth(q, fine, roughness=1.0)))
        loaded = f.add((channel, 2.0 * smooth(q, fine, roughness=1.0) * (s.load - 0.5)[:, None]))
        f.form(curve[:6], loaded[:6], share=0.5)
        f.form(curve, loaded, share=0.5)
    return f


def settling(s: Setting, drive: int) -> Forms:
    """The foot of a column sinks and the column leans: along the axis, sideways with the height, and in rotation."""
    f, t, h = Forms(), s.moments.elapsed_s, s.height_m(drive)
    travel = f"travel.{s.drive(drive)}"
    pairs = list(zip(s.of_drive("sideways", drive), s.of_drive("turn", drive), strict=False))

    def columns(sunk: Array) -> tuple[list[int], list[int]]:
        wide = sunk[:, None] if sunk.ndim == 1 else sunk
        down = f.add((travel, -wide))
        lean = [f.add((side, -wide * h[:, None]), (turn, wide)) for side, turn in pairs]
        return down, [c for each in lean for c in each]

    end = float(t.max())
    onsets = s.onsets((travel, *s.of_drive("sideways", drive)))
    for onset, prior in onsets:
        down, lean = columns((t >= onset).astype(np.float64))
        f.form(down, lean, share=0.5, onset_s=onset, weight=prior * ONSETS)
    for onset in np.linspace(0.0, 0.95, ONSETS) * end:
        for tau in SETTLING_S:
            down, lean = columns(1.0 - np.exp(-np.maximum(t - onset, 0.0) / tau))
            f.form(down, lean, share=0.5, onset_s=float(onset))
    down, lean = columns(brownian(t / max(end, 1.0), 24))
    most = strongest_onset(onsets)
    f.form(down, lean, share=0.5, weight=4.0, **most)
    f.form(down[:6], lean[:6], share=0.5, weight=4.0, **most)
    return f


def _short(s: Setting) -> str | None:
    return None if all(varied(q, 0.1) for q in s.moments.drives.T) else "the drives hardly moved"


def _brief(s: Setting) -> str | None:
    return None if varied(s.moments.t_s, 600.0) else "the campaign is too short"


EFFECTS = (
    Effect(
        "guide_straightness", "drive", Parameter("amplitude_m", 1e-6, 4e-4, "m", "RMS sideways"),
        "drive coordinate, reflectors on the sliders", ("screw_cumulative_error",), straightness, (), _short,
        measured="rms",
    ),
    Effect(
        "guide_angular", "drive", Parameter("amplitude_rad", 2e-6, 4e-3, "rad", "RMS rotation"),
        "drive coordinate, platform rotation; not a slider's reflector", ("joint_clearance",), angular, (), _short,
        measured="rms",
    ),
    Effect(
        "foundation_settling", "drive", Parameter("settled_m", 1e-6, 8e-4, "m", "how far the foot sinks"),
        "time, reflectors on the sliders against the floor nests", ("column_thermal_growth", "tracker_drift"),
        settling, (Parameter("onset_s", 0.0, 1e5, "s", "after the campaign's begin"),), _brief, measured="range",
    ),
)  # fmt: skip
