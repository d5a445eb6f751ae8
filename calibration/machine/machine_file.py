"""The machine file as it stands on disk (docs/reference/machine.md): sections, ranges, and what must fit together."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from calibration.base.toml_file import Section

Coordinate = Literal["x", "y", "z", "rx", "ry", "rz"]
Vector = tuple[float, float, float]
Range = tuple[float, float]
Positive = Annotated[float, Field(gt=0.0)]


class _Platform(Section):
    tool_point_m: Vector
    moving_mass_kg: float = Field(ge=0.0)
    centre_of_mass_m: Vector


class WorkspaceSection(Section):
    """Box of the tool point; a coordinate that is left out stays at zero."""

    x_m: Range | None = None
    y_m: Range | None = None
    z_m: Range | None = None
    rx_rad: Range | None = None
    ry_rad: Range | None = None
    rz_rad: Range | None = None

    def limits(self, coordinate: Coordinate) -> Range:
        """Lower and upper limit of a coordinate, zero if it is not listed."""
        unit = "rad" if coordinate.startswith("r") else "m"
        found: Range | None = getattr(self, f"{coordinate}_{unit}")
        return (0.0, 0.0) if found is None else found


class SliderEntry(Section):
    """A prismatic drive that carries joints along an axis."""

    name: str
    kind: Literal["slider"]
    axis: Vector
    branch: Literal[-1, 1]
    travel_m: Range

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in m."""
        return self.travel_m


class LegEntry(Section):
    """A telescopic leg: its drive lengthens one strut."""

    name: str
    kind: Literal["leg"]
    travel_m: Range

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in m."""
        return self.travel_m


class CrankEntry(Section):
    """A rotary drive that carries joints about an axis through its pivot."""

    name: str
    kind: Literal["crank"]
    pivot_m: Vector
    axis: Vector
    branch: Literal[-1, 1]
    travel_rad: Range

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in rad."""
        return self.travel_rad


DriveSection = Annotated[SliderEntry | LegEntry | CrankEntry, Field(discriminator="kind")]


class StrutEntry(Section):
    """A two-force member; without a drive its base joint is fixed to the base."""

    name: str
    drive: str | None = None
    platform_joint_m: Vector
    base_joint_m: Vector
    length_m: Positive
    stiffness_n_per_m: Positive


class GuideEntry(Section):
    """Holds the platform joint of a strut in a plane (direction: its normal) or on a line (its direction)."""

    name: str
    kind: Literal["plane", "line"]
    joint: str
    point_m: Vector
    direction: Vector
    stiffness_n_per_m: Positive


class ToleranceSection(Section):
    """Half-widths; a kind of parameter that no part of the machine has may be left out."""

    strut_length_m: Positive
    platform_joint_m: Positive
    base_joint_m: Positive
    axis_tilt_rad: Positive | None = None
    drive_scale: Positive
    pivot_m: Positive | None = None
    guide_position_m: Positive | None = None
    guide_tilt_rad: Positive | None = None
    ln_stiffness: Positive
    smr_position_m: Positive


class _Expansion(Section):
    coefficient_per_k: float
    u_per_k: float = Field(ge=0.0)
    sensor: str


class _Smr(Section):
    name: str
    on: str
    position_m: Vector


class LoadCase(Section):
    """A load on the platform: a mass and a force, each at a point of the platform frame."""

    name: str
    mass_kg: float = Field(ge=0.0, default=0.0)
    u_mass_kg: float = Field(ge=0.0, default=0.0)
    centre_of_mass_m: Vector = (0.0, 0.0, 0.0)
    force_n: Vector = (0.0, 0.0, 0.0)
    force_point_m: Vector = (0.0, 0.0, 0.0)


class MachineFile(Section):
    """The machine file as it stands on disk."""

    format: Literal[1]
    name: str
    degrees_of_freedom: tuple[Coordinate, ...] = Field(min_length=1)
    commanded: tuple[Coordinate, ...] = ()
    gravity_m_per_s2: Vector
    reference_temperature_c: float
    platform: _Platform
    workspace: WorkspaceSection
    drives: tuple[DriveSection, ...] = Field(min_length=1)
    struts: tuple[StrutEntry, ...] = Field(min_length=1)
    guides: tuple[GuideEntry, ...] = ()
    tolerances: ToleranceSection
    expansion: dict[str, _Expansion]
    smrs: tuple[_Smr, ...] = ()
    load_cases: tuple[LoadCase, ...] = ()

    @field_validator("drives", "struts", "guides", "smrs", "load_cases")
    @classmethod
    def _unique_names(cls, parts: tuple[Any, ...]) -> tuple[Any, ...]:
        names = [part.name for part in parts]
        if len(set(names)) != len(names):
            raise ValueError("two parts have the same name")
        return parts

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        free = self.degrees_of_freedom
        if len(set(free)) != len(free) or len({"rx", "ry", "rz"} & set(free)) == 2:
            raise ValueError("degrees_of_freedom: each once, and of the rotations none, one or all three")
        if stray := set(self.commanded) - set(free):
            raise ValueError(f"commanded: {sorted(stray)[0]} is not a free coordinate")
        if len(self.commanded) > len(self.drives):
            raise ValueError("commanded: more coordinates than drives")
        constraints = len(self.struts) + sum(2 if g.kind == "line" else 1 for g in self.guides)
        if constraints < len(free):
            raise ValueError(f"{constraints} constraints cannot hold {len(free)} free coordinates")
        self._drives_fit()
        for guide in self.guides:
            _unit(guide.direction, f"direction of guide '{guide.name}'")
            if guide.joint not in {s.name for s in self.struts}:
                raise ValueError(f"guide '{guide.name}' names the unknown strut '{guide.joint}'")
        self._needed_tolerances()
        return self

    def _drives_fit(self) -> None:
        names = {d.name for d in self.drives}
        driven = [s.drive for s in self.struts]
        for strut in self.struts:
            if strut.drive is not None and strut.drive not in names:
                raise ValueError(f"strut '{strut.name}' names the unknown drive '{strut.drive}'")
        for drive in self.drives:
            if drive.name not in driven:
                raise ValueError(f"drive '{drive.name}' drives no strut")
            if drive.kind == "leg" and driven.count(drive.name) != 1:
                raise ValueError(f"leg '{drive.name}' must drive exactly one strut")
            if drive.kind != "leg":
                _unit(drive.axis, f"axis of drive '{drive.name}'")
            if not drive.travel[0] < drive.travel[1]:
                raise ValueError(f"travel of drive '{drive.name}' is not a range")

    def _needed_tolerances(self) -> None:
        kinds = {d.kind for d in self.drives}
        needed = {
            "axis_tilt_rad": bool(kinds & {"slider", "crank"}),
            "pivot_m": "crank" in kinds,
            "guide_position_m": bool(self.guides),
            "guide_tilt_rad": bool(self.guides),
        }
        for name, wanted in needed.items():
            if wanted and getattr(self.tolerances, name) is None:
                raise ValueError(f"[tolerances] {name} is missing")


def _unit(vector: Vector, what: str) -> None:
    if abs(sum(c * c for c in vector) - 1.0) > 2e-9:
        raise ValueError(f"{what} is not of length 1")
