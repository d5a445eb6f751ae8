"""The machine: elastic constraints between a platform and its drives, read from TOML.

The format, its signs and its assembly branch are defined in docs/reference/machine.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.base.toml_file import parse_toml
from calibration.machine.machine_file import GuideEntry, LoadCase, MachineFile

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
PARTS = ("struts", "drives", "base", "platform")
FIXED = -1  # the drive of a strut that no drive moves
DriveKind = Literal["slider", "leg", "crank"]


@dataclass(frozen=True)
class Geometry:
    """Everything the equilibrium depends on, with or without errors. Lengths at the reference temperature.

    Shapes: s struts, g guide planes (a line is two), c = s + g constraints, d drives.
    platform_joint_m, base_joint_m (s, 3): a joint on a crank is relative to its pivot; length_m (s,);
    stiffness_n_per_m (c,); axis (d, 3) of length 1 (zero for a leg); pivot_m (d, 3) (zero but for cranks);
    scale (d,); guide_point_m, guide_normal (g, 3).
    """

    platform_joint_m: Array
    base_joint_m: Array
    length_m: Array
    stiffness_n_per_m: Array
    axis: Array
    pivot_m: Array
    scale: Array
    guide_point_m: Array
    guide_normal: Array


@dataclass(frozen=True)
class Smr:
    """A reflector: on the platform, on what a drive carries (its index) or on the floor.

    facing (3,): where it looks, on what carries it; None: it is seen from everywhere.
    """

    name: str
    on: Literal["platform", "slider", "floor"]
    drive: int
    position_m: Array
    facing: Array | None = None
    acceptance_rad: float = 0.5


@dataclass(frozen=True)
class Machine:
    """A machine with its nominal geometry.

    dof: indices of the free coordinates among x, y, z, rx, ry, rz. commanded: those of them that the drives
    are to command. strut_drive (s,): index of each strut's drive or FIXED. guide_joint (g,): the
    strut whose platform joint a plane holds; guide_turns (g, k, 3): directions about which the plane may be tilted.
    branch (d,). travel (d, 2): limits of the drive coordinates, m (rad for a crank). workspace (6, 2): box of the
    tool point and orientation. sensors: part to name of its temperature sensor.
    """

    file: MachineFile
    text: str
    name: str
    dof: NDArray[np.intp]
    commanded: NDArray[np.intp]
    nominal: Geometry
    strut_names: tuple[str, ...]
    strut_drive: NDArray[np.intp]
    guide_names: tuple[str, ...]
    guide_joint: NDArray[np.intp]
    guide_turns: tuple[Array, ...]
    drive_names: tuple[str, ...]
    drive_kinds: tuple[DriveKind, ...]
    branch: Array
    travel: Array
    tool_point_m: Array
    gravity_m_per_s2: Array
    moving_mass_kg: float
    centre_of_mass_m: Array
    workspace: Array
    expansion_per_k: Mapping[str, float]
    u_expansion_per_k: Mapping[str, float]
    sensors: Mapping[str, str]
    reference_temperature_c: float
    smrs: tuple[Smr, ...]
    load_cases: tuple[LoadCase, ...]

    @property
    def commanded_limits(self) -> Array:
        """Limits (k, 2) of the commanded coordinates, m and rad."""
        return self.workspace[self.commanded]

    @property
    def force_limit_n(self) -> Array:
        """Largest force (s,) of each strut; infinite where the file gives none."""
        return np.array([math.inf if s.force_limit_n is None else s.force_limit_n for s in self.file.struts])

    @property
    def planar(self) -> bool:
        """Whether the platform moves in the plane z = 0 only."""
        return not np.any(np.isin(self.dof, [2, 3, 4]))

    def crank_arm_m(self, drive: int) -> float:
        """Longest arm of a crank: from its axis to a joint that it carries."""
        joints = self.nominal.base_joint_m[self.strut_drive == drive]
        return float(np.max(np.linalg.norm(np.cross(self.nominal.axis[drive], joints), axis=1)))

    @cached_property
    def arms_m(self) -> Array:
        """Metres (d,) at each drive's joint for a unit of its coordinate."""
        kinds = enumerate(self.drive_kinds)
        return np.array([self.crank_arm_m(drive) if kind == "crank" else 1.0 for drive, kind in kinds])

    @property
    def rotary_drives(self) -> tuple[str, ...]:
        """Names of the drives whose coordinate is an angle."""
        return tuple(name for name, kind in zip(self.drive_names, self.drive_kinds, strict=True) if kind == "crank")

    @property
    def redundantly_actuated(self) -> bool:
        """Whether there are more drives than coordinates for them to command: they must agree with one another."""
        return len(self.drive_names) > len(self.commanded)

    @property
    def redundancy(self) -> int:
        """Constraints beyond the free coordinates."""
        return len(self.strut_names) + len(self.guide_names) - len(self.dof)

    def smr(self, name: str) -> Smr:
        """The reflector of that name; InputError if there is none."""
        for smr in self.smrs:
            if smr.name == name:
                return smr
        raise InputError(f"machine {self.name}: no SMR '{name}'; known: {', '.join(s.name for s in self.smrs)}")

    def expansion_factors(self, temperatures_c: Mapping[str, Array]) -> dict[str, Array]:
        """Length factor 1 + alpha (T - T_ref) of each part, from the temperatures of its sensor, shape (n,)."""
        missing = [s for s in self.sensors.values() if s not in temperatures_c]
        if missing:
            raise InputError(f"machine {self.name}: no temperature '{missing[0]}' in the data; map it in the rig file")
        return {
            part: 1.0 + self.expansion_per_k[part] * (np.asarray(temperatures_c[sensor]) - self.reference_temperature_c)
            for part, sensor in self.sensors.items()
        }


