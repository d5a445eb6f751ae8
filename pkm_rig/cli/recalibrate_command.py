"""Command on re-calibration: what is due and why, do it, stay, approve, postpone, take back."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.options import JsonOption, OutOption, RigOption, rig_name

if TYPE_CHECKING:
    from pkm_rig.recalibration.run import RunResult
    from pkm_rig.recalibration.situation import Situation
    from pkm_rig.rig.rig import Rig
    from pkm_rig.store.store import Store

STATUS = {"fit": 0, "due": 10, "out of tolerance": 1, "unknown": 3}


class Action(StrEnum):
    """What to do."""

    CHECK = "check"
    RUN = "run"
    WATCH = "watch"
    APPROVE = "approve"
    POSTPONE = "postpone"
    ROLLBACK = "rollback"
    NOTE = "note"
    UNIT = "unit"


def recalibrate(
    rig: RigOption,
    action: Annotated[
        Action,
        typer.Argument(
            help="check: what is due and why; run: do it; watch: stay; approve what waits; postpone; rollback; note: "
            "enter an event; unit: files for systemd"
        ),
    ] = Action.CHECK,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="run: say what would be done, touch no device")] = False,
    scheduled: Annotated[
        bool, typer.Option("--scheduled", help="run: only in a maintenance window and where the PLC grants it")
    ] = False,
    who: Annotated[str, typer.Option(help="approve, postpone, rollback, note: your name")] = "",
    why: Annotated[str, typer.Option(help="approve, postpone, rollback, note: the reason")] = "",
    until: Annotated[str, typer.Option(help="postpone: the end, as 2027-01-31 or 2027-01-31T06:00")] = "",
    event: Annotated[str, typer.Option(help="note: collision, structure changed or reference lost")] = "",
    part: Annotated[str, typer.Option(help="note: the drive or column concerned")] = "",
    every_s: Annotated[float, typer.Option(min=1.0, help="watch: time between two looks")] = 60.0,
    folder: Annotated[Path | None, typer.Option(help="unit: write the files there instead of printing them")] = None,
) -> None:
    """What is due and why; do it; stay and do it; decide on what waits."""
    if dry_run and action is not Action.RUN:
        raise InputError("recalibrate: --dry-run is for run")
    if action is Action.CHECK:
        _check(rig, out, json)
    elif action is Action.RUN:
        _run(rig, out, json, dry_run=dry_run, scheduled=scheduled)
    elif action is Action.WATCH:
        _watch(rig, out, every_s)
    elif action is Action.UNIT:
        _unit(rig, out, folder)
    else:
        _require_words(action, who, why)
        if action is Action.POSTPONE:
            _postpone(rig, out, json, who, why, until)
        elif action is Action.NOTE:
            _note(rig, out, json, who, why, event, part)
        elif action is Action.APPROVE:
            _approve(rig, out, json, who, why)
        else:
            _rollback(rig, out, json, who, why)


def _require_words(action: Action, who: str, why: str) -> None:
    for option, text in (("--who", who), ("--why", why)):
        if not text.strip():
            raise InputError(f"recalibrate {action.value}: {option} says nothing; it stays in the record")


def _check(rig: Path, out: Path, json: bool) -> None:
    import time

    from pkm_rig.recalibration.situation import read_situation, require_decidable_check
    from pkm_rig.report.recalibration_text import print_situation
    from pkm_rig.report.terminal import print_either
    from pkm_rig.store.store import open_existing_store

    with open_existing_store(out) as store:
        situation, _ = read_situation(store, rig, time.time())
        require_decidable_check(store, rig, situation)
    print_either(json, situation.as_dict(), print_situation)
    _end(situation.state, "; ".join(situation.verdict.reasons))


def _end(state: str, why: str) -> None:
    """End with the status of a state, and its reason as the last line on stderr."""
    from pkm_rig.report.terminal import print_message

    if STATUS[state]:
        print_message(f"{state}: {why}")
        raise typer.Exit(STATUS[state])


def _run(rig: Path, out: Path, json: bool, *, dry_run: bool, scheduled: bool) -> None:
    from pkm_rig.report.recalibration_text import print_run
    from pkm_rig.report.terminal import print_either

    if dry_run:
        _dry_run(rig, out, json, scheduled=scheduled)
        return
    result = _one_run(rig, out, scheduled=scheduled, command="run")
    print_either(json, vars(result) | {"reasons": list(result.reasons)}, print_run)
    if result.done == "failed":
        _end("unknown", result.why)
    if result.done == "refused":
        _end("out of tolerance", result.why)
    _end(result.state, result.why)


def _dry_run(rig: Path, out: Path, json: bool, *, scheduled: bool) -> None:
    import time

    from pkm_rig.recalibration.run import plan
    from pkm_rig.recalibration.situation import read_situation, require_decidable_check
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.store import open_existing_store

    with open_existing_store(out) as store:
        situation, file = read_situation(store, rig, time.time())
        require_decidable_check(store, rig, situation)
    intended = plan(situation, file, scheduled=scheduled)
    result = {"dry_run": True, "would": intended.what, "why": intended.why, "state": situation.state}
    print_result(json, result, f"would do: {intended.what}; {intended.why}")


def _one_run(rig: Path, out: Path, *, scheduled: bool, command: str, quiet: bool = False) -> RunResult:
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.recalibration.run import Recalibration
    from pkm_rig.report.terminal import print_message, progress_bar
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.store.store import hold_existing_store

    @contextmanager
    def connect() -> Iterator[Rig]:
        with open_rig(rig, needs=Need.MOTION | Need.TABLES) as connected_rig:
            yield connected_rig

    with hold_existing_store(out, rig=rig_name(rig)) as store, progress_bar() as progress:
        job = Recalibration(rig, out, store, connect, print_message, progress)
        return job.run(scheduled=scheduled, command=command, quiet=quiet)


def _watch(rig: Path, out: Path, every_s: float) -> None:
    from pkm_rig.recalibration.watch import Watcher, watch
    from pkm_rig.report.terminal import print_message

    watcher = Watcher(lambda: _one_run(rig, out, scheduled=True, command="watch", quiet=True), print_message)
    watch(watcher.tick, every_s)


def _unit(rig: Path, out: Path, folder: Path | None) -> None:
    import shutil

    from pkm_rig.jobs.next_command import rig_word
    from pkm_rig.recalibration.units import unit_texts, write_units
    from pkm_rig.report.terminal import results
    from pkm_rig.rig.config import EMBEDDED, load_rig

    file, _ = load_rig(rig)
    program = shutil.which("pkm-rig") or sys.argv[0]
    named = rig if rig_word(rig) == EMBEDDED else rig.resolve()
    words = [program, "recalibrate", "run", "--scheduled", "--rig", rig_word(named), "--out", str(out.resolve())]
    texts = unit_texts(file.rig, words)
    if folder is None:
        for name, text in texts.items():
            results.print(f"# {name}\n{text}", soft_wrap=True)
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; make it, or leave --folder out")
    for path in write_units(texts, folder):
        results.print(str(path), soft_wrap=True)


@contextmanager
def _decided(rig: Path, out: Path) -> Iterator[tuple[Store, Situation]]:
    """The store, to write, and the situation."""
    import time

    from pkm_rig.recalibration.situation import read_situation
    from pkm_rig.store.store import hold_existing_store

    with hold_existing_store(out, rig=rig_name(rig)) as store:
        situation, _ = read_situation(store, rig, time.time())
        yield store, situation


def _postpone(rig: Path, out: Path, json: bool, who: str, why: str, until: str) -> None:
    from pkm_rig.recalibration.decisions import postpone
    from pkm_rig.report.terminal import print_result

    with _decided(rig, out) as (store, situation):
        end = postpone(store, situation, who, why, until)
    print_result(json, {"rig": situation.rig, "postponed_until": end, "who": who, "why": why}, f"postponed until {end}")


def _note(rig: Path, out: Path, json: bool, who: str, why: str, event: str, part: str) -> None:
    from pkm_rig.recalibration.decisions import note
    from pkm_rig.report.terminal import print_result

    with _decided(rig, out) as (store, situation):
        note(store, situation, event, part, who, why)
    result = {"rig": situation.rig, "event": event, "part": part, "who": who, "why": why}
    print_result(json, result, f"noted: {event} {part}".rstrip())


def _approve(rig: Path, out: Path, json: bool, who: str, why: str) -> None:
    import time

    from pkm_rig.jobs.life_record import note_devices
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.recalibration.proposals import approve
    from pkm_rig.report.terminal import print_message, print_result
    from pkm_rig.rig.capabilities import Need

    with _decided(rig, out) as (store, situation):
        proposal = situation.proposal
        if proposal is None:
            raise InputError(f"rig {situation.rig}: no calibration waits for approval")
        with open_rig(rig, needs=Need.TABLES) as connected_rig:
            note_devices(connected_rig, store, print_message)
            tables = approve(connected_rig, store, proposal, who, why, time.time)
            simulated = bool(connected_rig.simulated_devices)
    words = ", ".join(f"{drive} {table}" for drive, table in tables.items())
    result = {"rig": situation.rig, "approved": proposal.campaign, "tables": tables, "simulated": simulated}
    print_result(json, result, f"approved: calibration {proposal.campaign}; {words}")


def _rollback(rig: Path, out: Path, json: bool, who: str, why: str) -> None:
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.recalibration.proposals import take_back
    from pkm_rig.report.terminal import print_message, print_result
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.table_recovery import end_unfinished_change

    with _decided(rig, out) as (store, situation):
        last = situation.history.last_calibration
        if last is None:
            raise InputError(f"rig {situation.rig}: no calibration is in force")
        with open_rig(rig, needs=Need.TABLES) as connected_rig:
            end_unfinished_change(connected_rig, store, print_message)
            use = take_back(connected_rig, store, situation.key, last.id, last.tables, who, why)
            simulated = bool(connected_rig.simulated_devices)
    result = {"rig": situation.rig, "rolled_back": last.id, "in_use": use, "simulated": simulated}
    print_result(json, result, f"calibration {last.id} is out of force; back to {use}")
