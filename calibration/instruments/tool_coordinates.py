"""Coordinates of the tool measured in the machine's frame: the full pose, x and y only, or the height alone.

An instrument whose frame is not known to the machine adds six unknowns; a subset of coordinates is compared after
that motion. An offset common to all readings (where a touch probe triggers) is a further unknown, and so is a bed that
is touched and is no plane but a bowl.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import rotation_matrix, rotation_vector, skew
from calibration.instruments.readings import WhitenedResiduals
from calibration.instruments.smr_positions import FRAME_PRIOR_M, FRAME_PRIOR_RAD
from calibration.machine.description import COORDINATES, Machine
from calibration.model.model import Poses, Unknown
from calibration.model.visits import Visits

BOWL = "bed.bowl"
HEIGHT = COORDINATES.index("z")


@dataclass(frozen=True)
class ToolCoordinates:
    """Readings of some coordinates (indices k of x, y, z, rx, ry, rz) of tool point and orientation.

    visit (r,); value (r, 6) in m and rad, rotation vectors, what is not measured is ignored; sigma (r, k) standard
    deviations of independent errors. own_frame: the instrument's frame is unknown. offset_u (k,): standard
    uncertainty of an offset common to all readings, zero where there is none. bowl_u_m: standard
    uncertainty of how much higher a touched bed is bowl_radius_m off the machine's axis than on it, growing with the
    square of the distance.
    """

    visit: NDArray[np.intp]
    coordinates: tuple[int, ...]
    value: Array
    sigma: Array
    own_frame: bool = False
    offset_u: tuple[float, ...] = ()
    bowl_u_m: float = 0.0
    bowl_radius_m: float = 1.0

    @classmethod
    def of(cls, visits: Visits, coordinates: tuple[int, ...], value: Array, sigma: Array) -> ToolCoordinates:
        """One reading a visit, sigma (k,) the same for all."""
        return cls(np.arange(len(visits)), coordinates, value, np.tile(sigma, (len(visits), 1)))

    def __len__(self) -> int:
        return len(self.visit)

    @property
    def width(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def free_rigid_motion(self) -> bool:
        """Whether the instrument's frame is unknown."""
        return self.own_frame

    def unknowns(self, machine: Machine) -> tuple[Unknown, ...]:
        """The instrument's frame, the offsets and the bowl, where there are any."""
        out = []
        if self.own_frame:
            free = [3, 4, 5, 0, 1, 2] if not machine.planar else [5, 0, 1]
            sigma = {True: FRAME_PRIOR_RAD, False: FRAME_PRIOR_M}
            out += [Unknown(f"frame.{COORDINATES[c]}", "rad" if c > 2 else "m", sigma[c > 2]) for c in free]
        for c, u in zip(self.coordinates, self.offset_u, strict=False):
            if u > 0.0:
                out.append(Unknown(f"offset.{COORDINATES[c]}", "rad" if c > 2 else "m", u))
        if self.bowl_u_m > 0.0:
            out.append(Unknown(BOWL, "m", self.bowl_u_m))
        return tuple(out)

    def visit_indices(self) -> NDArray[np.intp]:
        """One visit a reading."""
        return self.visit[:, None]

    def take(self, rows: NDArray[np.intp]) -> ToolCoordinates:
        """Some of the readings."""
        return replace(self, visit=self.visit[rows], value=self.value[rows], sigma=self.sigma[rows])

    def with_noise(self, white: Array) -> ToolCoordinates:
        """Values with whitened noise (r, k) added."""
        value = self.value.copy()
        value[:, list(self.coordinates)] += white * self.sigma
        return replace(self, value=value)

    def compare(
        self, poses: Poses, local: NDArray[np.intp], instrument_unknowns: Array, *, derivatives: bool = True
    ) -> WhitenedResiduals:
        """Whitened differences; rotations by the vector of the rotation from measured to predicted."""
        machine = poses.model.machine
        names = [u.name for u in self.unknowns(machine)]
        visit = local[:, 0]
        increment = np.zeros(6)
        for column, name in enumerate(names):
            if name.startswith("frame."):
                increment[[3, 4, 5, 0, 1, 2][COORDINATES.index(name[6:])]] = instrument_unknowns[column]
        depth_m = 0.0
        frame = Frame(np.eye(3), np.zeros(3)).with_increment(increment)
        turned = poses.tool_m()[visit] @ frame.rotation.T
        turn = (
            frame.rotation @ poses.equilibrium.rotation[visit] @ rotation_matrix(self.value[:, 3:]).transpose(0, 2, 1)
        )
        error = np.concatenate([turned + frame.translation_m - self.value[:, :3], rotation_vector(turn)], axis=1)
        chosen = list(self.coordinates)
        by_own = np.zeros((len(self), self.width, len(names)))
        for column, name in enumerate(names):
            if name == BOWL:
                # What is touched is higher than its stated height, and the tool with it.
                depth_m = instrument_unknowns[column]
                higher = np.sum(turned[:, :2] ** 2, axis=1) / self.bowl_radius_m**2
                error[:, HEIGHT] -= higher * depth_m
                by_own[:, chosen.index(HEIGHT), column] = -higher
                continue
            c = COORDINATES.index(name.partition(".")[2])
            if name.startswith("offset."):
                error[:, c] += instrument_unknowns[column]
                by_own[:, chosen.index(c), column] = 1.0
            elif c < 3:
                by_own[:, :, column] = np.eye(6)[c][chosen]
            else:
                full = np.concatenate([-skew(turned)[:, :, c - 3], np.broadcast_to(np.eye(3)[c - 3], turned.shape)], 1)
                by_own[:, :, column] = full[:, chosen]
        residual = error[:, chosen] / self.sigma
        if not derivatives:
            return WhitenedResiduals(residual, np.zeros((len(self), self.width, 0)), by_own[:, :, :0])
        by_point = poses.platform_point_derivatives(machine.tool_point_m)
        if depth_m:
            steeper = -2.0 * depth_m / self.bowl_radius_m**2 * poses.tool_m()[:, :2]
            by_point = by_point.copy()
            by_point[:, HEIGHT] += np.einsum("vc,vcu->vu", steeper, by_point[:, :2])
        by_turn = poses.jacobian[:, 3:]
        if self.own_frame:
            by_point, by_turn = frame.rotation @ by_point, frame.rotation @ by_turn
        by_model = np.empty((*residual.shape, by_point.shape[2]))
        scale = 1.0 / self.sigma[:, :, None]
        for row, c in enumerate(chosen):
            np.multiply((by_point if c < 3 else by_turn)[visit, c % 3], scale[:, row], out=by_model[:, row])
        return WhitenedResiduals(residual, by_model, scale * by_own)
