"""All that a report of a campaign is made from, whatever the campaign came to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calibration.identification.calibration import Calibration
from calibration.machine.description import Machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from calibration.reduction.reduction import Reduction
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.results.standard_results import StandardResult
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.rig.recalibration_sections import CertificateEntry


@dataclass(frozen=True)
class DriveTables:
    """What the drives used, in words: as found when the campaign began to change them, as left when it ended."""

    as_found: str
    as_left: str


@dataclass(frozen=True)
class ReportSource:
    """A campaign as it is reported.

    state and step: as `pkm-rig list` says them; why: why it broke off, empty if it did not. answered: what the devices
    said of themselves when the campaign began (`station`, `drives`), None where that was not stored. recording None:
    nothing was measured. not_reduced, not_identified: why there is no reduction or calibration, in one line.
    """

    campaign: str
    header: RecordingFile
    machine: Machine
    head: str
    state: str
    step: str
    why: str = ""
    answered: Mapping[str, Any] | None = None
    certificate: CertificateSection | None = None
    certificates: tuple[CertificateEntry, ...] = ()
    recording: Recording | None = None
    reduction: Reduction | None = None
    not_reduced: str = ""
    calibration: Calibration | None = None
    not_identified: str = ""
    diagnosis: DiagnosisAttempt | None = None
    outcome: CampaignOutcome | None = None
    standard: StandardResult | None = None
    standard_failure: str = ""
    tables: DriveTables | None = None
    limits_m: Mapping[int, float] = field(default_factory=dict)
