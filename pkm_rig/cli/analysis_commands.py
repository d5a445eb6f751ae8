"""Commands that compute: identify, diagnose, compare, poses, compensate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.fleet_commands import AgainOption, AllOption, JobsOption, SchedulerOption
from pkm_rig.cli.options import (
    CampaignArgument,
    JsonOption,
    MaybeCampaignArgument,
    OutOption,
    SequenceOption,
    rig_path,
)


def identify(
    campaign: MaybeCampaignArgument = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    estimator: Annotated[str, typer.Option(help="map, least_squares, tikhonov, l_curve or truncated_svd")] = "map",
    robust: Annotated[bool, typer.Option("--robust", help="tolerate outliers (Huber's loss); recordings only")] = False,
    monte_carlo: Annotated[int, typer.Option(help="draws of a Monte Carlo check; recordings only")] = 0,
    by_sequence: SequenceOption = False,
    all_campaigns: AllOption = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    again: AgainOption = False,
) -> None:
    """Identify a recording or a measurement folder: parameters with uncertainty, held-out error, bound."""
    from pkm_rig.cli.fleet_commands import run_on_all
    from pkm_rig.jobs.identify import identify_with_checks
    from pkm_rig.jobs.many_campaigns import identify_work
    from pkm_rig.jobs.measured_machine import find_measurement_folder, identify_measurements
    from pkm_rig.report.identified_text import print_identification
    from pkm_rig.report.measured_text import print_measurements
    from pkm_rig.report.terminal import print_either, say_repaired
    from pkm_rig.store.store import find_recording

    if _is_on_all("identify", campaign, all_campaigns, by_sequence, jobs, scheduler, again=again):
        work = identify_work(estimator, robust=robust, draws=monte_carlo)
        run_on_all(work, out, json, jobs, scheduler, again=again)
        return
    assert campaign is not None  # else it is refused
    measurements = find_measurement_folder(campaign, out)
    if measurements is None:
        recording = find_recording(campaign, out, by_sequence=by_sequence)
        repaired = say_repaired(recording)
        result = identify_with_checks(recording, estimator, robust=robust, draws=monte_carlo) | repaired
        print_either(json, result, print_identification)
        return
    if robust or monte_carlo:
        raise InputError("identify: --robust and --monte-carlo are for recordings; leave them out for a folder")
    print_either(json, identify_measurements(measurements, estimator), print_measurements)


def diagnose(
    campaign: MaybeCampaignArgument = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    add: Annotated[bool, typer.Option("--add", help="write the rig's twin: the model with the effects found")] = False,
    effects: Annotated[
        list[Path] | None,
        typer.Option(help="Python file with your own effects (docs/explanation/diagnosis.md); again for more"),
    ] = None,
    estimate_disturbances: Annotated[
        bool,
        typer.Option(
            "--estimate-disturbances", help="print the rig file's section [nuisance] instead, from a quiet campaign"
        ),
    ] = False,
    thorough: Annotated[
        bool, typer.Option("--thorough", help="leave out nothing to save time; may take minutes")
    ] = False,
    by_sequence: SequenceOption = False,
    all_campaigns: AllOption = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    again: AgainOption = False,
) -> None:
    """Say where the model still differs from the machine, which effect causes it, and what to measure next."""
    from pkm_rig.cli.fleet_commands import run_on_all
    from pkm_rig.jobs.axis import diagnose_folder, is_axis
    from pkm_rig.jobs.diagnose import run_diagnosis, run_folder_diagnosis
    from pkm_rig.jobs.disturbance_levels import estimate_disturbances as estimate_levels_of
    from pkm_rig.jobs.many_campaigns import diagnose_work
    from pkm_rig.jobs.measured_machine import find_measurement_folder
    from pkm_rig.jobs.next_command import measure_more
    from pkm_rig.jobs.session import store_if_there
    from pkm_rig.report.diagnosis_text import describe_diagnosis
    from pkm_rig.report.terminal import print_json, print_result, results, say_repaired
    from pkm_rig.store.store import find_recording

    if _is_on_all("diagnose", campaign, all_campaigns, by_sequence, jobs, scheduler, again=again):
        if estimate_disturbances:
            raise InputError("diagnose: --estimate-disturbances is of one campaign; leave out --all")
        run_on_all(diagnose_work(effects or (), add=add, thorough=thorough), out, json, jobs, scheduler, again=again)
        return
    assert campaign is not None  # else it is refused
    if is_axis(campaign):
        if add or effects or estimate_disturbances or thorough:
            raise InputError(
                "diagnose: --add, --effects, --estimate-disturbances and --thorough are for machines; leave them out "
                "for one axis"
            )
        print_result(json, *diagnose_folder(Path(campaign)))
        return
    measurements = find_measurement_folder(campaign, out)
    if measurements is not None:
        if estimate_disturbances:
            raise InputError("diagnose: --estimate-disturbances is for recordings; leave it out for a folder")
        diagnosis, result = run_folder_diagnosis(measurements, out, effects or (), add=add, thorough=thorough)
        print_result(json, result, describe_diagnosis(diagnosis, result))
        return
    recording = find_recording(campaign, out, by_sequence=by_sequence)
    repaired = say_repaired(recording)
    if estimate_disturbances:
        if add or effects or thorough:
            raise InputError(
                "diagnose: --estimate-disturbances looks for no effect; leave out --add, --effects and --thorough"
            )
        levels, section = estimate_levels_of(recording)
        if json:
            print_json(levels)
        else:  # a file of TOML, whose comments say what else is to be known
            results.print(section, soft_wrap=True)
        return
    diagnosis, result = run_diagnosis(recording, out, effects or (), add=add, thorough=thorough)
    with store_if_there(out) as store:
        is_stored = store is not None and not Path(campaign).is_dir()
        measure_with = measure_more(store, campaign, out) if store is not None and is_stored else None
    print_result(json, result | repaired, describe_diagnosis(diagnosis, result, measure_with))


def _is_on_all(
    command: str, campaign: str | None, all_campaigns: bool, by_sequence: bool, jobs: object, scheduler: object, *,
    again: bool,
) -> bool:  # fmt: skip
    """Whether all campaigns are meant; InputError unless it is either all of them or one."""
    if all_campaigns and (campaign is not None or by_sequence):
        raise InputError(
            f"{command}: --all is of the store's campaigns; leave out {campaign or '--sessions-from-sequence'}"
        )
    if not all_campaigns and campaign is None:
        raise InputError(f"{command}: of which campaign? `pkm-rig list` shows what is there; --all is all of them")
    if not all_campaigns and (jobs is not None or scheduler is not None or again):
        raise InputError(f"{command}: --jobs, --scheduler and --again go with --all")
    return all_campaigns


def compare(
    before: CampaignArgument,
    after: CampaignArgument,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    by_sequence: SequenceOption = False,
) -> None:
    """Say what changed on the machine between two campaigns, and what that does at the tool point."""
    from pkm_rig.jobs.compare import run_comparison, run_folder_comparison
    from pkm_rig.jobs.measured_machine import find_measurement_folder
    from pkm_rig.report.comparison_text import describe_comparison
    from pkm_rig.report.terminal import print_result, say_repaired
    from pkm_rig.store.store import find_recording

    first, second = (find_measurement_folder(campaign, out) for campaign in (before, after))
    if first is not None and second is not None:
        comparison, result = run_folder_comparison(first, second, out)
        print_result(json, result, describe_comparison(comparison, result))
        return
    if first is not None or second is not None:
        raise InputError(
            f"compare: {before if first is not None else after} is a measurement folder and the other is not; give two "
            "folders or two recordings"
        )
    recordings = [find_recording(campaign, out, by_sequence=by_sequence) for campaign in (before, after)]
    for recording in recordings:
        say_repaired(recording)
    comparison, result = run_comparison(recordings[0], recordings[1], out)
    print_result(json, result, describe_comparison(comparison, result))


def poses(
    rig: Annotated[Path | None, typer.Option(parser=rig_path, metavar="RIG.toml", help="rig file")] = None,
    machine: Annotated[str | None, typer.Option(help="a machine instead: shipped name or path; full poses")] = None,
    count: Annotated[int, typer.Option(help="how many poses to measure under each load")] = 40,
    criterion: Annotated[str, typer.Option(help="I: least predicted variance; D: largest information")] = "I",
    virtual_axis: Annotated[
        str | None, typer.Option("--virtual-axis", help="x, y or z: instead, the visits of ISO 230-2 along it")
    ] = None,
    iso9283: Annotated[bool, typer.Option("--iso9283", help="instead, the visits of 30 cycles of ISO 9283")] = False,
    nc: Annotated[
        Path | None, typer.Option("--nc", help="instead, write the rig's visits as an NC program, and as CSV beside it")
    ] = None,
    coordinates: Annotated[
        str, typer.Option(help="with --nc: command the drives' positions, or the pose of the tool (tool)")
    ] = "drives",
    axes: Annotated[str | None, typer.Option(help="with --nc: axis words, with commas, such as X,Y or Y1=,Y2=")] = None,
    dwell: Annotated[float | None, typer.Option(help="with --nc: dwell in s at each visit; left out, M0")] = None,
    first: Annotated[
        str | None,
        typer.Option(help="with --nc: campaign without correction, whose three largest errors are visited first"),
    ] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Choose the most informative poses, compare them with a grid, and list what they would leave undetermined."""
    from calibration.machine.description import load_machine, shipped_machine
    from pkm_rig.jobs.planning import Planner, parse_count, parse_criterion
    from pkm_rig.report.plan_text import print_plan
    from pkm_rig.report.terminal import print_either
    from pkm_rig.rig.config import load_rig

    if nc is not None:
        _nc_program(rig, nc, (coordinates, axes, dwell, first), out, json)
        return
    if coordinates != "drives" or axes is not None or dwell is not None or first is not None:
        raise InputError("poses: --coordinates, --axes, --dwell and --first are for --nc; give it")
    if virtual_axis is not None or iso9283:
        _standard_poses(rig, virtual_axis, json, iso9283=iso9283)
        return
    if machine is not None and rig is None:
        path = Path(machine) if machine.endswith(".toml") else shipped_machine(machine)
        planner = Planner.of_machine(load_machine(path))
    elif rig is not None and machine is None:
        planner = Planner.of_rig(*load_rig(rig))
    else:
        raise InputError("poses: give --rig or --machine, and not both")
    print_either(json, planner.plan(parse_count(count), parse_criterion(criterion)), print_plan)


