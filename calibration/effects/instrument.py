"""What the station sees differently: drift of its frame, bent light, reflectors that were taken off and put back."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, strongest_onset, varied
from calibration.effects.basis_functions import brownian, centred, products
from calibration.recording.header import DRIFT_LEVER_M, HOUR_S

ONSETS = 12
PER_KELVIN = 0.93e-6  # change of the refractive index
FRAME = ("rx", "ry", "rz", "x", "y", "z")


def drift(s: Setting, _: int) -> Forms:
    """The station's frame turns and shifts: steadily, as it warms up, with the air, at once, or at random."""
    f, t = Forms(), s.moments.elapsed_s

    def frame(shape: Array) -> list[int]:
        return [c for k in FRAME for c in f.add((f"station.{k}", shape / (DRIFT_LEVER_M if k[0] == "r" else 1.0)))]

    for shape in (t / HOUR_S, 1.0 - np.exp(-t / 900.0), 1.0 - np.exp(-t / 2700.0)):
        f.form(frame(shape))
    air = s.moments.temperatures_c["air"]
    f.form(frame((air - air[np.argmin(t)]) / max(float(np.ptp(air)), 0.1)))
    for onset, prior in s.onsets([f"station.{k}" for k in FRAME]):
        f.form(frame((t >= onset).astype(np.float64)), weight=2.0 * prior, onset_s=onset)
    f.form(frame(brownian(t / HOUR_S, 40)), weight=2.0)
    return f


def refraction(s: Setting, _: int) -> Forms:
    """Light bends towards cold air: angles go wrong with the distance, by where the light passes and as air warms."""
    f, t, p = Forms(), s.moments.elapsed_s, s.sight_m
    across, height = centred(p[:, 0]), centred(p[:, 2])
    warming = 1.0 - np.exp(-t / 2400.0)
    one = np.ones(len(t))
    unit = 0.5 * PER_KELVIN
    for channel in ("light.v", "light.hz"):
        uniform = f.add((channel, unit * one))
        warm = f.add((channel, unit * warming))
        powers = np.stack([across, height, across * height, across**2, height**2, across**3, height**3], axis=1)
        bumps = np.stack([np.exp(-(((across - c) / 0.45) ** 2)) for c in (-0.8, -0.4, 0.0, 0.4, 0.8)], axis=1)
        varying = f.add((channel, unit * np.concatenate([powers, bumps, products(bumps, height[:, None])], axis=1)))
        slowly = f.add((channel, unit * warming[:, None] * powers))
        f.form(uniform, varying, share=0.5)
        f.form(varying)
        f.form(warm, (*uniform, *slowly), share=0.5)
    return f


def reseat(s: Setting, smr: int) -> Forms:
    """One reflector sits elsewhere from some moment on, after every exchange, or wanders in its seat."""
    f, m = Forms(), s.moments
    name = [x.name for x in s.machine.smrs if x.on == "platform"][smr]
    channels = [c for c in s.channels if c.startswith(f"smr.{name}.")]
    t = m.elapsed_s

    def shift(shape: Array) -> list[int]:
        return [c for channel in channels for c in f.add((channel, shape))]

    end, onsets = float(t.max()), s.onsets(channels)
    for onset, prior in onsets:
        f.form(shift((t >= onset).astype(np.float64)), weight=prior * ONSETS, onset_s=onset)
    for onset in np.linspace(0.0, 0.95, ONSETS) * end:
        f.form(shift(1.0 - np.exp(-np.maximum(t - onset, 0.0) / 900.0)), weight=0.5, onset_s=float(onset))
    numbers = np.unique(m.exchanges)[1:]
    if numbers.size:
        f.form(shift((m.exchanges[:, None] == numbers).astype(np.float64)), weight=ONSETS / 2)
    f.form(shift(brownian(t / max(end, 1.0), 48)), (), weight=ONSETS / 2, **strongest_onset(onsets))
    return f


def _brief(s: Setting) -> str | None:
    return None if varied(s.moments.t_s, 600.0) else "the campaign is too short"


_ONSET = Parameter("onset_s", 0.0, 1e5, "s", "after the campaign's begin")

EFFECTS = (
    Effect(
        "tracker_drift", "rig", Parameter("drift_m", 2e-6, 1e-3, "m", "at 3 m, in an hour or at once"),
        "time, floor nests", ("foundation_settling",), drift, (_ONSET,), _brief, lambda n: n.drift_m,
    ),
    Effect(
        "refraction", "rig", Parameter("gradient_k_per_m", 0.2, 60.0, "K/m", "of the air's temperature"),
        "angles against height and distance, all reflectors and nests alike", ("tracker_drift",), refraction,
    ),
    Effect(
        "smr_reseat", "smr", Parameter("shift_m", 1e-6, 4e-4, "m", "of one reflector"),
        "time, one reflector against the others", (), reseat, (_ONSET,), _brief, lambda n: n.reseat_m, "range",
    ),
)  # fmt: skip
