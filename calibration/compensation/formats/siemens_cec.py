"""Siemens SINUMERIK: sag compensation (CEC) with products of tables, as an NC program that writes the system variables.

Function Manual Extended Functions, K3: a table over one base axis is added to the set position of its compensation
axis, linear between its points, the end values held. $AN_CEC_MULT_BY_TABLE[t] = u + 1 adds the product of tables t and
u as well. Tables t and u themselves stay in the sum, so what they add is taken out of the single tables again:
f + g + A B is written as (f - A) + A + (g - B) + B + A B. Numbers multiply in the control's unit: mm times mm are mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.decomposition import (
    Curve,
    DriveTables,
    Product,
    best_inputs,
    fit_products,
)
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

DECIMALS = 6
POSITION_RESOLUTION = 1e-3  # of points, in mm or degrees
MOST_PRODUCTS = 2  # of a drive; a third one is worth nothing on two drives, and does harm on more

CONTROL_828D = Control(
    "sinumerik-828d",
    "SINUMERIK 828D",
    tables=8,
    points=200,
    largest=1.0,  # MD32720 $MA_CEC_MAX_SUM as delivered
    steepest=0.1,  # MD32730 $MA_CEC_MAX_VELO as delivered, a share of the axis' speed
    axis_name=r"[A-Z][A-Z0-9_]{0,15}",
)
CONTROL_840D_SL = replace(CONTROL_828D, name="sinumerik-840d-sl", title="SINUMERIK 840D sl", tables=62, points=2000)


@dataclass(frozen=True)
class CecTable:
    """One table of the control: axes by number, points and values (n,) in its units, the table it is multiplied by."""

    base: int
    output: int
    start: float
    step: float
    values: Array
    multiplied_by: int | None = None


def build(order: Order) -> ControlFiles:
    """Fit, round and write the tables."""
    fitted = [_fit(order, drive) for drive in range(order.count)]
    tables = cec_tables(order, fitted)
    as_read = tuple(_as_read(order, tables, drive) for drive in range(order.count))
    check_control(order, as_read, len(tables), [len(t.values) for t in tables])
    return ControlFiles({"cec.mpf": write(order, tables)}, as_read, len(tables))


def _fit(order: Order, drive: int) -> DriveTables:
    samples = order.correction.fitted
    nodes = [
        Nodes.over(samples.drives[:, j], order.nodes, POSITION_RESOLUTION / order.scale(j)) for j in range(order.count)
    ]
    a_drive = _tables_of(order, drive)
    values = samples.correction[:, drive]
    by = best_inputs(samples.drives, values, nodes, a_drive)
    products = min(MOST_PRODUCTS, (a_drive - len(by)) // 2)
    return fit_products(samples.drives, values, nodes, products, by)


def _tables_of(order: Order, drive: int) -> int:
    """How many of the control's tables a drive gets; what is left over, those with the largest corrections."""
    each, more = divmod(order.control.tables or 0, order.count)
    size = np.sqrt(np.mean(order.correction.fitted.correction**2, axis=0)) * [
        order.scale(j) for j in range(order.count)
    ]
    return each + int(drive in np.argsort(-size)[:more])


def cec_tables(order: Order, fitted: Sequence[DriveTables]) -> list[CecTable]:
    """The control's tables, rounded: of each drive the factors of products first, then single tables without them."""
    tables: list[CecTable] = []
    for drive, own in enumerate(fitted):
        scale = order.scale(drive)
        added = {curve.by: curve.values * scale for curve in own.curves}
        for product in own.products:
            first, second = product.first.values * scale, product.second.values
            share = _balance(first, second)
            for values, curve, by in (
                (first / share, product.first, len(tables) + 1),
                (second * share, product.second, None),
            ):
                rounded = np.round(values, DECIMALS)
                tables.append(_table(order, curve, drive, rounded, by))
                added[curve.by] = added.get(curve.by, 0.0) - rounded
        tables += [_table(order, curve, drive, np.round(added[curve.by], DECIMALS), None) for curve in own.curves]
    return tables


def _balance(first: Array, second: Array) -> float:
    """What to divide the first factor by, and to multiply the second with, so that both are as large."""
    one, two = float(np.max(np.abs(first))), float(np.max(np.abs(second)))
    return float(np.sqrt(one / two)) if one > 0.0 and two > 0.0 else 1.0


def _table(order: Order, curve: Curve, drive: int, values: Array, by: int | None) -> CecTable:
    scale = order.scale(curve.by)
    return CecTable(
        curve.by, drive, round(curve.nodes.start * scale, 3), round(curve.nodes.step * scale, 3), values, by
    )


def _as_read(order: Order, tables: Sequence[CecTable], drive: int) -> DriveTables:
    """One drive's tables in our units, as the control adds them up."""

    def curve(table: CecTable, scale: float) -> Curve:
        own = order.scale(table.base)
        return Curve(table.base, Nodes(table.start / own, table.step / own, len(table.values)), table.values / scale)

    scale = order.scale(drive)
    own = [table for table in tables if table.output == drive]
    products = [
        Product(curve(table, scale), curve(tables[table.multiplied_by], 1.0))
        for table in own
        if table.multiplied_by is not None
    ]
    return DriveTables(curves=tuple(curve(table, scale) for table in own), products=tuple(products))


def write(order: Order, tables: Sequence[CecTable]) -> str:
    """The NC program."""
    unit = " and ".join(sorted({order.unit(j) for j in range(order.count)}))
    lines = ["%_N_NC_CEC_INI"]
    lines += comment_lines(
        order,
        (
            f"Values and positions in {unit}, metric system (MD10240 = 1); a value is added to the set position.",
            "Before loading: MD32710 $MA_CEC_ENABLE = 0 for every axis below; afterwards 1, then reset.",
            f"MD18342 $MN_MM_CEC_MAX_POINTS: at least {max(len(t.values) for t in tables)} for tables 0 to "
            f"{len(tables) - 1} (fixed on the 828D); SD41300 $SN_CEC_TABLE_ENABLE switches single tables.",
            FORMAT.trial,
        ),
        ";",
    )
    lines.append("CHANDATA(1)")
    for t, table in enumerate(tables):
        lines += [f"$AN_CEC[{t},{n}]={fixed(value)}" for n, value in enumerate(table.values)]
        end = table.start + table.step * (len(table.values) - 1)
        multiplied = 0 if table.multiplied_by is None else table.multiplied_by + 1
        lines += [
            f"$AN_CEC_INPUT_AXIS[{t}]=({order.axes[table.base]})",
            f"$AN_CEC_OUTPUT_AXIS[{t}]=({order.axes[table.output]})",
            f"$AN_CEC_STEP[{t}]={fixed(table.step, 3)}",
            f"$AN_CEC_MIN[{t}]={fixed(table.start, 3)}",
            f"$AN_CEC_MAX[{t}]={fixed(end, 3)}",
            f"$AN_CEC_DIRECTION[{t}]=0",
            f"$AN_CEC_MULT_BY_TABLE[{t}]={multiplied}",
            f"$AN_CEC_IS_MODULO[{t}]=0",
        ]
    return "\n".join([*lines, "M17", ""])


FORMAT = TableFormat(
    name="siemens-cec",
    title="Siemens CEC",
    controls=(CONTROL_828D, CONTROL_840D_SL),
    holds="tables over single axes and products of two of them",
    sign="the value is added to the set position",
    interpolation="linear, end values held",
    read_by=None,
    build=build,
    default_axes=lambda machine: tuple(f"AX{n}" for n in range(1, len(machine.drive_names) + 1)),
)
