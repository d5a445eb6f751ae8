"""Measure a calibration campaign into the store, or continue one."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.base.errors import InputError
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.added_visits import adds_visits, first_pose, has_repeated_visits, is_same_rig, renumber_poses
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.plans import Plan, calibration, prepare
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, open_runner, settings_event
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.rig.table_change import changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import now_text
from pkm_rig.store.store import Store


def measure(rig: Rig, store: Store, notify: Notify, progress: Progress, resume: str | None = None) -> str:
    """Prepare and measure a calibration campaign, compensation off meanwhile; returns its id.

    Every reading is in the store as soon as it is taken. `resume` continues a campaign that broke off: what is stored
    is not measured again, provided that a nest check finds the station where it was. Visits that the rig file did not
    list when the campaign was begun are added to it.
    Raises DeviceError, CampaignRefused, StoreError, and InputError if the rig file is a different one.
    """
    settle_tables(rig, store, notify)
    if resume is None:
        campaign, blocks, total = open_campaign(rig, store, notify, verify=False)
    else:
        campaign, blocks, total = _reopen_campaign(rig, store, notify, resume)
    with (
        open_runner(rig, store, campaign, lambda n, what: progress(n, total, what), "measure", notify) as runner,
        changing_tables(rig, store, "measure", campaign) as change,
    ):
        if resume is not None and store.has_readings(campaign):
            runner.resume(store.recording(campaign))
        measure_blocks(runner, blocks)
        change.bring_to_target()
    return campaign


def open_campaign(rig: Rig, store: Store, notify: Notify, *, verify: bool) -> tuple[str, tuple[Block, ...], int]:
    """Start a campaign in the store: its id, what it measures and the number of readings, with `verify` to the end."""
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if verify and not has_repeated_visits(blocks):
        raise InputError("campaign.visits: none is made three times, so there would be no noise floor; repeat some")
    total = planned_readings(rig, blocks, verify=verify)
    campaign = new_campaign_id(rig.file.rig)
    store.add_campaign(describe_campaign(rig, campaign, now_text()), rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig))
    notify(f"campaign {campaign}: {total} readings planned")
    return campaign, blocks, total


def _reopen_campaign(rig: Rig, store: Store, notify: Notify, campaign: str) -> tuple[str, tuple[Block, ...], int]:
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    settings = store.events(campaign, "settings")
    if not settings:
        raise InputError(f"campaign {campaign}: it was not measured here; `pkm-rig list` shows what is there")
    stored_rig_file, current_rig_file = (data["rig_file"] for data in (settings[0].data, settings_event(rig)))
    adds = adds_visits(stored_rig_file, current_rig_file)
    if not is_same_rig(stored_rig_file, current_rig_file, adds=adds):
        raise InputError(
            f"campaign {campaign}: begun with another rig file or campaign file; use that, or measure anew"
        )
    if store.events(campaign, "identified") or store.events(campaign, "verifying"):
        raise InputError(f"campaign {campaign}: its measurement is complete; measure a new one, without --resume")
    blocks = calibration_blocks(rig.machine, rig.file.campaign)
    if adds:
        blocks = renumber_poses(first_pose(store, campaign, current_rig_file["campaign"]["visits"]), blocks)
    notify(f"campaign {campaign}: going on{' with further visits' if adds else ''}")
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
