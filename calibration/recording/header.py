"""recording.toml: with what a campaign was measured, and what is stated of the instruments.

The rig file shares these sections. docs/reference/recording.md defines them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from calibration.base.toml_file import Section
from calibration.instruments.station import CertifiedLength, StationAccuracy
from calibration.model.payload import PayloadEntry

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]


class AccuracyEntry(Section):
    """What is stated of the station: standard deviations of a reading, standard uncertainty of its ranges."""

    angle_sd_rad: float = Field(gt=0.0)
    range_sd_m: float = Field(gt=0.0)
    range_constant_u_m: float = Field(gt=0.0)
    range_scale_u: float = Field(ge=0.0)
    drift_rad_per_sqrt_h: float = Field(gt=0.0, default=3.0e-6)
    drift_of_level_rad_per_sqrt_h: float = Field(gt=0.0, default=1.0e-6)
    drift_m_per_sqrt_h: float = Field(gt=0.0, default=1.0e-5)

    def stated(self) -> StationAccuracy:
        """For computation."""
        return StationAccuracy(self.angle_sd_rad, self.range_sd_m, self.range_constant_u_m, self.range_scale_u)


class StationEntry(Section):
    """The station: its rough place in the machine frame, its heading and its accuracy."""

    name: str = "station"
    position_m: tuple[float, float, float]
    heading_rad: float = 0.0
    accuracy: AccuracyEntry


class LengthEntry(Section):
    """A certified distance between two nests."""

    nests: tuple[str, str]
    value_m: float = Field(gt=0.0)
    u_m: float = Field(gt=0.0)

    def certified(self) -> CertifiedLength:
        """For computation."""
        return CertifiedLength(self.nests, self.value_m, self.u_m)


class NuisanceEntry(Section):
    """Declared levels of nuisance effects on this rig, one standard deviation each; zero if not declared."""

    drift_m: float = Field(ge=0.0, default=0.0)
    reseat_m: float = Field(ge=0.0, default=0.0)
    reversal_m: float = Field(ge=0.0, default=0.0)
    temperature_k: float = Field(ge=0.0, default=0.0)


class RecordingFile(Section):
    """recording.toml."""

    format: Literal[1]
    campaign: Name
    rig: Name
    created: str
    software: str
    drives: tuple[Name, ...]
    sensors: tuple[Name, ...]
    station: StationEntry
    nest_length: LengthEntry | None = None
    nest_limit_m: float = Field(gt=0.0)
    payloads: tuple[PayloadEntry, ...] = Field(min_length=1)
    nuisance: NuisanceEntry = NuisanceEntry()
    columns: dict[str, str] = Field(default_factory=dict)


HOUR_S = 3600.0
DRIFT_LEVER_M = 3.0  # where the drift of a rig is declared
