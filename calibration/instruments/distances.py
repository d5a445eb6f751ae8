"""Distances: a double ball bar between the tool and a ball on the base, or between the tool at two visits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.instruments.readings import WhitenedResiduals
from calibration.machine.description import Machine
from calibration.model.model import Poses, Unknown


@dataclass(frozen=True)
class Distances:
    """Distances (r,) in m with standard deviations (r,) from the tool point at `first` to where it was at `second`.

    second (r,): a visit, or None for a ball on the base at centre_m (3,), known to centre_u_m (an unknown of the
    fit). length_u_m, scale_u: standard uncertainties common to all distances (length of the bar, scale
    of a calliper).
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp] | None
    distance_m: Array
    sigma_m: Array
    centre_m: Array | None = None
    centre_u_m: float = 0.0
    length_u_m: float = 0.0
    scale_u: float = 0.0

    def __post_init__(self) -> None:
        if (self.second is None) == (self.centre_m is None):
            raise ValueError("either a second visit or a centre")

    def __len__(self) -> int:
        return len(self.first)

    @property
    def width(self) -> int:
        """One number a reading."""
        return 1

    @property
    def free_rigid_motion(self) -> bool:
        """A distance has no frame; the ball's place is known to its uncertainty."""
        return False

    def unknowns(self, machine: Machine) -> tuple[Unknown, ...]:
        """Place of the ball on the base, common error of length and of scale."""
        axes = "xy" if machine.planar else "xyz"
        unknowns = [Unknown(f"ball.{c}", "m", self.centre_u_m if self.second is None else 0.0) for c in axes]
        unknowns += [Unknown("bar.length", "m", self.length_u_m), Unknown("bar.scale", "1", self.scale_u)]
        return tuple(u for u in unknowns if u.sigma > 0.0)

    def visit_indices(self) -> NDArray[np.intp]:
        """One or two visits a reading."""
        return self.first[:, None] if self.second is None else np.stack([self.first, self.second], axis=1)

    def take(self, rows: NDArray[np.intp]) -> Distances:
        """Some of the readings."""
        return replace(
            self,
            first=self.first[rows],
            second=None if self.second is None else self.second[rows],
            distance_m=self.distance_m[rows],
            sigma_m=self.sigma_m[rows],
        )

    def with_noise(self, white: Array) -> Distances:
        """Distances moved by whitened amounts (r, 1)."""
        return replace(self, distance_m=self.distance_m + white[:, 0] * self.sigma_m)

    def compare(
        self, poses: Poses, local: NDArray[np.intp], instrument_unknowns: Array, *, derivatives: bool = True
    ) -> WhitenedResiduals:
        """Whitened differences of predicted and measured distances."""
        machine = poses.model.machine
        names = [u.name for u in self.unknowns(machine)]
        tool = poses.tool_m()
        if self.second is None:
            centre = np.array(self.centre_m)
            for column, name in enumerate(names):
                if name.startswith("ball."):
                    centre["xyz".index(name[-1])] += instrument_unknowns[column]
            between = tool[local[:, 0]] - centre
        else:
            between = tool[local[:, 0]] - tool[local[:, 1]]
        distance = np.linalg.norm(between, axis=1)
        along = between / distance[:, None]
        by_own = np.zeros((len(self), 1, len(names)))
        predicted_m = distance.copy()
        for column, name in enumerate(names):
            if name.startswith("ball."):
                by_own[:, 0, column] = -along[:, "xyz".index(name[-1])]
            else:
                by_own[:, 0, column] = 1.0 if name == "bar.length" else distance
                predicted_m += instrument_unknowns[column] * by_own[:, 0, column]
        residual = ((predicted_m - self.distance_m) / self.sigma_m)[:, None]
        if not derivatives:
            return WhitenedResiduals(residual, np.zeros((len(self), 1, 0)), by_own[:, :, :0])
        by_point = poses.platform_point_derivatives(machine.tool_point_m)
        by_model = by_point[local[:, 0]]
        if self.second is not None:
            by_model = by_model - by_point[local[:, 1]]
        scale = 1.0 / self.sigma_m[:, None, None]
        return WhitenedResiduals(residual, scale * np.einsum("ri,riu->ru", along, by_model)[:, None], scale * by_own)
