"""Which reflectors a station sees: within the angle that each accepts, and not behind a strut.

On the nominal machine. A reflector without `facing` is seen from everywhere, and a strut without `diameter_m` hides
nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.machine.description import FIXED, Machine
from calibration.machine.equilibrium import carriers_of, make_conditions

BEAM_RADIUS_M = 0.02  # of a reflector and the beam to it: nothing of a strut may be nearer to the line of sight
NEAR_END_M = 0.05  # of the line of sight, where the reflector is mounted


def hides_reflectors(machine: Machine) -> bool:
    """Whether any reflector may be out of sight at some poses."""
    return any(s.facing is not None for s in machine.smrs) or any(s.diameter_m is not None for s in machine.file.struts)


def visible(machine: Machine, station_m: Array, pose: Array, drives: Array) -> NDArray[np.bool_]:
    """Whether the station at a point (3,) of the machine frame sees each reflector (n, smrs) at platform poses (n, 6).

    drives (n, d): where the drives are at these poses.
    """
    at = make_conditions(machine, len(pose))
    turn = rotation_matrix(pose[:, 3:])
    carriers = carriers_of(machine, machine.nominal, drives, at)
    geometry = machine.nominal
    joints = pose[:, None, :3] + np.einsum("nij,mj->nmi", turn, geometry.platform_joint_m)
    bases = np.stack(
        [
            carriers[a if a != FIXED else len(carriers) - 1].position(geometry.base_joint_m[i]).T
            for i, a in enumerate(machine.strut_drive.tolist())
        ],
        axis=1,
    )
    out = np.ones((len(pose), len(machine.smrs)), dtype=bool)
    for i, smr in enumerate(machine.smrs):
        place, facing = _placed(machine, i, pose, turn, drives)
        sight = station_m - place
        distance = np.linalg.norm(sight, axis=1)
        if facing is not None:
            cosine = np.sum(sight * facing, axis=1) / distance
            out[:, i] &= np.arccos(np.clip(cosine, -1.0, 1.0)) <= smr.acceptance_rad
        start = place + sight * np.minimum(NEAR_END_M / distance, 0.5)[:, None]
        for strut, entry in enumerate(machine.file.struts):
            if entry.diameter_m is not None:
                gap = segment_gap(start, np.broadcast_to(station_m, start.shape), bases[:, strut], joints[:, strut])
                out[:, i] &= gap > 0.5 * entry.diameter_m + BEAM_RADIUS_M
    return out


def _placed(machine: Machine, smr: int, pose: Array, turn: Array, drives: Array) -> tuple[Array, Array | None]:
    """Where a reflector is (n, 3) and where it looks (n, 3), if it does not look everywhere."""
    reflector, n = machine.smrs[smr], len(pose)
    facing = reflector.facing
    if reflector.on == "platform":
        looks = None if facing is None else turn @ facing
        return pose[:, :3] + turn @ reflector.position_m, looks
    if reflector.on == "floor":
        return np.tile(reflector.position_m, (n, 1)), None if facing is None else np.tile(facing, (n, 1))
    carrier = carriers_of(machine, machine.nominal, drives, make_conditions(machine, n))[reflector.drive]
    if facing is None:
        return carrier.position(reflector.position_m).T, None
    ends = carrier.positions(np.stack([reflector.position_m, reflector.position_m + facing]))
    return ends[:, 0].T, (ends[:, 1] - ends[:, 0]).T


def segment_gap(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least distances (n,) between the segments from a to b and from c to d, all (n, 3).

    Sunday, Geometry Algorithms: the nearest points of the two lines, held within the segments.
    """
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (np.sum(p * q, axis=1) for p, q in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=1), np.sum(v * w, axis=1)
    determinant = uu * vv - uv**2
    parallel = determinant < 1e-12 * uu * vv
    s = np.clip(np.where(parallel, 0.0, (uv * vw - vv * uw) / np.where(parallel, 1.0, determinant)), 0.0, 1.0)
    t = np.clip((uv * s + vw) / vv, 0.0, 1.0)
    s = np.clip((uv * t - uw) / uu, 0.0, 1.0)
    return np.asarray(np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1))
