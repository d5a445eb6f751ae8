"""Effects for machines in space: which of the catalogue their plant has, and what these may know of such a machine.

An effect knows drives, struts and reflectors by `MachineFile`, which is planar. What is used of it here has no
direction: travels (of a crank times its arm, so that all sizes stay metres), lengths, names, masses.
"""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectChoice
from mock_devices.effects.catalogue import EffectError, check, spec_of
from mock_devices.machine_file import MachineFile, Slider, Smr, Strut, Tolerances
from mock_devices.spatial_file import GROUND, SpatialMachine

ALL: tuple[str, ...] = ()  # every variant of an effect
# `power_law`: its floor lies across the second axis of the frame, which points up in planar machines only.
NOT_OF_SPACE = ("power_law",)
IN_SPACE: dict[str, tuple[str, ...]] = {
    "backlash": ALL,
    "screw_cumulative_error": ALL,
    "screw_periodic_error": ALL,
    "encoder_interpolation": ALL,
    "servo_settling": ALL,
    "latency": ALL,
    "axis_coupling": ALL,
    "drive_scale": ALL,
    "screw_thermal_growth": ALL,
    "link_thermal_growth": ALL,
    "expansion_coefficient": ("screws",),
    "link_stiffness": ("softer", "softens_with_load"),
    "payload": ALL,
    "tracker_drift": ALL,
    "refraction": tuple(v for v in spec_of("refraction").variants if v not in NOT_OF_SPACE),
    "smr_reseat": ALL,
    "smr_offset": ALL,
}
NOT_OF_CRANKS = ("screw_thermal_growth", "expansion_coefficient")  # a crank has no screw, and its angle does not grow


def check_in_space(choice: EffectChoice, file: SpatialMachine) -> None:
    """Raise EffectError for an effect that makes no sense for a machine's parts, or that its plant does not have."""
    spec = check(choice, view_of(file))
    if spec.name not in IN_SPACE:
        known = ", ".join(name for name in IN_SPACE if not (has_cranks(file) and name in NOT_OF_CRANKS))
        raise EffectError(f"effect {spec.name}: the mock of {file.name} does not have it; it has {known}")
    if has_cranks(file) and spec.name in NOT_OF_CRANKS:
        raise EffectError(f"effect {spec.name}: the drives of {file.name} are cranks, which have no screws")
    if spec.name == "payload" and not _weighs_in_plane(file):
        raise EffectError(
            f"effect {spec.name}: {file.name} moves across gravity; no weight acts along what it moves in"
        )
    variants = IN_SPACE[spec.name] or spec.variants
    if (choice.variant or spec.variants[0]) not in variants:
        raise EffectError(
            f"effect {spec.name}: of {file.name} the mock has the variants {', '.join(variants)}; give variant=..."
        )


def _weighs_in_plane(file: SpatialMachine) -> bool:
    return not file.planar or bool(np.any(file.gravity[:2]))


def has_cranks(file: SpatialMachine) -> bool:
    """Whether a drive turns."""
    return any(drive.kind == "crank" for drive in file.drives)


def arms_m(file: SpatialMachine) -> Array:
    """Metres (d,) that the end of a crank's arm moves a radian; 1 for drives in metres."""
    return np.array(
        [
            float(np.linalg.norm(np.cross(drive.axis, _first_joint(file, a)))) if drive.kind == "crank" else 1.0
            for a, drive in enumerate(file.drives)
        ]
    )


def _first_joint(file: SpatialMachine, drive: int) -> Array:
    return next(rod.base_joint_m for rod in file.rods if rod.drive == drive)


def view_of(file: SpatialMachine) -> MachineFile:
    """What effects may know of a machine in space. Directions are those of its first two axes and must not matter."""
    arms = arms_m(file)
    sliders = tuple(
        Slider(drive.name, 1.0 + 0.0j, drive.branch, (drive.travel[0] * arm, drive.travel[1] * arm))
        for drive, arm in zip(file.drives, arms.tolist(), strict=True)
    )
    struts = tuple(
        Strut(
            rod.name,
            0 if rod.drive == GROUND else rod.drive,
            complex(rod.platform_joint_m[0], rod.platform_joint_m[1]),
            complex(rod.base_joint_m[0], rod.base_joint_m[1]),
            rod.length_m,
            rod.stiffness_n_per_m,
        )
        for rod in file.rods
    )
    smrs = tuple(
        Smr(
            smr.name,
            file.drives[smr.drive].name if smr.on == "drive" else smr.on,
            (float(smr.position_m[0]), float(smr.position_m[1]), float(smr.position_m[2])),
        )
        for smr in file.smrs
    )
    size = file.workspace
    return MachineFile(
        name=file.name,
        gravity=complex(0.0, -float(np.linalg.norm(file.gravity))),
        reference_temperature_c=file.reference_temperature_c,
        tool_point=complex(file.tool_point_m[0], file.tool_point_m[1]),
        moving_mass_kg=file.moving_mass_kg,
        centre_of_mass=complex(file.centre_of_mass_m[0], file.centre_of_mass_m[1]),
        workspace_m=((float(size[0, 0]), float(size[0, 1])), (float(size[1, 0]), float(size[1, 1]))),
        sliders=sliders,
        struts=struts,
        tolerances=Tolerances(**{name: file.tolerances.get(name, 0.0) for name in Tolerances.__annotations__}),
        expansion=file.expansion,
        smrs=smrs,
    )


def require_only_scalars(deviation: Deviation) -> None:
    """AssertionError where an effect changed what the plant in space does not take from it."""
    planar = (
        deviation.sideways_m, deviation.yaw_rad, deviation.platform_joint_m, deviation.base_joint_m,
        deviation.frame_shift_m, deviation.frame_turn_rad, deviation.moment_nm, deviation.carriage_compliance,
    )  # fmt: skip
    if any(np.any(part) for part in planar) or deviation.loads or deviation.laws:
        raise AssertionError("an effect of planar machines acts on a machine in space")
