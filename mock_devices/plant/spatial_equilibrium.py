"""Static equilibrium of a platform on rods and planes in space: the minimum of the stored energy less the loads' work.

The attitude is a unit quaternion. V is expanded to second order in a small motion (shift s, turn w) of the platform,
of which a point a of the platform, seen from its origin, moves by s + w x a + w x (w x a) / 2. Each step goes to the
minimum of that expansion. Planar machines have fewer free coordinates, not another formula.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mock_devices.plant.structure import NoEquilibrium

Array = NDArray[np.float64]

SMALL_STEP = 1e-13
_DECIMALS = 7  # far above round-off, near enough for one Newton step
_MOST_STEPS = 60
_LONGEST_STEP = 0.05
_NEAR = 1e-3  # farther away rods under huge forces would make the expansion curve the wrong way


@dataclass(frozen=True)
class SpatialPose:
    """Origin of the platform in metres and its attitude as a unit quaternion (scalar first)."""

    p: Array
    quaternion: Array

    @property
    def turn(self) -> Array:
        """Rotation matrix (3, 3)."""
        w, x, y, z = (float(value) for value in self.quaternion)
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def place(self, point_m: Array) -> Array:
        """A point of the platform in the machine frame."""
        return np.asarray(self.p + self.turn @ point_m)

    def moved(self, motion: Array) -> SpatialPose:
        """After a shift (3) and a turn (3) of the machine frame."""
        return SpatialPose(self.p + motion[:3], _product(quaternion_of(motion[3:]), self.quaternion))

    def rounded(self) -> SpatialPose:
        """A pose nearby that is the same for all that differ by a rounding."""
        quaternion = np.round(self.quaternion, _DECIMALS)
        return SpatialPose(np.round(self.p, _DECIMALS), quaternion / np.linalg.norm(quaternion))

    def vector(self) -> Array:
        """Position and rotation vector (6,)."""
        w, axis = float(self.quaternion[0]), self.quaternion[1:]
        size = float(np.linalg.norm(axis))
        angle = 2.0 * math.atan2(size, abs(w))
        factor = math.copysign(angle / size, w) if size > 1e-12 else math.copysign(2.0, w)
        return np.concatenate([self.p, factor * axis])


@dataclass(frozen=True)
class Assembly:
    """What holds the platform, as it stands: m rods, g planes, h loads.

    platform_m (m, 3) joints in the platform frame, base_m (m, 3), length_m (m,) without force, stiffness (m,);
    held_m (g, 3) joints that planes hold, point_m, normal (g, 3), plane_stiffness (g,); load_n (h, 3) forces that keep
    their direction, weights above all, at points centre_m (h, 3) of the platform.
    """

    platform_m: Array
    base_m: Array
    length_m: Array
    stiffness: Array
    held_m: Array
    point_m: Array
    normal: Array
    plane_stiffness: Array
    load_n: Array
    centre_m: Array

    def rods(self, pose: SpatialPose) -> tuple[Array, Array]:
        """Vectors (m, 3) from base joint to platform joint, and forces (m,), tension positive."""
        reach = pose.p + self.platform_m @ pose.turn.T - self.base_m
        return reach, self.stiffness * (np.sqrt((reach**2).sum(axis=1)) - self.length_m)

    def energy_j(self, pose: SpatialPose) -> float:
        """V at a pose."""
        force = self.rods(pose)[1]
        held = ((pose.p + self.held_m @ pose.turn.T - self.point_m) * self.normal).sum(axis=1)
        work = float((self.load_n * (pose.p + self.centre_m @ pose.turn.T)).sum())
        return float(0.5 * (force**2 / self.stiffness).sum() + 0.5 * (self.plane_stiffness * held**2).sum()) - work


def equilibrium(
    assembly: Assembly,
    start: SpatialPose,
    free: tuple[int, ...],
    *,
    is_near: bool = False,
    small_step: float = SMALL_STEP,
) -> SpatialPose:
    """The pose at rest nearest to `start` in the free coordinates; raises NoEquilibrium.

    `is_near`: the start is a pose of a moment ago. From there the whole expansion is used at once. `small_step`: a step
    (m, rad) after which the pose is taken; it is then right to some square of that.
    """
    pose, moves = start, np.array(free)
    for _ in range(_MOST_STEPS):
        slope, bend = _expansion(assembly, pose, whole=is_near)
        try:
            step = np.linalg.solve(bend[np.ix_(moves, moves)], -slope[moves])
        except np.linalg.LinAlgError:
            break
        size = float(np.abs(step).max())
        if not math.isfinite(size):
            break
        motion = np.zeros(6)
        motion[moves] = step * min(1.0, _LONGEST_STEP / size if size else 1.0)
        pose = pose.moved(motion)
        if is_near and size < small_step:
            return pose
        is_near = size < _NEAR
    raise NoEquilibrium(f"no equilibrium near {start.vector()}")


def _expansion(assembly: Assembly, pose: SpatialPose, *, whole: bool) -> tuple[Array, Array]:
    """Slope (6,) and curvature (6, 6) of V for a small motion of the platform; not `whole`: of rods without force."""
    turn = pose.turn
    reach, force = assembly.rods(pose)
    length = np.sqrt((reach**2).sum(axis=1))
    unit = reach / length[:, None]
    held = assembly.held_m @ turn.T
    beyond = ((pose.p + held - assembly.point_m) * assembly.normal).sum(axis=1)
    pull = assembly.plane_stiffness * beyond
    arms = np.concatenate([assembly.platform_m @ turn.T, held, assembly.centre_m @ turn.T])
    forces = np.concatenate([force[:, None] * unit, pull[:, None] * assembly.normal, -assembly.load_n])
    slope = np.concatenate([forces.sum(axis=0), cross_rows(arms, forces).sum(axis=0)])
    lines = np.concatenate([unit, assembly.normal])
    wrench = np.concatenate([lines, cross_rows(arms[: len(lines)], lines)], axis=1)
    count = len(unit)
    if not whole:
        return slope, (wrench.T * np.concatenate([assembly.stiffness, assembly.plane_stiffness])) @ wrench
    along = np.concatenate([assembly.stiffness - force / length, assembly.plane_stiffness])
    bend = (wrench.T * along) @ wrench
    aside = force / length  # a rod under force resists, or helps, motion across it
    shift = _motions(arms[:count])
    bend += np.einsum("m,mij,mik->jk", aside, shift, shift)
    second = 0.5 * (arms.T @ forces + forces.T @ arms) - float((arms * forces).sum()) * np.eye(3)
    bend[3:, 3:] += second
    return slope, bend


def cross(a: Array, b: Array) -> Array:
    """Cross product (3,): what numpy's own takes to find its axes is longer than the work here."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def cross_rows(a: Array, b: Array) -> Array:
    """The same row by row (n, 3)."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _motions(arms: Array) -> Array:
    """(m, 3, 6): how points at `arms` (m, 3) move with the platform's shift and turn, to first order."""
    out = np.zeros((len(arms), 3, 6))
    out[:, :, :3] = np.eye(3)
    x, y, z = arms.T
    out[:, 0, 4], out[:, 0, 5] = z, -y
    out[:, 1, 3], out[:, 1, 5] = -z, x
    out[:, 2, 3], out[:, 2, 4] = y, -x
    return out


def quaternion_of(vector_rad: Array) -> Array:
    """Unit quaternion (4,) of a rotation vector."""
    angle = float(np.linalg.norm(vector_rad))
    if angle < 1e-12:
        return np.concatenate([[1.0], 0.5 * vector_rad])
    return np.concatenate([[math.cos(0.5 * angle)], math.sin(0.5 * angle) / angle * vector_rad])


def _product(a: Array, b: Array) -> Array:
    """Quaternion of turn b followed by turn a, of length one."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    out = np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
        ]
    )
    return np.asarray(out / math.sqrt(float(out @ out)))


def pose_of(vector: Array) -> SpatialPose:
    """The pose of a position and rotation vector (6,)."""
    return SpatialPose(np.array(vector[:3], dtype=np.float64), quaternion_of(np.asarray(vector[3:], dtype=np.float64)))
