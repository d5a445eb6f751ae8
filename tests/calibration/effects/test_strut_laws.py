"""Struts that are no linear springs: their laws, their place in the structure, fitting them again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.diagnose import diagnose, diagnose_and_add
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.context import context_of_recording
from calibration.effects.structure import clearance_curves, link_stiffness_curves
from calibration.effects.strut_laws import (
    LawParameter,
    RestrainedStrut,
    curve_of_law,
    misfit_m,
    saturating_law,
    series_spring,
    smooth_spring,
)
from calibration.machine import equilibrium
from calibration.machine.description import load_machine
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import PLANAR, Rest, drawn_geometry, drawn_poses, plant, recorded, simulated

COMPLIANCE = 1e-8
LAWS = {
    "softer": lambda: series_spring(COMPLIANCE),
    "any play": lambda: saturating_law(3e-5, 400.0, 2.5),
    "sharp play": lambda: saturating_law(3e-5, 2000.0, 6.0),
    "smooth": lambda: smooth_spring(COMPLIANCE, 3000.0, 0.7, -0.3),
    "smooth alike": lambda: smooth_spring(COMPLIANCE, 3000.0, 0.3, -0.3),
}


def two_of_each(stands: int) -> tuple[np.ndarray, np.ndarray]:
    """A reading of each stand, and the stand of each of twice as many readings."""
    return np.arange(stands), np.repeat(np.arange(stands), 2)


@pytest.mark.parametrize("name", LAWS)
@given(tension=st.floats(-2e4, 2e4))
def test_a_law_grows_from_zero_and_knows_its_derivative(name, tension):
    law, at = LAWS[name](), np.array([tension])
    assert law(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-15)
    slope = law(at)[1]
    numeric = (law(at + 0.5)[0] - law(at - 0.5)[0]) / 1.0
    assert slope >= 0.0
    assert slope == pytest.approx(numeric, rel=1e-4, abs=1e-12)


@given(
    free=st.lists(st.floats(-5e4, 5e4), min_size=1, max_size=6),
    restraint=st.floats(0.0, 1e8),
    clearance=st.floats(1e-6, 4e-4),
    width=st.floats(50.0, 2e4),
)
def test_tension_and_growth_agree_with_what_holds_the_strut(free, restraint, clearance, width):
    tension, zero = np.array(free), np.zeros((len(free), 1))
    held = RestrainedStrut("length.any", 1e8, *two_of_each(len(free)), tension, np.full(len(free), restraint), zero)
    for law in (
        saturating_law(clearance, width, 2.5),
        series_spring(COMPLIANCE),
        smooth_spring(COMPLIANCE, width, 0.7, -0.3),
    ):
        at, slope, kept = held.solve_tension(law, np.zeros(1))
        assert at + restraint * law(at)[0] == pytest.approx(tension, rel=1e-6, abs=1e-6)
        assert slope == pytest.approx(law(at)[1])
        assert np.all((kept > 0.0) & (kept <= 1.0))


def test_a_tension_that_is_solved_is_not_left_again():
    """A step at its last digit may lead out of the limits by rounding."""
    tension = np.linspace(-4e3, 4e3, 400)
    held = RestrainedStrut("length.any", 1e8, *two_of_each(400), tension, np.full(400, 4e7), np.zeros((400, 1)))
    for name, make in LAWS.items():
        asked, law = [], make()
        held.solve_tension(lambda t, asked=asked, law=law: asked.append(1) or law(t), np.zeros(1))
        assert len(asked) < 20, name


@pytest.mark.parametrize("name", LAWS)
def test_the_structure_around_a_strut_is_linear_enough(name):
    """Against the whole machine solved with that strut's length corrected until its law holds, pose by pose."""
    machine, rng, strut = load_machine(PLANAR), np.random.default_rng(3), 2
    law, geometry = LAWS[name](), drawn_geometry(machine, rng)
    target, drives = drawn_poses(machine, rng, 6)
    cold = {sensor: np.full(6, machine.reference_temperature_c) for sensor in machine.sensors.values()}
    at = equilibrium.make_conditions(machine, 6, cold, np.full(6, 200.0), np.zeros((6, 3)))
    linear = Rest.of(machine, geometry, drives, at, target)
    answers = []
    for h in (-1e-6, 1e-6):
        length = geometry.length_m.copy()
        length[strut] += h
        answers.append(linear.again(replace(geometry, length_m=length)).rest.force_n[:, strut])
    restraint = (answers[0] - answers[1]) / 2e-6
    free = linear.rest.force_n[:, strut]
    stiffness = geometry.stiffness_n_per_m[strut]
    held = RestrainedStrut("length.any", stiffness, *two_of_each(6), free, restraint, np.zeros((6, 1)))
    tension = held.solve_tension(law, np.zeros(1))[0]
    growth = law(tension)[0]
    for row in range(6):
        one = Rest.of(machine, geometry, drives[[row]], at.take(np.array([row])), target[[row]])

        def longer(growth_m: float, one=one) -> float:
            length = geometry.length_m.copy()
            length[strut] += growth_m
            return float(one.again(replace(geometry, length_m=length)).rest.force_n[0, strut])

        solved = longer(float(growth[row]))
        assert solved == pytest.approx(tension[row], abs=0.01 * abs(free[row]) + 5.0)
        assert float(law(np.array([solved]))[0][0]) == pytest.approx(growth[row], abs=0.02 * abs(growth[row]) + 5e-7)


