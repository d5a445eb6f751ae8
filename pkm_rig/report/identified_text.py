"""The result of an identification, for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from calibration.base.rounding import round_result
from calibration.identification.observability import HELD
from pkm_rig.report.left_out_text import SHOWN, left_out_lines
from pkm_rig.report.terminal import results

UNITS = {"m": (1e6, "um"), "rad": (1e6, "urad"), "drive_scale": (1e6, "um/m")}


def print_identification(result: dict[str, Any]) -> None:
    """Parameters and figures for people."""
    table = Table(box=None, pad_edge=False)
    for column in ("parameter", "deviation", "U (k = 2)", "unit", ""):
        table.add_column(column, justify="right" if column in ("deviation", "U (k = 2)") else "left")
    for name, p in result["parameters"].items():
        factor, unit = UNITS.get("drive_scale" if name.startswith("drive_scale.") else p["unit"], (1.0, ""))
        note = "held by its tolerance" if p["left"] > HELD else ""
        table.add_row(name, *round_result(p["value"] * factor, 2 * p["u"] * factor), unit, note)
    results.print(table)
    held_out, bound = result["held_out"], result["bound"]
    results.print(
        f"held-out poses: {held_out['position_rms_m'] * 1e6:.1f} um, {held_out['orientation_rms_rad'] * 1e6:.1f} urad "
        f"(measurement noise included; bound of the model alone {bound['position_rms_m'] * 1e6:.1f} um, "
        f"{bound['orientation_rms_rad'] * 1e6:.1f} urad)"
    )
    left_out, chi2 = sum(result["dropped"].values()), result["chi2_per_dof"]
    results.print(f"{result['estimator']}: chi-square per degree of freedom {chi2:.2f}, {left_out} readings left out")
    for line in left_out_lines(result["left_out"], SHOWN):
        results.print(line, soft_wrap=True, markup=False)
    results.print(f"{result['rank']} of {len(result['parameters'])} directions decided by the data; left open:")
    for sentence in result["aliased"]:
        results.print(f"- {sentence}", soft_wrap=True, markup=False)
    for remark in result["remarks"]:
        results.print(f"note: {remark}", soft_wrap=True, markup=False)
    if "monte_carlo" in result:
        check = result["monte_carlo"]
        results.print(
            f"uncertainty of the tool: {check['linear_u_position_m'] * 1e6:.2f} um linear, "
            f"{check['drawn_u_position_m'] * 1e6:.2f} um by {check['draws']} Monte Carlo draws"
        )
