"""What may be wrong with a part, the good part in its place, and the name that the catalogue has for it.

`with_` are the fields of the part that are wrong, `around` what is so either way: the friction without which a play
would fall shut, the counterweight. The truth of a case is the same commands with the part made good.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.emergent.drive_model import DrivePart
from benchmarks.emergent.machines import DRIVES, STRUT_NAMES
from benchmarks.emergent.strut_model import SLIDERS, STRUTS, StrutParts

ON_DRIVES, ON_STRUTS, ON_COLUMNS = "drives", "struts", "columns"
WIDEST_M = 5e-5
BALANCED = {"balance": 0.985, "friction_n": 30.0}
FALLS = 1.0 / 3.0
AT_BOTH = 0.3  # share of the drives' causes that are at both


@dataclass(frozen=True)
class Fault:
    """Something wrong. cause: in this plant's words; effect: the catalogue's, or the cause if it has none.

    on: what it is at, by number `at`; scaled: fields that a size multiplies, and those that it divides.
    """

    cause: str
    effect: str
    on: str
    at: tuple[int, ...]
    with_: Mapping[str, float]
    around: Mapping[str, float]
    scaled: tuple[tuple[str, ...], tuple[str, ...]]

    def sized(self, factor: float) -> Fault:
        """The same, so many times as large."""
        more, less = self.scaled
        if "clearance_m" in self.with_:  # a wider bore is never touched: that would be a strut that is not there
            factor = min(factor, WIDEST_M / self.with_["clearance_m"])
        with_ = {
            name: value * factor if name in more else value / factor if name in less else value
            for name, value in self.with_.items()
        }
        return replace(self, with_=with_)

    @property
    def places(self) -> list[str]:
        """Names of what it is at."""
        names = STRUT_NAMES if self.on == ON_STRUTS else DRIVES
        return [names[k] for k in self.at]


def draw_fault(cause: str, rng: np.random.Generator, *, not_at: Sequence[int] = ()) -> Fault:
    """A fault of a cause, at drives that are not those of another one."""
    effect, on, scaled, draw = _CAUSES[cause]
    with_, around = draw(rng)
    if on == ON_STRUTS:
        at: tuple[int, ...] = (int(rng.integers(STRUTS)),)
    else:
        free = [a for a in range(SLIDERS) if a not in not_at]
        at = (int(rng.choice(free)),)
        if cause in _MAY_BE_AT_BOTH and len(free) == SLIDERS and rng.uniform() < AT_BOTH:
            at = tuple(free)
    return Fault(cause, effect, on, at, with_, around, scaled)


def drive_parts(faults: Sequence[Fault], good: Sequence[Fault] = ()) -> dict[int, DrivePart]:
    """Both drives with some faults, those among `good` repaired."""
    out = {a: DrivePart() for a in range(SLIDERS)}
    for fault in faults:
        if fault.on == ON_DRIVES:
            fields = {**fault.around, **({} if fault in good else fault.with_)}
            for a in fault.at:
                out[a] = replace(out[a], **fields)  # type: ignore[arg-type]  # flags are numbers here
    return out


def strut_parts(faults: Sequence[Fault], good: Sequence[Fault] = ()) -> StrutParts:
    """Struts and columns with some faults, those among `good` repaired."""
    parts = StrutParts()
    for fault in faults:
        if fault.on != ON_DRIVES and fault not in good:
            for name, value in fault.with_.items():
                values = list(getattr(parts, name))
                for k in fault.at:
                    values[k] = value
                parts = replace(parts, **{name: tuple(values)})
    return parts


_Drawn = tuple[dict[str, float], dict[str, float]]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _backlash(rng: np.random.Generator) -> _Drawn:
    around = {"friction_n": rng.uniform(1000.0, 1600.0), "balance": 0.985}
    if rng.uniform() < FALLS:  # a counterweight that is the same for all payloads: the heavy ones press the play shut
        around |= {"balance": 0.0, "counterweight_n": rng.uniform(800.0, 1400.0)}
    return {"play_m": 8e-5}, {**around, "viscous_n_s_per_m": rng.uniform(100.0, 800.0)}


def _windup(rng: np.random.Generator) -> _Drawn:
    around = {"friction_n": _log(rng, 200.0, 900.0), "balance": float(rng.choice([0.0, 0.5]))}
    return {"stiffness_n_per_m": 3e7}, {**around, "viscous_n_s_per_m": rng.uniform(100.0, 2000.0)}


def _stick_slip(rng: np.random.Generator) -> _Drawn:
    around = {"stiffness_n_per_m": _log(rng, 8e6, 2e7), "balance": 0.985, "friction_n": 10.0}
    return {"friction_n": _log(rng, 300.0, 700.0), "weakening": rng.uniform(0.3, 0.6)}, around


def _settling(rng: np.random.Generator) -> _Drawn:
    fault = {
        "gain_n_per_m": 5e6, "integral_s": _log(rng, 0.4, 2.5), "integral_in_motion": float(rng.uniform() < 0.3),
    }  # fmt: skip
    return fault, {"friction_n": _log(rng, 300.0, 900.0), "viscous_n_s_per_m": rng.uniform(200.0, 2500.0)}


def _clearance(_: np.random.Generator) -> _Drawn:
    return {"clearance_m": 3e-5}, {}


def _soft_strut(rng: np.random.Generator) -> _Drawn:
    stop = _log(rng, 2e-5, 8e-5) if rng.uniform() < 0.3 else math.inf
    return {"soft_n_per_m": 5e7, "stop_m": stop}, {}


def _soft_column(_: np.random.Generator) -> _Drawn:
    return {"column_n_per_m": 4e7}, {}


def _tooth(rng: np.random.Generator) -> _Drawn:
    return {"tooth_m": 5e-5}, {**BALANCED, "tooth_reach_m": _log(rng, 0.08, 0.25)}


def _cable(rng: np.random.Generator) -> _Drawn:
    """A cable's drag, hardly more than the noise of the torque, on a bracket that it bends."""
    reach_m = rng.uniform(0.05, 0.25)
    return {"cable_n": 10.0, "cable_n_per_m": 10.0 / reach_m}, {**BALANCED, "bracket_n_per_m": _log(rng, 1e5, 4e5)}


