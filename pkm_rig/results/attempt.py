"""A diagnosis within a calibration."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.diagnosis.result import Diagnosis


@dataclass(frozen=True)
class Attempt:
    """A diagnosis within a calibration: what was found, or in one line why nothing was."""

    diagnosis: Diagnosis | None
    failure: str = ""
