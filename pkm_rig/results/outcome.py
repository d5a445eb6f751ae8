"""The outcome of a calibration: what was written, how it was verified, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from calibration.compensation.tables import CompensationTable
from calibration.identification.calibration import Calibration
from calibration.reduction.figures import Figures
from calibration.reduction.reduction import Reduction
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt


@dataclass(frozen=True)
class Decision:
    """Whether tables may stay, and the rule in words."""

    accepted: bool
    rule: str


@dataclass(frozen=True)
class VerificationResult:
    """Verification at one payload: errors before and after, the decision, and the errors of each model's prediction."""

    payload: int
    payload_kg: float
    before: Figures
    after: Figures
    decision: Decision
    orientation_prediction_rad: float
    models: dict[str, Figures]


@dataclass(frozen=True)
class WrittenTable:
    """A table written for a payload; `drives`: drive to generation, CRC and whether it was active."""

    table: CompensationTable
    payload: int
    drives: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class CampaignOutcome:
    """The outcome of a calibration; `restored` says what the drives went back to if it was refused."""

    campaign: str
    calibration: Calibration
    reduction: Reduction
    floor: Figures
    verified: tuple[VerificationResult, ...]
    written: tuple[WrittenTable, ...]
    accepted: bool
    diagnosis: DiagnosisAttempt
    restored: str | None = None
