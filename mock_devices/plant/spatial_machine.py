"""A machine in space as it truly is: the file's machine with errors drawn within its tolerances, and where parts stand.

Not modelled: friction, backlash and flexibility of joints and drives, flexible platform, hysteresis of any kind; guides
are straight but for what effects add.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_devices.plant.spatial_equilibrium import (
    SMALL_STEP,
    Assembly,
    SpatialPose,
    cross,
    equilibrium,
    pose_of,
    quaternion_of,
)
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.spatial_file import GROUND, Actuator, Rod, SpatialMachine

Array = NDArray[np.float64]

_APART_M = 1e-6  # joints that are farther apart than this have a line of their own


@dataclass(frozen=True)
class Load:
    """A mass and its centre (3,) in the platform frame."""

    mass_kg: float
    centre_m: Array


@dataclass(frozen=True)
class Departure:
    """What effects change of a machine at one moment.

    travel (d,) in m or rad, length_m and ln_stiffness (m,) of the rods, smr_m (s, 3) of the reflectors on what carries
    them; the payload's mass and the place (3,) of its centre beyond its own; force_n (d,) that drives hold besides.
    sideways_m, yaw_rad (d,) of sliders (see `Carriage`); platform_m, base_m (m, 3): of joints beside their places;
    load_n, point_m (h, 3): forces on the platform and where; tilt_rad (3,): of the machine against the floor.
    """

    travel: Array
    length_m: Array
    ln_stiffness: Array
    smr_m: Array
    sideways_m: Array
    yaw_rad: Array
    payload_kg: float = 0.0
    payload_shift_m: Array = field(default_factory=lambda: np.zeros(3))
    force_n: Array = field(default_factory=lambda: np.zeros(0))
    platform_m: Array | float = 0.0
    base_m: Array | float = 0.0
    load_n: Array = field(default_factory=lambda: np.zeros((0, 3)))
    point_m: Array = field(default_factory=lambda: np.zeros((0, 3)))
    tilt_rad: Array | None = None


@dataclass(frozen=True)
class Carriage:
    """A slider's directions (3,) in which a guide may lead it astray, and the middle (3,) of its joints.

    `across` its axis, in the plane that its struts span with it in the middle of the workspace; it `turns` about the
    direction in which that takes its joints along the axis, or about the normal of that plane where they lie along it.
    """

    across: Array
    turns: Array
    middle_m: Array


@dataclass(frozen=True)
class TrueSpatialMachine:
    """A machine file's machine with its errors; `scales` are those of the drives, `payloads` by number."""

    file: SpatialMachine
    scales: Array
    payloads: tuple[Load, ...]

    def assembly(
        self,
        drives: Sequence[float],
        payload: int,
        temperatures_c: Mapping[str, float],
        departure: Departure | None = None,
    ) -> Assembly:
        """What holds the platform with the drives at these encoder positions."""
        file, grown = self.file, self._growth(temperatures_c)
        departure = departure or self.as_it_is
        travel = self.scales * np.asarray(drives, dtype=np.float64) + departure.travel
        parts = self._arrays
        length = parts["length_m"] * grown["struts"] + departure.length_m
        length[parts["legs"]] += travel[parts["leg_drives"]] * grown["drives"]
        joint = parts["joint_m"] * grown["platform"] + departure.platform_m
        load = self.payloads[payload]
        mass_kg = np.array([file.moving_mass_kg, load.mass_kg + departure.payload_kg])
        centre_m = np.array([file.centre_of_mass_m, load.centre_m + departure.payload_shift_m]) * grown["platform"]
        foot = np.broadcast_to(departure.base_m, (len(file.rods), 3))
        return Assembly(
            platform_m=joint,
            base_m=np.array(
                [
                    self._carried(rod.drive, rod.base_joint_m + off, travel, grown, departure)
                    for rod, off in zip(file.rods, foot, strict=True)
                ]
            ),
            length_m=length,
            stiffness=parts["stiffness"] * np.exp(departure.ln_stiffness),
            held_m=joint[parts["held"]].reshape(-1, 3),
            point_m=parts["point_m"] * grown["base"],
            normal=parts["normal"],
            plane_stiffness=parts["plane_stiffness"],
            load_n=np.concatenate([mass_kg[:, None] * file.gravity, departure.load_n]),
            centre_m=np.concatenate([centre_m, departure.point_m]),
        )

    @cached_property
    def as_it_is(self) -> Departure:
        """No departure."""
        rods, drives, smrs = len(self.file.rods), len(self.file.drives), len(self.file.smrs)
        of_drives, of_rods = np.zeros(drives), np.zeros(rods)
        return Departure(of_drives, of_rods, of_rods, np.zeros((smrs, 3)), of_drives, of_drives)

    @cached_property
    def _arrays(self) -> dict[str, NDArray[Any]]:
        """What of the machine never changes, as arrays."""
        rods, planes, drives = self.file.rods, self.file.planes, self.file.drives
        legs = [i for i, rod in enumerate(rods) if rod.drive != GROUND and drives[rod.drive].kind == "leg"]
        return {
            "length_m": np.array([rod.length_m for rod in rods]),
            "stiffness": np.array([rod.stiffness_n_per_m for rod in rods]),
            "joint_m": np.array([rod.platform_joint_m for rod in rods]),
            "legs": np.array(legs, dtype=np.intp),
            "leg_drives": np.array([rods[i].drive for i in legs], dtype=np.intp),
            "held": np.array([plane.rod for plane in planes], dtype=np.intp),
            "point_m": np.array([plane.point_m for plane in planes]).reshape(-1, 3),
            "normal": np.array([plane.normal for plane in planes]).reshape(-1, 3),
            "plane_stiffness": np.array([plane.stiffness_n_per_m for plane in planes]),
        }

    def pose(
        self,
        drives: Sequence[float],
        payload: int,
        t_c: Mapping[str, float],
        start: SpatialPose | None = None,
        departure: Departure | None = None,
        small_step: float = SMALL_STEP,
    ) -> SpatialPose:
        """The pose at rest; raises NoEquilibrium, also for one on another assembly branch than the machine's."""
        assembly = self.assembly(drives, payload, t_c, departure)
        begin = start or middle_pose(self.file)
        pose = equilibrium(assembly, begin, self.file.free, is_near=start is not None, small_step=small_step)
        reach = assembly.rods(pose)[0]
        for a, drive in enumerate(self.file.drives):
            first = self._first_rods[a]
            if drive.branch * _side(drive, assembly.base_m[first], reach[first]) < 0.0:
                raise NoEquilibrium(f"drive {drive.name}: the machine has left its assembly branch")
        return pose

    @cached_property
    def _first_rods(self) -> tuple[int, ...]:
        return tuple(
            next(i for i, rod in enumerate(self.file.rods) if rod.drive == a) for a in range(len(self.file.drives))
        )

    def rod_forces_n(self, drives: Sequence[float], payload: int, pose: SpatialPose, t_c: Mapping[str, float]) -> Array:
        """Forces (m,) of the rods at a pose, tension positive."""
        return self.assembly(drives, payload, t_c).rods(pose)[1]

    def loads(
        self,
        drives: Sequence[float],
        payload: int,
        pose: SpatialPose,
        t_c: Mapping[str, float],
        departure: Departure | None = None,
    ) -> tuple[Array, Array]:
        """Forces (m,) of the rods, and what each drive has to hold (d,): N along a slider or leg, N m about a pivot."""
        assembly = self.assembly(drives, payload, t_c, departure)
        reach, force = assembly.rods(pose)
        pull = force[:, None] * reach / np.sqrt((reach**2).sum(axis=1))[:, None]
        out = np.zeros(len(self.file.drives))
        for i, rod in enumerate(self.file.rods):
            if rod.drive == GROUND:
                continue
            drive = self.file.drives[rod.drive]
            if drive.kind == "leg":
                out[rod.drive] += force[i]
            elif drive.kind == "slider":
                out[rod.drive] -= pull[i] @ drive.axis
            else:
                out[rod.drive] -= cross(assembly.base_m[i] - drive.pivot_m, pull[i]) @ drive.axis
        return force, out

    def tool(self, pose: SpatialPose, temperatures_c: Mapping[str, float]) -> Array:
        """Position of the tool point and rotation vector (6,)."""
        place = pose.place(self.file.tool_point_m * self._growth(temperatures_c)["platform"])
        return np.concatenate([place, pose.vector()[3:]])

    def reflectors(
        self,
        pose: SpatialPose,
        drives: Sequence[float],
        temperatures_c: Mapping[str, float],
        departure: Departure | None = None,
    ) -> list[tuple[Array, Array | None]]:
        """Where each reflector is (3,) and where it looks to (3,) or None, in the order of the file."""
        grown = self._growth(temperatures_c)
        departure = departure or self.as_it_is
        travel = self.scales * np.asarray(drives, dtype=np.float64) + departure.travel
        out: list[tuple[Array, Array | None]] = []
        for smr, shift_m in zip(self.file.smrs, departure.smr_m, strict=True):
            facing = smr.facing
            if smr.on == "platform":
                place = pose.place(smr.position_m * grown["platform"] + shift_m)
                facing = None if facing is None else pose.turn @ facing
            elif smr.on == "floor":
                place = smr.position_m + shift_m
            else:
                place = self._carried(smr.drive, smr.position_m + shift_m, travel, grown, departure)
                drive = self.file.drives[smr.drive]
                if facing is not None and drive.kind == "crank":
                    facing = _turned(facing, drive.axis, float(travel[smr.drive]))
            if departure.tilt_rad is not None and smr.on != "floor":
                size = float(np.linalg.norm(departure.tilt_rad))
                place = _turned(place, departure.tilt_rad / max(size, 1e-300), size)
            out.append((place, facing))
        return out

    @cached_property
    def _carriages(self) -> dict[int, Carriage]:
        return {a: carriage_of(self.file, a) for a, drive in enumerate(self.file.drives) if drive.kind == "slider"}

    def _growth(self, temperatures_c: Mapping[str, float]) -> dict[str, float]:
        return {
            part: 1.0 + e.coefficient_per_k * (temperatures_c[e.sensor] - self.file.reference_temperature_c)
            for part, e in self.file.expansion.items()
        }

    def _carried(
        self, drive: int, point_m: Array, travel: Array, grown: Mapping[str, float], departure: Departure
    ) -> Array:
        """Where a point of the base or of a drive is."""
        actuator = None if drive == GROUND else self.file.drives[drive]
        if actuator is None or actuator.kind == "leg":
            return np.asarray(point_m * grown["base"])
        if actuator.kind == "slider":
            place = point_m * grown["base"] + actuator.axis * (travel[drive] * grown["drives"])
            sideways_m, yaw_rad = departure.sideways_m[drive], float(departure.yaw_rad[drive])
            if not sideways_m and not yaw_rad:
                return np.asarray(place)
            carriage = self._carriages[drive]
            arm = (point_m - carriage.middle_m) * grown["base"]
            return np.asarray(place + carriage.across * sideways_m + _turned(arm, carriage.turns, yaw_rad) - arm)
        arm = _turned(point_m, actuator.axis, float(travel[drive]))
        return np.asarray(actuator.pivot_m * grown["base"] + arm * grown["drives"])