def _standard_poses(rig: Path | None, virtual_axis: str | None, json: bool, *, iso9283: bool) -> None:
    """The visits that the formulae of a standard need, as a campaign file."""
    from pkm_rig.jobs.campaign_file import standard_campaign_text
    from pkm_rig.report.terminal import print_json
    from pkm_rig.rig.config import load_rig
    from pkm_rig.rig.standard_visits import axis_visits, pose_visits

    if rig is None or (virtual_axis is not None and iso9283):
        raise InputError("poses: --virtual-axis and --iso9283 need --rig, and each is a campaign of its own")
    file, described = load_rig(rig)
    section = pose_visits(described) if virtual_axis is None else axis_visits(described, file.campaign, virtual_axis)
    if json:
        visits = [visit.model_dump(mode="json") for visit in section.visits]
        print_json({"machine": described.name, "made_for": section.made_for, "visits": visits})
    else:
        print(standard_campaign_text(section, described), end="")


def _nc_program(
    rig: Path | None, path: Path, options: tuple[str, str | None, float | None, str | None], out: Path, json: bool
) -> None:
    """Write the visits of a rig as an NC program."""
    from pkm_rig.jobs.nc_program import NcChoice, write_program
    from pkm_rig.jobs.verify_folders import largest_error_poses
    from pkm_rig.report.control_text import print_program
    from pkm_rig.report.terminal import print_either
    from pkm_rig.rig.config import load_rig
    from pkm_rig.store.store import find_recording

    coordinates, axes, dwell_s, campaign = options
    if rig is None:
        raise InputError("poses --nc: give the rig file, whose campaign it is, with --rig")
    file, machine = load_rig(rig)
    first = () if campaign is None else largest_error_poses(find_recording(campaign, out))
    print_either(json, write_program(file, machine, path, NcChoice(coordinates, axes, dwell_s), first), print_program)


