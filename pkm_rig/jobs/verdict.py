"""Figures and verdict of a verified campaign: a function of what is stored."""

from __future__ import annotations

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.tables import table_for_payload
from calibration.identification.calibration import Calibration, identify_recording
from calibration.identification.model_comparison import model_comparison, orientation_prediction
from calibration.recording.recording import Recording
from calibration.reduction.figures import decide, noise_floor, visit_figures
from calibration.reduction.reduction import Reduction, reduce
from pkm_rig.jobs.diagnose import attempt
from pkm_rig.results.attempt import Attempt
from pkm_rig.results.outcome import Outcome, Verified, Written
from pkm_rig.rig.store import Store


def stored_outcome(store: Store, campaign: str) -> Outcome:
    """Rebuild the outcome of a verified campaign from the store."""
    recording = last_attempt(store, campaign)
    activated = store.events(campaign, "activated")
    verdicts = store.events(campaign, "accepted") + store.events(campaign, "refused")
    if not activated or not verdicts:
        raise InputError(f"campaign {campaign} was not verified; run `pkm-rig verify` first")
    identified = identify_recording(recording)
    written = tuple(
        Written(
            table_for_payload(identified, event.data["payload"], event.data["temperatures_c"]),
            event.data["payload"],
            event.data["tables"],
        )
        for event in activated[-len({e.data["payload"] for e in activated}) :]
    )
    former = verdicts[-1].data.get("restored") or "the former tables"
    return judge(campaign, identified, recording, written, attempt(recording), former)


def last_attempt(store: Store, campaign: str) -> Recording:
    """A campaign's recording without the readings of a verification that was begun before and broke off."""
    recording = store.recording(campaign)
    attempts = store.events(campaign, "verifying")
    first = attempts[-1].data["first_sequence"] if attempts else 0
    phase = np.asarray(recording["phase"]).astype(str)
    keep = (recording["sequence"] >= first) | ~np.char.startswith(phase, "verification")
    return recording.take(keep)


def judge(
    campaign: str,
    identified: Calibration,
    recording: Recording,
    written: tuple[Written, ...],
    diagnosis: Attempt,
    former: str,
) -> Outcome:
    """Figures and verdict of a campaign that was verified: a function of what is stored."""
    reduction = reduce(recording, identified.reduction)
    floor = noise_floor(reduction)
    if floor is None:
        raise InputError(f"campaign {campaign}: no pose was visited three times, so there is no noise floor")
    verified = tuple(verify_payload(identified, reduction, w.payload) for w in written)
    accepted = bool(verified) and all(v.decision.accepted for v in verified)
    return Outcome(
        campaign=campaign,
        calibration=identified,
        reduction=reduction,
        floor=floor,
        verified=verified,
        written=written,
        accepted=accepted,
        diagnosis=diagnosis,
        restored=None if accepted else former,
    )


def verify_payload(identified: Calibration, reduction: Reduction, payload: int) -> Verified:
    """Figures and decision at one payload; InputError if it was not verified."""
    before = visit_figures(reduction, "verification_before", payload)
    after = visit_figures(reduction, "verification_after", payload)
    predicted = orientation_prediction(identified, reduction, "verification_before", payload)
    if before is None or after is None or predicted is None:
        raise InputError(f"payload {payload} was not verified before and after; measure both")
    return Verified(
        payload=payload,
        payload_kg=reduction.recording.file.payloads[payload].mass_kg,
        before=before,
        after=after,
        decision=decide(before, after),
        orientation_prediction_rad=predicted,
        models=model_comparison(identified, reduction, payload),
    )
