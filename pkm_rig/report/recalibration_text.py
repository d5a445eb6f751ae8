"""What is due, and what a run did, for people."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from rich.text import Text

from pkm_rig.report.terminal import results


def print_situation(shown: dict[str, Any]) -> None:
    """The state, every rule, the dates, and what waits or hinders."""
    _print(f"rig {shown['rig']}, machine {shown['machine']}: {shown['state']}")
    for name, rule in shown["rules"].items():
        _print(f"  {name}: {rule['state']}; {rule['reason']}")
    _print(f"due: {_date(shown['due_utc_s'])}; act by: {_date(shown['act_by_utc_s'])}")
    _print(f"next check: {_date(shown['check_due_utc_s'])}")
    if shown["measure"] is not None:
        _print(f"to be measured: {shown['measure']}")
    if shown["postponed_until_utc_s"] is not None:
        _print(f"postponed until {_date(shown['postponed_until_utc_s'])}")
    if shown["proposal"] is not None:
        _print(f"calibration {shown['proposal']} waits: pkm-rig recalibrate approve")
    for line in (*shown["expired"], *shown["remarks"]):
        _print(line)


def print_run(shown: dict[str, Any]) -> None:
    """What was done and why."""
    campaign = f" ({shown['campaign']})" if shown["campaign"] else ""
    _print(f"{shown['done']}{campaign}: {shown['why']}")
    _print(f"rig {shown['rig']}: {shown['state']}")
    if shown["alarm"]:
        _print("somebody is asked for")


def _date(t_utc_s: float | None) -> str:
    if t_utc_s is None:
        return "none in sight"
    return "now" if t_utc_s <= 0.0 else f"{datetime.fromtimestamp(t_utc_s, UTC):%Y-%m-%d %H:%M} UTC"


def _print(line: str) -> None:
    results.print(Text(line), soft_wrap=True)