def _clamp(rng: np.random.Generator) -> _Drawn:
    around = {"friction_n": rng.uniform(50.0, 200.0), "balance": 0.3, "counterweight_n": rng.uniform(300.0, 900.0)}
    return {"clamp_n": _log(rng, 300.0, 700.0), "clamp_n_per_m": 1.5e7}, around


def _limit_cycle(rng: np.random.Generator) -> _Drawn:
    fault = {
        "motor_weakening": rng.uniform(0.5, 0.75), "gain_n_per_m": 6e6, "integral_s": rng.uniform(0.15, 0.5),
    }  # fmt: skip
    return fault, {"motor_friction_n": rng.uniform(900.0, 1600.0), "balance": 0.9}


_CAUSES: dict[
    str, tuple[str, str, tuple[tuple[str, ...], tuple[str, ...]], Callable[[np.random.Generator], _Drawn]]
] = {
    "play": ("backlash", ON_DRIVES, (("play_m",), ()), _backlash),
    "windup": ("friction_windup", ON_DRIVES, ((), ("stiffness_n_per_m",)), _windup),
    "stick_slip": ("friction_windup", ON_DRIVES, (("friction_n",), ()), _stick_slip),
    "settling": ("servo_settling", ON_DRIVES, ((), ("gain_n_per_m",)), _settling),
    "clearance": ("joint_clearance", ON_STRUTS, (("clearance_m",), ()), _clearance),
    "soft_strut": ("link_stiffness", ON_STRUTS, (("stop_m",), ("soft_n_per_m",)), _soft_strut),
    "soft_column": ("column_compliance", ON_COLUMNS, ((), ("column_n_per_m",)), _soft_column),
    "tooth": ("tooth", ON_DRIVES, (("tooth_m",), ()), _tooth),
    "cable_drag": ("cable_drag", ON_DRIVES, (("cable_n", "cable_n_per_m"), ()), _cable),
    "loose_clamp": ("loose_clamp", ON_DRIVES, ((), ("clamp_n_per_m",)), _clamp),
    "limit_cycle": ("limit_cycle", ON_DRIVES, ((), ("gain_n_per_m",)), _limit_cycle),
}
_MAY_BE_AT_BOTH = ("play", "windup", "stick_slip", "settling", "soft_column")
OUTSIDE = ("tooth", "cable_drag", "loose_clamp", "limit_cycle")
INSIDE = tuple(cause for cause in _CAUSES if cause not in OUTSIDE)