def carriage_of(file: SpatialMachine, drive: int) -> Carriage:
    """That of a slider."""
    rods, axis = [rod for rod in file.rods if rod.drive == drive], file.drives[drive].axis
    joints = np.array([rod.base_joint_m for rod in rods])
    middle_m = joints.mean(axis=0)
    if file.planar:
        up = np.array([0.0, 0.0, 1.0])
        return Carriage(np.cross(up, axis), up, middle_m)
    pose = middle_pose(file)
    towards = np.mean([pose.place(rod.platform_joint_m) for rod in rods], axis=0) - middle_m
    across = _unit(towards - axis * (towards @ axis))
    spread = joints[0] - middle_m
    spread = spread - axis * (spread @ axis)
    turns = np.cross(spread, axis) if np.linalg.norm(spread) > _APART_M else np.cross(axis, across)
    return Carriage(across, _unit(turns), middle_m)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def middle_pose(file: SpatialMachine) -> SpatialPose:
    """The pose that has the tool in the middle of the workspace."""
    middle = file.workspace.mean(axis=1)
    pose = pose_of(middle)
    return SpatialPose(pose.p - pose.turn @ file.tool_point_m, pose.quaternion)


def closed_drive(file: SpatialMachine, drive: int, pose: SpatialPose) -> float:
    """Nominal coordinate of a drive that closes its first rod at a pose. Raises NoEquilibrium out of reach."""
    actuator = file.drives[drive]
    rod = next(r for r in file.rods if r.drive == drive)
    joint = pose.place(rod.platform_joint_m)
    if actuator.kind == "leg":
        return float(np.linalg.norm(joint - rod.base_joint_m)) - rod.length_m
    if actuator.kind == "slider":
        apart = joint - rod.base_joint_m
        along = float(apart @ actuator.axis)
        inside = rod.length_m**2 - float(apart @ apart) + along**2
        if inside < 0.0:
            raise NoEquilibrium(f"drive {actuator.name}: its strut does not reach")
        return along + actuator.branch * math.sqrt(inside)
    return _crank_angle(actuator, rod, joint)


