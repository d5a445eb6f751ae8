"""Files for controls, read back by readers of their own, against the correction and against golden files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.compensation.correction import Correction, Samples, fit_targets
from calibration.compensation.decomposition import Curve, DriveTables, Loss, Product
from calibration.compensation.formats import siemens_cec
from calibration.compensation.formats.catalogue import FORMATS, table_format
from calibration.compensation.formats.control import Order, axis_names
from calibration.compensation.piecewise import Nodes
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives
from tests.calibration.compensation import control_readers as readers

GOLDEN = Path(__file__).parent / "golden"
GRIDS = ("csv", "beckhoff-plane")  # their number of nodes is their own
NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]\d+)?")
AXES = {"heidenhain-com": "X,Y,Z,A,B,C"}


def made_up(name, coefficients, per_axis=None):
    """A correction of a shipped machine: polynomials in its drives, with products, of some 0.1 mm."""
    machine = load_machine(shipped_machine(name))
    target = fit_targets(machine, machine.commanded_limits)[:: 4 if per_axis is None else per_axis]
    drives = nominal_drives(machine, target)
    middle, half = machine.travel.mean(axis=1), np.ptp(machine.travel, axis=1) / 2.0
    unit = (drives - middle) / half
    d = drives.shape[1]
    values = np.stack(
        [
            sum(
                1e-4 * coefficients[(a + j + 1) % len(coefficients)] * unit[:, j] ** (1 + (a + j) % 3) for j in range(d)
            )
            + 5e-5 * coefficients[a % len(coefficients)] * unit[:, 0] * unit[:, 1]
            for a in range(d)
        ],
        axis=1,
    )
    samples = Samples(target, drives, values)
    return Correction(machine, machine.commanded_limits, samples, samples)


def order_of(form, correction, **changes):
    points = {} if form.name in GRIDS else {"points": 17}
    control = replace(form.control(None), **points | changes)
    count = len(correction.machine.drive_names)
    given_axes = ",".join(AXES[form.name].split(",")[:count]) if form.name in AXES else None
    return Order(correction, control, axis_names(form, control, given_axes, correction.machine), ("a note",))


def golden_changes(form):
    return {} if form.name in GRIDS else {"points": 5}


def read_back(form, order, made):
    """What the control adds to the drives' commands (n, d) at drive positions (n, d), in m and rad."""
    files = dict(made.files)
    if form.name == "csv":
        by_axis = {axis: readers.read_csv(files[f"{axis}.csv"]) for axis in order.axes}
        return lambda at: [by_axis[axis](dict(zip(order.axes, at, strict=True))) for axis in order.axes]
    if form.name == "siemens-cec":
        parts = [readers.read_cec(files["cec.mpf"])]
    elif form.name == "beckhoff-plane":
        parts = [readers.read_plane(text) for text in files.values()]
    elif form.name == "heidenhain-com":
        parts = [readers.read_heidenhain(files)]
    else:
        parts = [readers.read_linuxcnc(files)]

    def at_drives(at):
        scaled = {axis: float(q) * order.scale(j) for j, (axis, q) in enumerate(zip(order.axes, at, strict=True))}
        found = {axis: value for part in parts for axis, value in part(scaled).items()}
        return [found[axis] / order.scale(j) for j, axis in enumerate(order.axes)]

    return at_drives


@pytest.mark.parametrize("machine", ["planar4", "rrr3", "stewart6"])
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_the_control_adds_what_was_announced_inside_and_beyond_the_table(name, machine):
    form = table_format(name)
    tables = {"tables": 62, "points": 7} if name == "siemens-cec" else {}
    order = order_of(form, made_up(machine, (0.7, -0.4, 0.9)), **tables)
    made = form.build(order)
    read = read_back(form, order, made)
    drives = order.correction.fitted.drives
    rng = np.random.default_rng(3)
    low, high = drives.min(axis=0), drives.max(axis=0)
    places = low + (high - low) * rng.uniform(-0.1, 1.1, (25, len(low)))
    wanted = np.stack([own.at(places) for own in made.tables], axis=1)
    result = np.array([read(at) for at in places])
    assert np.max(np.abs(result - wanted)) < 1e-12 + 1e-9 * np.max(np.abs(wanted))


@pytest.mark.parametrize("name", sorted(FORMATS))
@settings(max_examples=3, deadline=None)
@given(coefficients=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda c: sum(abs(v) for v in c) > 0.3))
def test_what_the_control_adds_is_the_correction_and_not_its_opposite(name, coefficients):
    form = table_format(name)
    order = order_of(form, made_up("planar4", coefficients, 16))
    made = form.build(order)
    read = read_back(form, order, made)
    samples = order.correction.fitted
    rows = np.random.default_rng(1).integers(0, len(samples), 15)
    left = samples.correction[rows] - np.array([read(at) for at in samples.drives[rows]])
    loss = Loss.of(made.tables, samples.drives, samples.correction)
    assert np.all(np.abs(left) <= loss.max_left + 1e-9)
    whole = np.sqrt(np.sum(samples.correction**2))
    if np.sqrt(np.sum(loss.rms_left**2)) < 0.5 * np.sqrt(np.sum(loss.rms_before**2)):
        assert np.sum(left**2) < np.sum(samples.correction[rows] ** 2) + (1e-3 * whole) ** 2


