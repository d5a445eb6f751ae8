"""A machine file as arrays, and the true geometry of one machine that was built by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.nominal import Description

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ON_PLATFORM, ON_FLOOR = -1, -2  # what carries a reflector, where it is no drive
GROUPS = ("struts", "drives", "base", "platform")  # what expands


@dataclass(frozen=True)
class Geometry:
    """Parameters of a machine with s struts, d drives and n reflectors, and of its station's frame.

    Names are those of the machine file's tolerances.
    """

    strut_length_m: Array  # (s,)
    platform_joint_m: Array  # (s, 3)
    base_joint_m: Array  # (s, 3)
    drive_scale: Array  # (d,)
    axis_tilt_rad: Array  # (d, 2), about the direction across the axis and about the plane's normal
    ln_stiffness: Array  # (s,)
    smr_position_m: Array  # (n, 3)
    station: Array  # (6,), shift in m and turn in rad

    def changed(self, name: str, index: tuple[int, ...], step: float) -> Geometry:
        """With one number changed by a step."""
        values = getattr(self, name).copy()
        values[index] += step
        return replace(self, **{name: values})


PARAMETERS = tuple(field.name for field in fields(Geometry))


@dataclass(frozen=True)
class Machine:
    """A nominal machine; where all drives are legs, there are no carriages."""

    description: Description
    planar: bool
    legs: bool
    drives: list[str]
    struts: list[str]
    reflectors: list[str]
    drive_of_strut: Indices  # (s,)
    carriers: Indices  # (n,), ON_PLATFORM, ON_FLOOR or the drive's number
    free: list[int]  # of x, y, z, rx, ry, rz
    gravity_m_per_s2: Array  # (3,)
    up: Array  # (3,)
    axes: Array  # (d, 3), zero for legs
    branches: Indices  # (d,)
    travel_m: Array  # (d, 2)
    sideways: Array  # (d, 3), across the axis, in the plane of a planar machine
    normals: Array  # (d, 3), across both
    moving_mass_kg: float
    centre_of_mass_m: Array  # (3,)
    tool_point_m: Array  # (3,)
    reference_c: float
    expansion_per_k: Mapping[str, float]  # by group
    tolerances: Mapping[str, float]  # half widths, by parameter
    nominal: Geometry

    @classmethod
    def of(cls, description: Description) -> Machine:
        """The machine of a machine file."""
        drives, struts, smrs = description["drives"], description["struts"], description["smrs"]
        names = [drive["name"] for drive in drives]
        planar = description["degrees_of_freedom"] == ["x", "y", "rz"]
        legs = drives[0]["kind"] == "leg"
        drive_of_strut = np.array([names.index(strut["drive"]) for strut in struts])
        gravity = np.array(description["gravity_m_per_s2"])
        axes = np.array([drive.get("axis", [0, 0, 0]) for drive in drives], float)
        nominal = Geometry(
            strut_length_m=np.array([strut["length_m"] for strut in struts]),
            platform_joint_m=np.array([strut["platform_joint_m"] for strut in struts]),
            base_joint_m=np.array([strut["base_joint_m"] for strut in struts]),
            drive_scale=np.ones(len(drives)),
            axis_tilt_rad=np.zeros((len(drives), 2)),
            ln_stiffness=np.log([strut["stiffness_n_per_m"] for strut in struts]),
            smr_position_m=np.array([smr["position_m"] for smr in smrs]),
            station=np.zeros(6),
        )
        sideways, normals = np.zeros_like(axes), np.zeros_like(axes)
        if not legs:
            bases = np.array([nominal.base_joint_m[drive_of_strut == drive].mean(0) for drive in range(len(drives))])
            for drive, axis in enumerate(axes):
                sideways[drive], normals[drive] = _across(axis, bases[drive], planar=planar)
        fixed = {"platform": ON_PLATFORM, "floor": ON_FLOOR}
        return cls(
            description=description,
            planar=planar,
            legs=legs,
            drives=names,
            struts=[strut["name"] for strut in struts],
            reflectors=[smr["name"] for smr in smrs],
            drive_of_strut=drive_of_strut,
            carriers=np.array([fixed[smr["on"]] if smr["on"] in fixed else names.index(smr["on"]) for smr in smrs]),
            free=[0, 1, 5] if planar else [0, 1, 2, 3, 4, 5],
            gravity_m_per_s2=gravity,
            up=-gravity / np.linalg.norm(gravity),
            axes=axes,
            branches=np.array([drive.get("branch", 1) for drive in drives]),
            travel_m=np.array([drive["travel_m"] for drive in drives]),
            sideways=sideways,
            normals=normals,
            moving_mass_kg=description["platform"]["moving_mass_kg"],
            centre_of_mass_m=np.array(description["platform"]["centre_of_mass_m"]),
            tool_point_m=np.array(description["platform"]["tool_point_m"]),
            reference_c=description["reference_temperature_c"],
            expansion_per_k={group: description["expansion"][group]["coefficient_per_k"] for group in GROUPS},
            tolerances={name: description["tolerances"].get(name, 0.0) for name in PARAMETERS if name != "station"},
            nominal=nominal,
        )

    def may_err(self, name: str) -> NDArray[np.bool_]:
        """Which numbers of a parameter may be in error: those of a planar machine only in its plane."""
        values = getattr(self.nominal, name)
        out = np.full(values.shape, self.tolerances.get(name, 1.0) > 0.0)
        if self.planar and name in ("platform_joint_m", "base_joint_m"):
            out[:, 2] = False
        if self.planar and name == "axis_tilt_rad":
            out[:, 0] = False
        return out

    def draw_true(self, rng: np.random.Generator) -> Geometry:
        """A true machine: deviations uniform within the tolerances."""
        true = {}
        for name, half_width in self.tolerances.items():
            values = getattr(self.nominal, name)
            deviations = rng.uniform(-1, 1, values.shape) * half_width
            true[name] = values + np.where(self.may_err(name), deviations, 0.0)
        return replace(self.nominal, **true)

    def drives_at(self, positions_m: Array, rotations: Array) -> Array:
        """Nominal drive coordinates (r, d) of poses (r, 3), (r, 3, 3), which close the first strut of each drive."""
        out = np.zeros((len(positions_m), len(self.drives)))
        for drive, (axis, branch) in enumerate(zip(self.axes, self.branches, strict=True)):
            strut = np.flatnonzero(self.drive_of_strut == drive)[0]
            length = self.nominal.strut_length_m[strut]
            joints = positions_m + rotations @ self.nominal.platform_joint_m[strut]
            ways = joints - self.nominal.base_joint_m[strut]
            if self.legs:
                out[:, drive] = np.linalg.norm(ways, axis=1) - length
            else:
                along = ways @ axis
                out[:, drive] = along + branch * np.sqrt(length**2 - ((ways - along[:, None] * axis) ** 2).sum(1))
        return out

    def poses_of(self, tool_poses: Array) -> Array:
        """Poses (r, 6) of the platform's origin that bring the tool point to (r, 6): m, and rad as rotation vectors."""
        out = tool_poses.copy()
        out[:, :3] -= rotations_of(tool_poses[:, 3:]) @ self.tool_point_m
        return out


def rotations_of(vectors: Array) -> Array:
    """Rotation matrices (r, 3, 3) of rotation vectors (r, 3), by Rodrigues' formula; a series near zero."""
    angles = np.linalg.norm(vectors, axis=1)[:, None, None]
    skew = np.zeros((len(vectors), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    skew = skew - skew.transpose(0, 2, 1)
    first = np.where(angles > 1e-6, np.sin(angles) / np.maximum(angles, 1e-12), 1 - angles**2 / 6)
    second = np.where(angles > 1e-6, (1 - np.cos(angles)) / np.maximum(angles, 1e-12) ** 2, 0.5)
    return np.eye(3) + first * skew + second * skew @ skew


def _across(axis: Array, base: Array, *, planar: bool) -> tuple[Array, Array]:
    """Two directions across a slider's axis: in the plane and its normal, or outwards and tangential."""
    if planar:
        return np.array([axis[1], -axis[0], 0]), np.array([0.0, 0.0, 1.0])
    outwards = base - base @ axis * axis
    outwards /= np.linalg.norm(outwards)
    return outwards, np.cross(axis, outwards)