def _crank_angle(actuator: Actuator, rod: Rod, joint: Array) -> float:
    """The angle in the travel at which the arm's end is a rod's length from the joint: bisection between turns."""
    towards = joint - actuator.pivot_m

    def gap(angle: float) -> tuple[float, float]:
        arm = _turned(rod.base_joint_m, actuator.axis, angle)
        side = actuator.branch * float(actuator.axis @ cross(arm, towards))
        return float(np.linalg.norm(towards - arm)) - rod.length_m, side

    low, high = actuator.travel
    angles = np.linspace(low - 0.5, high + 0.5, 400)
    gaps = [gap(float(angle)) for angle in angles]
    for (a, (before, _)), (b, (after, side)) in pairwise(zip(angles, gaps, strict=True)):
        if before * after <= 0.0 and side > 0.0:
            left, right = float(a), float(b)
            for _ in range(60):
                middle = 0.5 * (left + right)
                left, right = (middle, right) if gap(middle)[0] * before > 0.0 else (left, middle)
            return 0.5 * (left + right)
    raise NoEquilibrium(f"drive {actuator.name}: its link does not reach")


def _side(drive: Actuator, base: Array, reach: Array) -> float:
    """Positive on branch 1 (docs/reference/machine.md), from the base end of a drive's first rod and its direction."""
    if drive.kind == "slider":
        return float(-drive.axis @ reach)
    if drive.kind == "crank":
        arm = base - drive.pivot_m
        return float(drive.axis @ cross(arm, arm + reach))
    return 1.0


def _turned(point: Array, axis: Array, angle: float) -> Array:
    """A point turned about an axis through the origin."""
    return SpatialPose(np.zeros(3), quaternion_of(axis * angle)).turn @ point
