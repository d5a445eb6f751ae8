"""What a campaign has measured: loads, temperatures and poses for which there is a correction. Beyond there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.calibration import Calibration
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.inverse import platform_poses
from calibration.machine.measured_poses import held_poses, measured_box
from calibration.model.operating_conditions import OperatingConditions
from calibration.model.visits import Visits

BEYOND_MEASURED_K = 4.0  # of a part, where a calibration is due by default: expansion is known to some 1e-6 / K
LOAD_TOLERANCE_KG = 1e-6


@dataclass(frozen=True)
class MeasuredRange:
    """Limits (k, 2) of the commanded coordinates, of the payload in kg, and of each part's temperature in degC."""

    machine: Machine
    box: Array
    payload_kg: tuple[float, float]
    temperatures_c: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, calibration: Calibration) -> MeasuredRange:
        """Of the readings that a calibration was identified from."""
        return cls.of_visits(calibration.report.machine, calibration.reduction.calibration().visits)

    @classmethod
    def of_visits(cls, machine: Machine, visits: Visits) -> MeasuredRange:
        """Of visits."""
        temperatures = {name: _range_of(values) for name, values in visits.temperatures_c.items()}
        return cls(machine, measured_box(machine, visits.target_m), _range_of(visits.payload_kg), temperatures)

    def widened(self, visits: Visits) -> MeasuredRange:
        """With the loads and temperatures of further visits; the poses stay."""
        return replace(
            self,
            payload_kg=_range_of(np.append(visits.payload_kg, self.payload_kg)),
            temperatures_c={
                name: _range_of(np.append(visits.temperatures_c[name], known))
                for name, known in self.temperatures_c.items()
            },
        )

    def as_json(self) -> dict[str, Any]:
        """For the store."""
        return {
            "box": self.box.tolist(),
            "payload_kg": list(self.payload_kg),
            "temperatures_c": {name: list(t) for name, t in self.temperatures_c.items()},
        }

    @classmethod
    def of_json(cls, machine: Machine, data: Mapping[str, Any]) -> MeasuredRange:
        """From the store."""
        low, high = data["payload_kg"]
        temperatures = {str(name): (float(t[0]), float(t[1])) for name, t in data["temperatures_c"].items()}
        return cls(machine, np.array(data["box"], dtype=np.float64), (float(low), float(high)), temperatures)

    def require(self, conditions: OperatingConditions) -> None:
        """InputError for a payload or a temperature beyond those that were measured."""
        low, high = self.payload_kg
        if not low - LOAD_TOLERANCE_KG <= conditions.payload_kg <= high + LOAD_TOLERANCE_KG:
            raise InputError(
                f"payload {conditions.payload_kg:g} kg: {low:g} to {high:g} kg were measured, beyond them there is no "
                "correction; measure a campaign with it"
            )
        for name, (coldest, warmest) in sorted(self.temperatures_c.items()):
            now = conditions.temperatures_c[name]
            if not coldest - BEYOND_MEASURED_K <= now <= warmest + BEYOND_MEASURED_K:
                raise InputError(
                    f"temperature of {name}: {now:.1f} degC; {coldest:.1f} to {warmest:.1f} degC were measured, more "
                    f"than {BEYOND_MEASURED_K:g} K beyond there is no correction; wait, or measure a campaign as it is"
                )

    def held(self, target_m: Array) -> Array:
        """Platform poses (n, 6) for whose correction to ask at poses (n, 6); see `held_poses`."""
        return held_poses(self.machine, self.box, target_m)

    def require_workspace(self) -> None:
        """InputError where a part of the workspace was not measured, for corrections that serve all of it."""
        self.held(platform_poses(self.machine, np.array(list(product(*self.machine.commanded_limits)))))

    def in_words(self) -> str:
        """For people."""
        limits = ", ".join(
            f"{COORDINATES[c]} {low:.4g} to {high:.4g} {'rad' if c > 2 else 'm'}"
            for c, (low, high) in zip(self.machine.commanded, self.box, strict=True)
        )
        coldest = min((t[0] for t in self.temperatures_c.values()), default=float("nan"))
        warmest = max((t[1] for t in self.temperatures_c.values()), default=float("nan"))
        return (
            f"{limits}; {self.payload_kg[0]:g} to {self.payload_kg[1]:g} kg; parts at {coldest:.1f} to {warmest:.1f} "
            f"degC and {BEYOND_MEASURED_K:g} K beyond"
        )


def _range_of(values: Array) -> tuple[float, float]:
    return float(np.min(values)), float(np.max(values))
