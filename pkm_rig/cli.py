"""The command line. Messages and progress go to stderr, results to stdout; `--json` prints one object."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from pathlib import Path
from typing import Annotated

import typer

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.folder import read_folder, write_folder
from drivers.errors import DeviceError
from pkm_rig.jobs import calibrate as job
from pkm_rig.jobs import diagnose as diagnosing
from pkm_rig.jobs import homing, interim, planning
from pkm_rig.jobs.check import check_devices
from pkm_rig.jobs.compensate import compensate_recording
from pkm_rig.jobs.identify import identify_with_checks
from pkm_rig.jobs.measured_machine import find_measurements, identify_measured, import_printer
from pkm_rig.jobs.session import find_recording, open_rig, open_store
from pkm_rig.jobs.verdict import stored_outcome
from pkm_rig.report import diagnosis_text
from pkm_rig.report.check_text import print_check
from pkm_rig.report.homing_text import print_homing
from pkm_rig.report.html import write_report
from pkm_rig.report.identified_text import print_identified
from pkm_rig.report.interim_text import interim_test_json, print_interim_test
from pkm_rig.report.measured_text import print_measured
from pkm_rig.report.outcome_json import outcome_json
from pkm_rig.report.outcome_text import print_outcome
from pkm_rig.report.plan_text import print_plan
from pkm_rig.report.terminal import messages, print_json, print_result, progress_bar, results
from pkm_rig.results.outcome import Outcome
from pkm_rig.rig.config import embedded_rig_path, load_rig, with_visits
from pkm_rig.rig.plans import CampaignRefused
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.rig.store import StoreError
from pkm_rig.virtual import mock_rig
from pkm_rig.virtual.twin_files import find_twin

REFUSED, BAD_INPUT, DEVICE, INTERNAL = 1, 2, 3, 4

app = typer.Typer(
    help="Calibrates over-constrained parallel kinematic machines on the machine itself.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

RigOption = Annotated[Path | None, typer.Option("--rig", help="rig file; without it the embedded mock rig")]
RigNeeded = Annotated[Path, typer.Option("--rig", help="rig file")]
OutOption = Annotated[Path, typer.Option("--out", help="folder of the store and of reports")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store, or a recording folder")]


@app.command()
def calibrate(
    rig: RigOption = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    real_time: Annotated[bool, typer.Option(help="embedded mock rig at time scale 1")] = False,
    seed: Annotated[int | None, typer.Option(help="which embedded mock machine")] = None,
) -> None:
    """The main job: check, measure, identify, diagnose, build tables, write, verify, report."""
    with open_store(out) as store, open_rig(rig, real_time=real_time, seed=seed) as connected, progress_bar() as tell:
        outcome = job.calibrate(connected, store, _say, tell)
    _finish(outcome, out, json)


@app.command()
def verify(
    campaign: Annotated[str, typer.Argument(help="campaign id in the store")],
    rig: RigNeeded,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write the tables of a measured campaign, verify them by measuring, keep them or put the former back."""
    with open_store(out) as store:
        store.recording(campaign)  # an unknown campaign is said before any device is touched
    with open_store(out) as store, open_rig(rig) as connected, progress_bar() as tell:
        outcome = job.verify(connected, store, campaign, _say, tell)
    _finish(outcome, out, json)


@app.command()
def measure(
    rig: RigOption = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    resume: Annotated[
        str | None, typer.Option(help="go on with this campaign, which broke off or is to have more visits")
    ] = None,
    campaign_file: Annotated[
        Path | None, typer.Option("--campaign", help="campaign file: its visits in place of the rig file's poses")
    ] = None,
) -> None:
    """Measure a calibration campaign into the store, and stop there."""
    if campaign_file is not None:
        file, machine = load_rig(rig or embedded_rig_path())  # what is wrong is said before any device is touched
        calibration_blocks(machine, with_visits(file, campaign_file).campaign)
    with open_store(out) as store, open_rig(rig) as connected, progress_bar() as tell:
        if campaign_file is not None:
            connected.file = with_visits(connected.file, campaign_file)
        campaign = job.measure(connected, store, _say, tell, resume)
    print_result(json, {"campaign": campaign}, f"campaign {campaign}", f"next: pkm-rig identify {campaign} --out {out}")


@app.command()
def mock(
    rig: RigNeeded = Path("examples/mock-rig.toml"),
    seed: Annotated[int | None, typer.Option(help="which mock machine")] = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="NAME@N: a fault at the Nth operation, again for more")
    ] = None,
    list_faults: Annotated[bool, typer.Option(help="print the names of the faults and end")] = False,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=VALUE[,place=...,variant=...]: a flaw (docs/reference/mock-effects.md); may be repeated"
        ),
    ] = None,
    twin: Annotated[
        str | None, typer.Option(help="serve this twin: campaign of `pkm-rig diagnose --add`, or the twin's folder")
    ] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file with own effects that the twin has")] = None,
    out: OutOption = Path("runs"),
) -> None:
    """Serve the three mock devices on real transports until interrupted."""
    if list_faults:
        for line in mock_rig.fault_list():
            results.print(line, soft_wrap=True, markup=False)
        return
    file = mock_rig.with_choices(load_rig(rig)[0], seed, effect or ())
    files = None if twin is None else mock_rig.TwinFiles(find_twin(twin, out), tuple(effects or ()))
    with mock_rig.served(file, rig, fault or (), files) as served:
        for line in mock_rig.how_to_connect(file, served):
            results.print(line, soft_wrap=True)
        sys.stdout.flush()
        stopped = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        stopped.wait()


