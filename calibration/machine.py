"""The machine: elastic constraints between a platform and its drives, read from TOML.

The format, its signs and its assembly branch are defined in docs/machine.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from calibration.toml_file import InputError, Section, parse_toml, read_text

Array = NDArray[np.float64]
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
PARTS = ("struts", "drives", "base", "platform")
Vector = tuple[float, float, float]


class _Platform(Section):
    tool_point_m: Vector
    moving_mass_kg: float = Field(ge=0.0)
    centre_of_mass_m: Vector


class _Workspace(Section):
    x_m: tuple[float, float]
    y_m: tuple[float, float]


class _Drive(Section):
    name: str
    kind: Literal["slider"]
    axis: Vector
    branch: Literal[-1, 1]
    travel_m: tuple[float, float]


class _Strut(Section):
    name: str
    drive: str
    platform_joint_m: Vector
    base_joint_m: Vector
    length_m: float = Field(gt=0.0)
    stiffness_n_per_m: float = Field(gt=0.0)


class _Tolerances(Section):
    strut_length_m: float = Field(gt=0.0)
    platform_joint_m: float = Field(gt=0.0)
    base_joint_m: float = Field(gt=0.0)
    axis_tilt_rad: float = Field(gt=0.0)
    drive_scale: float = Field(gt=0.0)
    ln_stiffness: float = Field(gt=0.0)
    smr_position_m: float = Field(gt=0.0)


class _Expansion(Section):
    coefficient_per_k: float
    u_per_k: float = Field(ge=0.0)
    sensor: str


class _Smr(Section):
    name: str
    on: str
    position_m: Vector


class MachineFile(Section):
    """The machine file as it stands on disk."""

    format: Literal[1]
    name: str
    degrees_of_freedom: tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...]
    gravity_m_per_s2: Vector
    reference_temperature_c: float
    platform: _Platform
    workspace: _Workspace
    drives: tuple[_Drive, ...] = Field(min_length=1)
    struts: tuple[_Strut, ...] = Field(min_length=1)
    tolerances: _Tolerances
    expansion: dict[str, _Expansion]
    smrs: tuple[_Smr, ...]

    @field_validator("drives", "struts", "smrs")
    @classmethod
    def _unique_names(cls, parts: tuple[_Drive | _Strut | _Smr, ...]) -> tuple[_Drive | _Strut | _Smr, ...]:
        names = [part.name for part in parts]
        if len(set(names)) != len(names):
            raise ValueError("two parts have the same name")
        return parts


@dataclass(frozen=True)
class Geometry:
    """Everything the equilibrium depends on, with or without errors. Lengths at the reference temperature.

    Shapes: n struts, d drives. platform_joint_m, base_joint_m (n, 3); length_m, stiffness_n_per_m (n,);
    axis (d, 3) (its length is 1: the scale stands apart); scale (d,).
    """

    platform_joint_m: Array
    base_joint_m: Array
    length_m: Array
    stiffness_n_per_m: Array
    axis: Array
    scale: Array


@dataclass(frozen=True)
class Smr:
    """A reflector: on the platform, on the slider of a drive (its index) or on the floor."""

    name: str
    on: Literal["platform", "slider", "floor"]
    drive: int
    position_m: Array


@dataclass(frozen=True)
class Machine:
    """A machine with its nominal geometry.

    dof: indices of the free coordinates among x, y, z, rx, ry, rz. strut_drive (n,): index of each
    strut's drive. branch (d,). travel_m (d, 2). sensors: part to name of its temperature sensor.
    """

    file: MachineFile
    text: str
    name: str
    dof: NDArray[np.intp]
    nominal: Geometry
    strut_names: tuple[str, ...]
    strut_drive: NDArray[np.intp]
    drive_names: tuple[str, ...]
    branch: Array
    travel_m: Array
    tool_point_m: Array
    gravity_m_per_s2: Array
    moving_mass_kg: float
    centre_of_mass_m: Array
    workspace_m: Array
    expansion_per_k: Mapping[str, float]
    u_expansion_per_k: Mapping[str, float]
    sensors: Mapping[str, str]
    reference_temperature_c: float
    smrs: tuple[Smr, ...]

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
    """Read a machine file; InputError in one line if it is not fit."""
    return parse_machine(read_text(path), str(path))


def shipped_machine(name: str) -> Path:
    """Path of a machine that comes with the package; InputError if there is none."""
    folder = Path(__file__).parent / "machines"
    path = folder / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
        raise InputError(f"machine '{name}' is not shipped (known: {known}); give the path of a machine file")
    return path


def parse_machine(text: str, source: str) -> Machine:
    """Build a machine from the text of a machine file; `source` is said in complaints."""
    file = parse_toml(text, MachineFile, source)
    drive_names = tuple(d.name for d in file.drives)
    for strut in file.struts:
        if strut.drive not in drive_names:
            raise InputError(f"{source}: strut '{strut.name}' names the unknown drive '{strut.drive}'")
    for drive in file.drives:
        if abs(np.linalg.norm(drive.axis) - 1.0) > 1e-9:
            raise InputError(f"{source}: axis of drive '{drive.name}' is not of length 1")
    if set(file.expansion) != set(PARTS):
        wrong = sorted(set(PARTS) ^ set(file.expansion))[0]
        raise InputError(f"{source}: [expansion.{wrong}] is missing or unknown; the parts are {', '.join(PARTS)}")
    return Machine(
        file=file,
        text=text,
        name=file.name,
        dof=np.array([COORDINATES.index(c) for c in file.degrees_of_freedom]),
        nominal=_nominal(file),
        strut_names=tuple(s.name for s in file.struts),
        strut_drive=np.array([drive_names.index(s.drive) for s in file.struts]),
        drive_names=drive_names,
        branch=np.array([float(d.branch) for d in file.drives]),
        travel_m=np.array([d.travel_m for d in file.drives]),
        tool_point_m=np.array(file.platform.tool_point_m),
        gravity_m_per_s2=np.array(file.gravity_m_per_s2),
        moving_mass_kg=file.platform.moving_mass_kg,
        centre_of_mass_m=np.array(file.platform.centre_of_mass_m),
        workspace_m=np.array([file.workspace.x_m, file.workspace.y_m]),
        expansion_per_k={part: file.expansion[part].coefficient_per_k for part in PARTS},
        u_expansion_per_k={part: file.expansion[part].u_per_k for part in PARTS},
        sensors={part: file.expansion[part].sensor for part in PARTS},
        reference_temperature_c=file.reference_temperature_c,
        smrs=tuple(_smr(s, drive_names, source) for s in file.smrs),
    )


def _nominal(file: MachineFile) -> Geometry:
    return Geometry(
        platform_joint_m=np.array([s.platform_joint_m for s in file.struts]),
        base_joint_m=np.array([s.base_joint_m for s in file.struts]),
        length_m=np.array([s.length_m for s in file.struts]),
        stiffness_n_per_m=np.array([s.stiffness_n_per_m for s in file.struts]),
        axis=np.array([d.axis for d in file.drives]),
        scale=np.ones(len(file.drives)),
    )


def _smr(smr: _Smr, drive_names: tuple[str, ...], source: str) -> Smr:
    position = np.array(smr.position_m)
    if smr.on == "platform":
        return Smr(smr.name, "platform", -1, position)
    if smr.on == "floor":
        return Smr(smr.name, "floor", -1, position)
    if smr.on in drive_names:
        return Smr(smr.name, "slider", drive_names.index(smr.on), position)
    raise InputError(f"{source}: SMR '{smr.name}' is on '{smr.on}'; use 'platform', 'floor' or a drive's name")
