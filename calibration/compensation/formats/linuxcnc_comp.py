"""LinuxCNC: COMP_FILE, one a joint, over that joint's own position only.

Lines of three numbers: nominal position, value when moving forward, value when moving in reverse; at most 256, linear
between them, end values held. Type 1: motor = command + value. Type 0: motor = command - (value - nominal). The file is
read line by line up to the first that is no triplet, so it has no comments; they are in the fragment for the INI file.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.compensation.decomposition import Curve, DriveTables, fit_curves
from calibration.compensation.formats.control import (
    READ_BY_LINUXCNC,
    Control,
    ControlFiles,
    Order,
    TableFormat,
    check_control,
    comment_lines,
    fixed,
)
from calibration.compensation.piecewise import Nodes

DECIMALS = 6
CONTROL = Control("linuxcnc", "LinuxCNC", tables=9, points=256, axis_name=r"[0-8]")


def build(order: Order, file_type: int) -> ControlFiles:
    """Fit, round and write one file a joint; file_type: COMP_FILE_TYPE, 0 or 1."""
    samples = order.correction.fitted
    nodes = [
        Nodes.over(samples.drives[:, j], order.nodes, 10.0**-DECIMALS / order.scale(j)) for j in range(order.count)
    ]
    tables = []
    for drive in range(order.count):
        curve = fit_curves(samples.drives, samples.correction[:, drive], [drive], nodes).curves[0]
        rounded = np.round(curve.values * order.scale(drive), DECIMALS) / order.scale(drive)
        tables.append(DriveTables(curves=(replace(curve, values=rounded),)))
    check_control(order, tuple(tables), order.count, [len(t.curves[0].values) for t in tables])
    files = {
        f"joint{axis}.comp": write(order, own.curves[0], file_type)
        for axis, own in zip(order.axes, tables, strict=True)
    }
    files["comp.ini"] = _fragment(order, file_type)
    return ControlFiles(files, tuple(tables), order.count)


def write(order: Order, curve: Curve, file_type: int) -> str:
    """The file of one joint."""
    scale = order.scale(curve.by)
    lines = []
    for at, correction in zip(curve.nodes.positions * scale, curve.values * scale, strict=True):
        value = fixed(correction if file_type == 1 else at - correction, DECIMALS)
        lines.append(f"{fixed(at, DECIMALS)} {value} {value}\n")
    return "".join(lines)


def _fragment(order: Order, file_type: int) -> str:
    units = " and ".join(sorted({order.unit(j) for j in range(order.count)}))
    effect = "motor = command + value" if file_type == 1 else "motor = command - (value - nominal)"
    lines = comment_lines(
        order,
        (
            f"Into the INI file: positions and values in {units}, linear, ends held; type {file_type}: {effect}.",
            FORMATS[file_type].trial,
        ),
        "#",
    )
    for axis in order.axes:
        lines += [f"[JOINT_{axis}]", f"COMP_FILE = joint{axis}.comp", f"COMP_FILE_TYPE = {file_type}"]
    return "\n".join([*lines, ""])


def _format(file_type: int, sign: str) -> TableFormat:
    return TableFormat(
        name="linuxcnc-comp" if file_type == 1 else "linuxcnc-comp-0",
        title=f"LinuxCNC COMP_FILE of type {file_type}",
        controls=(CONTROL,),
        holds="one table an axis, over its own position",
        sign=sign,
        interpolation="linear, end values held, the same in both directions",
        read_by=READ_BY_LINUXCNC,
        build=lambda order: build(order, file_type),
        default_axes=lambda machine: tuple(str(n) for n in range(len(machine.drive_names))),
    )


FORMATS = {
    1: _format(1, "motor = command + value"),
    0: _format(0, "motor = command - (value - nominal)"),
}
