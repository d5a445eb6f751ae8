"""A diagnosis as part of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.diagnosis.result import Diagnosis


@dataclass(frozen=True)
class DiagnosisAttempt:
    """Diagnosis within a calibration: the result, or a one-line reason for its failure."""

    diagnosis: Diagnosis | None
    failure: str = ""
