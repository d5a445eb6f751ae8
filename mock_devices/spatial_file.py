"""The mock's own reader of machine files of every kind (docs/reference/machine.md): sliders, legs, cranks, guides.

`machine_file` is the older reader of planar machines with two sliders, whose plant has effects; this one is for all
others. Vectors are arrays (3,) in the machine frame, angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import Expansion, read_machine

Array = NDArray[np.float64]

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
MOST_DRIVES = 8
GROUND = -1  # what carries the base end of a strut that no drive moves
_TOP = {
    "format", "name", "degrees_of_freedom", "gravity_m_per_s2", "reference_temperature_c", "platform",
    "workspace", "drives", "struts", "tolerances", "expansion", "smrs", "commanded", "load_cases", "guides",
}  # fmt: skip
_PARTS = ("struts", "drives", "base", "platform")


@dataclass(frozen=True)
class Actuator:
    """A drive: what it is, its axis (zero for a leg), a crank's pivot, and the ends of its travel in m or rad."""

    name: str
    kind: Literal["slider", "leg", "crank"]
    axis: Array
    pivot_m: Array
    branch: int
    travel: tuple[float, float]

    @property
    def unit(self) -> Literal["m", "rad"]:
        """Unit of its coordinate."""
        return "rad" if self.kind == "crank" else "m"


@dataclass(frozen=True)
class Rod:
    """A strut: `drive` carries its base end (GROUND: nothing does). `force_limit_n`: what it must not exceed;
    `diameter_m`: None where it hides nothing."""

    name: str
    drive: int
    platform_joint_m: Array
    base_joint_m: Array
    length_m: float
    stiffness_n_per_m: float
    force_limit_n: float = float("inf")
    diameter_m: float | None = None


@dataclass(frozen=True)
class Plane:
    """What holds the platform joint of a rod in a plane; a line of the file is two of them."""

    name: str
    rod: int
    point_m: Array
    normal: Array
    stiffness_n_per_m: float


@dataclass(frozen=True)
class Reflector:
    """A reflector on the platform, on a drive (its index in `drive`) or on the floor.

    `facing`: the direction that it looks to, on what carries it; None where it is seen from everywhere.
    `acceptance_rad`: the largest angle to that direction from which it is seen.
    """

    name: str
    on: Literal["platform", "drive", "floor"]
    drive: int
    position_m: Array
    facing: Array | None
    acceptance_rad: float


@dataclass(frozen=True)
class SpatialMachine:
    """A machine as its file states it. `free`, `commanded`: numbers of coordinates; `workspace` (6, 2)."""

    name: str
    free: tuple[int, ...]
    commanded: tuple[int, ...]
    gravity: Array
    reference_temperature_c: float
    tool_point_m: Array
    moving_mass_kg: float
    centre_of_mass_m: Array
    workspace: Array
    drives: tuple[Actuator, ...]
    rods: tuple[Rod, ...]
    planes: tuple[Plane, ...]
    smrs: tuple[Reflector, ...]
    tolerances: dict[str, float]
    expansion: dict[str, Expansion]

    @property
    def planar(self) -> bool:
        """Whether it moves in the plane z = 0 only."""
        return not {2, 3, 4} & set(self.free)

    @property
    def redundant(self) -> bool:
        """Whether it has more drives than they are to command coordinates."""
        return len(self.drives) > len(self.commanded)


def read_spatial_machine(path: str | Path) -> SpatialMachine:
    """Read a machine file. Raises MachineFileError."""
    return read_machine(path, _machine)


def _machine(raw: dict[str, Any]) -> SpatialMachine:
    if unknown := set(raw) - _TOP:
        raise ValueError(f"unknown keys: {', '.join(sorted(unknown))}")
    if raw["format"] != 1:
        raise ValueError(f"format {raw['format']} is not known")
    drives = tuple(_actuator(entry) for entry in raw["drives"])
    if not 1 <= len(drives) <= MOST_DRIVES:
        raise ValueError(f"{len(drives)} drives; a mock rig has 1 to {MOST_DRIVES}")
    index = {drive.name: i for i, drive in enumerate(drives)}
    rods = tuple(_rod(entry, index) for entry in raw["struts"])
    free = tuple(sorted(COORDINATES.index(c) for c in raw["degrees_of_freedom"]))
    named = raw.get("commanded") or raw["degrees_of_freedom"][: len(drives)]
    platform = raw["platform"]
    return SpatialMachine(
        name=str(raw["name"]),
        free=free,
        commanded=tuple(sorted(COORDINATES.index(c) for c in named)),
        gravity=_vector(raw["gravity_m_per_s2"]),
        reference_temperature_c=float(raw["reference_temperature_c"]),
        tool_point_m=_vector(platform["tool_point_m"]),
        moving_mass_kg=float(platform["moving_mass_kg"]),
        centre_of_mass_m=_vector(platform["centre_of_mass_m"]),
        workspace=_workspace(raw["workspace"]),
        drives=drives,
        rods=rods,
        planes=tuple(plane for entry in raw.get("guides", ()) for plane in _planes(entry, rods)),
        smrs=tuple(_reflector(entry, index) for entry in raw["smrs"]),
        tolerances={name: float(width) for name, width in raw["tolerances"].items()},
        expansion={part: Expansion(**raw["expansion"][part]) for part in _PARTS},
    )