@app.command()
def check(rig: RigOption = None, json: JsonOption = False) -> None:
    """Connect, read identities, units and interlocks; say what is not fit."""
    with open_rig(rig) as connected:
        found = check_devices(connected)
    if json:
        print_json(found)
    else:
        print_check(found)
    if found["problems"]:
        raise CampaignRefused(found["problems"][0])


@app.command()
def home(
    rig: RigOption = None,
    json: JsonOption = False,
    again: Annotated[bool, typer.Option("--again", help="all drives, also those that are referenced")] = False,
) -> None:
    """Home the drives that have lost their reference, one after the other: they move."""
    with open_rig(rig, homing=True) as connected:
        found = homing.run(connected, again=again)
    if json:
        print_json(found)
    else:
        print_homing(found)


@app.command(name="interim-test")
def interim_test(rig: RigOption = None, json: JsonOption = False) -> None:
    """Test the station on the floor nests: two-face errors and the certified distance, pass or fail."""
    with open_rig(rig) as connected:
        found = interim.run(connected)
    if json:
        print_json(interim_test_json(found))
    else:
        print_interim_test(found)
    if not found.passed:
        raise CampaignRefused(f"interim test: {found.failures[0]}; have the station checked before measuring")


@app.command()
def identify(
    campaign: CampaignArgument,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    estimator: Annotated[str, typer.Option(help="map, least_squares, tikhonov, l_curve or truncated_svd")] = "map",
    robust: Annotated[bool, typer.Option("--robust", help="bear outliers (Huber's loss); recordings only")] = False,
    monte_carlo: Annotated[int, typer.Option(help="draws of a Monte Carlo check; recordings only")] = 0,
) -> None:
    """Identify a recording or a measurement folder: parameters with uncertainty, held-out error, bound."""
    measured = find_measurements(campaign, out)
    if measured is not None:
        if robust or monte_carlo:
            raise InputError("identify: --robust and --monte-carlo are for recordings; leave them out for a folder")
        found, show_found = identify_measured(measured, estimator), print_measured
    else:
        recording = find_recording(campaign, out)
        found = identify_with_checks(recording, estimator, robust=robust, draws=monte_carlo)
        show_found = print_identified
    if json:
        print_json(found)
    else:
        show_found(found)


@app.command()
def diagnose(
    campaign: CampaignArgument,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    add: Annotated[bool, typer.Option("--add", help="add what was found to the rig's twin")] = False,
    effects: Annotated[
        list[Path] | None,
        typer.Option(help="Python file with effects of your own (docs/explanation/diagnosis.md); again for more"),
    ] = None,
) -> None:
    """Say where the model still differs from the machine, which effect causes it, and what to measure next."""
    if find_measurements(campaign, out) is not None:
        raise InputError(
            f"{campaign}: a measurement folder; a diagnosis needs a recording (docs/reference/recording.md)"
        )
    found, result = diagnosing.run(find_recording(campaign, out), out, effects or (), add=add)
    print_result(json, result, diagnosis_text.text(found, result))


@app.command()
def poses(
    rig: RigOption = None,
    machine: Annotated[str | None, typer.Option(help="a machine instead: shipped name or path; full poses")] = None,
    count: Annotated[int, typer.Option(help="how many poses to measure under each load")] = 40,
    criterion: Annotated[str, typer.Option(help="I: least predicted variance; D: largest information")] = "I",
    json: JsonOption = False,
) -> None:
    """Choose the poses that tell most, compare them with a grid, and say what they would leave open."""
    if rig is not None and machine is not None:
        raise InputError("poses: give --rig or --machine, not both")
    if machine is not None:
        path = Path(machine) if machine.endswith(".toml") else shipped_machine(machine)
        planner = planning.Planner.of_machine(load_machine(path))
    else:
        planner = planning.Planner.of_rig(*load_rig(rig or embedded_rig_path()))
    found = planner.plan(planning.checked_count(count), planning.checked_criterion(criterion))
    if json:
        print_json(found)
    else:
        print_plan(found)


