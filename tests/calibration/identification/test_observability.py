"""What the data leave open is named, and what is named spans what is open."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import orth, subspace_angles

from calibration.base.frame import Frame
from calibration.identification.observability import _row_echelon, observability_of, planned_observability
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine, shipped_machines
from calibration.machine.inverse import drives_for
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

POSES = 60


def campaign(name, payload_kg=0.0, loads=False):
    machine = load_machine(shipped_machine(name))
    rng = np.random.default_rng(3)
    target = rng.uniform(*machine.workspace.T, (POSES, 6))
    drives, pose = drives_for(machine, machine.nominal, target)
    payload = np.where(np.arange(POSES) % 2 == 0, 0.0, payload_kg)
    return Model(ParameterSet.of(machine), with_loads=loads), Visits.at_reference_temperature(
        machine, drives, pose, payload
    )


def full_pose(model, visits):
    machine = model.machine
    sigma = np.where(machine.dof < 3, 7e-6, 3e-5)
    return ToolCoordinates.of(visits, tuple(machine.dof.tolist()), visits.target_m, sigma)


def reflectors(model, visits):
    smrs = tuple(i for i, s in enumerate(model.machine.smrs) if s.on == "platform")
    count = len(visits) * len(smrs)
    seen = ReflectorObservations(
        visits,
        np.repeat(np.arange(len(visits)), len(smrs)),
        np.tile(smrs, len(visits)),
        np.zeros((count, 3)),
        np.tile(np.eye(3) * 1e-10, (count, 1, 1)),
    )
    return SmrPositions(seen, StationModel(Frame(np.eye(3), np.array([0.3, 0.2, 4.0])), smrs))


def dense_null_space(model, visits, readings, tolerance):
    """Null space of the parameters, others projected out densely, the frame without any prior."""
    count = len(model.parameters)
    problem = LeastSquaresProblem(model, visits, (readings,))
    z = np.zeros(problem.layout.size)
    rows = []
    for _, _, found in problem._compare_blocks(z, derivatives=True):
        rows.append(np.concatenate([found.by_model, found.by_own], axis=2).reshape(-1, z.size))
    jacobian = np.vstack(rows) * problem.layout.sigma
    mounted = [i for i, name in enumerate(problem.layout.names) if name.startswith("mounting.")]
    jacobian = np.vstack([jacobian, np.eye(z.size)[mounted]])  # reflectors are known to their tolerance
    others = jacobian[:, count:]
    machine = jacobian[:, :count]
    if others.shape[1]:
        basis = orth(others / np.linalg.norm(others, axis=0), rcond=1e-10)
        machine = machine - basis @ (basis.T @ machine)
    _, s, vt = np.linalg.svd(machine)
    return vt[s < tolerance].T


@pytest.mark.parametrize("name", shipped_machines())
@pytest.mark.parametrize("readings", [full_pose, reflectors])
def test_named_combinations_span_the_null_space_of_every_machine(name, readings):
    model, visits = campaign(name)
    seen = readings(model, visits)
    observability = planned_observability(model, visits, [seen], threshold=1e-3 if readings is reflectors else 1e-6)
    named = np.array(
        [[c.coefficients.get(n, 0.0) for n in model.parameters.names] for c in observability.open_combinations]
    ).T
    named = named / model.parameters.sigma[:, None]
    null = dense_null_space(model, visits, seen, 1e-6)
    assert null.shape[1] == len(observability.open_combinations)
    assert np.max(subspace_angles(named, null)) < 1e-3
    assert observability.gap_rad < 1e-3
    assert all(c.words for c in observability.open_combinations)


def test_the_words_for_the_default_machine():
    model, visits = campaign("planar4")
    pose = planned_observability(model, visits, [full_pose(model, visits)], threshold=1e-6).sentences
    assert any("platform and base joint along x of left_upper, left_lower" in s for s in pose)
    assert any(s.startswith("stiffness of left_upper") for s in pose)
    seen = planned_observability(model, visits, [reflectors(model, visits)], threshold=1e-3).sentences
    assert "heights of the sliders left, right along y only as differences" in seen
    assert "the base as a body about z not at all" in seen


def test_a_known_load_difference_makes_stiffness_observable():
    rows = None
    left = []
    for payload_kg in (0.0, 400.0):
        model, visits = campaign("planar4", payload_kg, loads=True)
        rows = model.parameters.rows("ln_stiffness")
        left.append(planned_observability(model, visits, [full_pose(model, visits)]).remaining_share[rows])
    assert np.all(left[0] > 0.9)
    assert np.all(left[1] < 0.8)


def test_a_planned_campaign_promises_what_the_fit_then_has(synthetic):
    rig = synthetic(50)
    xy = rig.workspace(30)
    seen = rig.see(rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, 400.0], 30)))
    fit = rig.fit(seen, rig.rough)
    promised = planned_observability(rig.model, seen.visits, fit.instruments, rig.truth[: len(rig.model.parameters)])
    observability = observability_of(fit)
    np.testing.assert_allclose(observability.remaining_share, promised.remaining_share, rtol=0.05)
    np.testing.assert_allclose(observability.remaining_share, fit.theta_u / rig.model.parameters.sigma, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_open_is_listed_with_few_entries_a_row(seed):
    """The span stays, and each row has a column of its own."""
    basis = np.random.default_rng(seed).standard_normal((3, 7))
    basis[0, :5] = 0.0  # the largest entry is in another row than the one whose turn it is
    rows = _row_echelon(basis)
    assert np.max(subspace_angles(rows.T, basis.T)) < 1e-12
    own = [np.flatnonzero(np.all(np.abs(rows.T - unit) < 1e-12, axis=1)) for unit in np.eye(3)]
    assert all(len(columns) == 1 for columns in own)
