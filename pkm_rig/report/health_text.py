"""A check of the machine in words."""

from __future__ import annotations

from typing import Any

from rich.text import Text

from pkm_rig.report.history_text import figure, micrometres
from pkm_rig.report.terminal import results

MOST_CHANGES = 3


def print_health(result: dict[str, Any]) -> None:
    """The verdict, the error, the largest changes, what every rule says, and when it will be due."""
    _print(f"check {result['check']}: {result['verdict']}")
    _print(
        f"error {figure(result['error'])} (k = 2), tolerance {micrometres(result['tolerance_m'])}; {result['poses']} "
        f"poses in {result['duration_s'] / 60.0:.1f} min after a warm-up of {result['warm_up_s'] / 60.0:.1f} min"
    )
    for name, change in list(result["changes"].items())[:MOST_CHANGES]:
        _print(
            f"  {name}: {change['value'] / change['u']:+.1f} standard uncertainties, "
            f"{abs(change['value']) * change['error_per_unit'] * 1e6:.1f} um at the tool if it alone has changed"
        )
    for name, rule in result["rules"].items():
        _print(f"{name}: {rule['state']}; {rule['reason']}")
    for remark in result["remarks"]:
        _print(remark)
    if result["measure"] is not None:
        _print(f"to be measured: {result['measure']}")


def _print(line: str) -> None:
    results.print(Text(line), soft_wrap=True)
