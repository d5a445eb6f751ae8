"""The machine with good parts by hand: where its platform hangs, and what the struts pull. Many poses at once.

For what MuJoCo is not needed for: where to let go, the struts' force on a carriage, and how readings depend on the
geometry. A test compares it with MuJoCo. Newton's method with the strut's stiffness; n states, all in the plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.strut_model import CENTRES_M, GRAVITY, PAYLOADS_KG, STRUTS, Machine

Array = NDArray[np.float64]

ROUNDS = 7
OF_STRUT = np.array([0, 0, 1, 1])  # the drive of each strut


def hang(
    machine: Machine, drives_m: Array, payload: NDArray[np.intp], growth: Array | float = 0.0
) -> tuple[Array, Array]:
    """Poses (n, 3) x, y, rotation, and the struts' tension (n, 4), by drives (n, 2) and number of the payload (n,).

    growth (n, 4): relative growth of the struts' lengths.
    """
    carried = np.eye(len(PAYLOADS_KG))[payload] * PAYLOADS_KG  # by payload
    mass = machine.mass_kg + carried.sum(axis=1)
    bases = machine.base_m + machine.carriages_m(drives_m)[:, OF_STRUT]
    length = machine.length_m * (1.0 + np.asarray(growth)) * np.ones((len(drives_m), STRUTS))
    arm = machine.platform_m
    pose = np.zeros((len(drives_m), 3))
    pose[:, 0] = 0.5 * np.diff(bases.reshape(-1, 2, 2, 2)[..., 1].mean(axis=2), axis=1)[:, 0]
    pose[:, 1] = bases[..., 1].mean(axis=1) - np.sqrt(1.25)
    tension = np.zeros((len(pose), STRUTS))
    for _ in range(ROUNDS):
        joints = pose[:, None, :2] + _turned(arm, pose[:, 2])
        way = joints - bases
        long = np.linalg.norm(way, axis=-1)
        along = way / long[..., None]
        tension = machine.stiffness_n_per_m * (long - length)
        lever = _turned(arm, pose[:, 2])
        jacobian = np.concatenate([along, _cross(lever, along)[..., None]], axis=-1)  # of lengths by pose
        own = _turned(np.array([machine.centre_m]), pose[:, 2])[:, 0, 0]
        moment = machine.mass_kg * own + sum(
            kg * _turned(np.array([centre]), pose[:, 2])[:, 0, 0]
            for kg, centre in zip(carried.T, CENTRES_M, strict=True)
        )
        weight = np.stack([np.zeros_like(mass), -mass * GRAVITY, -GRAVITY * moment], axis=1)
        residual = weight - np.einsum("nij,ni->nj", jacobian, tension)
        stiffness = np.einsum("nij,i,nik->njk", jacobian, machine.stiffness_n_per_m, jacobian)
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        turning = np.concatenate([across, _cross(lever, across)[..., None]], axis=-1)
        stiffness += np.einsum("nij,ni,nik->njk", turning, tension / long, turning)
        pose = pose + np.linalg.solve(stiffness, residual[..., None])[..., 0]
    return pose, tension


def loads_n(machine: Machine, drives_m: Array, pose: Array, tension: Array) -> Array:
    """The struts' force (n, 2) on each carriage along its slide, positive upwards."""
    bases = machine.base_m + machine.carriages_m(drives_m)[:, OF_STRUT]
    way = pose[:, None, :2] + _turned(machine.platform_m, pose[:, 2]) - bases
    force = tension[..., None] * way / np.linalg.norm(way, axis=-1, keepdims=True)
    slide = np.stack([-np.sin(machine.tilt_rad), np.cos(machine.tilt_rad)], axis=-1)
    return np.asarray(np.einsum("nad,ad->na", force.reshape(-1, 2, 2, 2).sum(axis=2), slide))


def drives_of(nominal: Machine, x_m: Array, y_m: Array) -> Array:
    """Drives (n, 2) that bring the nominal platform to places, without weight and rotation."""
    reach = nominal.length_m[[0, 2]]
    off = np.stack([x_m, x_m], axis=1) + (nominal.platform_m - nominal.base_m)[[0, 2], 0]
    return np.asarray(y_m[:, None] + np.sqrt(reach**2 - off**2))


def places_m(machine: Machine, pose: Array, carriages: Array) -> Array:
    """All reflectors (n, 7, 3) by poses (n, 3) and carriages (n, 2, 3), machine's axes."""
    out = np.broadcast_to(machine.reflectors_m, (len(pose), *machine.reflectors_m.shape)).copy()
    out[:, :3, :2] = pose[:, None, :2] + _turned(machine.reflectors_m[:3, :2], pose[:, 2])
    for a in range(2):
        centre = machine.base_m[2 * a : 2 * a + 2].mean(axis=0)
        arm = _turned((machine.reflectors_m[3 + a, :2] - centre)[None], carriages[:, a, 2])[:, 0]
        out[:, 3 + a, :2] = carriages[:, a, :2] + centre + arm
    return out


def _turned(points_m: Array, angle_rad: Array) -> Array:
    """Points (k, 2) turned by each angle (n,): (n, k, 2)."""
    c, s = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    return np.stack([c * points_m[:, 0] - s * points_m[:, 1], s * points_m[:, 0] + c * points_m[:, 1]], axis=-1)


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