def load_machine(path: Path) -> Machine:
    """Read a machine file. Raises InputError, in one line, if it is invalid."""
    return parse_machine(read_text(path), str(path))


def shipped_machines() -> tuple[str, ...]:
    """Names of the machines that come with the package."""
    return tuple(sorted(p.stem for p in (Path(__file__).parent / "data").glob("*.toml")))


def shipped_machine(name: str) -> Path:
    """Path of a machine that comes with the package; InputError if there is none."""
    if name not in shipped_machines():
        raise InputError(
            f"machine '{name}' is not shipped (known: {', '.join(shipped_machines())}); give the path of a machine file"
        )
    return Path(__file__).parent / "data" / f"{name}.toml"


def parse_machine(text: str, source: str) -> Machine:
    """Build a machine from the text of a machine file; messages begin with `source`."""
    file = parse_toml(text, MachineFile, source)
    if set(file.expansion) != set(PARTS):
        wrong = sorted(set(PARTS) ^ set(file.expansion))[0]
        raise InputError(f"{source}: [expansion.{wrong}] is missing or unknown; the parts are {', '.join(PARTS)}")
    drive_names = tuple(d.name for d in file.drives)
    planes = [plane for guide in file.guides for plane in _planes(guide)]
    strut_names = [s.name for s in file.struts]
    free = [COORDINATES.index(c) for c in file.degrees_of_freedom]
    commanded = file.commanded or file.degrees_of_freedom[: len(file.drives)]
    return Machine(
        file=file,
        text=text,
        name=file.name,
        dof=np.array(sorted(free), dtype=np.intp),
        commanded=np.array(sorted(COORDINATES.index(c) for c in commanded), dtype=np.intp),
        nominal=_nominal(file, planes),
        strut_names=tuple(strut_names),
        strut_drive=np.array([FIXED if s.drive is None else drive_names.index(s.drive) for s in file.struts]),
        guide_names=tuple(p.name for p in planes),
        guide_joint=np.array([strut_names.index(p.joint) for p in planes], dtype=np.intp),
        guide_turns=tuple(p.turns for p in planes),
        drive_names=drive_names,
        drive_kinds=tuple(d.kind for d in file.drives),
        branch=np.array([1.0 if d.kind == "leg" else float(d.branch) for d in file.drives]),
        travel=np.array([d.travel for d in file.drives]),
        tool_point_m=np.array(file.platform.tool_point_m),
        gravity_m_per_s2=np.array(file.gravity_m_per_s2),
        moving_mass_kg=file.platform.moving_mass_kg,
        centre_of_mass_m=np.array(file.platform.centre_of_mass_m),
        workspace=np.array([file.workspace.limits(c) for c in ("x", "y", "z", "rx", "ry", "rz")]),
        expansion_per_k={part: file.expansion[part].coefficient_per_k for part in PARTS},
        u_expansion_per_k={part: file.expansion[part].u_per_k for part in PARTS},
        sensors={part: file.expansion[part].sensor for part in PARTS},
        reference_temperature_c=file.reference_temperature_c,
        smrs=_smrs(file, source),
        load_cases=file.load_cases,
    )


