"""The diagnosis of one axis in words."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from calibration.axis.result import AxisDiagnosis
from calibration.diagnosis.result import NONE, UNKNOWN, Quantity
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.diagnosis_text import (
    LEAST_PROBABILITY,
    MOST_RANKED,
    format_quantity,
    percent,
    probability,
    quantity_name,
)


def describe_axis(diagnosis: AxisDiagnosis) -> RenderableType:
    """The diagnosis for people."""
    gap, (low, high) = diagnosis.gap, diagnosis.gap.shrink_interval

    def size(value: float) -> str:
        return format_quantity(Quantity("", value, 0.0, diagnosis.unit))

    parts: list[RenderableType] = [
        Text(f"axis recording {diagnosis.recording}"),
        Text(f"verdict: {diagnosis.verdict}{_meaning(diagnosis)}"),
    ]
    if diagnosis.equivalent:
        together = " = ".join((diagnosis.verdict, *diagnosis.equivalent))
        parts.append(Text(f"equivalent: {together}; predictions differ by at most {size(diagnosis.matters)} RMS"))
    if diagnosis.effects:
        parts += [
            Text("\neffects (without it: what remains grows by, RMS)", style="bold"),
            _effects(diagnosis),
        ]
    ranked = sorted(diagnosis.ranking.items(), key=lambda item: -item[1])[:MOST_RANKED]
    likely = ", ".join(f"{name} {probability(p)}" for name, p in ranked if p >= LEAST_PROBABILITY)
    parts += [
        Text(f"\nranking: {likely}"),
        Text("\nthe gap of second position and motor, RMS on withheld data, noise floor removed", style="bold"),
        Text(f"before {size(gap.before)}, after {size(gap.after)}, noise floor {size(gap.noise_floor)}"),
        Text(f"shrink {percent(gap.shrink)} (95 %: {percent(low)} to {percent(high)}); withheld: {gap.withheld}"),
        Text(f"undetected errors over position are below {size(diagnosis.hidden)} RMS (95 %)"),
    ]
    if diagnosis.clues:
        parts.append(Text("\nclues to the unknown effect: what it may depend on", style="bold"))
        parts += [Text(f"- {name}: {percent(share)} of the best") for name, share in diagnosis.clues.items()]
    if diagnosis.following_delay is not None:
        parts.append(Text(f"the motor is later than its command by {format_quantity(diagnosis.following_delay)}"))
    if diagnosis.not_tested:
        parts.append(Text("\nnot tested", style="bold"))
        parts += [Text(f"- {name}: {reason}") for name, reason in diagnosis.not_tested.items()]
    parts += [Text(f"note: {remark}") for remark in diagnosis.remarks]
    return Group(*parts)


def _meaning(diagnosis: AxisDiagnosis) -> str:
    if diagnosis.verdict == NONE:
        return ", the gap is noise"
    return ", the gap has structure that no effect explains" if diagnosis.verdict == UNKNOWN else ""


def _effects(diagnosis: AxisDiagnosis) -> Padding:
    table = Table(box=None, pad_edge=False)
    for number, column in enumerate(("effect", f"size +- U (k = {COVERAGE_FACTOR:g})", "prob.", "without it")):
        table.add_column(column, justify="left" if number < 2 else "right", overflow="fold")
    for effect in diagnosis.effects:
        grows = format_quantity(Quantity("", effect.contribution, 0.0, diagnosis.unit))
        named = f"{quantity_name(effect.size)} = {format_quantity(effect.size)}"
        table.add_row(*map(Text, (effect.effect, named, probability(effect.probability), grows)))
        for quantity in effect.others:
            table.add_row(*map(Text, ("", f"{quantity_name(quantity)} = {format_quantity(quantity)}", "", "")))
    return Padding(table, (0, 0, 0, 2))
