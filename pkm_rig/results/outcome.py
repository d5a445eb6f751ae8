"""The outcome of a calibration: what was written, how it was verified, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from calibration.compensation.host import HostCorrection
from calibration.compensation.tables import CompensationTable
from calibration.identification.calibration import Calibration
from calibration.reduction.figures import Figures
from calibration.reduction.reduction import Reduction
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt

Verdict = Literal["accepted", "refused", "not decided"]


@dataclass(frozen=True)
class Decision:
    """Whether tables may stay, and the rule in words. Not decided: neither conformity nor its opposite is shown."""

    verdict: Verdict
    rule: str

    @property
    def accepted(self) -> bool:
        """Whether the tables may stay."""
        return self.verdict == "accepted"


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
    """A correction that acted at a payload: a table in the drives, or the host's.

    `drives`: drive to generation, CRC and whether it was active; empty where the host corrects.
    """

    table: CompensationTable | HostCorrection
    payload: int
    drives: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class CampaignOutcome:
    """The outcome of a calibration; `restored` says what the drives went back to if it was not accepted.

    `beyond`: why tables that were verified were not kept without approval: reasons of the envelope.
    `head` is the last value of the campaign's chain in the store, empty if it is not chained.
    """

    campaign: str
    calibration: Calibration
    reduction: Reduction
    floor: Figures
    verified: tuple[VerificationResult, ...]
    written: tuple[WrittenTable, ...]
    diagnosis: DiagnosisAttempt
    restored: str | None = None
    head: str = ""
    beyond: tuple[str, ...] = ()

    @property
    def decision(self) -> Verdict:
        """Accepted if every payload is, refused if one is, else not decided; nor are tables that await approval."""
        verdicts = {v.decision.verdict for v in self.verified}
        if verdicts == {"accepted"} and not self.beyond:
            return "accepted"
        return "not decided" if verdicts and "refused" not in verdicts else "refused"

    @property
    def accepted(self) -> bool:
        """Whether the tables stay."""
        return self.decision == "accepted"

    @property
    def back_end(self) -> Literal["drive-tables", "host"]:
        """What corrects."""
        return "host" if any(isinstance(w.table, HostCorrection) for w in self.written) else "drive-tables"

    @property
    def before_over_floor(self) -> float:
        """Least ratio of a measured error before to the noise floor, over payloads and what the drives command."""
        commanded = self.reduction.recording.machine.commanded
        ratios = [v.before.position_rms_m / self.floor.position_rms_m for v in self.verified]
        if (commanded > 2).any():
            ratios += [v.before.orientation_rms_rad / self.floor.orientation_rms_rad for v in self.verified]
        return min(ratios)

    @property
    def simulated(self) -> bool:
        """Whether a device of the campaign was simulated."""
        return self.reduction.recording.file.simulated