@app.command()
def compensate(
    campaign: CampaignArgument,
    payload: Annotated[int, typer.Option(help="number of the payload in the rig's list")] = 0,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Compute the compensation tables of a recording and save them; `verify` writes them to the drives."""
    found = compensate_recording(find_recording(campaign, out), payload, out)
    print_result(json, found, f"tables: {found['folder']}")


@app.command(name="list")
def list_campaigns(out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """What is in the store."""
    with open_store(out) as store:
        rows = store.campaigns()
    if json:
        keys = ("campaign", "created", "rig", "readings", "last_event")
        print_json({"campaigns": [dict(zip(keys, row, strict=True)) for row in rows]})
    else:
        for row in rows:
            results.print("  ".join(str(part) for part in row), soft_wrap=True)


@app.command()
def show(campaign: Annotated[str, typer.Argument()], out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """What happened to a campaign."""
    with open_store(out) as store:
        recording = store.recording(campaign)
        events = store.events(campaign)
    if json:
        print_json({
            "campaign": campaign,
            "readings": len(recording),
            "events": [{"created": e.created, "kind": e.kind, "data": e.data} for e in events],
        })  # fmt: skip
        return
    results.print(f"{campaign}: {len(recording)} readings")
    for event in events:
        reason = event.data.get("plan") or ""
        results.print(f"{event.created}  {event.kind}  {reason} {event.data.get('reason', '')}".rstrip())


@app.command()
def report(campaign: Annotated[str, typer.Argument()], out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """Write the report of a verified campaign anew."""
    with open_store(out) as store:
        outcome = stored_outcome(store, campaign)
    try:
        path = _report(outcome, out)
    except OSError as error:
        raise InputError(f"report: {error}; choose another --out") from error
    print_result(json, outcome_json(outcome, path), f"report: {path}")


@app.command(name="export")
def export_campaign(
    campaign: Annotated[str, typer.Argument()],
    folder: Annotated[Path, typer.Argument(help="new folder")],
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write a campaign as a recording folder (docs/reference/recording.md)."""
    with open_store(out) as store:
        recording = store.recording(campaign)
    write_folder(recording, folder)
    found = {"campaign": campaign, "folder": str(folder), "readings": len(recording)}
    print_result(json, found, f"{len(recording)} readings: {folder}")


@app.command(name="import")
def import_folder(
    source: Annotated[Path, typer.Argument(help="recording folder, or Klipper's printer.cfg of a linear delta")],
    folder: Annotated[Path | None, typer.Argument(help="new measurement folder, of a printer.cfg only")] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Read a recording into the store or a printer.cfg into a measurement folder (docs/reference/measurements.md)."""
    if not source.exists():
        raise InputError(f"{source}: no such file or folder; check the path")
    if source.is_file():
        _import_printer(source, folder, out, json)
        return
    if folder is not None:
        raise InputError(f"{source}: not a file; a second folder is only for what a printer.cfg holds")
    recording = read_folder(source)
    with open_store(out) as store:
        store.add_recording(recording)
    name, count = recording.file.campaign, len(recording)
    print_result(json, {"campaign": name, "readings": count}, f"campaign {name}: {count} readings")


def _import_printer(source: Path, folder: Path | None, out: Path, json: bool) -> None:
    folder = folder or out / source.stem
    found = import_printer(source, folder)
    print_result(json, found, f"{found['readings']} readings: {folder}", f"next: pkm-rig identify {folder}")


class Interrupted(BaseException):
    """SIGINT or SIGTERM: everything unwinds, so the drives are stopped and left without power."""


def _interrupt(_number: int, _frame: object) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):  # one is enough: leaving safely must not be interrupted
        signal.signal(number, signal.SIG_IGN)
    raise Interrupted


def main() -> None:
    """Run a command; every expected failure is one line on stderr and an exit status (docs/reference/commands.md)."""
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _interrupt)
    try:
        app(standalone_mode=True)
    except Interrupted:
        _end(DEVICE, "interrupted; the drives were stopped, what was read is kept")
    except InputError as error:
        _end(BAD_INPUT, str(error))
    except CampaignRefused as error:
        _end(REFUSED, str(error))
    except (DeviceError, StoreError) as error:
        _end(DEVICE, str(error))
    except Exception as error:
        messages.print(traceback.format_exc(), style="dim", markup=False)
        _end(
            INTERNAL,
            f"internal error: {type(error).__name__}: {error}; please report it with the lines above",
        )


def _end(status: int, line: str) -> None:
    messages.print(" ".join(f"pkm-rig: {line}".split()), markup=False, soft_wrap=True)
    sys.exit(status)


def _say(line: str) -> None:
    messages.print(line, markup=False, soft_wrap=True)


def _report(outcome: Outcome, out: Path) -> Path:
    path = out / outcome.campaign / "report.html"
    write_report(outcome, path)
    return path


def _finish(outcome: Outcome, out: Path, json: bool) -> None:
    path, failure = None, None
    try:
        path = _report(outcome, out)
    except OSError as error:  # the result stands, whatever becomes of its report
        failure = error
    if json:
        print_json(outcome_json(outcome, path))
    else:
        print_outcome(outcome, path)
    if failure is not None:
        _end(
            DEVICE, f"report: {failure}; the result is in the store, write it with `pkm-rig report {outcome.campaign}`"
        )
    if not outcome.accepted:
        _end(REFUSED, "the tables were refused; see the report for residuals and conditions")


if __name__ == "__main__":
    main()
