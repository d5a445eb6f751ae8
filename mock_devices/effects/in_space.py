"""Effects for machines in space: which of the catalogue their plant has, and what these may know of such a machine.

An effect knows drives, struts and reflectors by `MachineFile`, which is planar: travels (of a crank times its arm, so
that all sizes stay metres), lengths, names, masses. Directions that it gives are turned into those of the machine by
`mock_devices.plant.spatial_effects`; the drives' axes lie along the first axis of the view.
"""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectChoice
from mock_devices.effects.catalogue import EffectError, check, spec_of
from mock_devices.machine_file import MachineFile, Slider, Smr, Strut, Tolerances
from mock_devices.spatial_file import GROUND, SpatialMachine

ALL: tuple[str, ...] = ()  # every variant of an effect
# Their floor lies across the second axis of the frame, which points up in planar machines only.
NOT_OF_SPACE = ("power_law", "cold_floor")
# A platform that two sliders in a plane move, and forces by the angles of its struts.
OF_PLANE = ("sloshing", "hanging_chain", "landed_counterweight", "guide_pressed")
OF_SLIDERS = (  # what a guide, a linear motor or a carriage does
    "guide_straightness", "guide_angular", "joint_spacing",
    "loose_bolt", "air_bearing_lift", "oil_film", "lubrication_pulse", "magnet_detent", "guide_wear",
    "bedding_in", "chain_on_carriage", "dragged_seat",
)  # fmt: skip
TURNING = ("guide_angular", "loose_bolt", "chain_on_carriage")  # of a carriage about the middle of its joints
OUTSIDE = (
    "cable_drag", "dry_cable_drag", "payload_shift", "spindle_vibration", "crane_tilt", "humidity_swelling",
    "hose_moment", "loose_bolt", "air_bearing_lift", "oil_film", "lubrication_pulse", "magnet_detent", "damaged_tooth",
    "hunting", "circle_error", "lobed_joint", "guide_wear",
    "leaning_block", "brake_drop", "bedding_in", "dark_tracks", "creeping_thread", "clipped_beam",
    "reference_range", "circle_eccentricity", "tilted_axis",
    "bearing_wobble", "stiff_hose", "floating_ball", "chain_on_carriage",
    "cyclic_range", "dragged_seat", "toothed_brake",
    "stuck_bits", "maxwell_strap", "flipping_fork", "chance_of_balls",
    "lost_fringes", "tacky_film", "stepping_collar", "every_other_stop",
    "switched_gain", "rung_by_other", "rounded_ways",
    "catching_hook", "stay_cable", "scheduled_gain",
    "two_faces", "aneroid_bellows", "neighbours_cam", "rounded_ratio",
    "play_of_tangent_screw", "retied_rope", "sealed_tube", "product_of_ways",
)  # fmt: skip
IN_SPACE: dict[str, tuple[str, ...]] = {
    "backlash": ALL,
    "friction_windup": tuple(v for v in spec_of("friction_windup").variants if v not in OF_PLANE),
    "screw_cumulative_error": ALL,
    "screw_periodic_error": ALL,
    "encoder_interpolation": ALL,
    "servo_settling": ALL,
    "latency": ALL,
    "axis_coupling": ALL,
    "drive_scale": ALL,
    "guide_straightness": ALL,
    "guide_angular": ALL,
    "screw_thermal_growth": ALL,
    "link_thermal_growth": ALL,
    "expansion_coefficient": (
        "screws",
        "nickel_steel",
        "late_growth",
        "two_batches",
        "martensite",
        "curie_kink",
        "stressed_alloy",
        "graded_screw",
        "strained_by_rate",
        "grows_for_good",
        "ratcheting_metal",
    ),
    "link_stiffness": (
        "softer",
        "softens_with_load",
        "loosening",
        "creeping_bond",
        "warm_adhesive",
        "seated_taper",
        "fractional_rubber",
        "snapped_truss",
        "closed_spring",
        "opening_crack",
        "chance_contacts",
    ),
    "joint_clearance": ("gravity_seated", "friction_held"),
    "joint_spacing": ALL,
    "link_self_weight": ALL,
    "payload": tuple(v for v in spec_of("payload").variants if v not in OF_PLANE),
    "tracker_drift": ALL,
    "refraction": tuple(v for v in spec_of("refraction").variants if v not in NOT_OF_SPACE),
    "smr_reseat": ALL,
    "smr_offset": ALL,
    **dict.fromkeys(OUTSIDE, ALL),
}
NOT_OF_CRANKS = ("screw_thermal_growth", "expansion_coefficient", "friction_windup")  # a crank has no screw
BY_WEIGHT = ("payload", "payload_shift", "joint_clearance", "link_self_weight")  # nothing where none acts in the plane


def check_in_space(choice: EffectChoice, file: SpatialMachine) -> None:
    """Raise EffectError for an effect that makes no sense for a machine's parts, or that its plant does not have."""
    spec = check(choice, view_of(file))
    if spec.name not in IN_SPACE:
        known = ", ".join(name for name in IN_SPACE if _makes_no_sense(name, file) is None)
        raise EffectError(f"effect {spec.name}: the mock of {file.name} does not have it; it has {known}")
    if (why := _makes_no_sense(spec.name, file)) is not None:
        raise EffectError(f"effect {spec.name}: {why}")
    variants = IN_SPACE[spec.name] or spec.variants
    if (choice.variant or spec.variants[0]) not in variants:
        raise EffectError(
            f"effect {spec.name}: of {file.name} the mock has the variants {', '.join(variants)}; give variant=..."
        )


def _makes_no_sense(name: str, file: SpatialMachine) -> str | None:
    """Why a machine cannot have an effect of IN_SPACE."""
    if name in NOT_OF_CRANKS and has_cranks(file):
        return f"the drives of {file.name} are cranks, which have no screws"
    if name in OF_SLIDERS and any(drive.kind != "slider" for drive in file.drives):
        return f"the drives of {file.name} are no sliders, which alone have guides"
    if name in TURNING and min(sum(r.drive == a for r in file.rods) for a in range(len(file.drives))) < 2:
        return f"a slider of {file.name} carries one joint, which does not move when the slider turns about it"
    if name in BY_WEIGHT and not _weighs_in_plane(file):
        return f"{file.name} moves across gravity; no weight acts along what it moves in"
    return None


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


def require_only_known(deviation: Deviation) -> None:
    """AssertionError where an effect changed what the plant in space does not take from it."""
    planar = (deviation.carriage_compliance, deviation.carriage_hardening)
    if any(np.any(part) for part in planar) or deviation.laws:
        raise AssertionError("an effect of planar machines acts on a machine in space")
