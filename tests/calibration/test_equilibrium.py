"""Poses at rest against hand-checked values and an independent minimisation of the energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from calibration import equilibrium
from calibration.equilibrium import conditions, derivatives, drives_for, rotation_matrix, rotation_vector, solve
from calibration.parameters import ParameterSet


def poses(machine, count, seed):
    rng = np.random.default_rng(seed)
    target = np.zeros((count, 6))
    target[:, :2] = rng.uniform(*machine.workspace_m.T, (count, 2))
    drives = drives_for(machine, machine.nominal, target[:, :3], rotation_matrix(target[:, 3:]))
    parameters = ParameterSet.of(machine)
    tolerance = np.array([p.tolerance for p in parameters.parameters])
    theta = rng.uniform(-1.0, 1.0, len(parameters)) * tolerance
    return target, drives, parameters, theta


@pytest.mark.parametrize(
    ("pose", "left_m", "right_m"),
    [((0.0, 0.0), 1.118033988749895, 1.118033988749895), ((0.35, 0.30), 0.953834841531101, 1.651850583459577)],
)
def test_golden_poses_of_the_machine_document(machine, pose, left_m, right_m):
    target = np.array([[*pose, 0.0]])
    drives = drives_for(machine, machine.nominal, target, np.eye(3)[None])
    np.testing.assert_allclose(drives[0], [left_m, right_m], atol=1e-14)
    rest = solve(machine, machine.nominal, drives, conditions(replace(machine, moving_mass_kg=0.0), 1))
    np.testing.assert_allclose(rest.position_m[0], [*pose, 0.0], atol=1e-13)
    assert rest.converged.all()


def energy(machine, geometry, drives, payload_kg, com, x):
    """V of docs/machine.md in plain words, one pose."""
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
    at = conditions(machine, 6, payload_kg=400.0, payload_com_m=com)
    rest = solve(machine, geometry, drives, at, target)
    for i in range(6):
        found = minimize(
            lambda x, i=i: energy(machine, geometry, drives[i], 400.0, com, x),
            [*target[i, :2], 0.0],
            method="Nelder-Mead",
            options={"xatol": 1e-10, "fatol": 1e-10, "maxiter": 4000, "initial_simplex": _simplex(target[i])},
        )
        # An energy of some 100 J in double precision leaves the minimum uncertain to some 10 nm.
        np.testing.assert_allclose(rest.coordinates()[i, [0, 1, 5]], found.x, atol=5e-8)


def _simplex(target):
    start = np.array([target[0], target[1], 0.0])
    return np.vstack([start, *(start + 1e-4 * row for row in np.eye(3))])


def test_residual_force_vanishes_and_stiffness_is_symmetric(machine):
    target, drives, parameters, theta = poses(machine, 40, seed=4)
    geometry = parameters.geometry(theta)
    at = conditions(machine, 40, payload_kg=400.0)
    rest = solve(machine, geometry, drives, at, target)
    joints = equilibrium.carriage_joints(machine, geometry, drives, at)
    state = equilibrium._State.at(machine, geometry, joints, at, rest.position_m, rest.rotation)
    assert np.abs(state.gradient()[:, machine.dof]).max() < 1e-5
    stiffness = state.stiffness(machine.dof)
    assert np.abs(stiffness - stiffness.transpose(0, 2, 1)).max() < 1e-12 * np.abs(stiffness).max()


def test_derivatives_agree_with_central_differences(machine):
    target, drives, parameters, theta = poses(machine, 12, seed=5)
    at = conditions(machine, 12, {name: np.full(12, 23.0) for name in machine.sensors.values()}, 400.0)
    geometry = parameters.geometry(theta)
    rest = solve(machine, geometry, drives, at, target)
    d = derivatives(machine, geometry, drives, at, rest)
    exact = parameters.pose_jacobian(d, parameters.slide_derivative(geometry, drives, at))
    for i, p in enumerate(parameters.parameters):
        h = 1e-4 if p.kind == "ln_stiffness" else 1e-6
        step = np.zeros(len(parameters))
        step[i] = h
        ahead, behind = (
            solve(machine, parameters.geometry(theta + s), drives, at, target).coordinates()[:, machine.dof]
            for s in (step, -step)
        )
        np.testing.assert_allclose(exact[:, :, i], (ahead - behind) / (2.0 * h), atol=5e-9, err_msg=p.name)


def test_an_unreachable_pose_is_reported_and_never_a_number(machine):
    drives = np.array([[1.1, 1.1], [0.0, 50.0]])
    rest = solve(machine, machine.nominal, drives, conditions(machine, 2))
    assert rest.converged.tolist() == [True, False]
    assert np.isnan(rest.position_m[1]).all()
    assert np.isfinite(rest.position_m[0]).all()


def test_rotation_vector_inverts_rotation_matrix():
    rng = np.random.default_rng(1)
    vectors = rng.normal(0.0, 0.5, (50, 3))
    vectors[0] = 0.0
    vectors[1] = 1e-10
    np.testing.assert_allclose(rotation_vector(rotation_matrix(vectors)), vectors, atol=1e-14)


def test_heat_lengthens_every_part_as_documented(machine):
    """All parts alike: the machine is a scaled picture of itself, so a scaled drive gives a scaled pose."""
    same = replace(
        machine,
        moving_mass_kg=0.0,
        expansion_per_k=dict.fromkeys(machine.expansion_per_k, 1e-5),
    )
    target, drives, _, _ = poses(machine, 5, seed=6)
    hot = conditions(same, 5, {name: np.full(5, 30.0) for name in machine.sensors.values()})
    rest = solve(same, machine.nominal, drives, hot, target)
    np.testing.assert_allclose(rest.position_m, target[:, :3] * (1.0 + 1e-4), atol=1e-12)
