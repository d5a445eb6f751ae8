"""The mock control's reader of CSV tables, against what the writer of these tables says of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.compensation.decomposition import corrections_at, fit_curves, fit_planes
from calibration.compensation.formats.control import Order
from calibration.compensation.formats.csv_tables import CONTROL, write
from calibration.compensation.piecewise import Nodes
from calibration.machine.description import load_machine, shipped_machine
from mock_devices.nc.correction import CorrectionError, read_correction


@pytest.mark.parametrize("name", ["planar4", "rrr3"])
def test_both_sides_read_the_same_correction_from_a_file(name, tmp_path):
    machine = load_machine(shipped_machine(name))
    rng = np.random.default_rng(4)
    count, (low, high) = len(machine.drive_names), machine.travel.T
    drives = low + (high - low) * rng.uniform(0.0, 1.0, (400, count))
    values = 1e-4 * np.sin(drives @ rng.uniform(1.0, 3.0, (count, count)))
    nodes = [Nodes.over(drives[:, j], 6) for j in range(count)]
    pairs = [(i, j) for i in range(count) for j in range(i)]
    planes = [fit_planes(drives, values[:, a], pairs, [(nodes[i], nodes[j]) for i, j in pairs]) for a in range(count)]
    planes[0] = fit_curves(drives, values[:, 0], [1], nodes)
    order = Order(None, CONTROL, machine.drive_names, ("a note",))
    order = replace(order, correction=SimpleNamespace(machine=machine))
    for a, drive in enumerate(machine.drive_names):
        (tmp_path / f"{drive}.csv").write_text(write(order, planes[a], a), encoding="utf-8")
    read = read_correction(tmp_path, machine.drive_names)
    middle = drives.mean(axis=0)
    for asked in (drives[:50], middle + 2.0 * (drives[50:90] - middle)):  # beyond the tables their ends are held
        expected = asked + corrections_at(tuple(planes), asked)
        assert np.array([read.corrected(q) for q in asked]) == pytest.approx(expected, abs=1e-12)
    assert np.abs(corrections_at(tuple(planes), drives)).max() > 1e-5


HEAD = "table,input_1,position_1,input_2,position_2,correction_m\n"


def written(folder, left, right=HEAD + "0,left,0.0,,,0.0\n"):
    (folder / "left.csv").write_text("# a comment\n" + left, encoding="utf-8")
    (folder / "right.csv").write_text(right, encoding="utf-8")
    return folder


def test_tables_are_linear_between_nodes_and_held_beyond(tmp_path):
    rows = "0,left,1.0,,,1e-5\n0,left,2.0,,,3e-5\n1,left,0.0,right,0.0,0.0\n1,left,0.0,right,1.0,1e-6\n"
    rows += "1,left,1.0,right,0.0,2e-6\n1,left,1.0,right,1.0,5e-6\n"
    read = read_correction(written(tmp_path, HEAD + rows), ("left", "right"))
    assert read.corrected((1.5, 0.5))[0] - 1.5 == pytest.approx(2e-5 + 3.5e-6)
    assert read.corrected((0.5, 0.5))[0] - 0.5 == pytest.approx(1e-5 + 2e-6)
    assert read.corrected((9.0, -9.0))[0] - 9.0 == pytest.approx(3e-5 + 2e-6)
    assert read.corrected((1.5, 0.25))[1] == 0.25


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "its head is not"),
        ("table,input_1\n", "its head is not"),
        (HEAD + "0,middle,0.0,,,1e-6\n", "row 2: drive middle; the machine has left, right"),
        (HEAD + "0,left,0.0,,,nan\n", "row 2: not a number"),
        (HEAD + "0,left,0.0,,\n", "row 2"),
        (HEAD + "0,left,0.0,,,1e-6\n0,right,0.0,,,1e-6\n", "over the same drives"),
    ],
)
def test_what_is_no_correction_is_refused(tmp_path, text, complaint):
    with pytest.raises(CorrectionError, match=complaint):
        read_correction(written(tmp_path, text), ("left", "right"))
