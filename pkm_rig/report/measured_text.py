"""What `identify` of a measurement folder prints for people."""

from __future__ import annotations

from typing import Any

from rich.markup import escape
from rich.table import Table

from calibration.base.rounding import round_result
from pkm_rig.report.left_out_text import left_out_lines
from pkm_rig.report.notation import plain_number
from pkm_rig.report.terminal import results
from pkm_rig.results.unknowns import kind_in_words

SCALES = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "1": (1e3, "per mille")}


def print_measurements(result: dict[str, Any]) -> None:
    """Quantities, figures, what is open, and what must be said beside the figures."""
    counted = " and ".join(f"{n} {what}" for what, n in result["readings"].items())
    results.print(f"{result['calibration']}: {counted}", soft_wrap=True)
    for line in left_out_lines(result["left_out"], len(result["left_out"])):
        results.print(line, soft_wrap=True, markup=False)
    _print_values(result)
    results.print(_figures(result))
    former = result["former"]
    if former is not None:
        results.print(
            f"degrees of freedom left: {former['bare_degrees_of_freedom']} after the owner's {former['parameters']} "
            f"parameters, {result['degrees_of_freedom']:.1f} with all {result['unknowns']} unknowns under tolerances",
            soft_wrap=True,
        )
    else:
        results.print(f"degrees of freedom left: {result['degrees_of_freedom']:.1f}")
    results.print(f"{result['rank']} of {result['machine_parameters']} directions of the machine decided by the data")
    if result["explanations"]:
        results.print("what else would make the owner's residual:")
        results.print(_explanations(result["explanations"]))
    if result["aliased_in_short"]:
        results.print("the readings leave open:")
        for sentence in result["aliased_in_short"]:
            results.print(f"  {sentence}", soft_wrap=True, markup=False)
    for remark in result["remarks"]:
        results.print(f"note: {remark}", soft_wrap=True, markup=False)


def _print_values(result: dict[str, Any]) -> None:
    table = Table(box=None, pad_edge=False)
    named = bool(result["quantities"])
    for column in ("quantity", "before", "value") if named else ("parameter", "deviation"):
        table.add_column(column, justify="left" if column in ("quantity", "parameter") else "right")
    table.add_column("U (k = 2)", justify="right")
    table.add_column("unit")
    table.add_column("")
    for name, q in result["quantities"].items():
        factor, unit = (57.29577951308232, "deg") if q["unit"] == "rad" else SCALES[q["unit"]]
        table.add_row(
            escape(name),
            f"{q['nominal'] * factor:.3f}",
            *round_result(q["value"] * factor, 2 * q["u"] * factor),
            unit,
        )
    for name, p in {} if named else result["parameters"].items():
        factor, unit = SCALES.get(p["unit"], (1.0, p["unit"]))
        note = "" if p["observable"] else "held by its tolerance"
        table.add_row(escape(name), *round_result(p["value"] * factor, 2 * p["u"] * factor), unit, note)
    results.print(table)


def _figures(result: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("RMS")
    for column in ("residual", "leave-one-out", "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right")
    fits = [(f"all {result['unknowns']} unknowns", result)]
    if result["former"] is not None:
        fits.insert(0, (f"the owner's {result['former']['parameters']} parameters", result["former"]))
    for who, fit in fits:
        for key, residual in fit["residual"].items():
            name, _, unit = key.partition("_rms_")
            factor, unit_name = SCALES[unit]
            error = fit["leave_one_out"][key]
            table.add_row(f"{name}, {who}", f"{residual * factor:.3f}", f"{error * factor:.3f}", unit_name)
    return table


def _explanations(result: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in ("  kind", "by (RMS)", "unit", "explains", "left after the fit", "in sd of its tolerance"):
        table.add_column(column, justify="left" if column in ("  kind", "unit") else "right")
    for e in result:
        factor, unit = SCALES.get(e["unit"], (1.0, e["unit"]))
        table.add_row(
            escape(f"  {kind_in_words(e['kind'])}"), plain_number(e["rms"] * factor), unit, f"{e['share']:.0%}",
            f"{plain_number(100.0 * (1.0 - e['absorbed']), 2)}%",
            plain_number(e["prior_standard_deviations"], 2),
        )  # fmt: skip
    return table
