"""Commands on a machine's life: health, history."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.fleet_commands import JobsOption, SchedulerOption
from pkm_rig.cli.options import JsonOption, OutOption, RigOption, rig_name
from pkm_rig.errors import CampaignRefused, NotChecked

PARAMETERS = 6  # that the picture shows


def health(rig: RigOption, out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """A short check, tables on: fit (0), calibration due (10) or out of tolerance (1)."""
    from pkm_rig.jobs.health import health as check
    from pkm_rig.jobs.health import health_json
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.report.health_text import print_health
    from pkm_rig.report.terminal import print_either, print_message, progress_bar
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.store.store import hold_existing_store

    with (
        hold_existing_store(out, rig=rig_name(rig)) as store,
        open_rig(rig, needs=Need.MOTION | Need.TABLES) as connected_rig,
        progress_bar() as progress,
    ):
        try:
            result = check(connected_rig, store, print_message, progress)
        except CampaignRefused as error:  # its status is that of a machine out of tolerance
            raise NotChecked(f"no check was made: {error}") from error
    print_either(json, health_json(result), print_health)
    if result.verdict.exit_status:
        print_message(f"{result.verdict.state}: {'; '.join(result.verdict.reasons)}")
        raise typer.Exit(result.verdict.exit_status)


def history(
    name: Annotated[str | None, typer.Argument(help="name of the rig; left out, the only one of the store")] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    all_rigs: Annotated[bool, typer.Option("--all", help="every rig of the store")] = False,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """A machine over the years: checks with their limits, calibrations, parameters, effects, events, doubt."""
    from pkm_rig.jobs.history import chosen_rig, histories, rigs_of
    from pkm_rig.report.history_text import print_history
    from pkm_rig.report.terminal import print_either, print_json
    from pkm_rig.store.store import open_existing_store

    if all_rigs and name is not None:
        raise InputError("history: name a rig or give --all, not both")
    if not all_rigs and (jobs is not None or scheduler is not None):
        raise InputError("history: --jobs and --scheduler go with --all")
    with open_existing_store(out) as store:
        names = rigs_of(store) if all_rigs else [chosen_rig(store, name)]
        lives = histories(store, names)
    _draw(lives, out, jobs, scheduler)
    if json:
        print_json({"rigs": lives} if all_rigs else lives[0])
        return
    for life in lives:
        print_either(False, life, print_history)


def _draw(lives: list[dict[str, Any]], out: Path, jobs: int | None, scheduler: str | None) -> None:
    """Draw each life that there is anything of, and say in it where its picture is."""
    from pkm_rig.cli.fleet_commands import draw_all
    from pkm_rig.jobs.history import life_picture
    from pkm_rig.jobs.worker_pool import Attempt, Task
    from pkm_rig.store.place import store_folder

    by_rig = {life["rig"]: life for life in lives}

    def keep(attempt: Attempt) -> None:
        if attempt.failure:
            raise InputError(f"history: the picture of {attempt.name} failed: {attempt.failure}")
        path = store_folder(out) / f"history-{attempt.name}.png"
        try:
            path.write_bytes(attempt.value)
        except OSError as error:
            raise InputError(f"history: {path}: {error.strerror}; choose another --out") from error
        by_rig[attempt.name]["picture"] = str(path)

    for life in lives:
        life["picture"] = None
    shown = [life for life in lives if life["calibrations"] or life["checks"]]
    draw_all([Task(life["rig"], life_picture, (life, PARAMETERS)) for life in shown], keep, jobs, scheduler)