def compensate(
    campaign: CampaignArgument,
    payload: Annotated[int, typer.Option(help="number of the payload in the rig's list")] = 0,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="files for a control: csv, linuxcnc-comp, linuxcnc-comp-0, siemens-cec, beckhoff-plane, "
            "heidenhain-com; calibrated geometry: genhexkins, lineardeltakins, klipper-delta. Of vendors only "
            "LinuxCNC's software has read files of ours; csv has no vendor",
        ),
    ] = None,
    control: Annotated[
        str | None, typer.Option(help="which control, for example sinumerik-828d or sinumerik-840d-sl")
    ] = None,
    axes: Annotated[
        str | None, typer.Option(help="the control's names of the drives' axes, with commas, as in the machine file")
    ] = None,
    accept_loss: Annotated[
        bool,
        typer.Option("--accept-loss", help="also a format that removes less than half of the tool's predicted error"),
    ] = False,
    accept_change: Annotated[
        bool, typer.Option("--accept-change", help="also a correction that differs much from the former one")
    ] = False,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    by_sequence: SequenceOption = False,
) -> None:
    """Compute the compensation tables of a recording and save them; `verify` writes them to the drives."""
    from calibration.compensation.kinematics.catalogue import KINEMATICS
    from pkm_rig.jobs.compensate import compensate_recording
    from pkm_rig.jobs.control_files import Choice, write_control_files
    from pkm_rig.jobs.kinematics_files import write_kinematics_files
    from pkm_rig.report.control_text import print_control_files, print_kinematics_files
    from pkm_rig.report.terminal import print_either, print_message, print_result, say_repaired
    from pkm_rig.store.store import find_recording

    if form is None and (control is not None or axes is not None or accept_loss or accept_change):
        raise InputError("compensate: --control, --axes, --accept-loss and --accept-change are for --format; give it")
    recording = find_recording(campaign, out, by_sequence=by_sequence)
    repaired = say_repaired(recording)
    if form is None:
        tables = repaired | compensate_recording(recording, payload, out)
        print_result(json, tables, f"tables: {tables['folder']}")
        return
    choice = Choice(form, control, axes, accept_loss=accept_loss, accept_change=accept_change)
    if form in KINEMATICS:
        geometry = repaired | write_kinematics_files(recording, payload, out, choice, print_message)
        print_either(json, geometry, print_kinematics_files)
        return
    result = repaired | write_control_files(recording, payload, out, choice, print_message)
    print_either(json, result, print_control_files)
