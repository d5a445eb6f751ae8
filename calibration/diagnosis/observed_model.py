"""A modelled machine together with the readings of its reflectors or of its tool, measured or only planned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import skew
from calibration.effects.context import ReadingContext
from calibration.machine.description import Machine
from calibration.model.model import Poses

TOOL = -1  # in place of a reflector's index: the tool point itself was read


@dataclass(frozen=True)
class ObservedModel:
    """Readings (n) of reflectors, or of the tool, on a modelled machine.

    smr (n,): index of the reflector in the machine file, TOOL for the tool. poses: of the visits; visit (n,): their
    rows, -1 for floor nests. frame: from the machine's to the station's or another instrument's; mounted_m (smrs, 3):
    fitted positions of the reflectors on their parts, followed by the tool point where that is read; position_m (n, 3):
    of the readings in the station's frame. station_m (3,) or (n, 3): where the station stood in it, which is not the
    origin in later set-ups. turns (n,): readings that are rotations of the platform, not places; None if there is none.
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
    turns: NDArray[np.bool_] | None = field(default=None, kw_only=True)

    @property
    def sight_m(self) -> Array:
        """From the station to each reading's reflector (n, 3)."""
        return np.asarray(self.position_m - self.station_m)

    @property
    def on_platform(self) -> NDArray[np.bool_]:
        """Readings (n,) of the platform's reflectors, and of the tool."""
        return np.array([*(smr.on == "platform" for smr in self.machine.smrs), True])[self.smr]

    @property
    def on_floor(self) -> NDArray[np.bool_]:
        """Readings (n,) of the floor nests."""
        return np.array([*(smr.on == "floor" for smr in self.machine.smrs), False])[self.smr]

    @property
    def by_station(self) -> bool:
        """Whether a station read reflectors; else the tool was read, by instruments without light or nests."""
        return bool(np.any(self.smr != TOOL))

    def platform_shift(self, change: Array) -> Array:
        """Shifts (n, 3) of what is read of the platform, m, for a change of the pose (v, 6); rad where turns are read.

        Zero for all other readings.
        """
        out = np.zeros((len(self.smr), 3))
        rows = np.flatnonzero(self.on_platform)
        visit = self.visit[rows]
        lever = np.einsum("nij,nj->ni", self.poses.equilibrium.rotation[visit], self.mounted_m[self.smr[rows]])
        moved = change[visit]
        out[rows] += moved[:, :3] - np.einsum("nij,nj->ni", skew(lever), moved[:, 3:])
        if self.turns is not None:
            out[self.turns] = change[self.visit[self.turns], 3:]
        return out

    def platform_growth(self) -> Array:
        """Shifts (n, 3) of what is read of the platform if it becomes longer by one, relatively, about its origin."""
        out = np.zeros((len(self.smr), 3))
        rows = np.flatnonzero(self.on_platform)
        rotation = self.poses.equilibrium.rotation[self.visit[rows]]
        out[rows] = np.einsum("nij,nj->ni", rotation, self.mounted_m[self.smr[rows]])
        if self.turns is not None:
            out[self.turns] = 0.0
        return out


def whitened_shift(whiten: Array, frame: Frame, shift_m: Array) -> Array:
    """Shifts (n, 3) in the machine's frame, multiplied by the whitening matrices (n, w, 3) of the station's frame."""
    return np.einsum("nij,nj->ni", whiten, shift_m @ frame.rotation.T)
