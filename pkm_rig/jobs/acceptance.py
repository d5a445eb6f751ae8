"""Whether the tables of a verified campaign stay: its figures and the decision, a function of what is stored."""

from __future__ import annotations

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.tables import table_for_payload
from calibration.identification.calibration import Calibration, identify_recording
from calibration.identification.model_comparison import model_comparison, orientation_prediction
from calibration.recording.recording import Recording
from calibration.reduction.figures import COVERAGE_FACTOR, Figures, noise_floor, visit_figures
from calibration.reduction.reduction import Reduction, reduce
from pkm_rig.jobs.diagnose import try_diagnosis
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import CampaignOutcome, Decision, VerificationResult, WrittenTable
from pkm_rig.store.store import Store


def stored_outcome(store: Store, campaign: str) -> CampaignOutcome:
    """Rebuild the outcome of a verified campaign from the store."""
    recording = last_verification_attempt(store, campaign)
    activated = store.events(campaign, "activated")
    verdicts = store.events(campaign, "accepted") + store.events(campaign, "refused")
    if not activated or not verdicts:
        raise InputError(f"campaign {campaign} was not verified; run `pkm-rig verify` first")
    identification = identify_recording(recording)
    written = tuple(
        WrittenTable(
            table_for_payload(identification, event.data["payload"], event.data["temperatures_c"]),
            event.data["payload"],
            event.data["tables"],
        )
        for event in activated[-len({e.data["payload"] for e in activated}) :]
    )
    previous_tables = verdicts[-1].data.get("restored") or "the former tables"
    return evaluate_campaign(campaign, identification, recording, written, try_diagnosis(recording), previous_tables)


def last_verification_attempt(store: Store, campaign: str) -> Recording:
    """A campaign's recording without the readings of a verification that was begun before and broke off."""
    recording = store.recording(campaign)
    attempts = store.events(campaign, "verifying")
    first = attempts[-1].data["first_sequence"] if attempts else 0
    phase = np.asarray(recording["phase"]).astype(str)
    keep = (recording["sequence"] >= first) | ~np.char.startswith(phase, "verification")
    return recording.take(keep)


def evaluate_campaign(
    campaign: str,
    identification: Calibration,
    recording: Recording,
    written: tuple[WrittenTable, ...],
    diagnosis: DiagnosisAttempt,
    previous_tables: str,
) -> CampaignOutcome:
    """Figures and verdict of a campaign that was verified: a function of what is stored."""
    reduction = reduce(recording, identification.reduction)
    floor = noise_floor(reduction)
    if floor is None:
        raise InputError(f"campaign {campaign}: no pose was visited three times, so there is no noise floor")
    verified = tuple(verify_payload(identification, reduction, w.payload) for w in written)
    accepted = bool(verified) and all(v.decision.accepted for v in verified)
    return CampaignOutcome(
        campaign=campaign,
        calibration=identification,
        reduction=reduction,
        floor=floor,
        verified=verified,
        written=written,
        accepted=accepted,
        diagnosis=diagnosis,
        restored=None if accepted else previous_tables,
    )


def verify_payload(identification: Calibration, reduction: Reduction, payload: int) -> VerificationResult:
    """Figures and decision at one payload; InputError if it was not verified."""
    before = visit_figures(reduction, "verification_before", payload)
    after = visit_figures(reduction, "verification_after", payload)
    predicted = orientation_prediction(identification, reduction, "verification_before", payload)
    if before is None or after is None or predicted is None:
        raise InputError(f"payload {payload} was not verified before and after; measure both")
    return VerificationResult(
        payload=payload,
        payload_kg=reduction.recording.file.payloads[payload].mass_kg,
        before=before,
        after=after,
        decision=decide(before, after),
        orientation_prediction_rad=predicted,
        models=model_comparison(identification, reduction, payload),
    )


def decide(before: Figures, after: Figures) -> Decision:
    """Tables stay only if the position error falls by more than its expanded uncertainty (JCGM 106)."""
    fall = before.position_rms_m - after.position_rms_m
    expanded = COVERAGE_FACTOR * float(np.hypot(before.u_position_rms_m, after.u_position_rms_m))
    accepted = fall > expanded
    rule = (
        f"fall {fall * 1e6:.1f} um {'>' if accepted else '<='} U = {expanded * 1e6:.1f} um (k = 2): "
        f"{'the tables stay' if accepted else 'the former tables come back'}"
    )
    return Decision(accepted, rule)
