"""Beckhoff TwinCAT CNC and ISG kernel: plane compensation, one list an axis (kw.crosscomp2.*).

The position of an axis is corrected by a grid over two master axes, of which it may be one: integers of 0.1 um (0.0001
degrees), one interval for both masters, table[j][i] with j along the second master; linear between the four corners,
the margin held.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.decomposition import DriveTables, Plane, fit_planes
from calibration.compensation.formats.control import (
    Control,
    ControlFiles,
    Order,
    TableFormat,
    check_control,
    comment_lines,
)
from calibration.compensation.piecewise import Nodes

INCREMENTS = 1e4  # of a mm or a degree
NODES_OF_TWO, NODES_OF_MORE = 33, 9
CONTROL = Control("twincat-cnc", "TwinCAT CNC", tables=32, points=10201, largest=2e5, axis_name=r"[1-9][0-9]?")


def build(order: Order) -> ControlFiles:
    """Fit, round and write one list a drive."""
    planes = [_fit(order, drive) for drive in range(order.count)]
    tables = tuple(DriveTables(planes=(plane,)) for plane in planes)
    check_control(order, tables, order.count, [plane.values.size for plane in planes])
    files = {f"achskw{order.axes[drive]}.lis": write(order, plane, drive) for drive, plane in enumerate(planes)}
    return ControlFiles(files, tables, order.count)


def _fit(order: Order, drive: int) -> Plane:
    """The plane over the pair of drives that explains most, rounded."""
    samples = order.correction.fitted
    values = samples.correction[:, drive]
    found = []
    for pair in combinations(range(order.count), 2):
        if len({order.unit(j) for j in pair}) > 1:  # one interval serves both
            continue
        grid = _grid(order, pair)
        plane = fit_planes(samples.drives, values, [pair], [grid]).planes[0]
        found.append((float(np.sum((values - plane.at(samples.drives)) ** 2)), plane))
    if not found:
        raise InputError("format beckhoff-plane: it needs two drives of one kind")
    plane = min(found, key=lambda item: item[0])[1]
    scale = order.scale(drive) * INCREMENTS
    return Plane(plane.by, plane.nodes, np.round(plane.values * scale) / scale)


def _grid(order: Order, pair: tuple[int, int]) -> tuple[Nodes, Nodes]:
    """Grid of one interval, in whole increments."""
    drives, increment = order.correction.fitted.drives, 1.0 / (order.scale(pair[0]) * INCREMENTS)
    count = NODES_OF_TWO if order.count == 2 else NODES_OF_MORE
    longest = max(float(np.ptp(drives[:, j])) for j in pair)
    interval = float(np.ceil(longest / (count - 1) / increment)) * increment
    nodes = []
    for j in pair:
        low, high = float(np.min(drives[:, j])), float(np.max(drives[:, j]))
        start = float(np.floor(low / increment)) * increment
        nodes.append(Nodes(start, interval, int(np.ceil((high - start) / interval - 1e-9)) + 1))
    return nodes[0], nodes[1]


def write(order: Order, plane: Plane, drive: int) -> str:
    """The list of one axis."""
    first, second = plane.nodes
    scale = order.scale(drive) * INCREMENTS
    own = [order.scale(j) * INCREMENTS for j in plane.by]
    lines = comment_lines(
        order,
        (
            f"Positions and corrections in 0.0001 {order.unit(drive)}; a correction is taken to be added to the axis'",
            "position, which the documentation does not say: see whether the error falls at the first poses.",
            "Switched on by lr_param.crosscomp2 1 in the axis' parameter list.",
            FORMAT.trial,
        ),
        "#",
    )
    lines += [
        f"kopf.achs_nr {order.axes[drive]}",
        f"kopf.log_achs_name {order.machine.drive_names[drive]}",
        f"kw.crosscomp2.interval {round(first.step * own[0])}",
        f"kw.crosscomp2.last_index_master1 {first.count - 1}",
        f"kw.crosscomp2.last_index_master2 {second.count - 1}",
        f"kw.crosscomp2.start_position_master1 {round(first.start * own[0])}",
        f"kw.crosscomp2.start_position_master2 {round(second.start * own[1])}",
        "kw.crosscomp2.unit 1",
        "kw.crosscomp2.n_cycles 10",
        f"kw.crosscomp2.master1_ax_nr {order.axes[plane.by[0]]}",
        f"kw.crosscomp2.master2_ax_nr {order.axes[plane.by[1]]}",
    ]
    lines += [
        f"kw.crosscomp2.table[{j}][{i}].correction {round(plane.values[i, j] * scale)}"
        for j in range(second.count)
        for i in range(first.count)
    ]
    return "\n".join([*lines, "End", ""])


FORMAT = TableFormat(
    name="beckhoff-plane",
    title="Beckhoff plane compensation",
    controls=(CONTROL,),
    holds="one table an axis, over two axes",
    sign="taken to be added to the axis' position; the documentation does not say",
    interpolation="linear between four corners, margin held",
    read_by=None,
    build=build,
    default_axes=lambda machine: tuple(str(n) for n in range(1, len(machine.drive_names) + 1)),
)