def _workspace(raw: dict[str, Any]) -> Array:
    keys = [f"{c}_{'rad' if c.startswith('r') else 'm'}" for c in COORDINATES]
    if unknown := set(raw) - set(keys):
        raise ValueError(f"workspace: unknown keys: {', '.join(sorted(unknown))}")
    return np.array([raw.get(key, (0.0, 0.0)) for key in keys], dtype=np.float64)


def _actuator(entry: dict[str, Any]) -> Actuator:
    kind, nothing = entry["kind"], [0.0, 0.0, 0.0]
    if kind not in ("slider", "leg", "crank"):
        raise ValueError(f"drive {entry['name']}: a {kind} is not known")
    axis = _vector(nothing if kind == "leg" else entry["axis"])
    low, high = entry["travel_rad" if kind == "crank" else "travel_m"]
    if not low < high:
        raise ValueError(f"drive {entry['name']}: its travel is not a range")
    return Actuator(
        name=entry["name"],
        kind=kind,
        axis=axis if kind == "leg" else axis / np.linalg.norm(axis),
        pivot_m=_vector(entry["pivot_m"] if kind == "crank" else nothing),
        branch=1 if kind == "leg" else int(entry["branch"]),
        travel=(float(low), float(high)),
    )


def _rod(entry: dict[str, Any], index: dict[str, int]) -> Rod:
    return Rod(
        name=entry["name"],
        drive=index[entry["drive"]] if "drive" in entry else GROUND,
        platform_joint_m=_vector(entry["platform_joint_m"]),
        base_joint_m=_vector(entry["base_joint_m"]),
        length_m=float(entry["length_m"]),
        stiffness_n_per_m=float(entry["stiffness_n_per_m"]),
        force_limit_n=float(entry.get("force_limit_n", "inf")),
        diameter_m=float(entry["diameter_m"]) if "diameter_m" in entry else None,
    )


def _planes(entry: dict[str, Any], rods: tuple[Rod, ...]) -> list[Plane]:
    name, point, direction = entry["name"], _vector(entry["point_m"]), _vector(entry["direction"])
    rod = [r.name for r in rods].index(entry["joint"])
    stiffness = float(entry["stiffness_n_per_m"])
    if entry["kind"] == "plane":
        return [Plane(name, rod, point, direction / np.linalg.norm(direction), stiffness)]
    if entry["kind"] != "line":
        raise ValueError(f"guide {name}: a {entry['kind']} is not known")
    first, second = across(direction)
    return [Plane(f"{name}.{i}", rod, point, normal, stiffness) for i, normal in enumerate((first, second), start=1)]


def across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors across a direction: the first as near as can be to the machine's axis it has least of."""
    along = direction / np.linalg.norm(direction)
    size = np.abs(along)
    nearest = min(range(3), key=lambda i: (size[i] > np.sort(size)[1], i))
    axis = np.eye(3)[nearest]
    first = axis - along * float(along @ axis)
    first = first / np.linalg.norm(first)
    return first, np.cross(along, first)


def _reflector(entry: dict[str, Any], index: dict[str, int]) -> Reflector:
    on = entry["on"]
    if on not in {"platform", "floor", *index}:
        raise ValueError(f"SMR {entry['name']}: there is no {on}")
    return Reflector(
        name=entry["name"],
        on=on if on in ("platform", "floor") else "drive",
        drive=index.get(on, GROUND),
        position_m=_vector(entry["position_m"]),
        facing=_vector(entry["facing"]) if "facing" in entry else None,
        acceptance_rad=float(entry.get("acceptance_rad", 0.5)),
    )


def _vector(values: list[float]) -> Array:
    x, y, z = (float(value) for value in values)
    return np.array([x, y, z])
