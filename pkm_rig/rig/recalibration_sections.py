"""Sections of the rig file about the machine's life: its tolerance, certificates, and when it is calibrated again."""

from __future__ import annotations

from datetime import date
from typing import Annotated

from pydantic import Field, model_validator

from calibration.base.toml_file import Label, Section

PositiveLength = Annotated[float, Field(gt=0.0, le=0.1)]


class CertificateEntry(Section):
    """A certificate of something that measurements rest on."""

    instrument: Label = Field(description="What it is of: `station`, `nest_length`, or any other name.")
    number: Label = Field(description="Number of the certificate.")
    serial: Label | None = Field(
        default=None, description="Serial number that it is for; the station's is compared with the one that answers."
    )
    due: date = Field(description="Last day on which it is valid, as in 2027-03-31.")
    calibrated: date | None = Field(default=None, description="Day of that calibration, as in 2026-03-31.")
    model: Label | None = Field(default=None, description="Make and model of what it is of.")
    laboratory: Label | None = Field(default=None, description="Who issued it.")

    @model_validator(mode="after")
    def _in_order(self) -> CertificateEntry:
        if self.calibrated is not None and self.due < self.calibrated:
            raise ValueError(f"certificates: {self.instrument}: due before it was calibrated")
        return self


class RecalibrationSettings(Section):
    """When the machine is calibrated again, and within which limits it may be done alone."""

    tolerance_m: PositiveLength | None = Field(
        default=None,
        description="Largest position error of the tool that is allowed, RMS over the workspace; `health` and "
        "`recalibrate` need it.",
    )
    operating_time: str | None = Field(
        default=None,
        description="Name of the `[[plc.readings]]` with the machine's operating time, in s; left out, all time since "
        "the first record counts as operation.",
    )
