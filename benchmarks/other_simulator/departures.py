"""How readings depart from the machine's formulas, and what one effect contributes to that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import GROUPS, Machine
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Contribution:
    """What an effect changes at r readings, for an amplitude of one.

    The first five are at the place that the effect acts at, the others anywhere on the rig of d drives and s struts.
    What is given here is what `Departures` has for it.
    """

    drive_m: Array | None = None  # (r,)
    carriage_m: Array | None = None  # (r, 3)
    carriage_rad: Array | None = None  # (r, 3)
    strut_m: Array | None = None  # (r,)
    ln_stiffness: Array | None = None  # (r,)

    drives_m: Array | None = None  # (r, d)
    struts_m: Array | None = None  # (r, s)
    joints_m: Array | None = None  # (r, s, 3)
    points_m: Array | None = None  # (r, 3)
    station_m: Array | None = None  # (r, 3)
    station_rad: Array | None = None  # (r, 3)
    sights_m: Array | None = None  # (r, 3)
    force_n: Array | None = None  # (r, 3)
    moment_nm: Array | None = None  # (r, 3)
    payload_kg: Array | None = None  # (r,)
    payload_centre_m: Array | None = None  # (r, 3)
    expansion_per_k: Mapping[str, float] = field(default_factory=dict)

    # What depends on forces: of the state that it results in, and of the amplitude, which is in the contribution.
    under_load: Callable[[Equilibrium, float], Contribution] | None = None

    step_s: float | None = None  # rig time of its first step
    period_m: float | None = None
    largest: float | None = None  # amplitude that this draw of the form may have at most


AT_PLACE = {
    "drive_m": "drives_m", "carriage_m": "carriages_m", "carriage_rad": "carriages_rad",
    "strut_m": "struts_m", "ln_stiffness": "ln_stiffnesses",
}  # fmt: skip
ANYWHERE = (
    "drives_m", "struts_m", "joints_m", "points_m", "station_m", "station_rad", "sights_m", "force_n", "moment_nm",
    "payload_kg", "payload_centre_m",
)  # fmt: skip


@dataclass
class Departures:
    """Sums of contributions at r readings; everything in the machine frame but `joints_m` and the station's."""

    drives_m: Array  # (r, d), added to the drives' travel
    carriages_m: Array  # (r, d, 3)
    carriages_rad: Array  # (r, d, 3), about the middle of the carriage's joints
    struts_m: Array  # (r, s), added to the lengths
    ln_stiffnesses: Array  # (r, s)
    joints_m: Array  # (r, s, 3), of the platform, in its frame
    points_m: Array  # (r, 3), of the reflector that is read
    station_m: Array  # (r, 3), shift of the station's frame
    station_rad: Array  # (r, 3), its turn
    sights_m: Array  # (r, 3), of what the station sees, in its frame
    force_n: Array  # (r, 3), on the platform's origin
    moment_nm: Array  # (r, 3)
    payload_kg: Array  # (r,)
    payload_centre_m: Array  # (r, 3)
    expansion_per_k: dict[str, float]  # by group

    @classmethod
    def none(cls, machine: Machine, readings: int) -> Departures:
        """Nothing departs."""
        drives, struts = len(machine.drives), len(machine.struts)

        def vectors() -> Array:
            return np.zeros((readings, 3))

        return cls(
            drives_m=np.zeros((readings, drives)),
            carriages_m=np.zeros((readings, drives, 3)),
            carriages_rad=np.zeros((readings, drives, 3)),
            struts_m=np.zeros((readings, struts)),
            ln_stiffnesses=np.zeros((readings, struts)),
            joints_m=np.zeros((readings, struts, 3)),
            points_m=vectors(),
            station_m=vectors(),
            station_rad=vectors(),
            sights_m=vectors(),
            force_n=vectors(),
            moment_nm=vectors(),
            payload_kg=np.zeros(readings),
            payload_centre_m=vectors(),
            expansion_per_k=dict.fromkeys(GROUPS, 0.0),
        )

    def copy(self) -> Departures:
        """A copy that shares nothing."""
        return deepcopy(self)

    def add(self, part: Contribution, place: int | None, amplitude: float) -> None:
        """Add a contribution; place: number of the drive or strut, None where it has none."""
        for name, whole in AT_PLACE.items():
            shape = getattr(part, name)
            if shape is not None and place is not None:
                getattr(self, whole)[:, place] += amplitude * shape
        for name in ANYWHERE:
            shape = getattr(part, name)
            if shape is not None:
                getattr(self, name)[...] += amplitude * shape
        for group, coefficient in part.expansion_per_k.items():
            self.expansion_per_k[group] += amplitude * coefficient

    def damp(self, former: Departures) -> None:
        """Take a part of the former: effects of forces that switch would otherwise swing from round to round."""
        for name in _ARRAYS:
            setattr(self, name, _NEW * getattr(self, name) + _FORMER * getattr(former, name))

    def plus(self, other: Departures) -> Departures:
        """The sum of both; coefficients of expansion are those of this one."""
        out = self.copy()
        for name in _ARRAYS:
            setattr(out, name, getattr(self, name) + getattr(other, name))
        return out


_NEW, _FORMER = 0.55, 0.45
_ARRAYS = tuple(entry.name for entry in fields(Departures) if entry.name != "expansion_per_k")
