"""The machine file (docs/reference/machine.md): its sections, ranges, and consistency between them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from calibration.base.toml_file import CellLabel, Label, Section

Coordinate = Literal["x", "y", "z", "rx", "ry", "rz"]
Vector = tuple[float, float, float]
Range = tuple[float, float]
Positive = Annotated[float, Field(gt=0.0)]


class _Platform(Section):
    """The platform."""

    tool_point_m: Vector = Field(description="Tool point, in the platform frame.")
    moving_mass_kg: float = Field(ge=0.0, description="Mass of the platform and what always moves with it.")
    centre_of_mass_m: Vector = Field(description="Its centre of mass, in the platform frame.")


class WorkspaceSection(Section):
    """Box of the tool point; a coordinate that is left out stays at zero."""

    x_m: Range | None = Field(default=None, description="Lowest and highest x of the tool point.")
    y_m: Range | None = Field(default=None, description="Lowest and highest y of the tool point.")
    z_m: Range | None = Field(default=None, description="Lowest and highest z of the tool point.")
    rx_rad: Range | None = Field(default=None, description="Lowest and highest rotation about x.")
    ry_rad: Range | None = Field(default=None, description="Lowest and highest rotation about y.")
    rz_rad: Range | None = Field(default=None, description="Lowest and highest rotation about z.")

    def limits(self, coordinate: Coordinate) -> Range:
        """Lower and upper limit of a coordinate, zero if it is not listed."""
        unit = "rad" if coordinate.startswith("r") else "m"
        limits: Range | None = getattr(self, f"{coordinate}_{unit}")
        return (0.0, 0.0) if limits is None else limits


class _DriveEntry(Section):
    """What every drive has. Periods that are stated tell errors of its parts apart."""

    name: CellLabel = Field(description="Name; each once.")

    @property
    def transmission_m(self) -> tuple[float, ...]:
        """Stated periods of screw and teeth in m."""
        return ()

    @property
    def scale_m(self) -> tuple[float, ...]:
        """Stated period of the scale in m."""
        return ()


class _LinearDriveEntry(_DriveEntry):
    """A drive that moves along a line."""

    lead_m: Positive | None = Field(default=None, description="Travel in one turn of the screw.")
    tooth_m: Positive | None = Field(default=None, description="Travel from tooth to tooth of a belt, rack or gear.")
    scale_pitch_m: Positive | None = Field(
        default=None, description="Travel in one period of the signals of scale or encoder."
    )

    @property
    def transmission_m(self) -> tuple[float, ...]:
        """Stated periods of screw and teeth in m."""
        return tuple(period for period in (self.lead_m, self.tooth_m) if period is not None)

    @property
    def scale_m(self) -> tuple[float, ...]:
        """Stated period of the scale in m."""
        return () if self.scale_pitch_m is None else (self.scale_pitch_m,)


class SliderEntry(_LinearDriveEntry):
    """A prismatic drive that carries joints along an axis."""

    kind: Literal["slider"] = Field(description="Kind of drive.")
    axis: Vector = Field(description="Unit vector along which the slider moves.")
    branch: Literal[-1, 1] = Field(description="Assembly branch of its first strut.")
    travel_m: Range = Field(description="Lowest and highest drive coordinate.")

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in m."""
        return self.travel_m


