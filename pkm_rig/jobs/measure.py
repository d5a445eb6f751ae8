"""Measure a calibration campaign into the store, or continue one."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.base.errors import InputError
from calibration.machine.description import Machine
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.added_visits import adds_visits, first_pose, has_repeated_visits, is_same_rig, renumber_poses
from pkm_rig.jobs.life_record import note_devices
from pkm_rig.jobs.setup_tie import PlannedReadings, tie_to_earlier_setups
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.kept_tables import kept_tables
from pkm_rig.rig.plans import Plan, calibration, prepare
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, open_runner, settings_event
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.rig.table_change import changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import now_text
from pkm_rig.store.campaign_state import is_measured
from pkm_rig.store.store import Store


def measure(
    rig: Rig,
    store: Store,
    notify: Notify,
    progress: Progress,
    resume: str | None = None,
    *,
    new_setup: bool = False,
) -> str:
    """Prepare and measure a calibration campaign, compensation off meanwhile; returns its id.

    Every reading is in the store as soon as it is taken. `resume` continues a campaign that broke off: what is stored
    is not measured again, provided that a nest check finds the station where it was. Visits that the rig file did not
    list when the campaign was begun are added to it. It goes on in the last set-up of the station, or in a `new_setup`.
    Raises DeviceError, CampaignRefused, StoreError, and InputError if the rig file is a different one or the set-up
    cannot be tied to those before.
    """
    settle_tables(rig, store, notify)
    note_devices(rig, store, notify)
    if resume is None:
        campaign, blocks, total = open_campaign(rig, store, notify, verify=False)
    else:
        campaign, blocks, total = reopen_campaign(rig, store, notify, resume, verify=False)
    with (
        open_runner(rig, store, campaign, total.show_by(progress), "measure", notify) as runner,
        changing_tables(rig, store, "measure", campaign) as change,
    ):
        go_on(runner, blocks, total, new_setup=new_setup)
        tie_to_earlier_setups(runner, total)
        measure_blocks(runner, blocks)
        change.bring_to_target()
    return campaign


def open_campaign(
    rig: Rig, store: Store, notify: Notify, *, verify: bool, first: Sequence[int] = ()
) -> tuple[str, tuple[Block, ...], PlannedReadings]:
    """Start a campaign in the store: its id, what it measures and the number of readings, with `verify` to the end.

    first: poses that a control's program visits before all others.
    """
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    blocks = calibration_blocks(rig.machine, rig.file.campaign, rig.file.station.position_m)
    if verify and not has_repeated_visits(blocks):
        raise InputError("campaign.visits: none is made three times, so there would be no noise floor; repeat some")
    total = PlannedReadings(planned_readings(rig.file.campaign, rig.machine, blocks, verify=verify))
    campaign = new_campaign_id(rig.file.rig)
    store.work_on(campaign)  # so that nobody sees it as one that was given up
    header = describe_campaign(rig, campaign, now_text(), kept_tables(rig, store))
    store.add_campaign(header, rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig) | ({"first_poses": list(first)} if first else {}))
    notify(f"campaign {campaign}: {total.total} readings planned")
    return campaign, blocks, total


def reopen_campaign(
    rig: Rig, store: Store, notify: Notify, campaign: str, *, verify: bool
) -> tuple[str, tuple[Block, ...], PlannedReadings]:
    """Go on with a campaign: its id, what of it may be missing, the number of readings to come.

    With `verify` also one whose measurement is complete; nothing is then missing. InputError if it has its verdict.
    """
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    settings = store.events(campaign, "settings")
    if not settings:
        raise InputError(f"campaign {campaign}: it was not measured here; `pkm-rig list` shows what is there")
    if bool(settings[0].data.get("moved_by_control")) != rig.moved_by_control:
        how = "without --moved-by-control" if rig.moved_by_control else "with --moved-by-control"
        raise InputError(f"campaign {campaign}: it was begun {how}; go on with it in the same way")
    stored_rig_file, current_rig_file = (data["rig_file"] for data in (settings[0].data, settings_event(rig)))
    adds = adds_visits(stored_rig_file, current_rig_file)
    if not is_same_rig(stored_rig_file, current_rig_file, adds=adds):
        raise InputError(
            f"campaign {campaign}: begun with another rig file or campaign file; use that, or measure anew"
        )
    events = store.events(campaign)
    verdict = next((e.kind for e in events if e.kind in ("accepted", "refused")), None)
    if verdict is not None:
        raise InputError(f"campaign {campaign} was verified already: {verdict}; see `pkm-rig report {campaign}`")
    complete = is_measured(events)
    if complete and not verify and any(e.kind in ("identified", "verifying") for e in events):
        raise InputError(
            f"campaign {campaign}: its measurement is complete; go on with `calibrate --resume {campaign}`, or measure "
            "a new one, without --resume"
        )
    verification = planned_readings(rig.file.campaign, rig.machine, (), verify=True) if verify else 0
    if complete and verify and not adds:
        notify(f"campaign {campaign}: going on; it is measured")
        return campaign, (), PlannedReadings(verification, verification)
    blocks = calibration_blocks(rig.machine, rig.file.campaign, rig.file.station.position_m)
    if adds:
        blocks = renumber_poses(first_pose(store, campaign, current_rig_file["campaign"]["visits"]), blocks)
    notify(f"campaign {campaign}: going on{' with further visits' if adds else ''}")
    planned = planned_readings(rig.file.campaign, rig.machine, blocks, verify=verify)
    return campaign, blocks, PlannedReadings(planned, verification)


def go_on(runner: Runner, blocks: Sequence[Block], total: PlannedReadings, *, new_setup: bool = False) -> None:
    """Take up what is stored of a campaign, in its last set-up or in a new one; progress counts it."""
    if not runner.store.has_readings(runner.campaign):
        return
    recording = runner.store.recording(runner.campaign)
    if new_setup:
        runner.begin_setup(recording)
    runner.resume(recording)
    settings, machine = runner.rig.file.campaign, runner.rig.machine
    to_come = planned_readings(settings, machine, runner.devices.missing_of(blocks), verify=False) if blocks else 0
    total.total = len(recording) + to_come + total.verification
    runner.devices.progress(len(recording), "stored")


def planned_readings(settings: CampaignSettings, machine: Machine, blocks: Sequence[Block], *, verify: bool) -> int:
    """Number of readings of a campaign, nests included."""
    on = [smr.on for smr in machine.smrs]
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


def measure_blocks(runner: Runner, blocks: Sequence[Block]) -> None:
    """Warm up, check the repeatability and measure all blocks, with compensation off."""
    rig = runner.rig
    rig.enable()
    rig.compensate(None)
    rig.refresh_atmosphere()
    runner.run(_concatenate(prepare(runner.devices, blocks), calibration(runner.devices, blocks)), "calibration")


def _concatenate(first: Plan, second: Plan) -> Plan:
    yield from first
    yield from second
