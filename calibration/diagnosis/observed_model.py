"""A modelled machine together with the readings of its reflectors, measured or only planned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.effects.context import ReadingContext
from calibration.machine.description import Machine
from calibration.model.model import Poses


@dataclass(frozen=True)
class ObservedModel:
    """Readings of reflectors (n) on a modelled machine.

    smr (n,): index of the reflector in the machine file. poses: of the visits; visit (n,): their rows, -1 for floor
    nests. frame: from the machine's to the station's; mounted_m (smrs, 3): fitted positions of the reflectors on their
    parts; position_m (n, 3): of the readings in the station's frame. station_m (3,) or (n, 3): where the station stood
    in it, which is not the origin in later set-ups.
    """

    machine: Machine
    context: ReadingContext
    smr: NDArray[np.intp]
    visit: NDArray[np.intp]
    poses: Poses
    frame: Frame
    mounted_m: Array
    position_m: Array
    station_m: Array = field(default_factory=lambda: np.zeros(3), kw_only=True)

    @property
    def sight_m(self) -> Array:
        """From the station to each reading's reflector (n, 3)."""
        return np.asarray(self.position_m - self.station_m)

    @property
    def on_platform(self) -> NDArray[np.bool_]:
        """Readings (n,) of the platform's reflectors."""
        return np.array([smr.on == "platform" for smr in self.machine.smrs])[self.smr]

    @property
    def on_floor(self) -> NDArray[np.bool_]:
        """Readings (n,) of the floor nests."""
        return np.array([smr.on == "floor" for smr in self.machine.smrs])[self.smr]


def whitened_shift(whiten: Array, frame: Frame, shift_m: Array) -> Array:
    """Shifts (n, 3) in the machine's frame, multiplied by the whitening matrices (n, 3, 3) of the station's frame."""
    return np.einsum("nij,nj->ni", whiten, shift_m @ frame.rotation.T)
