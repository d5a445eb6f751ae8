"""Selected poses promise and give less uncertainty than a grid."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.rotation import rotation_vector
from calibration.identification.estimators import identify
from calibration.identification.pose_selection import (
    PlannedLoad,
    Selection,
    candidate_poses,
    grid_poses,
    reachable,
    visits_at,
    workspace_poses,
)
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, parse_machine, shipped_machine
from calibration.machine.inverse import drives_for
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet

SIGMA_M, SIGMA_RAD = 7e-6, 3e-5
UNLOADED = (PlannedLoad(),)


def full_pose(machine):
    sigma = np.where(machine.dof < 3, SIGMA_M, SIGMA_RAD)
    return lambda visits: [ToolCoordinates.of(visits, tuple(machine.dof.tolist()), visits.target_m, sigma)]


def selection(machine, tool, loads=UNLOADED):
    model = Model(ParameterSet.of(machine))
    theta = np.random.default_rng(4).normal(size=len(model.parameters)) * model.parameters.sigma
    over = visits_at(machine, workspace_poses(machine, 150, 9), UNLOADED)
    return Selection.of(model, tool, loads, full_pose(machine), over, theta)


@pytest.mark.parametrize("count", [25, 64])
def test_selected_poses_beat_the_grid_by_five_percent(machine, count):
    grid = selection(machine, grid_poses(machine, count)).forecast_all()
    chosen = selection(machine, candidate_poses(machine, 128, 1)).select(count)
    random = selection(machine, workspace_poses(machine, count, 5)).forecast_all()
    assert len(grid.tool) == count
    assert chosen.u_position_m < 0.95 * grid.u_position_m
    assert grid.u_position_m < random.u_position_m


@pytest.mark.parametrize("count", [25, 64])
def test_simulated_rigs_confirm_the_gain(machine, count):
    """RMS error at held-out poses of rigs calibrated at selected poses and at the grid, the same errors for both."""
    sets = {
        "grid": grid_poses(machine, count),
        "chosen": selection(machine, candidate_poses(machine, 128, 1)).select(count).tool,
    }
    rigs = 60
    held = visits_at(machine, workspace_poses(machine, 100, 77), UNLOADED)
    squares = {name: np.zeros(rigs) for name in sets}
    for rig in range(rigs):
        for name, tool in sets.items():
            squares[name][rig] = held_out(machine, tool, held, rig)
    gain = 1.0 - np.sqrt(squares["chosen"].mean() / squares["grid"].mean())
    again = np.random.default_rng(0).integers(rigs, size=(500, rigs))
    spread = np.std(1.0 - np.sqrt(squares["chosen"][again].mean(axis=1) / squares["grid"][again].mean(axis=1)))
    promised = 1.0 - promise(machine, sets["chosen"]) / promise(machine, sets["grid"])
    assert promised > 0.05
    assert gain > 0.0
    assert abs(gain - promised) < 3.0 * spread


def promise(machine, tool):
    return selection(machine, tool).forecast_all().u_position_m


def held_out(machine, tool, held, seed):
    """Mean squared error of the tool position at held-out poses for one drawn machine."""
    rng = np.random.default_rng([seed, 1])
    model = Model(ParameterSet.of(machine))
    truth = rng.normal(size=len(model.parameters)) * model.parameters.sigma
    visits = visits_at(machine, tool, UNLOADED)
    true = model.predict(truth, visits)
    value = np.concatenate([true.tool_m(), rotation_vector(true.equilibrium.rotation)], axis=1)
    sigma = np.where(machine.dof < 3, SIGMA_M, SIGMA_RAD)
    value[:, machine.dof] += rng.normal(size=(len(visits), 3)) * sigma
    fit = identify(model, visits, [ToolCoordinates.of(visits, tuple(machine.dof.tolist()), value, sigma)])
    return np.mean(np.sum((fit.predict(held).tool_m() - model.predict(truth, held).tool_m()) ** 2, axis=1))


def test_d_optimal_poses_have_the_larger_determinant(machine):
    candidates = selection(machine, candidate_poses(machine, 64, 1))
    by_d, by_i = candidates.select(20, "D"), candidates.select(20, "I")

    def log_det(rows):
        stacked = candidates.rows[rows].reshape(-1, candidates.rows.shape[2])
        return np.linalg.slogdet(np.eye(stacked.shape[1]) + stacked.T @ stacked)[1]

    assert log_det(by_d.rows) > log_det(by_i.rows)
    assert by_i.u_position_m < by_d.u_position_m


def test_greedy_gain_is_the_true_gain(machine):
    candidates = selection(machine, candidate_poses(machine, 16, 1))
    start = np.array([0, 3, 5])
    covariance = np.linalg.inv(candidates._information(start))
    for criterion in ("I", "D"):
        gains = candidates._gain(covariance, criterion)
        for row in (1, 7, 11):
            after = candidates._score(np.append(start, row), criterion)
            assert gains[row] == pytest.approx(candidates._score(start, criterion) - after, rel=1e-6)


def test_load_cases_are_part_of_the_plan(machine):
    tool = candidate_poses(machine, 32, 2)
    loads = (PlannedLoad(), PlannedLoad(400.0, (0.0, -0.2, 0.0)))
    one, two = selection(machine, tool).select(12), selection(machine, tool, loads).select(12)
    assert two.u_position_m < one.u_position_m


@pytest.mark.parametrize("name", ["delta6", "gough8", "prs3", "rrr4"])
def test_every_chosen_pose_is_within_the_travel(name):
    machine = load_machine(shipped_machine(name))
    chosen = selection(machine, candidate_poses(machine, 32, 3)).select(8).tool
    drives, _ = drives_for(machine, machine.nominal, chosen)
    assert np.all((drives >= machine.travel[:, 0]) & (drives <= machine.travel[:, 1]))
    low, high = machine.commanded_limits.T
    assert np.all((chosen[:, machine.commanded] >= low) & (chosen[:, machine.commanded] <= high))


def test_grids_take_what_fits(machine):
    assert len(grid_poses(machine, 64)) == 64
    assert len(grid_poses(machine, 30)) == 30
    assert len(grid_poses(load_machine(shipped_machine("delta6")), 25)) == 18


def test_a_workspace_out_of_reach_is_named():
    text = shipped_machine("planar4").read_text(encoding="utf-8").replace("[0.32, 1.70]", "[0.32, 0.33]")
    machine = parse_machine(text, "short.toml")
    assert len(reachable(machine, np.full((1, 2), 0.5))) == 0
    with pytest.raises(InputError, match="travel"):
        workspace_poses(machine, 10, 1)
