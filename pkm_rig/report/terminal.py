"""What commands print: one JSON object for programs (docs/json.md), short tables for people."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from calibration.reduction.figures import Figures
from pkm_rig.jobs.calibrate import Outcome
from pkm_rig.report.html import remark, short_table

Tell = Callable[[int, int, str], None]  # advance, total, what

messages = Console(stderr=True, highlight=False)
results = Console(highlight=False)


def print_json(result: dict[str, Any]) -> None:
    """One machine-readable object on stdout."""
    print(json.dumps(result, allow_nan=False))


def print_result(as_json: bool, result: dict[str, Any], *shown: RenderableType) -> None:
    """A result for programs, or what is shown of it to people."""
    if as_json:
        print_json(result)
        return
    for part in shown:
        results.print(part, soft_wrap=True)


def pooled(several: list[Figures]) -> dict[str, float]:
    """The figures of several sets of poses as one."""
    n = np.array([f.n for f in several], dtype=float)
    position = np.array([f.position_rms_m for f in several])
    turn = np.array([f.orientation_rms_rad for f in several])
    return {
        "position_rms_m": float(np.sqrt(np.sum(n * position**2) / n.sum())),
        "position_max_m": max(f.position_max_m for f in several),
        "orientation_rms_rad": float(np.sqrt(np.sum(n * turn**2) / n.sum())),
    }


def outcome_json(outcome: Outcome, report: Path | None) -> dict[str, Any]:
    """The result of `calibrate` and `verify`."""
    last = outcome.verified[-1]
    return {
        "campaign": outcome.campaign,
        "accepted": outcome.accepted,
        "before": pooled([v.before for v in outcome.verified]),
        "after": pooled([v.after for v in outcome.verified]),
        "noise_floor": pooled([outcome.floor]),
        "baselines": {name: pooled([f]) for name, f in last.models.items()},
        "tables": {
            drive: {**state, "active": bool(state["active"] and outcome.accepted)}
            for drive, state in outcome.written[-1].drives.items()
        },
        "report": None if report is None else str(report),
        "payloads": [
            {
                "payload_kg": v.payload_kg,
                "before": v.before.as_dict(),
                "after": v.after.as_dict(),
                "orientation_prediction_rad": v.orientation_prediction_rad,
                "rule": v.decision.rule,
                "models": {name: f.as_dict() for name, f in v.models.items()},
            }
            for v in outcome.verified
        ],
        "diagnosis": outcome.diagnosis.as_json(),
    }


def print_outcome(outcome: Outcome, report: Path | None) -> None:
    """The short table, the comparison, the verdict and where the report is."""
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    table.add_column("position / um (U, k = 2)", justify="right")
    table.add_column("orientation / urad", justify="right")
    for name, position, orientation in short_table(outcome):
        table.add_row(name, position, orientation)
    results.print(table)
    last = outcome.verified[-1]
    comparison = Table(box=None, pad_edge=False)
    comparison.add_column(f"prediction at {last.payload_kg:g} kg by")
    comparison.add_column("position / um", justify="right")
    comparison.add_column("orientation / urad", justify="right")
    for name, found in last.models.items():
        comparison.add_row(name, f"{found.position_rms_m * 1e6:.1f}", f"{found.orientation_rms_rad * 1e6:.1f}")
    results.print()
    results.print(comparison)
    results.print(remark(last))
    results.print()
    for verified in outcome.verified:
        results.print(f"{verified.payload_kg:g} kg: {verified.decision.rule}")
    results.print(outcome.diagnosis.line, soft_wrap=True, markup=False)
    results.print("accepted" if outcome.accepted else f"refused; {outcome.restored}")
    if report is not None:
        results.print(f"report: {report}", soft_wrap=True)


@contextmanager
def progress_bar() -> Iterator[Tell]:
    """A bar on stderr; it is told how far a job advanced, of how much, and with what."""
    columns = (
        TextColumn("{task.description:20.20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("connecting", total=None)

        def tell(advance: int, total: int, what: str) -> None:
            progress.update(task, advance=advance, total=total, description=what.replace("_", " "))

        yield tell
