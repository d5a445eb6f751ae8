"""HEIDENHAIN: compensation value tables (.COM), one a causing axis, and the list of them (.CMA).

Every table has at most 256 equidistant points and a column for each axis that is compensated; the values of an axis
add up over all tables. The line of the .CMA that is marked * is active. The manuals plot and enter the error of the
axis, so a value here is the error that the correction takes away: minus the correction.
"""

from __future__ import annotations

import numpy as np

from calibration.compensation.decomposition import Curve, DriveTables, fit_curves
from calibration.compensation.formats.control import (
    Control,
    ControlFiles,
    Order,
    TableFormat,
    check_control,
    comment_lines,
    fixed,
)
from calibration.compensation.piecewise import Nodes

DECIMALS = 4
CONTROL = Control(
    "heidenhain",
    "HEIDENHAIN",
    tables=10,
    points=256,
    total_points=2560,
    steepest=1.0 / 64.0,
    axis_name=r"[A-Z][A-Z0-9]?",
)


def build(order: Order) -> ControlFiles:
    """Fit, round and write one .COM an axis, the .CMA and the notes."""
    samples = order.correction.fitted
    every = range(order.count)
    nodes = [Nodes.over(samples.drives[:, j], order.nodes, 10.0**-DECIMALS / order.scale(j)) for j in every]
    tables = []
    for drive in every:
        fitted = fit_curves(samples.drives, samples.correction[:, drive], every, nodes)
        scale = order.scale(drive)
        tables.append(
            DriveTables(
                curves=tuple(Curve(c.by, c.nodes, np.round(c.values * scale, DECIMALS) / scale) for c in fitted.curves)
            )
        )
    check_control(order, tuple(tables), order.count, [n.count for n in nodes])
    files = {f"{order.axes[j]}.COM": write(order, tables, j) for j in every}
    files["CONFIG.CMA"] = _list(order)
    files["README.txt"] = _notes(order)
    return ControlFiles(files, tuple(tables), order.count)


def write(order: Order, tables: list[DriveTables], by: int) -> str:
    """The table of one causing axis."""
    columns = [own.curves[by] for own in tables]
    positions = columns[0].nodes.positions * order.scale(by)
    rows = [["NR", "AXISPOS", "BACKLASH", *order.axes]]
    for n, at in enumerate(positions):
        errors = [fixed(-c.values[n] * order.scale(drive), DECIMALS) for drive, c in enumerate(columns)]
        rows.append([str(n), fixed(at, DECIMALS), fixed(0.0, DECIMALS), *errors])
    return "\n".join([f"BEGIN {order.axes[by]} .COM MM", *_aligned(rows), "[END]", ""])


def _list(order: Order) -> str:
    rows = [["NR", "ACTIVE", *order.axes], ["0", "*", *(f"{axis}.COM" for axis in order.axes)]]
    return "\n".join(["BEGIN CONFIG .CMA", *_aligned(rows), "[END]", ""])


def _notes(order: Order) -> str:
    lines = comment_lines(
        order,
        (
            "Positions and values in mm (degrees for a rotary axis); a value is the error of the axis, which the "
            "control takes away. That is read from the manuals' examples: see at the first poses whether it falls.",
            "Linear between the points.",
            FORMAT.trial,
        ),
        "#",
    )
    return "\n".join([*lines, ""])


def _aligned(rows: list[list[str]]) -> list[str]:
    """Columns as wide as their widest entry, two spaces apart."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]


FORMAT = TableFormat(
    name="heidenhain-com",
    title="HEIDENHAIN .COM",
    controls=(CONTROL,),
    holds="tables over single axes, added up",
    sign="the value is the axis' error, minus the correction, as in the manuals' examples",
    interpolation="linear",
    read_by=None,
    build=build,
    default_axes=None,
)
