"""The mock's own reader of the machine file (docs/reference/machine.md).

Planar vectors are complex numbers, x + iy in metres: the plant is planar and this is shorter than arrays.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
Vector3 = tuple[float, float, float]

_TOP = {
    "format", "name", "degrees_of_freedom", "gravity_m_per_s2", "reference_temperature_c", "platform",
    "workspace", "drives", "struts", "tolerances", "expansion", "smrs", "commanded", "load_cases",
}  # fmt: skip
_MOST_BYTES = 1_000_000
_LONG_KEY = re.compile(r"""(?<![A-Za-z0-9_"'-])(?:[A-Za-z0-9_"'-]++[ \t]*+\.[ \t]*+){15,}""")
_EXPANDING = ("struts", "drives", "base", "platform")


class MachineFileError(ValueError):
    """The machine file is not one that the mock plant can stand for; says why."""


@dataclass(frozen=True)
class Slider:
    """A drive: joints and SMRs ride along `axis` (unit, planar); `travel_m` bounds its coordinate."""

    name: str
    axis: complex
    branch: int
    travel_m: tuple[float, float]


@dataclass(frozen=True)
class Strut:
    """A two-force member; `drive` is the index of its slider, joints in their own frames."""

    name: str
    drive: int
    platform_joint: complex
    base_joint: complex
    length_m: float
    stiffness_n_per_m: float


@dataclass(frozen=True)
class Smr:
    """A reflector: on the platform, on a slider (by its name) or on the floor."""

    name: str
    on: str
    position_m: Vector3


@dataclass(frozen=True)
class Tolerances:
    """Half-widths of the uniform distributions that the true errors come from."""

    strut_length_m: float
    platform_joint_m: float
    base_joint_m: float
    axis_tilt_rad: float
    drive_scale: float
    ln_stiffness: float
    smr_position_m: float


@dataclass(frozen=True)
class Expansion:
    """Coefficient of a part, its standard uncertainty and the sensor that tells its temperature."""

    coefficient_per_k: float
    u_per_k: float
    sensor: str


@dataclass(frozen=True)
class MachineFile:
    """A planar machine as its file states it. `expansion` is keyed struts, drives, base, platform."""

    name: str
    gravity: complex
    reference_temperature_c: float
    tool_point: complex
    moving_mass_kg: float
    centre_of_mass: complex
    workspace_m: tuple[tuple[float, float], tuple[float, float]]
    sliders: tuple[Slider, ...]
    struts: tuple[Strut, ...]
    tolerances: Tolerances
    expansion: dict[str, Expansion]
    smrs: tuple[Smr, ...]


def read_machine_file(path: str | Path) -> MachineFile:
    """Read a machine file; raises MachineFileError where it is not a planar machine of two or more sliders."""
    return read_machine(path, _machine)


def read_machine(path: str | Path, make: Callable[[dict[str, Any]], T]) -> T:
    """What `make` makes of the tables of a machine file. Raises MachineFileError, also where it finds one malformed."""
    try:
        return make(tomllib.loads(read_machine_text(path)))
    except RecursionError as error:
        raise MachineFileError(f"{path}: nested too deep for a machine file") from error
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise MachineFileError(f"{path}: missing or malformed entry: {error!r}") from error
    except ValueError as error:
        raise MachineFileError(f"{path}: {error}") from error


def read_machine_text(path: str | Path) -> str:
    """The text of a machine file: a plain file, not larger than any of ours. Raises MachineFileError, OSError."""
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise MachineFileError(f"{path}: not a plain file")
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise MachineFileError(f"{path}: larger than {_MOST_BYTES} bytes; not a machine file")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise MachineFileError(f"{path}: not UTF-8 text") from error
    if _LONG_KEY.search(text):  # tomllib takes time with the square of their parts
        raise MachineFileError(f"{path}: a key of many dotted parts; not a machine file")
    return text


def _machine(raw: dict[str, Any]) -> MachineFile:
    if unknown := set(raw) - _TOP:
        raise ValueError(f"unknown keys: {', '.join(sorted(unknown))}")
    if raw["format"] != 1 or raw["degrees_of_freedom"] != ["x", "y", "rz"]:
        raise ValueError("the mock plant is planar: format 1 with degrees of freedom x, y, rz")
    platform = raw["platform"]
    sliders = tuple(_slider(entry) for entry in raw["drives"])
    index = {slider.name: i for i, slider in enumerate(sliders)}
    expansion = {part: Expansion(**raw["expansion"][part]) for part in _EXPANDING}
    smrs = tuple(_smr(entry, index) for entry in raw["smrs"])
    space = raw["workspace"]
    return MachineFile(
        name=str(raw["name"]),
        gravity=_planar(raw["gravity_m_per_s2"]),
        reference_temperature_c=float(raw["reference_temperature_c"]),
        tool_point=_planar(platform["tool_point_m"]),
        moving_mass_kg=float(platform["moving_mass_kg"]),
        centre_of_mass=_planar(platform["centre_of_mass_m"]),
        workspace_m=(_pair(space["x_m"]), _pair(space["y_m"])),
        sliders=sliders,
        struts=tuple(_strut(entry, index) for entry in raw["struts"]),
        tolerances=Tolerances(**raw["tolerances"]),
        expansion=expansion,
        smrs=smrs,
    )


def _slider(entry: dict[str, Any]) -> Slider:
    if entry["kind"] != "slider":
        raise ValueError(f"drive {entry['name']}: the mock plant knows sliders only")
    axis = _planar(entry["axis"])
    return Slider(entry["name"], axis / abs(axis), int(entry["branch"]), _pair(entry["travel_m"]))


def _strut(entry: dict[str, Any], index: dict[str, int]) -> Strut:
    return Strut(
        name=entry["name"],
        drive=index[entry["drive"]],
        platform_joint=_planar(entry["platform_joint_m"]),
        base_joint=_planar(entry["base_joint_m"]),
        length_m=float(entry["length_m"]),
        stiffness_n_per_m=float(entry["stiffness_n_per_m"]),
    )


def _smr(entry: dict[str, Any], index: dict[str, int]) -> Smr:
    if entry["on"] not in {"platform", "floor", *index}:
        raise ValueError(f"SMR {entry['name']}: there is no {entry['on']}")
    x, y, z = (float(value) for value in entry["position_m"])
    return Smr(entry["name"], entry["on"], (x, y, z))


def _planar(vector: list[float]) -> complex:
    x, y, _ = vector
    return complex(x, y)


def _pair(values: list[float]) -> tuple[float, float]:
    low, high = values
    if not low < high:
        raise ValueError(f"{values} is not a range")
    return float(low), float(high)
