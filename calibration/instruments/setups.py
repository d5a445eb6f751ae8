"""Set-ups of a station: one instrument that stood in several places, tied to the frame of its first set-up.

A set-up is left when the station is knocked, moved or switched off. Each has a frame of its own; a rigid motion takes
its points to the frame of the first. Whatever is computed of the machine is computed there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, skew

RANGE_ERRORS = ("range.constant", "range.scale", "refraction.curvature")


@dataclass(frozen=True)
class Setups:
    """Rigid motions of k set-ups to the frame of the first, and what is not known of them.

    numbers (k,): as in the column `station`, ascending. rotation (k, 3, 3), translation_m (k, 3): a point p of a set-up
    is at R p + t; translation_m is also where the station stood. The error of the later motions, a rotation vector and
    a shift in the first frame for each, (6 (k - 1),), is normal with error_mean and error_covariance, and grows with
    each of RANGE_ERRORS by error_by_range (6 (k - 1), 3): ranges that are all too long bend the nests differently from
    every place.
    """

    numbers: NDArray[np.intp]
    rotation: Array
    translation_m: Array
    error_mean: Array
    error_covariance: Array
    error_by_range: Array

    @classmethod
    def single(cls, number: int = 1) -> Setups:
        """One set-up, whose frame is that of all points."""
        none = np.zeros((0, 0))
        numbers = np.array([number], dtype=np.intp)
        return cls(numbers, np.eye(3)[None], np.zeros((1, 3)), np.zeros(0), none, np.zeros((0, len(RANGE_ERRORS))))

    def __len__(self) -> int:
        return len(self.numbers)

    def rows(self, number: Array) -> NDArray[np.intp]:
        """Rows (n,) of set-ups by their numbers (n,)."""
        return np.searchsorted(self.numbers, np.asarray(number)).astype(np.intp)

    def to_first(self, points_m: Array, setup: NDArray[np.intp]) -> Array:
        """Points (n, 3) of set-ups (n,), rows of this, in the frame of the first; unchanged with one set-up."""
        if len(self) == 1:
            return points_m
        return np.asarray(np.einsum("nij,nj->ni", self.rotation[setup], points_m) + self.translation_m[setup])

    def covariances_in_first(self, covariances_m2: Array, setup: NDArray[np.intp]) -> Array:
        """Covariances (n, 3, 3) of points, turned likewise."""
        if len(self) == 1:
            return covariances_m2
        turn = self.rotation[setup]
        return np.asarray(turn @ covariances_m2 @ turn.transpose(0, 2, 1))

    def without_error(self, error: Array, covariance: Array) -> Setups:
        """The motions once their errors (6 (k - 1),) are known, with the covariance that is left."""
        rotation, translation = self.rotation.copy(), self.translation_m.copy()
        for k in range(1, len(self)):
            turn = rotation_matrix(error[6 * k - 6 : 6 * k - 3])
            rotation[k] = turn.T @ rotation[k]
            translation[k] = turn.T @ (translation[k] - error[6 * k - 3 : 6 * k])
        return replace(
            self,
            rotation=rotation,
            translation_m=translation,
            error_mean=np.zeros_like(error),
            error_covariance=covariance,
            error_by_range=np.zeros_like(self.error_by_range),
        )

    def with_common_drift(self, covariances: Mapping[float, Array]) -> Setups:
        """With the covariance (6, 6) of a common drift of each set-up's readings, in its own frame, by its number: a
        motion that was fitted to readings contains their drift, that of the first set-up's too."""
        total, first = self.error_covariance.copy(), covariances.get(float(self.numbers[0]), np.zeros((6, 6)))
        for k in range(1, len(self)):
            turn = self.rotation[k]
            to_first = np.block([[turn, np.zeros((3, 3))], [skew(self.translation_m[k]) @ turn, turn]])
            own = slice(6 * k - 6, 6 * k)
            total[own, own] += to_first @ covariances.get(float(self.numbers[k]), np.zeros((6, 6))) @ to_first.T
        count = len(self) - 1
        return replace(self, error_covariance=total + np.tile(first, (count, count)))

    def with_error(self, sigma: float) -> Setups:
        """The same motions with independent errors of one standard deviation in rad and m."""
        size = 6 * (len(self) - 1)
        return replace(
            self,
            error_mean=np.zeros(size),
            error_covariance=np.eye(size) * sigma**2,
            error_by_range=np.zeros((size, len(RANGE_ERRORS))),
        )

    def moved_by_error(self, points_m: Array, setup: NDArray[np.intp], error: Array) -> Array:
        """Points (n, 3), seen from set-ups (n,), as motions with errors (6 (k - 1),) bring them to the first frame."""
        turn, shift = np.zeros((len(self), 3)), np.zeros((len(self), 3))
        turn[1:], shift[1:] = error.reshape(-1, 2, 3).transpose(1, 0, 2)
        return np.asarray(np.einsum("nij,nj->ni", rotation_matrix(turn)[setup], points_m) + shift[setup])

    def shift_by_error(self, points_m: Array, setup: NDArray[np.intp]) -> Array:
        """Derivatives (n, 3, 6 (k - 1)) of points (n, 3), in the first frame, with the errors of the motions."""
        return shift_by_motion(points_m, setup, len(self))


def shift_by_motion(points_m: Array, setup: NDArray[np.intp], count: int) -> Array:
    """Derivatives (n, 3, 6 (count - 1)) of points (n, 3) with a rotation vector and a shift of each later set-up."""
    out = np.zeros((len(points_m), 3, 6 * (count - 1)))
    for k in range(1, count):
        rows = np.flatnonzero(setup == k)
        out[rows, :, 6 * k - 6 : 6 * k - 3] = -skew(points_m[rows])
        out[rows, :, 6 * k - 3 : 6 * k] = np.eye(3)
    return out


def range_shifts(sight_m: Array) -> dict[str, Array]:
    """Shifts (n, 3) of points at sights (n, 3), from the station, by a unit of each of RANGE_ERRORS.

    The curvature of the line of sight bends it upwards, the vertical axis of a levelled station being z.
    """
    distance = np.linalg.norm(sight_m, axis=1)[:, None]
    up = np.broadcast_to([0.0, 0.0, 1.0], sight_m.shape)
    return {
        "range.constant": sight_m / distance,
        "range.scale": sight_m,
        "refraction.curvature": 0.5 * distance**2 * (up - sight_m * sight_m[:, 2:] / distance**2),
    }
