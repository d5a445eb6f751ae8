"""Plain CSV for controls that take tables by other ways: for two drives grids, for more sums of grids over every pair.

SI units. The correction of a drive is the sum of its tables, each bilinear between its nodes, ends held; it is added
to the commanded position.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.decomposition import DriveTables, fit_curves, fit_planes
from calibration.compensation.formats.control import (
    Control,
    ControlFiles,
    Order,
    TableFormat,
    check_control,
    comment_lines,
)
from calibration.compensation.piecewise import Nodes

NODES_A_SIDE = {2: 33, 3: 9, 4: 9}
NODES_OF_MORE = 6  # of five drives and more: samples must outnumber the nodes of all pairs
CONTROL = Control("none", "a program of your own", tables=None, points=10**6)


def build(order: Order) -> ControlFiles:
    """Fit and write one file a drive."""
    tables = tuple(_fit(order, drive) for drive in range(order.count))
    check_control(order, tables, sum(len(t.planes) + len(t.curves) for t in tables), [])
    files = {f"{order.axes[drive]}.csv": write(order, own, drive) for drive, own in enumerate(tables)}
    return ControlFiles(files, tables, sum(len(t.planes) + len(t.curves) for t in tables))


def _fit(order: Order, drive: int) -> DriveTables:
    samples = order.correction.fitted
    values = samples.correction[:, drive]
    pairs = list(combinations(range(order.count), 2))
    count = NODES_A_SIDE.get(order.count, NODES_OF_MORE)
    if not pairs:
        return fit_curves(samples.drives, values, [0], [Nodes.over(samples.drives[:, 0], order.nodes)])
    coarse = [Nodes.over(samples.drives[:, j], count) for j in range(order.count)]
    grids = [(coarse[i], coarse[j]) for i, j in pairs]
    if order.count == 2:
        return fit_planes(samples.drives, values, pairs, grids)
    every = range(order.count)
    fine = [Nodes.over(samples.drives[:, j], order.nodes) for j in every]
    return fit_planes(samples.drives, values, pairs, grids, every, fine)


def write(order: Order, tables: DriveTables, drive: int) -> str:
    """The file of one drive; the second input of a table over one drive is empty."""
    names = order.machine.drive_names
    units = ["rad" if kind == "crank" else "m" for kind in order.machine.drive_kinds]
    lines = comment_lines(
        order,
        (
            f"Correction of {names[drive]} in {units[drive]}: the sum of its tables at the commanded positions, to be "
            "added to the command; linear between nodes, ends held.",
        ),
        "#",
    )
    lines.append(f"table,input_1,position_1,input_2,position_2,correction_{units[drive]}")
    number = 0
    for curve in tables.curves:
        for at, value in zip(curve.nodes.positions.tolist(), curve.values.tolist(), strict=True):
            lines.append(f"{number},{names[curve.by]},{at!r},,,{value!r}")
        number += 1
    for plane in tables.planes:
        lines += _plane_rows(number, plane.values, [names[j] for j in plane.by], [n.positions for n in plane.nodes])
        number += 1
    return "\n".join([*lines, ""])


def _plane_rows(number: int, values: Array, names: list[str], positions: list[Array]) -> list[str]:
    return [
        f"{number},{names[0]},{float(p)!r},{names[1]},{float(q)!r},{float(values[i, j])!r}"
        for (i, p) in enumerate(positions[0])
        for (j, q) in enumerate(positions[1])
        if np.isfinite(values[i, j])
    ]


FORMAT = TableFormat(
    name="csv",
    title="CSV",
    controls=(CONTROL,),
    holds="tables over pairs of drives",
    sign="the value is added to the commanded position",
    interpolation="bilinear, ends held",
    read_by="programs that follow docs/reference/control-files.md",
    build=build,
    default_axes=lambda machine: machine.drive_names,
)
