"""Every kind of reading: derivatives against differences, and what a fit of it can and cannot know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.rotation import rotation_vector
from calibration.identification.estimators import identify
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.identification.prediction import monte_carlo, predict_tool
from calibration.identification.problem import Layout
from calibration.instruments.distances import Distances
from calibration.instruments.readings import split_by_visits
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet

LOADS = (PlannedLoad(), PlannedLoad(40.0, (0.01, 0.02, 0.05)))
SIGMA_M, SIGMA_RAD = 7e-6, 3e-5
KNOWN = SystematicUncertainties(
    1e-3, 1e-3, dict.fromkeys(("struts", "drives", "base", "platform"), 3e-7), {"struts": 0.1}
)


def rig(name, poses=30, seed=0):
    """A machine with drawn errors and its visits, without and with payload, warm."""
    machine = load_machine(shipped_machine(name))
    rng = np.random.default_rng(seed)
    model = Model(ParameterSet.of(machine), KNOWN)
    visits = visits_at(machine, workspace_poses(machine, poses, seed), LOADS)
    warm = {name: t + 1.0 + k for k, (name, t) in enumerate(visits.temperatures_c.items())}
    visits = replace(visits, temperatures_c=warm)
    truth = rng.normal(size=len(model)) * np.array([u.sigma for u in model.unknowns])
    return model, visits, truth, rng


def pose_of(model, truth, visits):
    prediction = model.predict(truth, visits)
    return np.concatenate([prediction.tool_m(), rotation_vector(prediction.equilibrium.rotation)], axis=1)


def readings_of(kind, model, visits, value):  # noqa: PLR0911  one kind, one return
    dof = tuple(model.machine.dof.tolist())
    sigma = np.tile(np.where(model.machine.dof < 3, SIGMA_M, SIGMA_RAD), (len(visits), 1))
    every = np.arange(len(visits))
    match kind:
        case "full pose":
            return ToolCoordinates(every, dof, value, sigma)
        case "own frame":
            return ToolCoordinates(every, dof, value, sigma, own_frame=True)
        case "height":
            return ToolCoordinates(every, (2,), value, sigma[:, :1], offset_u=(1e-3,))
        case "bowl":
            return ToolCoordinates(every, (0, 2), value, sigma[:, :2], bowl_u_m=1e-3, bowl_radius_m=0.2)
        case "x and y":
            return ToolCoordinates(every, (0, 1), value, sigma[:, :2])
        case "ball bar":
            centre = np.array([0.3, -0.2, 0.1])
            length = np.linalg.norm(value[:, :3] - centre, axis=1)
            return Distances(every, None, length, sigma[:, 0], centre, 1e-3, length_u_m=1e-4)
        case _:
            pairs = np.stack([every[:-1], every[1:]])
            length = np.linalg.norm(value[pairs[0], :3] - value[pairs[1], :3], axis=1)
            return Distances(pairs[0], pairs[1], length, sigma[:-1, 0], length_u_m=1e-4, scale_u=1e-3)


KINDS = ("full pose", "own frame", "height", "bowl", "x and y", "ball bar", "calliper")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["planar4", "delta6", "prs3"])
def test_derivatives_agree_with_differences(kind, name):
    if name == "planar4" and kind in ("height", "bowl"):
        pytest.skip("a planar machine has no height")
    model, visits, truth, rng = rig(name, 4)
    readings = readings_of(kind, model, visits, pose_of(model, truth, visits))
    layout = Layout.of(model, [readings])
    values = np.zeros(layout.size)
    values[: len(model)] = truth
    values[len(model) :] = rng.normal(size=layout.size - len(model)) * 1e-4
    count = len(model)

    def predict(at):
        return readings.compare(model.predict(at[:count], visits), readings.visit_indices(), at[count:])

    prediction = predict(values)
    exact = np.concatenate([prediction.by_model, prediction.by_own], axis=2)
    for column, unknown in enumerate(layout.unknowns):
        step = np.zeros(layout.size)
        step[column] = min(1e-2 * unknown.sigma, 1e-4)
        ahead, behind = predict(values + step).residual, predict(values - step).residual
        size = np.max(np.abs(exact[:, :, column])) + 1e-3 / unknown.sigma
        error = np.abs((ahead - behind) / (2.0 * step[column]) - exact[:, :, column])
        # Rotations are compared by the vector between them, whose derivative differs from ours by its own size.
        assert np.max(error) < 1e-3 * size, unknown.name


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_reading_identifies_what_it_sees(kind):
    """The weighted residuals of a fit have the size of the stated noise, and the truth lies within its covariance."""
    model, visits, truth, rng = rig("delta6", 60, seed=3)
    readings = readings_of(kind, model, visits, pose_of(model, truth, visits))
    noisy = with_noise(readings, rng)
    fit = identify(model, visits, [noisy])
    freedom = max(fit.degrees_of_freedom, 1.0)
    assert abs(fit.chi2_per_dof - 1.0) < 5.0 * np.sqrt(2.0 / freedom)
    error = fit.unknowns[: len(model)] - truth
    covariance = fit.covariance[: len(model), : len(model)]
    scale = fit.layout.sigma[: len(model)]
    square = error @ np.linalg.solve(covariance + 1e-12 * np.diag(scale**2), error)
    assert square < len(model) + 5.0 * np.sqrt(2.0 * len(model))


def with_noise(readings, rng):
    return readings.with_noise(rng.normal(size=(len(readings), readings.width)))


def test_with_x_and_y_only_the_orientation_stays_open():
    model, visits, truth, rng = rig("planar4", 60, seed=5)
    value = pose_of(model, truth, visits)
    seen = {k: with_noise(readings_of(k, model, visits, value), rng) for k in ("full pose", "x and y")}
    u = {k: predict_tool(identify(model, visits, [r]), visits).u for k, r in seen.items()}
    assert np.sqrt(np.mean(u["x and y"][:, 5] ** 2)) > 1e-4
    assert np.sqrt(np.mean(u["full pose"][:, 5] ** 2)) < 1e-5
    assert np.sqrt(np.mean(u["x and y"][:, :2] ** 2)) < 3e-6


def test_robust_loss_bears_outliers():
    model, visits, truth, rng = rig("planar4", 40, seed=6)
    readings = with_noise(readings_of("full pose", model, visits, pose_of(model, truth, visits)), rng)
    readings.value[::9, 0] += 300e-6
    errors = []
    for robust in (False, True):
        fit = identify(model, visits, [readings], robust=robust)
        shift = fit.predict(visits).tool_m() - model.predict(truth, visits).tool_m()
        errors.append(np.sqrt(np.mean(np.sum(shift**2, axis=1))))
    assert errors[0] > 15e-6
    assert errors[1] < 6e-6


def test_two_instruments_join_in_one_fit():
    model, visits, truth, rng = rig("delta6", 40, seed=7)
    value = pose_of(model, truth, visits)
    height = with_noise(readings_of("height", model, visits, value), rng)
    bar = with_noise(readings_of("ball bar", model, visits, value), rng)
    alone, both = identify(model, visits, [height]), identify(model, visits, [height, bar])
    assert np.all(np.diag(both.covariance)[: len(model)] <= np.diag(alone.covariance)[: len(model)] * (1.0 + 1e-9))
    assert both.value("bar.length")[1] < 1e-4
    with pytest.raises(InputError, match=r"no unknown 'range\.scale'"):
        both.value("range.scale")


def test_blocks_of_visits_give_the_same_fit(monkeypatch):
    model, visits, truth, rng = rig("planar4", 40, seed=8)
    value = pose_of(model, truth, visits)
    seen = [with_noise(readings_of(k, model, visits, value), rng) for k in ("full pose", "calliper")]
    whole = identify(model, visits, seen)
    monkeypatch.setattr("calibration.identification.problem.VISITS_AT_ONCE", 7)
    assert len(list(split_by_visits(seen[1], 7))) > 10
    cut = identify(model, visits, seen)
    u = np.sqrt(np.diag(whole.covariance))
    assert np.max(np.abs(cut.unknowns - whole.unknowns) / u) < 1e-5


@pytest.mark.parametrize("name", ["planar4"])
def test_monte_carlo_agrees_with_linear_propagation(name):
    """JCGM 101 as a cross-check: 100 draws tell a standard deviation to 7 %."""
    model, visits, truth, rng = rig(name, 30, seed=9)
    readings = with_noise(readings_of("full pose", model, visits, pose_of(model, truth, visits)), rng)
    fit = identify(model, visits, [readings])
    few = visits.take(np.arange(0, len(visits), 10))
    linear, drawn = predict_tool(fit, few).u, monte_carlo(fit, few, seed=1, draws=100).u
    free = model.machine.dof
    np.testing.assert_allclose(drawn[:, free], linear[:, free], rtol=0.35)
    assert np.mean(drawn[:, free] / linear[:, free]) == pytest.approx(1.0, abs=0.12)


def test_a_bowl_of_the_bed_is_found_with_its_sign():
    """A bed that is 0.4 mm higher 0.2 m off the axis: touched there, the tool stands higher than the height says."""
    model, visits, truth, rng = rig("prs3", 80, seed=9)
    pose, depth_m = pose_of(model, truth, visits), 4e-4
    stated = pose.copy()
    stated[:, 2] -= depth_m * np.sum(pose[:, :2] ** 2, axis=1) / 0.2**2
    sigma = np.full((len(visits), 3), SIGMA_M)
    touched = ToolCoordinates(np.arange(len(visits)), (0, 1, 2), stated, sigma, bowl_u_m=1e-3, bowl_radius_m=0.2)
    fit = identify(model, visits, [with_noise(touched, rng)])
    value, u = fit.value("bed.bowl")
    assert u < 2e-4
    assert abs(value - depth_m) < 4.0 * u
