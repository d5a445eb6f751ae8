"""What `identify` of a measurement folder prints for people."""

from __future__ import annotations

from typing import Any

from rich.markup import escape
from rich.table import Table

from pkm_rig.report.terminal import results
from pkm_rig.results.unknowns import in_words

SCALES = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "1": (1e3, "per mille")}


def print_measured(found: dict[str, Any]) -> None:
    """Quantities, figures, what is open, and what must be said beside the figures."""
    counted = " and ".join(f"{n} {what}" for what, n in found["readings"].items())
    results.print(f"{found['calibration']}: {counted}", soft_wrap=True)
    _print_values(found)
    results.print(_figures(found))
    former = found["former"]
    if former is not None:
        results.print(
            f"degrees of freedom left: {former['bare_degrees_of_freedom']} after the owner's {former['parameters']} "
            f"parameters, {found['degrees_of_freedom']:.2g} with all {found['unknowns']} unknowns under tolerances",
            soft_wrap=True,
        )
    else:
        results.print(f"degrees of freedom left: {found['degrees_of_freedom']:.3g}")
    results.print(f"{found['rank']} of {found['machine_parameters']} directions of the machine decided by the data")
    if found["explanations"]:
        results.print("what else would make the owner's residual:")
        results.print(_explanations(found["explanations"]))
    if found["aliased_in_short"]:
        results.print("the readings leave open:")
        for sentence in found["aliased_in_short"]:
            results.print(f"  {sentence}", soft_wrap=True, markup=False)
    for remark in found["remarks"]:
        results.print(f"note: {remark}", soft_wrap=True, markup=False)


def _print_values(found: dict[str, Any]) -> None:
    table = Table(box=None, pad_edge=False)
    named = bool(found["quantities"])
    for column in ("quantity", "before", "value") if named else ("parameter", "deviation"):
        table.add_column(column, justify="left" if column in ("quantity", "parameter") else "right")
    table.add_column("U (k = 2)", justify="right")
    table.add_column("unit")
    table.add_column("")
    for name, q in found["quantities"].items():
        factor, unit = (57.29577951308232, "deg") if q["unit"] == "rad" else SCALES[q["unit"]]
        table.add_row(
            escape(name),
            f"{q['nominal'] * factor:.3f}",
            f"{q['value'] * factor:.3f}",
            f"{2 * q['u'] * factor:.2g}",
            unit,
        )
    for name, p in {} if named else found["parameters"].items():
        factor, unit = SCALES.get(p["unit"], (1.0, p["unit"]))
        note = "" if p["observable"] else "held by its tolerance"
        table.add_row(escape(name), f"{p['value'] * factor:.3g}", f"{2 * p['u'] * factor:.2g}", unit, note)
    results.print(table)


def _figures(found: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("RMS")
    for column in ("residual", "leave-one-out", "unit"):
        table.add_column(column, justify="left" if column == "unit" else "right")
    fits = [(f"all {found['unknowns']} unknowns", found)]
    if found["former"] is not None:
        fits.insert(0, (f"the owner's {found['former']['parameters']} parameters", found["former"]))
    for who, fit in fits:
        for key, residual in fit["residual"].items():
            name, _, unit = key.partition("_rms_")
            factor, shown = SCALES[unit]
            error = fit["leave_one_out"][key]
            table.add_row(f"{name}, {who}", f"{residual * factor:.3f}", f"{error * factor:.3f}", shown)
    return table


def _explanations(found: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in ("  kind", "by (RMS)", "unit", "explains", "left after the fit", "in sd of its tolerance"):
        table.add_column(column, justify="left" if column in ("  kind", "unit") else "right")
    for e in found:
        factor, unit = SCALES.get(e["unit"], (1.0, e["unit"]))
        table.add_row(
            escape(f"  {in_words(e['kind'])}"), f"{e['rms'] * factor:.3g}", unit, f"{e['share']:.0%}",
            f"{100.0 * (1.0 - e['absorbed']):.2g}%",
            f"{e['prior_standard_deviations']:.2g}",
        )  # fmt: skip
    return table
