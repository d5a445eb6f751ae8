"""Command on the tables in the drives: show them, switch them off, go back."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.options import JsonOption, OutOption, RigOption


class Action(StrEnum):
    """What to do with the tables."""

    SHOW = "show"
    OFF = "off"
    ROLLBACK = "rollback"


def tables(
    rig: RigOption,
    action: Annotated[Action, typer.Argument(help="show; off; back to those before the last change")] = Action.SHOW,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    yes: Annotated[bool, typer.Option("--yes", help="do not ask")] = False,
) -> None:
    """What each drive holds and uses, of which campaign; switch compensation off; bring the former tables back."""
    changes = action is not Action.SHOW
    if changes and not yes and not sys.stdin.isatty():
        raise InputError(f"tables {action.value}: nobody can be asked here; give --yes")
    from pkm_rig.jobs import tables as job
    from pkm_rig.jobs.session import open_rig, store_if_there
    from pkm_rig.report.tables_text import print_tables
    from pkm_rig.report.terminal import print_either, print_message
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.table_recovery import end_unfinished_change

    with (
        store_if_there(out) as store,
        open_rig(rig, needs=Need.TABLES, homing=True) as connected_rig,
    ):
        end_unfinished_change(connected_rig, store, print_message)
        if action is Action.ROLLBACK:
            if store is None:
                raise InputError(
                    f"tables rollback: there is no store in {out}, so nothing is known of before; give --out"
                )
            change = job.last_change(connected_rig, store)
            _confirm(f"rig {connected_rig.file.rig}: bring the tables back to {job.describe_before(change)}?", yes=yes)
            job.roll_back(connected_rig, store, change)
        elif action is Action.OFF:
            _confirm(f"rig {connected_rig.file.rig}: switch compensation off on all drives?", yes=yes)
            job.change_to_off(connected_rig, store)
        shown = job.show_tables(connected_rig, store)
    print_either(json, {"changed": changes, **shown}, print_tables)


def _confirm(question: str, *, yes: bool) -> None:
    if not yes and not typer.confirm(question, err=True):
        raise InputError("tables: not confirmed; nothing was changed")
