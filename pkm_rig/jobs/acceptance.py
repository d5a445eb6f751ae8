"""Whether the tables of a verified campaign stay: its figures and the decision, a function of what is stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.host import HostCorrection, host_correction
from calibration.compensation.tables import CompensationTable, table_for_payload
from calibration.identification.calibration import Calibration, identify_recording
from calibration.identification.model_comparison import model_comparison, orientation_prediction
from calibration.machine.description import Machine
from calibration.recording.recording import Recording
from calibration.reduction.figures import COVERAGE_FACTOR, Figures, noise_floor, scale_part, visit_figures
from calibration.reduction.reduction import CALIBRATION, Reduction, reduce
from pkm_rig.jobs.diagnose import try_diagnosis
from pkm_rig.jobs.reversals import stored_reversals
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import CampaignOutcome, Decision, Verdict, VerificationResult, WrittenTable
from pkm_rig.rig.schedule import Block
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
            _correction(identification, event.data),
            event.data["payload"],
            event.data["tables"],
        )
        for event in activated[-len({e.data["payload"] for e in activated}) :]
    )
    previous_tables = verdicts[-1].data.get("restored") or "the former tables"
    outcome = evaluate_campaign(
        campaign,
        identification,
        recording,
        written,
        try_diagnosis(recording),
        previous_tables=previous_tables,
        limits_m=stored_limits_m(store, campaign),
    )
    return replace(outcome, head=store.head(campaign), beyond=tuple(verdicts[-1].data.get("beyond", ())))


def _correction(identification: Calibration, activated: Mapping[str, Any]) -> CompensationTable | HostCorrection:
    """The correction of a stored event: tables, where it does not say otherwise."""
    payload, temperatures_c = activated["payload"], activated["temperatures_c"]
    if activated.get("back_end") != "host":
        table = table_for_payload(identification, payload, temperatures_c)
        machine = identification.report.machine
        return table.with_reversals(machine, stored_reversals(activated, len(machine.drive_names)))
    return host_correction(identification, payload, temperatures_c)


def stored_limits_m(store: Store, campaign: str) -> dict[int, float]:
    """Payload to `accept_below_m`, as it was stored before the last verification began; older ones had none."""
    attempts = store.events(campaign, "verifying")
    limits = attempts[-1].data.get("accept_below_m", {}) if attempts else {}
    return {int(payload): float(limit_m) for payload, limit_m in limits.items()}


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
    *,
    previous_tables: str,
    limits_m: Mapping[int, float],
) -> CampaignOutcome:
    """Figures and verdict of a campaign that was verified: a function of what is stored.

    `limits_m`: `accept_below_m` by payload. InputError for one that is below its guard band.
    """
    reduction = reduce(recording, identification.reduction)
    floor = noise_floor(reduction)
    if floor is None:
        raise InputError(f"campaign {campaign}: no pose was visited three times, so there is no noise floor")
    verified = tuple(
        verify_payload(identification, reduction, w.payload, limits_m.get(w.payload), w.table) for w in written
    )
    outcome = CampaignOutcome(
        campaign=campaign,
        calibration=identification,
        reduction=reduction,
        floor=floor,
        verified=verified,
        written=written,
        diagnosis=diagnosis,
    )
    return outcome if outcome.accepted else replace(outcome, restored=previous_tables)


def verify_payload(
    identification: Calibration,
    reduction: Reduction,
    payload: int,
    limit_m: float | None,
    correction: CompensationTable | HostCorrection | None = None,
) -> VerificationResult:
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
        decision=_decide_payload(before, after, payload, limit_m, correction, reduction.recording.machine),
        orientation_prediction_rad=predicted,
        models=model_comparison(identification, reduction, payload),
    )


def require_possible_limits(
    limits_m: Mapping[int, float], identification: Calibration, blocks: Sequence[Block]
) -> None:
    """InputError for a limit below its guard band whatever will be measured, found before any table is written.

    The scale's part of U is known by then; what the scatter over the poses adds is known only in the end.
    """
    scale_u, _ = scale_part(identification.reduction, identification.reduction.rows(CALIBRATION))
    for block in blocks:
        target_m = np.array([visit.target_m[:3] for visit in block.visits])
        reach_m = float(np.sqrt(np.mean(np.sum((target_m - target_m.mean(axis=0)) ** 2, axis=1))))
        _require_above_guard_band(block.payload, limits_m.get(block.payload), COVERAGE_FACTOR * scale_u * reach_m)


def decide(
    before: Figures,
    after: Figures,
    limit_m: float | None = None,
    *,
    rotation: bool = False,
    what: str = "the tables stay",
) -> Decision:
    """A correction stays only if the position error falls by more than its expanded uncertainty U (k = 2).

    Where the drives command rotations (`rotation`) the orientation error must fall by more than its own U as well.
    With a limit the error afterwards must also lie below it by a guard band w, its own U (JCGM 106:2012, 8.3.2:
    guarded acceptance, w = U). Above limit + w it is shown to be too large, in between nothing is shown.
    """
    fall = before.position_rms_m - after.position_rms_m
    expanded = COVERAGE_FACTOR * float(np.hypot(before.u_position_rms_m, after.u_position_rms_m))
    rule = f"fall {fall * 1e6:.1f} um {'>' if fall > expanded else '<='} U = {expanded * 1e6:.1f} um (k = 2)"
    verdict: Verdict = "accepted" if fall > expanded else "refused"
    if rotation:
        turn = before.orientation_rms_rad - after.orientation_rms_rad
        u_turn = COVERAGE_FACTOR * float(np.hypot(before.u_orientation_rms_rad, after.u_orientation_rms_rad))
        verdict = verdict if turn > u_turn else "refused"
        rule = f"{rule}; {turn * 1e6:.1f} urad {'>' if turn > u_turn else '<='} U = {u_turn * 1e6:.1f} urad"
    if limit_m is not None:
        conforms, words = _conformity(after, limit_m)
        rule = f"{rule}; {words}"
        verdict = conforms if verdict == "accepted" else "refused"
    tables = what if verdict == "accepted" else "the former tables come back"
    return Decision(verdict, f"{rule}: {'not decided, ' if verdict == 'not decided' else ''}{tables}")


def _conformity(after: Figures, limit_m: float) -> tuple[Verdict, str]:
    """Whether the error afterwards is shown to be below its limit, and that in words."""
    error, guard = after.position_rms_m, COVERAGE_FACTOR * after.u_position_rms_m
    limit = f"limit {limit_m * 1e6:.1f} um"
    band = f"w = U = {guard * 1e6:.1f} um"
    if error <= limit_m - guard:
        return "accepted", f"after {error * 1e6:.1f} um <= {limit} - w, {band}"
    if error <= limit_m + guard:
        return "not decided", f"after {error * 1e6:.1f} um is within w of the {limit}, {band}"
    return "refused", f"after {error * 1e6:.1f} um > {limit} + w, {band}"


def _decide_payload(
    before: Figures, after: Figures, payload: int, limit_m: float | None, correction: object, machine: Machine
) -> Decision:
    _require_above_guard_band(payload, limit_m, COVERAGE_FACTOR * after.u_position_rms_m)
    if isinstance(correction, HostCorrection):
        rotation = bool(np.any(machine.commanded > 2))
        return decide(before, after, limit_m, rotation=rotation, what="the correction stays")
    return decide(before, after, limit_m)


def _require_above_guard_band(payload: int, limit_m: float | None, guard_m: float) -> None:
    if limit_m is not None and limit_m < guard_m:
        raise InputError(
            f"campaign.accept_below_m: payload {payload}: {limit_m * 1e6:.2f} um is below its guard band U = "
            f"{guard_m * 1e6:.2f} um (k = 2), so nothing could be accepted; raise it or measure with less uncertainty"
        )
