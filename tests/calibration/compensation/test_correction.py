"""The correction of any machine: it takes the error away; tables of several kinds take most of it away."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from calibration.base.errors import InputError
from calibration.compensation.correction import Correction, correct_drives
from calibration.compensation.decomposition import (
    Curve,
    DriveTables,
    Loss,
    Plane,
    best_inputs,
    fit_curves,
    fit_planes,
    fit_products,
)
from calibration.compensation.error_map import ErrorMap
from calibration.compensation.limits import (
    FormerCorrection,
    check_change,
    check_size_and_slope,
)
from calibration.compensation.piecewise import Nodes
from calibration.machine.description import load_machine, shipped_machine, shipped_machines
from calibration.machine.inverse import nominal_drives, platform_poses
from calibration.machine.measured_poses import measured_box
from pkm_rig.report.maps import error_fields, error_maps
from tests.calibration.compensation.drawn_machine import DrawnMachine

positions = st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=20)


@pytest.mark.parametrize("name", shipped_machines())
def test_corrected_drives_bring_the_tool_of_every_machine_onto_its_target(name):
    drawn = DrawnMachine.of(name, 2)
    machine, load = drawn.machine, drawn.load(30.0)
    target = drawn.targets(40, 5)
    drives = correct_drives(machine, lambda q, t: drawn.tool_error(q, t, load), target)
    left = drawn.tool_error(drives, target, load)[:, machine.commanded]
    before = drawn.tool_error(nominal_drives(machine, target), target, load)[:, machine.commanded]
    assert np.max(np.abs(left)) < 1e-9
    assert np.sqrt(np.mean(before**2)) > 5e-6
    # with more drives than coordinates: of all drives that do it, those nearest to the nominal ones
    step = drives - nominal_drives(machine, target)
    ahead = 1e-6 * np.eye(len(machine.drive_names))
    jac = np.stack(
        [(drawn.tool_error(drives + e, target, load)[:, machine.commanded] - left) / 1e-6 for e in ahead], axis=2
    )
    along = np.linalg.pinv(jac) @ jac @ step[:, :, None]
    assert np.max(np.abs(along[:, :, 0] - step)) < 2e-6 + 0.05 * np.max(np.abs(step))


def test_sums_of_tables_over_single_drives_remove_most_and_products_more():
    drawn = DrawnMachine.of("planar4", 1)
    load = drawn.load(200.0)
    correction = Correction.sampled(drawn.machine, lambda q, t: drawn.tool_error(q, t, load))
    drives, values = correction.fitted.drives[::3], correction.fitted.correction[::3]
    nodes = [Nodes.over(drives[:, j], 17) for j in range(2)]

    def share(tables):
        return Loss.of(tables, correction.check.drives, correction.check.correction).remaining_share

    own = share([fit_curves(drives, values[:, a], [a], nodes) for a in range(2)])
    total = share([fit_curves(drives, values[:, a], [0, 1], nodes) for a in range(2)])
    one, two = (share([fit_products(drives, values[:, a], nodes, n) for a in range(2)]) for n in (1, 2))
    plane = share([fit_planes(drives, values[:, a], [(0, 1)], [(nodes[0], nodes[1])]) for a in range(2)])
    assert own < 0.8
    assert total < 0.5 * own
    assert one < 0.5 * total
    assert two < one
    assert plane < 0.01


@settings(max_examples=30, deadline=None)
@given(at=positions, values=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=9))
def test_a_curve_is_linear_between_its_nodes_and_held_beyond(at, values):
    nodes = Nodes(-1.0, 0.25, len(values))
    found = Curve(0, nodes, np.array(values)).at(np.array(at)[:, None])
    assert found == pytest.approx(np.interp(at, nodes.positions, values), abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(at=positions, seed=st.integers(0, 1000))
def test_a_plane_is_bilinear_in_its_cells_and_held_beyond(at, seed):
    rng = np.random.default_rng(seed)
    nodes = (Nodes(-1.0, 0.5, 4), Nodes(0.0, 0.25, 6))
    values = rng.normal(size=(4, 6))
    places = np.stack([at, rng.uniform(-1.0, 2.0, len(at))], axis=1)
    inside = np.stack([np.clip(places[:, k], n.start, n.end) for k, n in enumerate(nodes)], axis=1)
    wanted = RegularGridInterpolator([n.positions for n in nodes], values)(inside)
    assert Plane((0, 1), nodes, values).at(places) == pytest.approx(wanted, abs=1e-12)


def test_nodes_cover_what_they_are_for_in_whole_steps():
    nodes = Nodes.over(np.array([0.12345678, 1.98765432]), 9, 1e-6)
    assert nodes.start <= 0.12345678 < nodes.start + 1e-6
    assert nodes.end >= 1.98765432
    assert nodes.step * 1e6 == pytest.approx(round(nodes.step * 1e6), abs=1e-9)
    with pytest.raises(InputError, match="does not move"):
        Nodes.over(np.ones(3), 5)
    with pytest.raises(InputError, match="two or more"):
        Nodes(0.0, 1.0, 1)


def test_the_inputs_that_matter_are_chosen():
    drives = np.random.default_rng(1).uniform(-1.0, 1.0, (400, 4))
    values = 1e-4 * (np.sin(drives[:, 2]) + 0.3 * drives[:, 0] ** 2)
    nodes = [Nodes.over(drives[:, j], 9) for j in range(4)]
    assert best_inputs(drives, values, nodes, 1) == (2,)
    assert best_inputs(drives, values, nodes, 2) == (0, 2)


def test_the_measured_box_ends_where_measuring_ended():
    machine = load_machine(shipped_machine("stewart6"))
    low, high = machine.commanded_limits.T
    values = low + (high - low) * np.random.default_rng(2).uniform(0.3, 0.6, (50, 6))
    box = measured_box(machine, platform_poses(machine, values))
    margin = 0.02 * (high - low)
    assert box[:, 0] == pytest.approx(values.min(axis=0) - margin, abs=1e-9)
    assert box[:, 1] == pytest.approx(values.max(axis=0) + margin, abs=1e-9)
    values[:, 2] = 1.1
    with pytest.raises(InputError, match="the same z"):
        measured_box(machine, platform_poses(machine, values))


def straight(slope, at_zero=0.0):
    nodes = Nodes(0.0, 1.0, 2)
    return DriveTables(curves=(Curve(0, nodes, np.array([at_zero, at_zero + slope])),))


def test_size_slope_and_change_are_limited():
    machine = load_machine(shipped_machine("planar4"))
    drives = np.random.default_rng(1).uniform(0.1, 0.9, (50, 2))
    good, none = straight(1e-3), straight(0.0)
    check_size_and_slope(machine, (good, none), drives)
    with pytest.raises(InputError, match="drive right: a correction of 3000 um"):
        check_size_and_slope(machine, (none, straight(0.0, 3e-3)), drives)
    steep = DriveTables(curves=(Curve(0, Nodes(0.0, 0.02, 51), 5e-4 * (-1.0) ** np.arange(51)),))
    with pytest.raises(InputError, match=r"drive left: the correction changes by 0\.05"):
        check_size_and_slope(machine, (steep, none), drives)
    former = FormerCorrection(drives, np.zeros((50, 2)), "rig-1")
    assert check_change(machine, (none, none), former, accept=False) == 0.0
    with pytest.raises(InputError, match=r"from that of rig-1 .* --accept-change"):
        check_change(machine, (good, none), former, accept=False)
    assert check_change(machine, (good, none), former, accept=True) == pytest.approx(1e-3 * drives[:, 0].max())
    assert check_change(machine, (good, none), None, accept=False) is None


def test_the_map_is_hatched_where_the_uncertainty_exceeds_the_error():
    x, y = np.meshgrid([-0.1, 0.0, 0.1], [-0.1, 0.0, 0.1], indexing="ij")
    target = np.stack([x.ravel(), y.ravel()], axis=1)
    before = np.full((9, 2), 1e-5)
    u = np.full(9, 1e-6)
    u[4] = 8e-6
    figure = error_maps(error_fields(ErrorMap(target, before, 0.1 * before, u), None, 0), "a map")
    patches = [p for axes in figure.axes for p in axes.patches if p.get_hatch()]
    assert [p.get_hatch() for p in patches] == ["////", "////"]
    assert patches[0].get_xy() == pytest.approx((-0.05, -0.05))
    assert "hatched" in figure.get_suptitle()
    sure = error_maps(error_fields(ErrorMap(target, before, 0.1 * before, np.full(9, 1e-6)), None, 0), "a map")
    assert "hatched" not in sure.get_suptitle()
    assert not any(p.get_hatch() for axes in sure.axes for p in axes.patches)
