"""Parts that are warmer than their sensor says: struts, columns, screws."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Effect, Forms, Parameter, Setting, ladder
from calibration.effects.basis_functions import smooth

TAUS_S = ladder(250.0, 7000.0, 6)
LAGS_S = ladder(400.0, 5000.0, 4)
COLUMN_WIDTH_M = 0.4
DUTY_M_PER_S = 0.01
TAKEN_UP = (0.1, 0.2, 0.3, 0.45, 0.6)  # of the most heat, by the stretch of a screw that was assembled under tension
LEAST_S = 900.0  # a shorter campaign shows no warming

_RISE = Parameter("rise_k", 0.1, 40.0, "K", "how much warmer than its sensor the part becomes")
_TAU = Parameter("tau_s", 200.0, 8000.0, "s", "time constant of the part")


def _warming(s: Setting, sensor: str) -> tuple[list[tuple[Array, float]], list[tuple[Array, float]]]:
    """Temperature above the sensor (n,), with time constants: of parts that warm from the start, of parts that lag."""
    t = s.moments.elapsed_s
    rises = [(1.0 - np.exp(-t / tau), tau) for tau in TAUS_S]
    lags = [(s.moments.lag_k(sensor, tau), tau) for tau in LAGS_S] if sensor in s.moments.temperatures_c else []
    return rises, lags


def _too_short(s: Setting) -> str | None:
    return None if np.ptp(s.moments.t_s) >= LEAST_S else "the campaign is too short for a part to warm"


def _thermal(f: Forms, acts: tuple[tuple[str, Array], ...], s: Setting, sensor: str) -> None:
    """Forms of one geometry: one time constant, two stages, warmed once and cooling again, behind the sensor."""
    rises, lags = _warming(s, sensor)
    t = s.moments.elapsed_s

    def through(shapes: Array) -> list[int]:
        wide = shapes[:, None] if shapes.ndim == 1 else shapes
        return f.add(*((channel, shape[:, None] * wide) for channel, shape in acts))

    rest = through(smooth(s.moments.t_s, 5))
    rising = [through(rise) for rise, _ in rises]
    lagging = [through(lag) for lag, _ in lags]
    for column, (_, tau) in zip((*rising, *lagging), (*rises, *lags), strict=True):
        f.form(column, rest, share=0.1, tau_s=tau)
    for fast, slow, (_, tau) in zip(rising, rising[2:], rises, strict=False):
        f.form((*fast, *slow), rest, share=0.1, tau_s=tau)
    for _, tau in rises:
        f.form(through(t / tau * np.exp(1.0 - t / tau)), rest, share=0.1, weight=0.5, tau_s=tau)
    for lag, (_, tau) in zip(lagging, lags, strict=True):
        f.form((*rising[2], *lag), rest, share=0.1, weight=0.5, tau_s=tau)


def link_growth(s: Setting, strut: int) -> Forms:
    """A strut grows by alpha l dT."""
    f, machine = Forms(), s.machine
    grown = np.full(len(s.moments), machine.expansion_per_k["struts"] * machine.nominal.length_m[strut])
    _thermal(f, ((f"length.{machine.strut_names[strut]}", grown),), s, machine.sensors["struts"])
    return f


def column_growth(s: Setting, drive: int) -> Forms:
    """A column grows from its foot and takes the guide with it, or bends where one side is warmer."""
    f, alpha = Forms(), s.machine.expansion_per_k["base"]
    h, sensor = s.height_m(drive), s.machine.sensors["base"]
    travel = f"travel.{s.drive(drive)}"
    _thermal(f, ((travel, alpha * h),), s, sensor)
    _thermal(f, ((travel, 0.5 * alpha * h**2),), s, sensor)
    for side, turn in zip(s.of_drive("sideways", drive), s.of_drive("turn", drive), strict=False):
        bent = alpha / COLUMN_WIDTH_M
        _thermal(f, ((side, -0.5 * bent * h**2), (turn, bent * h)), s, sensor)
        _thermal(f, ((side, 0.5 * bent * h**2), (turn, bent * h)), s, sensor)
    return f


def screw_growth(s: Setting, drive: int) -> Forms:
    """A screw is heated by its own motion; what it does to the slider depends on which end is held."""
    f, alpha = Forms(), s.machine.expansion_per_k["drives"]
    travel, x = f"travel.{s.drive(drive)}", s.moments.drives[:, drive] - s.machine.travel[drive, 0]
    span = float(s.machine.travel[drive, 1] - s.machine.travel[drive, 0])
    u = s.along(drive)
    for tau in TAUS_S:
        heat = s.moments.warmth(drive, tau) / DUTY_M_PER_S
        warm = alpha * heat
        low = f.add((travel, warm * x))
        high = f.add((travel, warm * (x - span)))
        bend = f.add(
            (travel, span * alpha * heat[:, None] * np.stack([0.5 * u**2, 0.5 * u**3, 0.3 * np.ones_like(u)], axis=1))
        )
        limited = [f.add((travel, alpha * np.maximum(heat - k * heat.max(), 0.0) * x)) for k in TAKEN_UP]
        every = [c for columns in limited for c in columns]
        f.form(low, (*bend, *every), share=0.5, tau_s=tau)
        f.form(high, tau_s=tau)
        f.form((*low, *every), bend, share=0.3, tau_s=tau)
        for columns in limited:
            f.form(columns, tau_s=tau)
        f.form(bend, share=0.5, tau_s=tau)
    return f


EFFECTS = (
    Effect(
        "link_thermal_growth", "strut", _RISE, "time, a temperature swing",
        ("joint_clearance", "column_thermal_growth"), link_growth, (_TAU,), _too_short,
        lambda n: n.temperature_k, "sum",
    ),
    Effect(
        "column_thermal_growth", "drive", _RISE, "time, a temperature swing, reflectors on the sliders",
        ("foundation_settling", "screw_thermal_growth"), column_growth, (_TAU,), _too_short,
        lambda n: n.temperature_k, "sum",
    ),
    Effect(
        "screw_thermal_growth", "drive", _RISE, "time and the way moved, drive coordinate, reflectors on the sliders",
        ("column_thermal_growth",), screw_growth, (_TAU,), _too_short,
        lambda n: n.temperature_k, "sum",
    ),
)  # fmt: skip
