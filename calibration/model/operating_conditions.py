"""Operating conditions: the payload and the temperatures that a prediction or a table is for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.model.visits import Visits


@dataclass(frozen=True)
class OperatingConditions:
    """The payload and the temperatures (sensor to degC) that a prediction or a table is for."""

    payload_kg: float
    payload_com_m: tuple[float, float, float]
    temperatures_c: dict[str, float]

    def at_poses(self, drives: Array, target_m: Array) -> Visits:
        """Visits of n poses under these conditions."""
        n = len(drives)
        return Visits(
            drives,
            target_m,
            np.full(n, self.payload_kg),
            np.tile(self.payload_com_m, (n, 1)),
            {name: np.full(n, t) for name, t in self.temperatures_c.items()},
        )
