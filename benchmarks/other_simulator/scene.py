"""What a form of an effect may depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import Geometry, Machine
from benchmarks.other_simulator.rows import Rows
from benchmarks.other_simulator.state import Equilibrium
from benchmarks.other_simulator.tables import KnownTable
from benchmarks.other_simulator.weather import Weather

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A campaign of r readings on a true machine with its ordinary disturbances and without an effect."""

    machine: Machine
    geometry: Geometry  # true
    rows: Rows
    weather: Weather
    tables: Sequence[KnownTable]
    calm: Equilibrium
    points_m: Array  # (r, 3), in the machine frame
    sights_m: Array  # (r, 3), in the station's frame
    loads_n: Array  # (r, d), of the drives

    @property
    def stiffness_n_per_m(self) -> Array:
        """True stiffness of the struts (s,)."""
        return np.exp(self.geometry.ln_stiffness)

    @property
    def reflectors_m(self) -> Array:
        """Nominal place (r, 3) of the reflector that is read, in the frame of what carries it."""
        return self.machine.nominal.smr_position_m[self.rows.smr]

    @property
    def platform_reach_m(self) -> float:
        """Largest coordinate of a reflector of the platform."""
        on_platform = self.machine.carriers == -1
        return float(np.abs(self.machine.nominal.smr_position_m[on_platform]).max())
