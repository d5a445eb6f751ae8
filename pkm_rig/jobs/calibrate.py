"""The main job: check, measure, identify, diagnose, build tables, write, verify, and a verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bluesky.plan_stubs as bps

from calibration.base.errors import InputError
from calibration.compensation.tables import table_for_payload
from calibration.identification.calibration import (
    Calibration,
    identified_summary,
    identify_recording,
)
from drivers.drives.table_bank import CompensationState
from pkm_rig.jobs.diagnose import attempt
from pkm_rig.jobs.further_visits import adds_visits, first_pose, numbered_from, same_rig, visited_thrice
from pkm_rig.jobs.verdict import judge, last_attempt
from pkm_rig.report.diagnosis_json import attempt_json
from pkm_rig.report.diagnosis_text import attempt_line
from pkm_rig.results.attempt import Attempt
from pkm_rig.results.outcome import Outcome, Written
from pkm_rig.rig.fitness import check_rig
from pkm_rig.rig.former_tables import FormerTables, former_tables
from pkm_rig.rig.plans import CampaignRefused, Plan, calibration, prepare, verification
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, running, settings_event
from pkm_rig.rig.schedule import Block, calibration_blocks, verification_block
from pkm_rig.rig.store import Store, now_text

Say = Callable[[str], None]
Progress = Callable[[int, int, str], None]


def measure(rig: Rig, store: Store, say: Say, progress: Progress, resume: str | None = None) -> str:
    """Prepare and measure a calibration campaign, compensation off meanwhile; returns its id.

    Every reading is in the store as soon as it is taken. `resume` goes on with a campaign that broke off: what is
    stored is not measured again, provided that a nest check finds the station where it was. Where the rig file now
    gives visits that it did not give then, they are added to the campaign.
    Raises DeviceError, CampaignRefused, StoreError, and InputError where the rig file is another one.
    """
    if resume is None:
        campaign, blocks, total = _open_campaign(rig, store, say, verify=False)
    else:
        campaign, blocks, total = _reopen_campaign(rig, store, say, resume)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        if resume is not None and store.has_readings(campaign):
            runner.resume(store.recording(campaign))
        _measure(runner, blocks)
        former.restore()
    return campaign


def calibrate(rig: Rig, store: Store, say: Say, progress: Progress) -> Outcome:
    """Run the main job on a connected rig.

    Raises DeviceError, CampaignRefused, StoreError or InputError with the machine stopped, former
    tables restored where the drives can still be reached, and all readings kept.
    """
    campaign, blocks, total = _open_campaign(rig, store, say, verify=True)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        _measure(runner, blocks)
        say("identifying")
        identified = identify_recording(store.recording(campaign))
        store.add_event(campaign, "identified", identified_summary(identified))
        diagnosis = attempt(store.recording(campaign))
        store.add_event(campaign, "diagnosed", attempt_json(diagnosis))
        say(attempt_line(diagnosis))
        return _verify(runner, identified, diagnosis, former, say)


def verify(rig: Rig, store: Store, campaign: str, say: Say, progress: Progress) -> Outcome:
    """Verify a measured campaign: identify it, measure before, write and activate its tables, measure after.

    The readings join the campaign, whose frame and nests they need: the station must not have been moved.
    """
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    identified = identify_recording(store.recording(campaign))
    if store.events(campaign, "accepted") or store.events(campaign, "refused"):
        raise InputError(f"campaign {campaign} was verified already; measure a new one")
    diagnosis = attempt(store.recording(campaign))
    say(attempt_line(diagnosis))
    total = planned_readings(rig, (), verify=True)
    with (
        running(rig, store, campaign, lambda n, what: progress(n, total, what)) as runner,
        former_tables(rig) as former,
    ):
        runner.resume(store.recording(campaign))
        rig.enable()
        return _verify(runner, identified, diagnosis, former, say)


def _open_campaign(rig: Rig, store: Store, say: Say, *, verify: bool) -> tuple[str, tuple[Block, ...], int]:
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if verify and not visited_thrice(blocks):
        raise InputError("campaign.visits: none is made three times, so there would be no noise floor; repeat some")
    total = planned_readings(rig, blocks, verify=verify)
    campaign = new_campaign_id(rig.file.rig)
    store.add_campaign(describe_campaign(rig, campaign, now_text()), rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig))
    say(f"campaign {campaign}: {total} readings planned")
    return campaign, blocks, total


def _reopen_campaign(rig: Rig, store: Store, say: Say, campaign: str) -> tuple[str, tuple[Block, ...], int]:
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    settings = store.events(campaign, "settings")
    if not settings:
        raise InputError(f"campaign {campaign}: it was not measured here; `pkm-rig list` shows what is there")
    then, now = (data["rig_file"] for data in (settings[0].data, settings_event(rig)))
    adds = adds_visits(then, now)
    if not same_rig(then, now, adds=adds):
        raise InputError(
            f"campaign {campaign}: begun with another rig file or campaign file; use that, or measure anew"
        )
    if store.events(campaign, "identified") or store.events(campaign, "verifying"):
        raise InputError(f"campaign {campaign}: its measurement is complete; measure a new one, without --resume")
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if adds:
        blocks = numbered_from(first_pose(store, campaign, now["campaign"]["visits"]), blocks)
    say(f"campaign {campaign}: going on{' with further visits' if adds else ''}")
    return campaign, blocks, planned_readings(rig, blocks, verify=False)


def planned_readings(rig: Rig, blocks: Sequence[Block], *, verify: bool) -> int:
    """Number of readings of a campaign, nests included."""
    settings = rig.file.campaign
    on = [smr.on for smr in rig.machine.smrs]
    platform, floor, slider = (on.count(part) for part in ("platform", "floor", "slider"))
    visits = [len(block.visits) for block in blocks]
    readings = sum(visits) * (platform + slider)
    checks = sum(2 + (n - 1) // settings.nest_every_visits for n in visits)
    if blocks:
        readings += settings.repeatability_visits
        checks += 1
    if verify:
        runs = 2 * len(settings.verification_payloads)
        readings += runs * settings.verification_poses * platform
        checks += runs * (2 + (settings.verification_poses - 1) // settings.nest_every_visits)
    return readings + floor * checks


def _measure(runner: Runner, blocks: Sequence[Block]) -> None:
    rig = runner.rig
    rig.enable()
    rig.compensate(None)
    rig.refresh_atmosphere()
    runner.run(_both(prepare(runner.stage, blocks), calibration(runner.stage, blocks)), "calibration")


def _verify(runner: Runner, identified: Calibration, diagnosis: Attempt, former: FormerTables, say: Say) -> Outcome:
    rig, store, campaign = runner.rig, runner.store, runner.campaign
    store.add_event(campaign, "verifying", {"first_sequence": runner.stage.context.sequence})
    written = []
    payloads = rig.file.campaign.verification_payloads
    for payload in payloads:
        block = verification_block(rig.machine, rig.file.campaign, payload)
        say(f"verifying with payload '{rig.file.payloads[payload].name}'")
        runner.run(_payload(runner, payload), "payload")
        rig.compensate(None)
        rig.refresh_atmosphere()
        runner.run(verification(runner.stage, block, "verification_before"), "verification before")
        temperatures = rig.temperatures_c()
        table = table_for_payload(identified, payload, temperatures)
        drives = table_summary(rig, rig.compensate(rig.images(table, rig.next_generation())))
        activated = {"payload": payload, "temperatures_c": temperatures, "tables": drives}
        store.add_event(campaign, "activated", activated)
        written.append(Written(table, payload, drives))
        runner.run(verification(runner.stage, block, "verification_after"), "verification after")
    recording = last_attempt(store, campaign)
    outcome = judge(campaign, identified, recording, tuple(written), diagnosis, former.description)
    if not outcome.accepted:
        say(f"the result is refused; back to {former.description}")
        former.restore()
    _record_verdict(store, outcome)
    return outcome


def _both(first: Plan, second: Plan) -> Plan:
    yield from first
    yield from second


def _payload(runner: Runner, payload: int) -> Plan:
    yield from bps.abs_set(runner.stage.payload, payload, wait=True)


def table_summary(rig: Rig, states: Sequence[CompensationState]) -> dict[str, dict[str, Any]]:
    """Drive to generation, CRC and whether its table is active."""
    return {
        drive.name: {"generation": state.generation, "crc": state.crc, "active": state.valid}
        for drive, state in zip(rig.file.drives, states, strict=True)
    }


def _record_verdict(store: Store, outcome: Outcome) -> None:
    store.add_event(
        outcome.campaign,
        "accepted" if outcome.accepted else "refused",
        {
            "restored": outcome.restored,
            "noise_floor": outcome.floor.as_dict(),
            "verified": [
                {
                    "payload": v.payload,
                    "before": v.before.as_dict(),
                    "after": v.after.as_dict(),
                    "rule": v.decision.rule,
                }
                for v in outcome.verified
            ],
        },
    )