@pytest.fixture(scope="module")
def yielding():
    """A strut that gives way above a tension."""
    return recorded(plant(80, EffectChoice("link_stiffness", 4.0, "right_lower", "yielding")))


@pytest.fixture(scope="module")
def known(yielding):
    likelihood = MarginalLikelihood.of(linearise_recording(yielding))
    return likelihood, inputs_of_recording(likelihood, periodograms(likelihood))


def test_answers_of_the_setting_are_those_of_the_model(known):
    """Tension after a strut grew, by the model solved again."""
    likelihood, s = known
    linear, poses = likelihood.linear, likelihood.linear.poses
    geometry, rest = poses.geometry, poses.equilibrium
    for j in range(4):
        forces = []
        for h in (-1e-6, 1e-6):
            length = geometry.length_m.copy()
            length[j] += h
            solved = equilibrium.solve(
                linear.machine,
                replace(geometry, length_m=length),
                poses.visits.drives,
                poses.conditions,
                rest.coordinates(),
            )
            forces.append(solved.force_n[:, :4])
        expected = ((forces[1] - forces[0]) / 2e-6)[np.maximum(linear.visit, 0)]
        np.testing.assert_allclose(s.tension_response_n_per_m[:, :, j], expected, atol=1e-3 * np.abs(expected).max())


def test_columns_of_a_tangent_are_derivatives(known):
    """Growth a little beside a point against the column of that parameter, in its unit."""
    _, s = known
    curve = curve_of_law(
        RestrainedStrut.from_inputs(s, 3), lambda at: saturating_law(np.exp(at[0]), np.exp(at[1]), 6.0),
        (LawParameter(-20.0, 0.0), LawParameter(0.0, 20.0)), starts=[(np.log(4e-5), np.log(3000.0))], middles=(0.5,),
        size=lambda at: np.ones_like(at[0]), misfit_unit_m=lambda at: 1e-5, misfit_m=misfit_m(s), form="play",
    )  # fmt: skip
    at = curve.starts[1]
    here = curve.tangent(at)
    columns = np.array([shape for ((_, shape),) in here.contributions])
    assert here.value == 1.0
    for i, unit in enumerate(here.units):
        moved = 1e-3 * unit * np.eye(len(at))[i]
        (((_, above),), *_), (((_, below),), *_) = (
            curve.tangent(at + moved).contributions,
            curve.tangent(at - moved).contributions,
        )
        expected = (above - below) / 2e-3
        np.testing.assert_allclose(columns[i + 1], expected, atol=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("curves", "number", "own", "limits", "within"),
    [
        (clearance_curves, 0, (np.log(6e-5), np.log(0.1), 0.2, 0.0, np.log(3.0)), (1e-6, 4e-4), 0.5),
        (link_stiffness_curves, 0, (np.log(2.0), 1.0, 0.5, 0.0), (0.05, 20.0), 0.5),
    ],
)
def test_fitting_again_finds_what_was_put_in(known, curves, number, own, limits, within):
    """Noise as stated and what a law does to one strut with some misfit: size, parameters and misfit are found."""
    likelihood, s = known
    truth = curves(s, 1)[number]
    point = np.zeros(len(truth.low))
    point[: len(own)] = own
    point[len(own)] = held_at(s, 1, 0.3)
    tangent = truth.tangent(point)
    size = float(np.exp(own[0]))
    linear = likelihood.linear
    noise = np.random.default_rng(2).standard_normal(linear.residual.shape)
    signal = size * likelihood.columns(truth.at_readings(tangent)[:1])[:, :, 0]
    curve_fits = fit_curves(MarginalLikelihood.of(replace(linear, residual=noise + signal)), [truth], *limits)
    assert curve_fits is not None
    weights = np.array([*curve_fits.best.basis_set.size, *[0.0] * (len(curve_fits.best.coefficients) - 2)])
    u = float(np.sqrt(weights @ curve_fits.best.covariance @ weights))
    assert weights @ curve_fits.best.coefficients == pytest.approx(size, abs=3.0 * u)
    assert u < 0.45 * size
    there = np.array(curve_fits.best.basis_set.curve[1])
    # A width that is much narrower than the tensions between two stands is hardly told.
    u_of_own = np.sqrt(np.diag(curve_fits.best.covariance))[1 : len(own) + 1] / curve_fits.best.coefficients[0]
    assert np.all(np.abs(there - point)[: len(own)] < np.maximum(within, 3.0 * u_of_own))
    assert there[0] == pytest.approx(point[0], abs=within)
    # What it does to the strut is what was put in, but for what calibration takes up.
    left = np.einsum("nwk,k->nw", likelihood.columns(curve_fits.contributions), curve_fits.best.coefficients) - signal
    assert np.sqrt(np.mean(likelihood.apply(left[:, :, None]) ** 2)) < 0.15


