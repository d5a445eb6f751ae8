"""A plan of poses, for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from pkm_rig.report.terminal import results


def print_plan(plan: dict[str, Any]) -> None:
    """The plan for people; the last lines can be pasted into a rig file."""
    table = Table(box=None, pad_edge=False)
    for column in ("poses", "number", "u of position / um", "u of orientation / urad"):
        table.add_column(column, justify="left" if column == "poses" else "right")
    for name, s in plan["sets"].items():
        position, orientation = s["u_position_m"] * 1e6, s["u_orientation_rad"] * 1e6
        table.add_row(name, str(s["poses"]), f"{position:.2f}", f"{orientation:.1f}")
    results.print(table)
    results.print(
        f"each at {', '.join(f'{kg:g} kg' for kg in plan['payloads_kg'])}; root mean square over the workspace"
    )
    results.print(f"the data would decide {plan['decided']} of {len(plan['parameters'])} directions; they leave open:")
    for sentence in plan["open"]:
        results.print(f"- {sentence}", soft_wrap=True, markup=False)
    results.print(campaign_section(plan), soft_wrap=True, markup=False)


def campaign_section(plan: dict[str, Any]) -> str:
    """The selected poses as the section of a rig file."""
    rows = "\n".join(f"  {row}," for row in plan["targets"])
    return f"[campaign]  # coordinates {', '.join(plan['coordinates'])}\ntargets = [\n{rows}\n]"
