"""What a calibration ended with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from calibration.compensation.tables import CompensationTable
from calibration.identification.calibration import (
    Calibration,
)
from calibration.reduction.figures import Decision, Figures
from calibration.reduction.reduction import Reduction
from pkm_rig.results.attempt import Attempt


@dataclass(frozen=True)
class Verified:
    """Verification at one payload: measured before and after, the rule, how the models predict it."""

    payload: int
    payload_kg: float
    before: Figures
    after: Figures
    decision: Decision
    orientation_prediction_rad: float
    models: dict[str, Figures]


@dataclass(frozen=True)
class Written:
    """A table that was written: for which payload, and by drive its generation, CRC and whether it was active."""

    table: CompensationTable
    payload: int
    drives: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """What a calibration ended with."""

    campaign: str
    calibration: Calibration
    reduction: Reduction
    floor: Figures
    verified: tuple[Verified, ...]
    written: tuple[Written, ...]
    accepted: bool
    diagnosis: Attempt
    restored: str | None = None
