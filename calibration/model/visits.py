"""Visits of poses: drive coordinates, commanded pose, payload and temperatures of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array, RowSelection
from calibration.machine.description import Machine


@dataclass(frozen=True)
class Visits:
    """One row a visit (v) of a pose.

    drives (v, d) actual drive coordinates, m (rad for a crank); target_m (v, 6) commanded pose of the platform
    (coordinates and rotation vector); payload_kg (v,); payload_com_m (v, 3); temperatures_c: sensor to (v,).
    forces: pairs of a known force (v, 3) in N, machine frame, and its point (v, 3) in m, platform frame.
    """

    drives: Array
    target_m: Array
    payload_kg: Array
    payload_com_m: Array
    temperatures_c: Mapping[str, Array]
    forces: tuple[tuple[Array, Array], ...] = ()

    def __len__(self) -> int:
        return len(self.drives)

    def take(self, rows: RowSelection) -> Visits:
        """Some of the visits."""
        return Visits(
            self.drives[rows],
            self.target_m[rows],
            self.payload_kg[rows],
            self.payload_com_m[rows],
            {name: t[rows] for name, t in self.temperatures_c.items()},
            tuple((force[rows], point[rows]) for force, point in self.forces),
        )

    @classmethod
    def at_reference_temperature(
        cls,
        machine: Machine,
        drives: Array,
        target_m: Array,
        payload_kg: Array | float = 0.0,
        payload_com_m: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Visits:
        """Visits at the reference temperature."""
        n = len(drives)
        return cls(
            drives,
            target_m,
            np.broadcast_to(np.asarray(payload_kg, dtype=np.float64), (n,)),
            np.broadcast_to(np.asarray(payload_com_m, dtype=np.float64), (n, 3)),
            {sensor: np.full(n, machine.reference_temperature_c) for sensor in machine.sensors.values()},
        )

    def concatenate(self, other: Visits) -> Visits:
        """These visits, then the other ones, which have as many forces."""
        pairs = zip(self.forces, other.forces, strict=True)
        return Visits(
            np.concatenate([self.drives, other.drives]),
            np.concatenate([self.target_m, other.target_m]),
            np.concatenate([self.payload_kg, other.payload_kg]),
            np.concatenate([self.payload_com_m, other.payload_com_m]),
            {name: np.concatenate([t, other.temperatures_c[name]]) for name, t in self.temperatures_c.items()},
            tuple((np.concatenate([f, g]), np.concatenate([p, q])) for (f, p), (g, q) in pairs),
        )
