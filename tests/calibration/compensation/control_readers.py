"""Readers of control files as the controls' documentation describes them; nothing here uses the writers.

Each gives a function from positions of the axes, in the control's units by axis name, to the correction by axis name
that the control adds to the axes' commands.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from itertools import pairwise


def between(points, at):
    """Linear between the points (position, value), the outer values held."""
    points = sorted(points)
    if at <= points[0][0]:
        return points[0][1]
    for (x0, y0), (x1, y1) in pairwise(points):
        if at <= x1:
            return y0 + (y1 - y0) * (at - x0) / (x1 - x0)
    return points[-1][1]


def bilinear(first, second, values, at):
    """Between the four corners of a cell; beyond the margin its values."""

    def cell(nodes, x):
        x = min(max(x, nodes[0]), nodes[-1])
        k = max(i for i in range(len(nodes) - 1) if nodes[i] <= x + 1e-12)
        return k, (x - nodes[k]) / (nodes[k + 1] - nodes[k])

    (i, a), (j, b) = cell(first, at[0]), cell(second, at[1])
    low = values[i][j] * (1 - b) + values[i][j + 1] * b
    high = values[i + 1][j] * (1 - b) + values[i + 1][j + 1] * b
    return low * (1 - a) + high * a


def read_cec(text):
    """SINUMERIK: every table's value goes to its output axis, and so does its product with the table it names."""
    lines = [line.split(";")[0].strip() for line in text.splitlines()]
    assert lines[0] == "%_N_NC_CEC_INI"
    assert [line for line in lines if line][-1] == "M17"
    values, entries = defaultdict(dict), defaultdict(dict)
    for line in lines:
        if found := re.fullmatch(r"\$AN_CEC\[(\d+),(\d+)\]=(\S+)", line):
            values[int(found[1])][int(found[2])] = float(found[3])
        elif found := re.fullmatch(r"\$AN_CEC_(\w+)\[(\d+)\]=\(?([^()]+)\)?", line):
            entries[int(found[2])][found[1]] = found[3]
        else:
            assert line in ("", "%_N_NC_CEC_INI", "CHANDATA(1)", "M17"), line
    assert sorted(values) == list(range(len(values)))

    def table(t, at):
        e = entries[t]
        step, low, high = (float(e[key]) for key in ("STEP", "MIN", "MAX"))
        assert e["IS_MODULO"] == e["DIRECTION"] == "0"
        assert abs(low + step * (len(values[t]) - 1) - high) < 1e-9
        return between([(low + step * n, v) for n, v in values[t].items()], at[e["INPUT_AXIS"]])

    def correction(at):
        out = defaultdict(float)
        for t in values:
            factor = int(entries[t]["MULT_BY_TABLE"])
            own = table(t, at)
            out[entries[t]["OUTPUT_AXIS"]] += own + (own * table(factor - 1, at) if factor else 0.0)
        return out

    correction.tables = len(values)
    return correction


def read_linuxcnc(files):
    """LinuxCNC: type 1 adds the value, type 0 subtracts what it differs by from the nominal position."""
    ini = files["comp.ini"]
    parts = re.findall(r"\[JOINT_(\d)\]\nCOMP_FILE = (\S+)\nCOMP_FILE_TYPE = ([01])", ini)
    joints = {}
    for joint, name, file_type in parts:
        rows = [tuple(map(float, line.split())) for line in files[name].splitlines()]
        assert all(len(row) == 3 and row[1] == row[2] for row in rows)
        assert len(rows) <= 256
        joints[joint] = [(n, f if file_type == "1" else n - f) for n, f, _ in rows]

    def correction(at):
        return {joint: between(points, at[joint]) for joint, points in joints.items()}

    return correction


def read_plane(text):
    """TwinCAT CNC: table[j][i] with j along the second master, everything in 0.1 um or 0.0001 degrees."""
    found = dict(re.findall(r"^(k\w+\.[\w.]+|kopf\.\w+) (\S+)$", text, re.M))
    cells = {(int(i), int(j)): int(v) for j, i, v in re.findall(r"table\[(\d+)\]\[(\d+)\]\.correction (-?\d+)", text)}
    assert found["kw.crosscomp2.unit"] == "1"
    interval = int(found["kw.crosscomp2.interval"])
    nodes = []
    for k in ("1", "2"):
        start, last = (int(found[f"kw.crosscomp2.{key}_master{k}"]) for key in ("start_position", "last_index"))
        nodes.append([(start + interval * n) / 1e4 for n in range(last + 1)])
    assert len(cells) == len(nodes[0]) * len(nodes[1]) <= 10201
    values = [[cells[i, j] / 1e4 for j in range(len(nodes[1]))] for i in range(len(nodes[0]))]
    masters = [found[f"kw.crosscomp2.master{k}_ax_nr"] for k in "12"]

    def correction(at):
        return {found["kopf.achs_nr"]: bilinear(*nodes, values, [at[m] for m in masters])}

    return correction


def read_heidenhain(files):
    """HEIDENHAIN: the active line of the .CMA says which .COM holds for each causing axis; values are errors."""
    rows = [line.split() for line in files["CONFIG.CMA"].splitlines()[1:-1]]
    active = next(row for row in rows[1:] if row[1] == "*")
    tables = {}
    for axis, name in zip(rows[0][2:], active[2:], strict=True):
        lines = files[name].splitlines()
        assert lines[0] == f"BEGIN {axis} .COM MM"
        assert lines[-1] == "[END]"
        head, *body = [line.split() for line in lines[1:-1]]
        assert head[:3] == ["NR", "AXISPOS", "BACKLASH"]
        assert len(body) <= 256
        tables[axis] = {
            output: [(float(row[1]), float(row[3 + k])) for row in body] for k, output in enumerate(head[3:])
        }

    def correction(at):
        out = defaultdict(float)
        for axis, columns in tables.items():
            for output, points in columns.items():
                out[output] -= between(points, at[axis])
        return out

    return correction


def read_csv(text):
    """The sum of the file's tables, over one input or two, in m or rad."""
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))[1:]
    tables = defaultdict(list)
    for row in rows:
        tables[row[0]].append(row)

    def one(part, at):
        if not part[0][3]:
            return between([(float(r[2]), float(r[5])) for r in part], at[part[0][1]])
        first, second = (sorted({float(r[k]) for r in part}) for k in (2, 4))
        cells = {(float(r[2]), float(r[4])): float(r[5]) for r in part}
        values = [[cells[p, q] for q in second] for p in first]
        return bilinear(first, second, values, [at[part[0][1]], at[part[0][3]]])

    return lambda at: sum(one(part, at) for part in tables.values())
