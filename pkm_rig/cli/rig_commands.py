"""Commands that measure on a rig, or decide by what was measured: calibrate, demo, measure, verify."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.going_on import resumable
from pkm_rig.cli.options import JsonOption, OutOption, RigOption, campaigns, rig_name, rig_path
from pkm_rig.cli.terminal_operator import at_terminal
from pkm_rig.errors import CampaignRefused, StoreError

if TYPE_CHECKING:
    from pkm_rig.results.outcome import CampaignOutcome

ResumeOption = Annotated[
    str | None,
    typer.Option("--resume", help="go on with this campaign, wherever it ended", autocompletion=campaigns),
]
NewSetupOption = Annotated[
    bool, typer.Option("--new-setup", help="the station stands anew: tie it to where it stood, then go on")
]
AcceptChangeOption = Annotated[
    bool,
    typer.Option("--accept-change", help="the machine was altered: its correction may differ much from the former"),
]


def calibrate(
    rig: RigOption,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    resume: ResumeOption = None,
    new_setup: NewSetupOption = False,
    accept_change: AcceptChangeOption = False,
) -> None:
    """The main job: check, measure, identify, diagnose, build tables, write, verify, report."""
    goes_on = resumable("calibrate", rig, out, campaign=resume, new_setup=new_setup)
    _calibrate(rig, out, json, resume, goes_on, new_setup=new_setup, accept_change=accept_change)


def demo(
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    real_time: Annotated[bool, typer.Option(help="at time scale 1; else in virtual time, as fast as it goes")] = False,
    seed: Annotated[int | None, typer.Option(help="which mock machine")] = None,
    machine: Annotated[str | None, typer.Option(help="a shipped machine; planar4 if left out")] = None,
    resume: ResumeOption = None,
    new_setup: NewSetupOption = False,
    accept_change: AcceptChangeOption = False,
) -> None:
    """The main job without hardware: `calibrate` on the embedded mock rig, over its real protocols."""
    from pkm_rig.rig.config import demo_rig_path
    from pkm_rig.rig.expected_error import LEAST_RATIO

    options = ["--real-time"] if real_time else []
    options += [] if seed is None else ["--seed", str(seed)]
    options += [] if machine is None else ["--machine", machine]
    goes_on = resumable("demo", None, out, *options, campaign=resume, new_setup=new_setup)
    outcome = _calibrate(
        demo_rig_path(machine),
        out,
        json,
        resume,
        goes_on,
        new_setup=new_setup,
        real_time=real_time,
        seed=seed,
        accept_change=accept_change,
    )
    if outcome.before_over_floor < LEAST_RATIO:
        raise CampaignRefused(
            f"demo: an error before is only {outcome.before_over_floor:.1f} times the noise floor, {LEAST_RATIO:g} are "
            "needed to show anything"
        )


def _calibrate(
    rig: Path,
    out: Path,
    json: bool,
    resume: str | None,
    goes_on: AbstractContextManager[None],
    *,
    new_setup: bool,
    real_time: bool = False,
    seed: int | None = None,
    accept_change: bool = False,
) -> CampaignOutcome:
    _require_capabilities(rig, tables=True)
    from pkm_rig.jobs.calibrate import calibrate
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.report.terminal import print_message
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.session_record import last_moment
    from pkm_rig.store.store import open_store

    needs, begun_s = Need.MOTION | Need.TABLES, time.monotonic()
    _require_campaign(resume, out, new_setup=new_setup)
    with goes_on, open_store(out, hold=True, rig=rig_name(rig), campaign=resume) as store:
        after = None if resume is None else last_moment(store, resume)
        with (
            open_rig(rig, needs=needs, real_time=real_time, seed=seed, after=after) as connected_rig,
            at_terminal(connected_rig, out) as progress,
        ):
            outcome = calibrate(
                connected_rig,
                store,
                print_message,
                progress,
                resume,
                new_setup=new_setup,
                accept_change=accept_change,
            )
    recording = outcome.reduction.recording
    duration_s = float(recording["t_rig_s"].max() - recording["t_rig_s"].min())
    print_message(
        f"{int(recording['visit'].max()) + 1} visits, {len(recording)} readings, {duration_s / 3600.0:.2f} h of rig "
        f"time in {time.monotonic() - begun_s:.0f} s"
    )
    _report_outcome(outcome, out, json)
    return outcome


def measure(
    rig: RigOption,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    resume: Annotated[
        str | None,
        typer.Option(help="continue this campaign: it broke off, or gets more visits", autocompletion=campaigns),
    ] = None,
    campaign_file: Annotated[
        Path | None,
        typer.Option("--campaign", help="campaign file or CSV: its visits in place of the rig file's poses"),
    ] = None,
    new_setup: NewSetupOption = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="touch no device: print and draw poses, way and duration")
    ] = False,
    moved_by_control: Annotated[
        bool,
        typer.Option(
            "--moved-by-control",
            help="the machine's control visits the poses by the program of `poses --nc`: the station sees when it "
            "stands, no drive is read",
        ),
    ] = False,
    first: Annotated[
        str | None,
        typer.Option(
            help="with --moved-by-control, as with `poses --nc`: the campaign without correction, whose largest errors "
            "are visited first and must have become smaller",
            autocompletion=campaigns,
        ),
    ] = None,
) -> None:
    """Measure a calibration campaign into the store, and stop there."""
    if moved_by_control or first is not None:
        if not moved_by_control or campaign_file is not None or new_setup or dry_run:
            raise InputError(
                "measure: --first is for --moved-by-control, which takes neither --campaign nor --new-setup nor "
                "--dry-run"
            )
        from pkm_rig.cli.watched_command import measure_by_station

        _require_campaign(resume, out, new_setup=False)
        measure_by_station(rig, out, json=json, resume=resume, first=first)
        return
    _require_capabilities(rig, tables=False)
    if dry_run:
        _dry_run(rig, campaign_file, out, json)
        return
    from pkm_rig.jobs.measure import measure
    from pkm_rig.jobs.next_command import command_line, rig_word
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.report.terminal import print_message, print_result
    from pkm_rig.rig.capabilities import Need, can_verify
    from pkm_rig.rig.config import load_rig
    from pkm_rig.rig.schedule import calibration_blocks
    from pkm_rig.rig.session_record import last_moment
    from pkm_rig.rig.visits_file import with_visits
    from pkm_rig.store.store import open_store

    if campaign_file is not None:  # errors are reported before any device is touched
        file, machine = load_rig(rig)
        calibration_blocks(machine, with_visits(file, campaign_file, machine).campaign, file.station.position_m)
    _require_campaign(resume, out, new_setup=new_setup)
    options = [] if campaign_file is None else ["--campaign", str(campaign_file)]
    with (
        resumable("measure", rig, out, *options, campaign=resume, new_setup=new_setup),
        open_store(out, hold=True, rig=rig_name(rig), campaign=resume) as store,
        open_rig(rig, needs=Need.MOTION, after=last_moment(store, resume) if resume else None) as connected_rig,
        at_terminal(connected_rig, out) as progress,
    ):
        if campaign_file is not None:
            connected_rig.file = with_visits(connected_rig.file, campaign_file, connected_rig.machine)
        campaign = measure(connected_rig, store, print_message, progress, resume, new_setup=new_setup)
        simulated = store.header(campaign).simulated
        corrects = can_verify(connected_rig.file, connected_rig.machine, rig)
        made_for = connected_rig.file.campaign.made_for
    if made_for is not None:
        next_command = command_line("report", campaign, "--out", out)
    elif corrects:
        next_command = command_line("verify", campaign, "--rig", rig_word(rig), "--out", out)
    else:
        next_command = command_line("identify", campaign, "--out", out)
    print_result(
        json,
        {"campaign": campaign, "simulated": simulated},
        f"campaign {campaign}",
        f"next: {next_command}",
    )


def _dry_run(rig: Path, campaign_file: Path | None, out: Path, json: bool) -> None:
    from calibration.base.errors import InputError
    from pkm_rig.jobs.dry_run import dry_run
    from pkm_rig.report.dry_run_text import draw_dry_run, print_dry_run
    from pkm_rig.report.pictures import save_png
    from pkm_rig.report.terminal import print_json, results
    from pkm_rig.rig.config import load_rig
    from pkm_rig.rig.visits_file import with_visits

    file, machine = load_rig(rig)
    run = dry_run(file if campaign_file is None else with_visits(file, campaign_file, machine), machine)
    picture = out / f"dry-run-{machine.name}.png"
    try:
        out.mkdir(parents=True, exist_ok=True)
        save_png(draw_dry_run(run), picture, simulated=False)
    except OSError as error:
        raise InputError(f"{picture}: {error.strerror}; give another --out") from error
    if json:
        print_json(run.as_json() | {"picture": str(picture)})
        return
    print_dry_run(run)
    results.print(f"picture: {picture}", soft_wrap=True)


def verify(
    campaign: Annotated[str | None, typer.Argument(help="campaign id in the store", autocompletion=campaigns)] = None,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", parser=rig_path, metavar="RIG.toml", help="rig file; `embedded`: the one of the demo"),
    ] = None,
    before: Annotated[
        str | None, typer.Option(help="where a control leads the machine: campaign or folder without its correction")
    ] = None,
    after: Annotated[str | None, typer.Option(help="the same visits with it: campaign or folder")] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    new_setup: NewSetupOption = False,
    accept_change: AcceptChangeOption = False,
) -> None:
    """Write the tables of a measured campaign, verify them by measuring, keep them or restore the previous ones."""
    if before is not None or after is not None:
        from pkm_rig.cli.watched_command import verify_by_campaigns

        verify_by_campaigns(campaign, rig, before, after, out, json=json)
        return
    if campaign is None or rig is None:
        raise InputError(
            f"verify: {'CAMPAIGN' if campaign is None else '--rig'} is missing. Give both, the rig file as --rig "
            "RIG.toml; where a control leads the machine give --before and --after; without hardware try `pkm-rig demo`"
        )
    _require_capabilities(rig, tables=True)
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.jobs.verify import verify
    from pkm_rig.report.terminal import print_message
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.session_record import last_moment
    from pkm_rig.store.store import open_existing_store, open_store

    with open_existing_store(out) as store:
        store.recording(campaign)  # an unknown campaign is reported before any device is touched
    with (
        resumable("verify", rig, out, campaign=campaign, new_setup=new_setup),
        open_store(out, hold=True, rig=rig_name(rig), campaign=campaign) as store,
        open_rig(rig, needs=Need.MOTION | Need.TABLES, after=last_moment(store, campaign)) as connected_rig,
        at_terminal(connected_rig, out) as progress,
    ):
        outcome = verify(
            connected_rig,
            store,
            campaign,
            print_message,
            progress,
            new_setup=new_setup,
            accept_change=accept_change,
        )
    _report_outcome(outcome, out, json)


def _require_campaign(resume: str | None, out: Path, *, new_setup: bool) -> None:
    """Report an unknown campaign, or none, before any device is touched and before a store is made."""
    from calibration.base.errors import InputError
    from pkm_rig.store.store import open_existing_store

    if new_setup and resume is None:
        raise InputError("--new-setup: of which campaign? give it with --resume ID")
    if resume is not None:
        with open_existing_store(out) as store:
            store.header(resume)


def _report_outcome(outcome: CampaignOutcome, out: Path, json: bool) -> None:
    """Write the report and print the outcome; raises StoreError without a report, CampaignRefused without tables."""
    from pkm_rig.jobs.next_command import command_line
    from pkm_rig.jobs.report import write_outcome_report
    from pkm_rig.report.html import report_path
    from pkm_rig.report.outcome_json import outcome_json
    from pkm_rig.report.outcome_text import print_outcome
    from pkm_rig.report.terminal import print_json

    path: Path | None = report_path(outcome.campaign, out)
    failure = None
    try:
        write_outcome_report(outcome, out)
    except OSError as error:  # the result stands, whatever becomes of its report
        path, failure = None, error
    if json:
        print_json(outcome_json(outcome, path))
    else:
        print_outcome(outcome, path)
    if failure is not None:
        again = command_line("report", outcome.campaign, "--out", out)
        raise StoreError(f"report: {failure}; the result is in the store, write it with `{again}`")
    if not outcome.accepted:
        what = "correction was" if outcome.back_end == "host" else "tables were"
        raise CampaignRefused(f"the {what} {outcome.decision}; see the report for residuals and conditions")


def _require_capabilities(rig: Path, *, tables: bool) -> None:
    """Refuse a rig that cannot do the job, before the store is made and before what takes seconds to import."""
    from pkm_rig.rig.capabilities import Need, require_capabilities
    from pkm_rig.rig.config import load_rig

    file, machine = load_rig(rig)
    require_capabilities(file, machine, rig, Need.MOTION | Need.TABLES if tables else Need.MOTION)
