"""Poses at rest and drives for wanted poses, on every shipped machine; hand-checked values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from calibration.base.rotation import rotation_matrix, rotation_vector, rotations_poses_last
from calibration.machine import equilibrium
from calibration.machine.description import load_machine, parse_machine, shipped_machine, shipped_machines
from calibration.machine.equilibrium import PoseStatus, make_conditions, solve, state_at
from calibration.machine.inverse import drives_for, nominal_drives
from calibration.model.parameters import ParameterSet


def poses(machine, count, seed):
    rng = np.random.default_rng(seed)
    target = np.zeros((count, 6))
    low, high = machine.commanded_limits.T
    target[:, machine.commanded] = rng.uniform(low, high, (count, len(low)))
    drives, pose = drives_for(machine, machine.nominal, target)
    parameters = ParameterSet.of(machine)
    tolerance = np.array([p.tolerance for p in parameters.parameters])
    theta = rng.uniform(-1.0, 1.0, len(parameters)) * tolerance
    return pose, drives, parameters, theta


@pytest.fixture(params=shipped_machines())
def any_machine(request):
    return load_machine(shipped_machine(request.param))


@pytest.mark.parametrize(
    ("pose", "left_m", "right_m"),
    [((0.0, 0.0), 1.118033988749895, 1.118033988749895), ((0.35, 0.30), 0.953834841531101, 1.651850583459577)],
)
def test_golden_poses_of_the_machine_document(machine, pose, left_m, right_m):
    target = np.array([[*pose, 0.0, 0.0, 0.0, 0.0]])
    drives = nominal_drives(machine, target)
    np.testing.assert_allclose(drives[0], [left_m, right_m], atol=1e-14)
    rest = solve(machine, machine.nominal, drives, make_conditions(replace(machine, moving_mass_kg=0.0), 1))
    np.testing.assert_allclose(rest.position_m[0], [*pose, 0.0], atol=1e-13)
    assert rest.converged.all()


def energy(machine, geometry, drives, payload_kg, com, x):
    """V of docs/reference/machine.md in plain words, one pose."""
    c, s = np.cos(x[2]), np.sin(x[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    p = np.array([x[0], x[1], 0.0])
    total = 0.0
    for i in range(4):
        a = machine.strut_drive[i]
        joint = geometry.base_joint_m[i] + geometry.scale[a] * drives[a] * geometry.axis[a]
        stretch = np.linalg.norm(p + turn @ geometry.platform_joint_m[i] - joint) - geometry.length_m[i]
        total += 0.5 * geometry.stiffness_n_per_m[i] * stretch**2
    for mass, at in ((machine.moving_mass_kg, machine.centre_of_mass_m), (payload_kg, np.asarray(com))):
        total -= mass * machine.gravity_m_per_s2 @ (p + turn @ at)
    return total


def test_rest_is_the_minimum_of_the_energy(machine):
    target, drives, parameters, theta = poses(machine, 6, seed=3)
    geometry = parameters.geometry(theta)
    com = (0.02, -0.2, 0.0)
    at = make_conditions(machine, 6, payload_kg=400.0, payload_com_m=com)
    rest = solve(machine, geometry, drives, at, target)
    for i in range(6):
        optimum = minimize(
            lambda x, i=i: energy(machine, geometry, drives[i], 400.0, com, x),
            [*target[i, :2], 0.0],
            method="Nelder-Mead",
            options={"xatol": 1e-10, "fatol": 1e-10, "maxiter": 4000, "initial_simplex": _simplex(target[i])},
        )
        # An energy of some 100 J in double precision leaves the minimum uncertain to some 10 nm.
        np.testing.assert_allclose(rest.coordinates()[i, [0, 1, 5]], optimum.x, atol=5e-8)


def _simplex(target):
    start = np.array([target[0], target[1], 0.0])
    return np.vstack([start, *(start + 1e-4 * row for row in np.eye(3))])


def test_residual_force_vanishes_and_stiffness_is_symmetric(any_machine):
    pose, drives, parameters, theta = poses(any_machine, 40, seed=4)
    geometry = parameters.geometry(theta)
    at = make_conditions(any_machine, 40, payload_kg=40.0, payload_com_m=(0.02, 0.01, 0.03))
    rest = solve(any_machine, geometry, drives, at, pose)
    assert rest.converged.all()
    state = state_at(any_machine, geometry, drives, at, rest.position_m, rest.rotation)
    assert np.abs(state.gradient()).max() < 1e-5
    assert np.linalg.eigvalsh(state.hessian().transpose(2, 0, 1)).min() > 0.0


def test_drives_for_wanted_poses_and_back(any_machine):
    """The commanded coordinates of a machine with errors, load and heat come out as wanted."""
    pose, _, parameters, theta = poses(any_machine, 25, seed=8)
    geometry = parameters.geometry(0.5 * theta)
    warm = {sensor: np.full(25, 24.0) for sensor in any_machine.sensors.values()}
    at = make_conditions(any_machine, 25, warm, payload_kg=30.0)
    wanted = pose.copy()
    wanted[:, :3] += rotation_matrix(pose[:, 3:]) @ any_machine.tool_point_m
    drives, found = drives_for(any_machine, geometry, wanted, at)
    rest = solve(any_machine, geometry, drives, at, pose)
    np.testing.assert_allclose(rest.coordinates(), found, atol=1e-10)
    grown = at.factors["platform"][:, None]
    tool = rest.position_m + grown * (rest.rotation @ any_machine.tool_point_m)
    turn = rotation_vector(rest.rotation @ rotation_matrix(wanted[:, 3:]).transpose(0, 2, 1))
    error = np.concatenate([tool - wanted[:, :3], turn], axis=1)[:, any_machine.commanded]
    assert np.abs(error).max() < 1e-9


def test_the_middle_of_the_workspace_is_start_enough(any_machine):
    pose, drives, parameters, theta = poses(any_machine, 50, seed=9)
    geometry, at = parameters.geometry(theta), make_conditions(any_machine, 50)
    from_pose, from_middle = solve(any_machine, geometry, drives, at, pose), solve(any_machine, geometry, drives, at)
    np.testing.assert_allclose(from_middle.coordinates(), from_pose.coordinates(), atol=1e-12)


def test_blocks_do_not_change_a_pose(machine):
    pose, drives, parameters, theta = poses(machine, 2 * equilibrium.BLOCK + 7, seed=10)
    geometry, at = parameters.geometry(theta), make_conditions(machine, len(pose))
    every = solve(machine, geometry, drives, at, pose)
    rows = np.arange(0, len(pose), 97)
    some = solve(machine, geometry, drives[rows], at.take(rows), pose[rows])
    np.testing.assert_allclose(some.coordinates(), every.coordinates()[rows], atol=1e-13)


def test_the_other_assembly_is_not_taken_for_the_machine(machine):
    """Sliders that stand below the platform close every strut as well."""
    target = np.zeros((1, 6))
    below = -nominal_drives(machine, target)
    rest = solve(machine, machine.nominal, below, make_conditions(machine, 1).without_loads(), target)
    assert rest.status.tolist() == [PoseStatus.OTHER_BRANCH]
    assert np.isnan(rest.position_m).all()


@pytest.mark.parametrize("drive", [0, 1])
def test_one_drive_on_the_other_branch_is_enough(machine, drive):
    """Each slider alone below the platform closes its struts as well; the first and the last drive are looked at."""
    target = np.zeros((1, 6))
    target[0, 0] = 0.05  # in the middle the struts would be in line
    drives = nominal_drives(machine, target)
    drives[0, drive] *= -1.0
    rest = solve(machine, machine.nominal, drives, make_conditions(machine, 1).without_loads(), target)
    assert rest.status.tolist() == [PoseStatus.OTHER_BRANCH]


def test_a_machine_that_nothing_holds_is_singular():
    """All struts of the planar machine parallel: it can slide across them."""
    text = shipped_machine("planar4").read_text(encoding="utf-8")
    upright = text.replace("1.2, 0.125", "0.2, 0.125").replace("1.2, -0.125", "0.2, -0.125")
    machine = parse_machine(upright, "upright.toml")
    drives = np.full((2, 2), 1.5)
    rest = solve(machine, machine.nominal, drives, make_conditions(machine, 2).without_loads(), np.zeros((2, 6)))
    assert rest.status.tolist() == [PoseStatus.SINGULAR] * 2
    assert np.isnan(rest.force_n).all()


def test_an_unreachable_pose_is_reported_and_never_a_number(machine):
    drives = np.array([[1.1, 1.1], [0.0, 50.0]])
    rest = solve(machine, machine.nominal, drives, make_conditions(machine, 2))
    assert rest.converged.tolist() == [True, False]
    assert np.isnan(rest.position_m[1]).all()
    assert np.isfinite(rest.position_m[0]).all()


def test_rotation_vector_inverts_rotation_matrix():
    rng = np.random.default_rng(1)
    vectors = rng.normal(0.0, 0.5, (50, 3))
    vectors[0] = 0.0
    vectors[1] = 1e-10
    np.testing.assert_allclose(rotation_vector(rotation_matrix(vectors)), vectors, atol=1e-14)
    np.testing.assert_allclose(rotations_poses_last(vectors.T).transpose(2, 0, 1), rotation_matrix(vectors), atol=1e-15)


def test_heat_lengthens_every_part_as_documented(machine):
    """All parts alike: the machine is a scaled picture of itself, so a scaled drive gives a scaled pose."""
    same = replace(
        machine,
        moving_mass_kg=0.0,
        expansion_per_k=dict.fromkeys(machine.expansion_per_k, 1e-5),
    )
    target, drives, _, _ = poses(machine, 5, seed=6)
    hot = make_conditions(same, 5, {name: np.full(5, 30.0) for name in machine.sensors.values()})
    rest = solve(same, machine.nominal, drives, hot, target)
    np.testing.assert_allclose(rest.position_m, target[:, :3] * (1.0 + 1e-4), atol=1e-12)