@dataclass(frozen=True)
class _Plane:
    """One constraint of a guide: normal, and the directions about which it may be tilted."""

    name: str
    joint: str
    point_m: Array
    normal: Array
    turns: Array
    stiffness_n_per_m: float


def across(direction: Array) -> Array:
    """Two unit vectors (2, 3) across a direction, along the machine's axes where the direction is."""
    least, middle = np.argsort(np.abs(direction), kind="stable")[:2]
    first = np.eye(3)[min(least, middle)]
    first = first - (first @ direction) * direction
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def _planes(guide: GuideEntry) -> list[_Plane]:
    point, direction = np.array(guide.point_m), np.array(guide.direction)
    a, b = across(direction)
    if guide.kind == "plane":
        return [_Plane(guide.name, guide.joint, point, direction, np.array([a, b]), guide.stiffness_n_per_m)]
    # A turn of either plane about the line itself moves nothing: each may be tilted about the other's normal only.
    return [
        _Plane(f"{guide.name}.1", guide.joint, point, a, b[None], guide.stiffness_n_per_m),
        _Plane(f"{guide.name}.2", guide.joint, point, b, a[None], guide.stiffness_n_per_m),
    ]


def _nominal(file: MachineFile, planes: list[_Plane]) -> Geometry:
    return Geometry(
        platform_joint_m=np.array([s.platform_joint_m for s in file.struts]),
        base_joint_m=np.array([s.base_joint_m for s in file.struts]),
        length_m=np.array([s.length_m for s in file.struts]),
        stiffness_n_per_m=np.array(
            [s.stiffness_n_per_m for s in file.struts] + [p.stiffness_n_per_m for p in planes],
        ),
        axis=np.array([(0.0, 0.0, 0.0) if d.kind == "leg" else d.axis for d in file.drives]),
        pivot_m=np.array([d.pivot_m if d.kind == "crank" else (0.0, 0.0, 0.0) for d in file.drives]),
        scale=np.ones(len(file.drives)),
        guide_point_m=np.array([p.point_m for p in planes]).reshape(-1, 3),
        guide_normal=np.array([p.normal for p in planes]).reshape(-1, 3),
    )


def _smrs(file: MachineFile, source: str) -> tuple[Smr, ...]:
    carriers = {d.name: (i, d.kind) for i, d in enumerate(file.drives)}
    smrs = []
    for entry in file.smrs:
        position = np.array(entry.position_m)
        looks = (None if entry.facing is None else np.array(entry.facing), entry.acceptance_rad)
        if entry.on == "platform":
            smrs.append(Smr(entry.name, "platform", FIXED, position, *looks))
        elif entry.on == "floor":
            smrs.append(Smr(entry.name, "floor", FIXED, position, *looks))
        elif entry.on not in carriers:
            raise InputError(
                f"{source}: SMR '{entry.name}' is on '{entry.on}'; use 'platform', 'floor' or a drive's name"
            )
        elif carriers[entry.on][1] == "leg":
            raise InputError(f"{source}: SMR '{entry.name}' is on the leg '{entry.on}'; put it on the platform")
        else:
            smrs.append(Smr(entry.name, "slider", carriers[entry.on][0], position, *looks))
    return tuple(smrs)
