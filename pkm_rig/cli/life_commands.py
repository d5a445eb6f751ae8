"""Commands on a machine's life: health, history."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibration.base.errors import InputError
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
) -> None:
    """A machine over the years: checks with their limits, calibrations, parameters, effects, events, doubt."""
    from pkm_rig.jobs.history import chosen_rig, histories, rigs_of
    from pkm_rig.report.history_text import print_history
    from pkm_rig.report.terminal import print_either, print_json
    from pkm_rig.store.store import open_existing_store

    if all_rigs and name is not None:
        raise InputError("history: name a rig or give --all, not both")
    with open_existing_store(out) as store:
        names = rigs_of(store) if all_rigs else [chosen_rig(store, name)]
        lives = histories(store, names)
    for life in lives:
        life["picture"] = _draw(life, out)
    if json:
        print_json({"rigs": lives} if all_rigs else lives[0])
        return
    for life in lives:
        print_either(False, life, print_history)


def _draw(life: dict[str, object], out: Path) -> str | None:
    from typing import Any, cast

    from pkm_rig.jobs.history import largest_changes
    from pkm_rig.report.history_pictures import draw_history
    from pkm_rig.report.pictures import save_png
    from pkm_rig.store.place import store_folder

    shown = cast("dict[str, Any]", life)
    if not shown["calibrations"] and not shown["checks"]:
        return None
    path = store_folder(out) / f"history-{shown['rig']}.png"
    figure = draw_history(shown, largest_changes(shown["parameters"], PARAMETERS))
    try:
        save_png(figure, path, simulated=shown["simulated"])
    except OSError as error:
        raise InputError(f"history: {path}: {error.strerror}; choose another --out") from error
    return str(path)