class LegEntry(_LinearDriveEntry):
    """A telescopic leg: its drive lengthens one strut."""

    kind: Literal["leg"] = Field(description="Kind of drive.")
    travel_m: Range = Field(description="Lowest and highest drive coordinate.")

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in m."""
        return self.travel_m


class CrankEntry(_DriveEntry):
    """A rotary drive that carries joints about an axis through its pivot."""

    kind: Literal["crank"] = Field(description="Kind of drive.")
    pivot_m: Vector = Field(description="A point of the axis that the crank turns about.")
    axis: Vector = Field(description="Unit vector along the axis.")
    branch: Literal[-1, 1] = Field(description="Assembly branch of its first strut.")
    travel_rad: Range = Field(description="Lowest and highest drive coordinate.")

    @property
    def travel(self) -> Range:
        """Limits of the drive coordinate in rad."""
        return self.travel_rad


DriveSection = Annotated[SliderEntry | LegEntry | CrankEntry, Field(discriminator="kind")]


class StrutEntry(Section):
    """A two-force member; without a drive its base joint is fixed to the base."""

    name: CellLabel = Field(description="Name; each once.")
    drive: str | None = Field(default=None, description="Drive that carries the base joint or lengthens the strut.")
    platform_joint_m: Vector = Field(description="Joint on the platform, in the platform frame.")
    base_joint_m: Vector = Field(
        description="Joint on the base or drive, in the machine frame at drive position 0; of a crank from its pivot."
    )
    length_m: Positive = Field(description="Length without force, at the reference temperature.")
    stiffness_n_per_m: Positive = Field(description="Axial stiffness, joints included.")
    force_limit_n: Positive | None = Field(
        default=None, description="Largest force of the strut, tension or compression; paths beyond it are refused."
    )
    diameter_m: Positive | None = Field(
        default=None, description="Outer diameter; the station sees no reflector behind the strut."
    )


class GuideEntry(Section):
    """Holds the platform joint of a strut in a plane (direction: its normal) or on a line (its direction)."""

    name: CellLabel = Field(description="Name; each once.")
    kind: Literal["plane", "line"] = Field(description="What the joint is held on.")
    joint: str = Field(description="Strut whose platform joint is held.")
    point_m: Vector = Field(description="A point of the plane or line.")
    direction: Vector = Field(description="Unit vector: normal of a plane, direction of a line.")
    stiffness_n_per_m: Positive = Field(description="Stiffness across the plane or line.")


class ToleranceSection(Section):
    """Half-widths of uniform distributions; a kind that no part of the machine has may be left out."""

    strut_length_m: Positive = Field(description="Length of a strut.")
    platform_joint_m: Positive = Field(description="Each coordinate of a joint on the platform.")
    base_joint_m: Positive = Field(description="Each coordinate of a joint on the base or a drive.")
    axis_tilt_rad: Positive | None = Field(default=None, description="Tilt of an axis about each direction across it.")
    drive_scale: Positive = Field(description="Scale of a drive, relative.")
    pivot_m: Positive | None = Field(default=None, description="Each coordinate of a pivot.")
    guide_position_m: Positive | None = Field(default=None, description="Place of a guide plane along its normal.")
    guide_tilt_rad: Positive | None = Field(default=None, description="Tilt of a guide plane about its point.")
    ln_stiffness: Positive = Field(description="Natural logarithm of a stiffness.")
    smr_position_m: Positive = Field(description="Each coordinate of a reflector.")


class _Expansion(Section):
    """Thermal expansion of one group of parts."""

    coefficient_per_k: float = Field(description="Coefficient of thermal expansion.")
    u_per_k: float = Field(ge=0.0, description="Its standard uncertainty.")
    sensor: str = Field(description="Temperature sensor of these parts.")


class _Smr(Section):
    """A reflector on the machine, or a nest on the floor."""

    name: CellLabel = Field(description="Name; each once.")
    on: str = Field(description="`platform`, `floor`, or the slider or crank that it rides on.")
    position_m: Vector = Field(description="Position on what carries it; of a floor nest in the machine frame.")
    facing: Vector | None = Field(
        default=None,
        description="Unit vector to where it looks, on what carries it; left out, it is seen from everywhere.",
    )
    acceptance_rad: float = Field(
        gt=0.0, le=3.15, default=0.5, description="Largest angle between `facing` and the direction to the station."
    )


class LoadCase(Section):
    """A load on the platform: a mass and a force, each at a point of the platform frame."""

    name: CellLabel = Field(description="Name; each once.")
    mass_kg: float = Field(ge=0.0, default=0.0, description="Mass.")
    u_mass_kg: float = Field(ge=0.0, default=0.0, description="Its standard uncertainty.")
    centre_of_mass_m: Vector = Field(default=(0.0, 0.0, 0.0), description="Its centre, in the platform frame.")
    force_n: Vector = Field(default=(0.0, 0.0, 0.0), description="Force, in the machine frame.")
    force_point_m: Vector = Field(default=(0.0, 0.0, 0.0), description="Its point, in the platform frame.")


class MachineFile(Section):
    """A machine: nominal geometry, stiffness, tolerances and reflectors, as its file states them."""

    format: Literal[1] = Field(description="Version of the format.")
    name: Label = Field(description="Name of the machine.")
    degrees_of_freedom: tuple[Coordinate, ...] = Field(
        min_length=1, description="Free coordinates; of the rotations none, one or all three."
    )
    commanded: tuple[Coordinate, ...] = Field(
        default=(), description="Coordinates that the drives command; left out, the first free ones, one a drive."
    )
    gravity_m_per_s2: Vector = Field(description="Gravity, in the machine frame.")
    reference_temperature_c: float = Field(description="Temperature at which lengths are stated.")
    platform: _Platform = Field(description="The platform.")
    workspace: WorkspaceSection = Field(description="The workspace.")
    drives: tuple[DriveSection, ...] = Field(min_length=1, description="The drives.")
    struts: tuple[StrutEntry, ...] = Field(min_length=1, description="The struts.")
    guides: tuple[GuideEntry, ...] = Field(default=(), description="Planes and lines that hold joints.")
    tolerances: ToleranceSection = Field(description="Tolerances.")
    expansion: dict[str, _Expansion] = Field(
        description="Thermal expansion of `struts`, `drives` (their scales), `base` and `platform`."
    )
    smrs: tuple[_Smr, ...] = Field(default=(), description="Reflectors and floor nests.")
    load_cases: tuple[LoadCase, ...] = Field(default=(), description="Loads for planning and simulation.")

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
        for smr in self.smrs:
            if smr.facing is not None:
                _unit(smr.facing, f"facing of SMR '{smr.name}'")
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
        for name, is_needed in needed.items():
            if is_needed and getattr(self.tolerances, name) is None:
                raise ValueError(f"[tolerances] {name} is missing")


def _unit(vector: Vector, what: str) -> None:
    if abs(sum(c * c for c in vector) - 1.0) > 2e-9:
        raise ValueError(f"{what} is not of length 1")
