"""Measure a campaign of a machine that its own control moves: the station sees when it stands, no drive is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.recording.recording import Recording
from calibration.reduction.reduction import CALIBRATION
from pkm_rig.jobs.life_record import note_devices
from pkm_rig.jobs.measure import go_on, open_campaign, reopen_campaign
from pkm_rig.jobs.nc_program import with_first_poses
from pkm_rig.jobs.verify_folders import FIRST_POSES, largest_error_poses, require_smaller_errors
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.plans import Plan, calibration, put_on, steady_temperatures, visits
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.runner import Runner, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.store.store import Store


def measure_watched(
    rig: Rig,
    store: Store,
    notify: Notify,
    progress: Progress,
    resume: str | None = None,
    *,
    before: Recording | None = None,
) -> str:
    """Watch the control's program visit the rig file's poses and measure them; the campaign's id.

    `before`: a campaign of the same visits without the control's correction. The program visits the three poses with
    its largest errors first (`poses --nc --first`); once these are measured CorrectionGrows is raised if the error has
    grown there. `resume` goes on with a campaign; the visit in which it ended is measured anew.
    Raises DeviceError, CampaignRefused (also for a pose that is not the next one), StoreError and InputError.
    """
    if not rig.moved_by_control:
        raise TypeError("a rig that its control moves is needed")
    require_program(rig.file, rig.machine)
    first = () if before is None else largest_error_poses(before)
    if resume is None:
        note_devices(rig, store, notify)
        campaign, blocks, total = open_campaign(rig, store, notify, verify=False, first=first)
    else:
        _require_same_first(store, resume, first)
        campaign, blocks, total = reopen_campaign(rig, store, notify, resume, verify=False)
        note_devices(rig, store, notify)
    order: Sequence[Block] = with_first_poses(blocks, first)
    command = "measure --moved-by-control"
    with open_runner(rig, store, campaign, total.show_by(progress), command, notify, order) as runner:
        go_on(runner, order, total)
        rig.refresh_atmosphere()
        runner.run(_prepared(runner), "preparation")
        if before is not None:
            order = _measure_first(runner, before, order)
            notify("the error is smaller at the first poses: going on")
        runner.run(calibration(runner.devices, order), "calibration")
    return campaign


def require_program(file: RigFile, machine: Machine) -> None:
    """Raise InputError where a rig file's campaign is none that a program can visit and the station can watch."""
    if not any(smr.on == "platform" for smr in machine.smrs):
        raise InputError(f"machine {machine.name}: it has no reflector on its platform, which the station could follow")
    calibration_blocks(machine, file.campaign, file.station.position_m)


def _prepared(runner: Runner) -> Plan:
    yield from put_on(runner.devices, 0)
    yield from steady_temperatures(runner.devices)


def _measure_first(runner: Runner, before: Recording, order: Sequence[Block]) -> tuple[Block, ...]:
    """Measure the first poses, between nest checks, and hear what they say of the correction; what is left then."""
    devices, (opening, *others) = runner.devices, order
    first = replace(opening, visits=opening.visits[:FIRST_POSES])
    if devices.missing_of([first]):
        runner.run(visits(devices, first, CALIBRATION, devices.smrs("platform", "slider")), "first poses")
    require_smaller_errors(before, runner.store.recording(runner.campaign))
    return (replace(opening, visits=opening.visits[FIRST_POSES:]), *others)


def _require_same_first(store: Store, campaign: str, first: Sequence[int]) -> None:
    settings = store.events(campaign, "settings")
    begun = settings[0].data.get("first_poses", []) if settings else []
    if list(begun) != list(first):
        what = f"visits poses {', '.join(map(str, begun))} first" if begun else "visits none of them first"
        raise InputError(f"campaign {campaign}: its program {what}; give the same --first, or none if it had none")
