"""Sections of the rig file about the machine's life: its tolerance, certificates, and when it is calibrated again."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import Field, model_validator

from calibration.base.toml_file import Label, Section

Probability = Annotated[float, Field(gt=0.0, lt=1.0)]
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


class CheckSettings(Section):
    """The short check of `pkm-rig health`: when it looks, and with which error probabilities it may stop."""

    looks: tuple[Annotated[int, Field(ge=4, le=12)], ...] = Field(
        min_length=1, default=(4, 6, 8, 10, 12), description="Numbers of poses after which it decides whether to go on."
    )
    false_alarm: Probability = Field(
        default=0.014, description="Probability that one check of an unchanged machine says changed."
    )
    early_miss: Probability = Field(
        default=0.01, description="Probability that a change of `size` is missed at a look before the last."
    )
    size: float = Field(gt=0.0, default=5.5, description="The change to be found, in standard uncertainties.")
    longest_s: float = Field(
        gt=0.0, le=600.0, default=600.0, description="Longest rig time of a check; it decides on what it has then."
    )
    warm_up_max_s: float = Field(
        ge=0.0, default=900.0, description="Rig time after which a warm-up that has not settled has failed."
    )
    warm_up_step_s: float = Field(
        gt=0.0, default=20.0, description="Rig time between two looks at the temperatures during the warm-up."
    )


Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
TimeOfDay = Annotated[str, Field(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$")]


class WindowEntry(Section):
    """A maintenance window: from `begin` on each of `days` until `end`, on the next day where that is earlier."""

    days: tuple[Day, ...] = Field(
        min_length=1, default=("mon", "tue", "wed", "thu", "fri", "sat", "sun"), description="Days on which it begins."
    )
    begin: TimeOfDay = Field(description="Time of day, as in 22:00.")
    end: TimeOfDay = Field(description="Time of day; the same as `begin` is a whole day.")


class EnvelopeSettings(Section):
    """Largest changes with which tables are exchanged without anybody's approval."""

    parameter_sigmas: float = Field(
        gt=0.0, default=6.0, description="Of a parameter, in standard deviations of what was to be expected."
    )
    table_m: PositiveLength = Field(default=50e-6, description="Of a table's correction.")
    error_m: PositiveLength = Field(default=50e-6, description="Error with the former tables.")


class DriftEntry(Section):
    """How the machine drifts without any event, in standard uncertainties of a check with all its poses."""

    walk_per_sqrt_week: float = Field(
        ge=0.0, default=0.2, description="Random walk of each watched change, for a square-root week."
    )
    per_k: float = Field(
        ge=0.0, default=0.15, description="Standard deviation of what a kelvin does to each watched change."
    )
    instrument: float = Field(
        ge=0.0, default=5.0, description="Standard deviation by which another instrument sees each watched change."
    )


class PredictionEntry(Section):
    """How far and how surely the due date is predicted."""

    horizon_days: float = Field(gt=0.0, le=36525.0, default=1095.75, description="Days beyond which no date is stated.")
    coverage: Probability = Field(default=0.95, description="Probability that the interval of the due date covers it.")
    act_by: Probability = Field(
        default=0.01, description="Probability that the tolerance is left before the act-by date."
    )
    trend: Probability = Field(default=0.3, description="Probability, before any check, that something wears.")
    fastest_weeks: float = Field(
        gt=0.0, default=40.0, description="Weeks in which wear of one standard deviation uses the whole tolerance."
    )


class PlcWords(Section):
    """Registers by which the PLC grants the automatic mode and is told of the machine's state; none is left out."""

    automatic: int | None = Field(
        ge=0, le=0xFFFF, default=None, description="Register that grants it: 1; 0 while somebody else has the machine."
    )
    state: int | None = Field(
        ge=0, le=0xFFFF, default=None, description="Register for the state: 0 fit, 1 due, 2 out of tolerance."
    )
    days_left: int | None = Field(
        ge=0, le=0xFFFF, default=None, description="Register for the days until it is due; 65535: none in sight."
    )
    alarm: int | None = Field(
        ge=0, le=0xFFFF, default=None, description="Register for the alarm: 1 when somebody is asked for, else 0."
    )


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
    longest_interval_days: float = Field(gt=0.0, default=365.0, description="Days after which it is due in any case.")
    operating_h: float | None = Field(
        gt=0.0, default=None, description="Hours of operation after which it is due; left out, they do not count."
    )
    temperature_k: float = Field(
        gt=0.0, default=4.0, description="Difference from the calibration's temperature at which it is due."
    )
    next_slot_days: float = Field(
        gt=0.0, default=7.0, description="Days until the next occasion: it is due if the tolerance is left before."
    )
    probability: float = Field(
        ge=0.5, lt=1.0, default=0.95, description="Probability of a statement's being right, for the guard band."
    )
    check: CheckSettings = Field(default=CheckSettings(), description="The short check.")
    check_every_days: float = Field(gt=0.0, default=7.0, description="Days after which a check is due.")
    windows: tuple[WindowEntry, ...] = Field(
        default=(), max_length=50, description="When scheduled work may move the machine; none: never."
    )
    time_zone: str = Field(default="UTC", description="Time zone of the windows, as in Europe/Berlin.")
    alone: bool = Field(
        default=False,
        description="Whether scheduled work may calibrate, within the envelope; else it checks only, and asks for "
        "somebody.",
    )
    envelope: EnvelopeSettings = Field(default=EnvelopeSettings(), description="Changes that need no approval.")
    drift: DriftEntry = Field(default=DriftEntry(), description="Drift without any event.")
    prediction: PredictionEntry = Field(default=PredictionEntry(), description="Prediction of the due date.")
    plc: PlcWords = Field(default=PlcWords(), description="Registers of the PLC.")
    notify: tuple[str, ...] = Field(
        default=(),
        max_length=50,
        description="A command and its arguments, run without a shell after each run; it gets the JSON line on stdin.",
    )

    @model_validator(mode="after")
    def _possible(self) -> RecalibrationSettings:
        try:
            ZoneInfo(self.time_zone)
        except (KeyError, ValueError, OSError) as error:
            raise ValueError(f"time_zone: '{self.time_zone}' is no time zone; name one as Europe/Berlin") from error
        if list(self.check.looks) != sorted(set(self.check.looks)):
            raise ValueError("check.looks: they rise")
        return self