def test_with_two_products_a_control_holds_a_sum_and_two_products_to_rounding():
    form = table_format("siemens-cec")
    order = replace(order_of(form, made_up("planar4", (0.7, -0.4, 0.9))), control=form.control("sinumerik-840d-sl"))
    made = form.build(order)
    assert readers.read_cec(made.files["cec.mpf"]).tables == made.needed == 12
    loss = Loss.of(made.tables, order.correction.fitted.drives, order.correction.fitted.correction)
    assert np.max(loss.max_left) < 3e-7


def test_a_control_with_eight_tables_gets_eight_and_a_product_each():
    form = table_format("siemens-cec")
    made = form.build(order_of(form, made_up("planar4", (0.7, -0.4, 0.9))))
    assert made.needed == 8
    assert made.files["cec.mpf"].count("MULT_BY_TABLE[0]=2") == 1
    assert len(re.findall(r"MULT_BY_TABLE\[\d\]=[1-9]", made.files["cec.mpf"])) == 2


def test_golden_cec():
    """Tables of a position-dependent inclination times a height, as in the K3 manual's example of a product."""
    order = order_of(table_format("siemens-cec"), made_up("planar4", (0.7, -0.4, 0.9)))
    nodes = Nodes(0.4, 0.3, 5)
    inclination = Curve(0, nodes, np.array([0.0, 1.0, 3.0, 4.0, 4.5]) * 1e-5)
    height = Curve(1, nodes, nodes.positions)
    own = Curve(0, nodes, np.array([3.0, 10.0, 12.0, 5.0, 0.0]) * 1e-6)
    fitted = [
        DriveTables(curves=(own, Curve(1, nodes, np.zeros(5))), products=(Product(inclination, height),)),
        DriveTables(curves=(Curve(1, nodes, -own.values),)),
    ]
    text = siemens_cec.write(order, siemens_cec.cec_tables(order, fitted))
    assert text == (GOLDEN / "siemens-cec-cec.mpf").read_text(encoding="utf-8")
    added = readers.read_cec(text)({"AX1": 1000.0, "AX2": 1300.0})
    assert added["AX1"] == pytest.approx(0.012 + 0.03 * 1.3, abs=3e-6)
    assert added["AX2"] == pytest.approx(0.0 - 0.005, abs=1e-9)


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"siemens-cec"}))
def test_golden_files(name):
    """Small tables in the form of the vendors' documented examples; each line was compared with those by hand."""
    form = table_format(name)
    made = form.build(order_of(form, made_up("planar4", (0.7, -0.4, 0.9)), **golden_changes(form)))
    for file, text in made.files.items():
        lines = text.splitlines(keepends=True)
        head = "".join(lines[:40]) if len(text) > 8000 else text  # grids have a size of their own
        wanted = (GOLDEN / f"{name}-{file}").read_text(encoding="utf-8")
        if name == "csv":  # gives all digits, of which the last depend on the processor
            assert NUMBER.sub("", head) == NUMBER.sub("", wanted)
            assert [*map(float, NUMBER.findall(head))] == pytest.approx([*map(float, NUMBER.findall(wanted))], rel=1e-6)
        else:
            assert head == wanted, file


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_every_file_for_a_vendors_control_says_whether_its_software_has_read_one(name):
    form = table_format(name)
    made = form.build(order_of(form, made_up("planar4", (0.7, -0.4, 0.9))))
    text = "".join(made.files.values())
    assert (form.trial in text) == (form.name != "csv")
    assert "a note" in text


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"largest": 0.01}, "a correction of 0."),
        ({"steepest": 1e-5}, "changes by 0.000"),
        ({"tables": 0, "name": "none"}, "tables"),
    ],
)
def test_what_the_control_cannot_take_is_refused_by_name(changes, complaint):
    form = table_format("heidenhain-com")
    with pytest.raises(InputError, match=re.escape(complaint)):
        form.build(order_of(form, made_up("planar4", (0.7, -0.4, 0.9)), **changes))


@pytest.mark.parametrize(
    ("given_axes", "complaint"),
    [(None, "give the control's names"), ("X", "give 2 different"), ("X,X", "give 2 different"), ("X,9", "'9' is no")],
)
def test_axes_are_checked(given_axes, complaint):
    form = table_format("heidenhain-com")
    machine = load_machine(shipped_machine("planar4"))
    with pytest.raises(InputError, match=complaint):
        axis_names(form, form.control(None), given_axes, machine)


def test_unknown_formats_and_controls_are_named():
    with pytest.raises(InputError, match="known: csv, linuxcnc"):
        table_format("fanuc")
    with pytest.raises(InputError, match="sinumerik-828d, sinumerik-840d-sl"):
        table_format("siemens-cec").control("s7")
    assert table_format("siemens-cec").control("sinumerik-828d") is siemens_cec.CONTROL_828D
