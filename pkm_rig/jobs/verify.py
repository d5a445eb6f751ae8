"""Verify a measured campaign: write its tables, measure again, keep them or restore the previous ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from calibration.base.errors import InputError
from calibration.identification.calibration import Calibration, identify_recording
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.acceptance import (
    evaluate_campaign,
    last_verification_attempt,
    require_possible_limits,
    stored_outcome,
)
from pkm_rig.jobs.diagnose import try_diagnosis
from pkm_rig.jobs.former_correction import SAMPLES, former_correction
from pkm_rig.jobs.life_record import key_of, note_devices, record_identified, verdict_data
from pkm_rig.jobs.measure import go_on, planned_readings
from pkm_rig.jobs.reversals import diagnosed_reversals
from pkm_rig.jobs.setup_tie import PlannedReadings, tie_to_earlier_setups
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import CampaignOutcome, WrittenTable
from pkm_rig.rig.back_end import back_end_of
from pkm_rig.rig.plans import put_on, verification
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, require_back_end
from pkm_rig.rig.runner import Runner, open_runner
from pkm_rig.rig.schedule import verification_block
from pkm_rig.rig.table_change import VERDICT, TableChange, changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import append_event
from pkm_rig.store.life import PROPOSED, add_life_row
from pkm_rig.store.store import Store

Judge = Callable[[CampaignOutcome, TableChange], tuple[str, ...]]


def verify(
    rig: Rig,
    store: Store,
    campaign: str,
    notify: Notify,
    progress: Progress,
    *,
    new_setup: bool = False,
    accept_change: bool = False,
) -> CampaignOutcome:
    """Verify a measured campaign: identify it, measure before, write and activate its tables, measure after.

    The readings join the campaign, whose frame and nests they need: in its last set-up of the station, which must not
    have been moved, or in a `new_setup`.
    """
    require_back_end(rig)
    settled = settle_tables(rig, store, notify)
    if settled is not None and settled.campaign == campaign and settled.judged:
        return stored_outcome(store, campaign)
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    planned = planned_readings(rig.file.campaign, rig.machine, (), verify=True)
    total = PlannedReadings(planned, planned)
    show = total.show_by(progress)
    show(0, "identifying")
    identification = identify_recording(store.recording(campaign))
    if store.events(campaign, "accepted") or store.events(campaign, "refused"):
        raise InputError(f"campaign {campaign} was verified already; measure a new one")
    show(0, "diagnosing")
    diagnosis = try_diagnosis(store.recording(campaign))
    notify(diagnosis_line(diagnosis))
    note_devices(rig, store, notify)
    record_identified(rig, store, campaign, identification)
    with (
        open_runner(rig, store, campaign, show, "verify", notify) as runner,
        changing_tables(rig, store, "verify", campaign) as change,
    ):
        go_on(runner, (), total, new_setup=new_setup)
        tie_to_earlier_setups(runner, total)
        rig.enable()
        return verify_tables(runner, identification, diagnosis, change, notify, accept_change=accept_change)


def verify_tables(
    runner: Runner,
    identification: Calibration,
    diagnosis: DiagnosisAttempt,
    change: TableChange,
    notify: Notify,
    judge: Judge | None = None,
    *,
    accept_change: bool = False,
) -> CampaignOutcome:
    """Write the tables of an identification, measure before and after, and decide at every payload of the rig file.

    judge: asked about tables that are to stay; where it has reasons against that, the former ones come back.
    accept_change: also a correction that differs much from the former one (InputError without; a judge decides itself).
    """
    rig, store, campaign = runner.rig, runner.store, runner.campaign
    settings = rig.file.campaign
    station_m = rig.file.station.position_m
    blocks = [
        verification_block(rig.machine, settings, payload, station_m) for payload in settings.verification_payloads
    ]
    require_possible_limits(settings.accept_below_m, identification, blocks)
    begun = {"first_sequence": runner.devices.tags.sequence, "accept_below_m": settings.accept_below_m}
    store.add_event(campaign, "verifying", begun)
    written, back_end = [], back_end_of(rig, change)
    for block in blocks:
        payload = block.payload
        notify(f"verifying with payload '{rig.file.payloads[payload].name}'")
        runner.run(put_on(runner.devices, payload), "payload")
        rig.compensate(None)
        rig.refresh_atmosphere()
        runner.run(verification(runner.devices, block, "verification_before"), "verification before")
        temperatures = rig.temperatures_c()
        correction = back_end.build(identification, payload, temperatures)
        correction = back_end.against_reversals(correction, diagnosed_reversals(diagnosis, rig.machine))
        samples = back_end.samples(correction)
        former, change_m = former_correction(rig, store, campaign, payload), None
        if former is not None:
            accept = accept_change or judge is not None
            change_m = back_end.change_since(correction, *former, accept=accept)
        corrected = back_end.commanded(block, correction)
        if (remark := back_end.remark(block, correction)) is not None:
            notify(remark)
        drives = back_end.try_out(correction)
        activated = {
            "payload": payload,
            "temperatures_c": temperatures,
            "tables": drives,
            "payload_kg": rig.file.payloads[payload].mass_kg,
            "largest_change": change_m,
            SAMPLES: samples.as_json(),
            **back_end.settings(),
        }
        store.add_event(campaign, "activated", activated)
        written.append(WrittenTable(correction, payload, drives))
        runner.run(verification(runner.devices, corrected, "verification_after"), "verification after")
        back_end.require_in_use()
    recording = last_verification_attempt(store, campaign)
    outcome = evaluate_campaign(
        campaign,
        identification,
        recording,
        tuple(written),
        diagnosis,
        previous_tables=change.description,
        limits_m=settings.accept_below_m,
    )
    if outcome.accepted and judge is not None and (beyond := judge(outcome, change)):
        outcome = replace(outcome, beyond=beyond, restored=change.description)
    _record_verdict(rig, store, outcome, change)
    if outcome.accepted:
        back_end.keep()
    else:
        notify(f"the result is {outcome.decision}; back to {change.description}")
        back_end.roll_back()
    return replace(outcome, head=store.head(campaign))


def _record_verdict(rig: Rig, store: Store, outcome: CampaignOutcome, change: TableChange) -> None:
    """From here on the tables stay, if they are accepted, whatever happens: the next command would finish it.

    The verdict and its place in the machine's life are one transaction.
    """
    verified = [
        {"payload": v.payload, "before": v.before.as_dict(), "after": v.after.as_dict(), "rule": v.decision.rule}
        for v in outcome.verified
    ]
    event = {
        VERDICT: change.id,
        "decision": outcome.decision,
        "beyond": list(outcome.beyond),
        "restored": outcome.restored,
        "noise_floor": outcome.floor.as_dict(),
        "verified": verified,
    }
    kind = PROPOSED if outcome.beyond else outcome.decision
    own = {"rig": rig.file.rig, "machine": key_of(rig), "kind": kind, "campaign": outcome.campaign}
    with store.writing() as connection:
        append_event(connection, outcome.campaign, "accepted" if outcome.accepted else "refused", event)
        add_life_row(
            connection, "calibrations", data=verdict_data(outcome, had_tables=change.before.on, change=change.id), **own
        )