def test_the_contrary_of_an_effect_is_not_that_effect(known):
    likelihood, s = known
    truth = link_stiffness_curves(s, 1)[0]
    contributions = truth.at_readings(truth.tangent(np.zeros(len(truth.low))))
    signal = -0.5 * likelihood.columns(contributions[:1])[:, :, 0]
    found = fit_curves(MarginalLikelihood.of(replace(likelihood.linear, residual=signal)), [truth], 0.05, 20.0)
    assert found is None or found.log_evidence < 0.0


@pytest.mark.parametrize("curves", [clearance_curves, link_stiffness_curves])
def test_points_that_are_followed_together_lead_where_each_does_alone(known, curves):
    likelihood, s = known
    for together in curves(s, 3):
        alone = replace(together, tangents=None)
        of_all, of_each = (fit_curves(likelihood, [curve], 1e-6, 20.0) for curve in (together, alone))
        assert of_all.log_evidence == pytest.approx(of_each.log_evidence, rel=1e-6, abs=1e-3)
        np.testing.assert_allclose(of_all.best.basis_set.curve[1], of_each.best.basis_set.curve[1], atol=1e-3)


@pytest.mark.parametrize("name", ["stewart6", "prs3"])
def test_struts_that_nothing_holds_carry_what_they_carry(name):
    """On a machine without redundancy the tension stays, and misfits change nothing."""
    likelihood = MarginalLikelihood.of(linearise_recording(simulated(name, 40)))
    s = inputs_of_recording(likelihood, periodograms(likelihood))
    held = RestrainedStrut.from_inputs(s, 0)
    assert np.max(held.restraint_n_per_m) < 1e-3 * held.stiffness_n_per_m
    for curves, limits in ((link_stiffness_curves, (0.05, 20.0)), (clearance_curves, (1e-6, 4e-4))):
        for one in curves(s, 0):
            columns = np.array([shape for ((_, shape),) in one.tangent(one.starts[0]).contributions])
            assert np.all(np.isfinite(columns))
        curve_fits = fit_curves(likelihood, curves(s, 0), *limits)
        assert curve_fits is None or np.isfinite(curve_fits.log_evidence)


def held_at(s, strut: int, middle: float) -> float:
    """The strut's misfit that puts its mean tension at so many standard deviations."""
    return RestrainedStrut.from_inputs(s, strut).starting_misfits_m((middle,))[1]


@pytest.mark.parametrize(
    ("name", "variant", "size", "place"),
    [
        ("link_stiffness", "yielding", 4.0, "right_lower"),
        ("link_stiffness", "joint_angle", 1.3, "left_lower"),
        ("joint_clearance", "load_dependent", 6e-5, "left_upper"),
        ("joint_clearance", "soft_contact", 8e-5, "right_upper"),
    ],
)
def test_play_and_softness_of_a_strut_are_told_apart(name, variant, size, place):
    diagnosis = diagnose(recorded(plant(120, EffectChoice(name, size, place, variant))))
    assert name in (diagnosis.verdict, *diagnosis.equivalent)
    assert diagnosis.effects[0].place == place


def test_a_twin_with_a_curve_there_and_back(yielding):
    _, twin = diagnose_and_add(yielding)
    assert twin.added[0].curve is not None
    hostile = twin.to_data()
    for curve_data in ([0, 0.0], [99, *hostile["added"][0]["curve"][1:]], [0.5, 1.0], "curve", [0, float("nan")]):
        hostile["added"][0]["curve"] = curve_data
        with pytest.raises(InputError, match="twin"):
            Twin.from_data(PLANAR.read_text(encoding="utf-8"), hostile)
    again = Twin.from_data(PLANAR.read_text(encoding="utf-8"), twin.to_data())
    context = context_of_recording(yielding)
    rows = np.arange(0, len(context), 40)
    assert np.array_equal(again.places_m(context, rows), twin.places_m(context, rows))
