"""Draws the true machine in space of a seed: errors of its parts within the file's tolerances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import Expansion
from mock_devices.plant.spatial_equilibrium import SpatialPose, quaternion_of
from mock_devices.plant.spatial_machine import Load, TrueSpatialMachine
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings, Payload
from mock_devices.spatial_file import Reflector, SpatialMachine, across

Array = NDArray[np.float64]

_FLOOR_HALF_WIDTH_M = 3.0e-3


def draw_spatial_machine(file: SpatialMachine, settings: MockSettings) -> TrueSpatialMachine:
    """Draw the true machine of a seed. A nest length holds to its certificate's error (first two floor SMRs)."""
    seed, scale, width = settings.seed, settings.error_scale, file.tolerances
    in_plane = np.array([1.0, 1.0, 0.0 if file.planar else 1.0])

    def uniform(purpose: str, half_width: float, *shape: int) -> Array:
        return half_width * generator(seed, purpose).uniform(-1.0, 1.0, shape)

    n, count = len(file.rods), len(file.drives)
    length = uniform("strut length", scale * width["strut_length_m"], n)
    platform = uniform("platform joint", scale * width["platform_joint_m"], n, 3) * in_plane
    base = uniform("base joint", scale * width["base_joint_m"], n, 3) * in_plane
    ln_k = uniform("ln stiffness", width["ln_stiffness"], n + len(file.planes))
    rods = tuple(
        replace(
            rod,
            length_m=rod.length_m + float(length[i]),
            platform_joint_m=rod.platform_joint_m + platform[i],
            base_joint_m=rod.base_joint_m + base[i],
            stiffness_n_per_m=rod.stiffness_n_per_m * math.exp(ln_k[i]),
        )
        for i, rod in enumerate(file.rods)
    )
    tilt = uniform("axis tilt", scale * width.get("axis_tilt_rad", 0.0), count, 2)
    pivot = uniform("pivot", scale * width.get("pivot_m", 0.0), count, 3) * in_plane
    drives = tuple(
        drive
        if drive.kind == "leg"
        else replace(
            drive,
            axis=_tilted(drive.axis, tilt[a], planar=file.planar),
            pivot_m=drive.pivot_m + (pivot[a] if drive.kind == "crank" else 0.0),
        )
        for a, drive in enumerate(file.drives)
    )
    shift = uniform("guide position", scale * width.get("guide_position_m", 0.0), len(file.planes))
    lean = uniform("guide tilt", scale * width.get("guide_tilt_rad", 0.0), len(file.planes), 2)
    planes = tuple(
        replace(
            plane,
            point_m=plane.point_m + shift[i] * plane.normal,
            normal=_tilted(plane.normal, lean[i], planar=False),
            stiffness_n_per_m=plane.stiffness_n_per_m * math.exp(ln_k[n + i]),
        )
        for i, plane in enumerate(file.planes)
    )
    true_file = replace(
        file,
        rods=rods,
        drives=drives,
        planes=planes,
        smrs=_draw_reflectors(file, settings),
        expansion={part: _draw_expansion(part, e, seed) for part, e in file.expansion.items()},
    )
    scales = 1.0 + uniform("drive scale", scale * width["drive_scale"], count)
    return TrueSpatialMachine(
        true_file, scales, tuple(_draw_payload(i, p, seed) for i, p in enumerate(settings.payloads))
    )


def _tilted(direction: Array, tilt: Array, *, planar: bool) -> Array:
    """A direction turned about the two directions across it; of a planar machine about z alone, where that turns it."""
    about = np.array([0.0, 0.0, tilt[0]]) if planar else tilt[0] * across(direction)[0] + tilt[1] * across(direction)[1]
    return SpatialPose(np.zeros(3), quaternion_of(about)).turn @ direction


def _draw_expansion(part: str, stated: Expansion, seed: int) -> Expansion:
    error = stated.u_per_k * float(generator(seed, part).uniform(-1.0, 1.0))
    return replace(stated, coefficient_per_k=stated.coefficient_per_k + error)


def _draw_reflectors(file: SpatialMachine, settings: MockSettings) -> tuple[Reflector, ...]:
    smrs = []
    for i, smr in enumerate(file.smrs):
        width_m = _FLOOR_HALF_WIDTH_M if smr.on == "floor" else file.tolerances["smr_position_m"]
        shift = generator(settings.seed, "smr", i).uniform(-width_m, width_m, 3)
        smrs.append(replace(smr, position_m=smr.position_m + shift))
    nests = [i for i, smr in enumerate(file.smrs) if smr.on == "floor"][:2]
    if len(nests) == 2:
        a, b = nests
        stated = float(np.linalg.norm(file.smrs[b].position_m - file.smrs[a].position_m))
        stated += settings.certificate_sd_m * float(generator(settings.seed, "certificate").standard_normal())
        apart = smrs[b].position_m - smrs[a].position_m
        smrs[b] = replace(smrs[b], position_m=smrs[a].position_m + apart * (stated / float(np.linalg.norm(apart))))
    return tuple(smrs)


def _draw_payload(index: int, payload: Payload, seed: int) -> Load:
    mass, *shift = generator(seed, "payload", index).standard_normal(4)
    centre = np.array(payload.com_m) + payload.u_com_m * np.array(shift)
    return Load(payload.mass_kg + payload.u_mass_kg * float(mass), centre)
