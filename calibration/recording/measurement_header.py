"""measurements.toml: what was measured of a machine and what is stated of it (docs/reference/measurements.md)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from calibration.base.toml_file import Section
from calibration.recording.header import Name

Column = Literal["x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"]
Kind = Literal[
    "strut_length",
    "platform_joint",
    "base_joint",
    "pivot",
    "guide_position",
    "guide_tilt",
    "axis_tilt",
    "drive_scale",
    "ln_stiffness",
]
Line = Annotated[str, Field(max_length=1000)]
NotNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


class ColumnEntry(Section):
    """A measured coordinate: standard deviation of a reading, standard uncertainty of an offset common to all."""

    sd: Positive
    offset_u: NotNegative = 0.0


class BedEntry(Section):
    """A bed that was touched and may be a bowl: standard uncertainty of how much higher it is at a radius off the
    machine's axis than on it."""

    bowl_u_m: Positive
    radius_m: Positive


class DistancesEntry(Section):
    """Distances: standard deviation of a reading; standard uncertainties of what all have in common.

    centre_m: with it, distances are from a ball on the base; without, between two visits.
    """

    sd_m: Positive
    length_u_m: NotNegative = 0.0
    scale_u: NotNegative = 0.0
    centre_m: tuple[float, float, float] | None = None
    centre_u_m: NotNegative = 0.0


class PreviousFitEntry(Section):
    """The fit that the nominal machine came from: how many parameters it had, the kinds that it varied, and by how much
    the nominal machine may miss a reading before the step size is questioned."""

    parameters: int = Field(ge=1, le=1000)
    unknowns: tuple[Kind, ...] = Field(min_length=1)
    misses_at_most_m: Positive


class QuantityEntry(Section):
    """A number that the owner knows the machine by: its nominal value and its derivatives with parameters."""

    name: Annotated[str, Field(max_length=100)]
    unit: Literal["m", "rad", "1"]
    nominal: float
    of: dict[str, float] = Field(min_length=1)


class MeasurementFile(Section):
    """measurements.toml."""

    format: Literal[1]
    name: Name
    source: Line = ""
    unknowns: tuple[Kind, ...] | None = Field(default=None, min_length=1)
    own_frame: bool = False
    columns: dict[Column, ColumnEntry] = Field(default_factory=dict)
    bed: BedEntry | None = None
    distances: DistancesEntry | None = None
    former: PreviousFitEntry | None = None
    quantities: tuple[QuantityEntry, ...] = ()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if not self.columns and self.distances is None:
            raise ValueError("neither [columns] nor [distances]: say what was measured")
        if self.bed is not None and "z_m" not in self.columns:
            raise ValueError("[bed] without [columns.z_m]: a bed is touched at heights")
        if self.bed is not None and self.own_frame:
            raise ValueError("[bed] with own_frame: a bed is touched by the machine itself, in its own frame")
        names = [q.name for q in self.quantities]
        if len(set(names)) != len(names):
            raise ValueError("two quantities have the same name")
        return self
