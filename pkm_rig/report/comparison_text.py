"""A comparison of two campaigns in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from calibration.base.rounding import round_result
from calibration.comparison.result import Comparison, FoundChange, WorkspaceChange
from calibration.diagnosis.result import Quantity
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.comparison_json import by_probability
from pkm_rig.report.diagnosis_text import format_quantity, length, probability, quantity_name

LEAST_PROBABILITY = 0.005
MOST_QUANTITIES = 6
WORDS = {
    "drive_offset": "drive {}: its zero",
    "drive_scale": "drive {}: its scale",
    "screw_curve": "drive {}: the curve of its screw",
    "column": "the column of drive {}",
    "strut": "strut {}",
    "guide": "guide {}",
    "nest": "reflector or nest {}",
}


def name_in_words(structure: str, place: str) -> str:
    """What has changed, for people."""
    return WORDS.get(structure, structure + " {}").format(place)


def one_line_verdict(comparison: Comparison) -> str:
    """The verdict, its probability, and what it means for the machine, in one line."""
    sure = f"probability {probability(comparison.ranking[comparison.verdict])}"
    if alike := {structure for structure, _ in comparison.equivalent} - {comparison.verdict}:
        of_all = sum(comparison.ranking[name] for name in (comparison.verdict, *alike))
        sure += f", {probability(min(of_all, 1.0))} with what is not told apart from it"
    if comparison.verdict == "nothing":
        return f"nothing has changed ({sure}); what is hidden is below {length(comparison.hidden_m)} RMS (95 %)"
    if comparison.verdict == "unknown":
        return f"something has changed that is none of the known structures ({sure})"
    first = comparison.changes[0]
    what = name_in_words(first.structure, first.place)
    if not any(change.of_machine for change in comparison.changes):
        return f"{what} has moved, by which the machine is measured, not the machine ({sure})"
    return f"{what} has changed ({sure}); at the tool point: {_workspace(comparison.workspace)}"


def describe_comparison(comparison: Comparison, result: Mapping[str, Any]) -> RenderableType:
    """The comparison for people; `result` is its JSON object with pictures."""
    parts: list[RenderableType] = [
        Text(f"{comparison.before} ({comparison.readings[0]} readings) and "
             f"{comparison.after} ({comparison.readings[1]} readings)"),
        Text(f"verdict: {f'{comparison.verdict} {comparison.place}'.strip()}"),
        Text(one_line_verdict(comparison)),
    ]  # fmt: skip
    if comparison.equivalent:
        names = ", ".join(name_in_words(*name) for name in comparison.equivalent)
        parts.append(Text(f"not told apart from it (within {comparison.matters_sigma:.2f} sigma RMS): {names}"))
    if comparison.changes:
        title = "changes, after minus before (raw, visible: RMS shift of readings in sigma, before and after a refit)"
        parts += [Text(f"\n{title}", style="bold"), _changes(comparison)]
    likely = [(name, p) for name, p in by_probability(comparison) if p >= LEAST_PROBABILITY]
    parts.append(Text(f"\nranking: {', '.join(f'{name} {probability(p)}' for name, p in likely)}"))
    parts += [Text(f"note: {remark}") for remark in comparison.remarks]
    if result["pictures"]:
        parts.append(Text(f"\npictures: {', '.join(result['pictures'].values())}"))
    return Group(*parts)


def _changes(comparison: Comparison) -> Padding:
    table = Table(box=None, pad_edge=False)
    for name in ("what", f"size +- U (k = {COVERAGE_FACTOR:g})"):
        table.add_column(name, overflow="fold")
    for name in ("prob.", "of place", "raw", "visible"):
        table.add_column(name, justify="right")
    for change in comparison.changes:
        figures = (
            probability(change.probability),
            probability(change.place_probability),
            f"{change.raw_sigma:.1f}",
            f"{change.visible_sigma:.1f}",
        )
        lines = _quantities(change)
        table.add_row(f"{change.structure} {change.place}", lines[0], *figures)
        for line in lines[1:]:
            table.add_row("", line, *[""] * 4)
        if change.of_machine and len(comparison.changes) > 1:
            table.add_row("", f"at the tool point: {_workspace(change.workspace)}", *[""] * 4)
    return Padding(table, (0, 0, 0, 2))


def _quantities(change: FoundChange) -> list[str]:
    lines = []
    for q in change.quantities[:MOST_QUANTITIES]:
        quantity = Quantity(q.name, q.value, q.u, q.unit)
        lines.append(f"{quantity_name(quantity)} = {format_quantity(quantity)}")
    if len(change.quantities) > MOST_QUANTITIES:
        lines.append(f"and {len(change.quantities) - MOST_QUANTITIES} more (--json)")
    return lines


def _workspace(change: WorkspaceChange | None) -> str:
    if change is None:
        return "nothing"
    rms, u = round_result(change.rms_m * 1e6, COVERAGE_FACTOR * change.u_rms_m * 1e6)
    zeroed = f"{length(change.rest_rms_m)} after a new zero"
    return f"{rms} +- {u} um RMS, at most {length(change.max_m)} ({zeroed})"
