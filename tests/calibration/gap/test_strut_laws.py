"""Struts that are no linear springs: their laws, their place in the structure, fitting them again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration import equilibrium
from calibration.effects.structure import clearance_curves
from calibration.effects.strut_laws import Held, curve, one_way, play, slipping, softer
from calibration.gap.baseline import baseline_of
from calibration.gap.diagnosis import diagnose, diagnose_and_add
from calibration.gap.evidence import Readout
from calibration.gap.moments import moments_of
from calibration.gap.refit import refit
from calibration.gap.setting import periodograms, setting_of
from calibration.gap.twin import Twin
from calibration.machine import load_machine
from mock_devices.effects import EffectChoice
from tests.calibration.gap.campaigns import PLANAR, Rest, drawn_geometry, drawn_poses, plant, recorded

COMPLIANCE = 1e-8
LAWS = {
    "play": lambda: play(3e-5, 400.0),
    "softer": lambda: softer(COMPLIANCE),
    "slipping": lambda: slipping(COMPLIANCE, 2000.0, 2.0),
    "tension alone": lambda: one_way(COMPLIANCE, 1.0, 200.0),
    "compression alone": lambda: one_way(COMPLIANCE, -1.0, 200.0),
}


@pytest.mark.parametrize("name", LAWS)
@given(tension=st.floats(-2e4, 2e4))
def test_a_law_grows_from_zero_and_knows_its_derivative(name, tension):
    law, at = LAWS[name](), np.array([tension])
    assert law(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-15)
    slope = law(at)[1]
    numeric = (law(at + 0.5)[0] - law(at - 0.5)[0]) / 1.0
    assert slope >= 0.0
    assert slope == pytest.approx(numeric, rel=1e-4, abs=1e-12)


@settings(deadline=None)
@given(
    free=st.lists(st.floats(-5e4, 5e4), min_size=1, max_size=6),
    restraint=st.floats(0.0, 1e8),
    clearance=st.floats(1e-6, 4e-4),
    width=st.floats(50.0, 2e4),
)
def test_tension_and_growth_agree_with_what_holds_the_strut(free, restraint, clearance, width):
    tension, zero = np.array(free), np.zeros((len(free), 1))
    held = Held("length.any", 1e8, tension, np.full(len(free), restraint), zero)
    for law in (play(clearance, width), slipping(COMPLIANCE, width, 6.0), one_way(COMPLIANCE, -1.0, width)):
        at, growth, kept = held.taken_up(law, np.zeros(1))
        found = np.isfinite(growth)
        assert np.all(found | (width < 0.05 * np.abs(tension)))
        assert (at + restraint * growth)[found] == pytest.approx(tension[found], rel=2e-3, abs=2e-3)
        assert np.all((kept > 0.0) & (kept <= 1.0))


@pytest.mark.parametrize("name", LAWS)
def test_the_structure_around_a_strut_is_linear_enough(name):
    """Against the whole machine solved with that strut's length corrected until its law holds, pose by pose."""
    machine, rng, strut = load_machine(PLANAR), np.random.default_rng(3), 2
    law, geometry = LAWS[name](), drawn_geometry(machine, rng)
    target, drives = drawn_poses(machine, rng, 6)
    cold = {sensor: np.full(6, machine.reference_temperature_c) for sensor in machine.sensors.values()}
    at = equilibrium.conditions(machine, 6, cold, np.full(6, 200.0), np.zeros((6, 3)))
    linear = Rest.of(machine, geometry, drives, at, target)
    answers = []
    for h in (-1e-6, 1e-6):
        length = geometry.length_m.copy()
        length[strut] += h
        answers.append(linear.again(replace(geometry, length_m=length)).rest.force_n[:, strut])
    restraint = (answers[0] - answers[1]) / 2e-6
    free = linear.rest.force_n[:, strut]
    held = Held("length.any", geometry.stiffness_n_per_m[strut], free, restraint, np.zeros((6, 1)))
    tension, growth, _ = held.taken_up(law, np.zeros(1))
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
    readout = Readout(baseline_of(yielding))
    return readout, setting_of(readout, periodograms(readout))


def test_answers_of_the_setting_are_those_of_the_model(known):
    """Tension after a strut grew, by the model solved again."""
    readout, s = known
    baseline, poses = readout.baseline, readout.baseline.poses
    geometry, rest = poses.geometry, poses.rest
    for j in range(4):
        forces = []
        for h in (-1e-6, 1e-6):
            length = geometry.length_m.copy()
            length[j] += h
            solved = equilibrium.solve(
                baseline.machine, replace(geometry, length_m=length), poses.visits.drives, poses.at, rest.coordinates()
            )
            forces.append(solved.force_n[:, :4])
        expected = ((forces[1] - forces[0]) / 2e-6)[np.maximum(baseline.visit, 0)]
        np.testing.assert_allclose(s.answer_n_per_m[:, :, j], expected, atol=1e-3 * np.abs(expected).max())


def test_columns_of_a_tangent_are_derivatives(known):
    """Growth a little beside a point against the column and the step that its coefficient stands for."""
    _, s = known
    found = curve(
        Held.of(s, 3), lambda at: play(np.exp(at[0]), float(np.exp(at[1]))), [(np.log(4e-5), np.log(3000.0))],
        [(-20.0, 0.0, np.inf), (0.0, 20.0, np.inf)], lambda at, growth: 1.0, lambda at: 1e-5, (0.5,), amplitude=False,
    )  # fmt: skip
    at = found.starts[1]
    here = found.tangent(at)
    columns = np.array([shape for ((_, shape),) in here.acts])
    nothing = np.eye(len(columns))[0]
    for i in range(1, len(columns)):
        moved = here.step(nothing + 1e-3 * np.eye(len(columns))[i])
        assert np.flatnonzero(moved).tolist() == [i - 1]
        (((_, above),), *_), (((_, below),), *_) = found.tangent(at + moved).acts, found.tangent(at - moved).acts
        expected = (above - below) / 2e-3
        np.testing.assert_allclose(columns[i], expected, atol=0.02 * np.abs(expected).max())


def test_fitting_again_finds_what_was_put_in(known):
    """Readings of the model with play in one strut, noise as stated: size and misfit are those that were put in."""
    readout, s = known
    (truth,) = clearance_curves(s, 1)
    point = truth.starts[0].copy()
    point[:3] = np.log(6e-5), np.log(800.0), 0.2
    point[3] = held_at(s, 1, 0.3)
    acts = truth.tangent(point).acts
    baseline = readout.baseline
    noise = np.random.default_rng(2).standard_normal(baseline.residual.shape)
    signal = 6e-5 * readout.columns(acts[:1])[:, :, 0]
    made = Readout(replace(baseline, residual=noise + signal))
    found = refit(made, [truth], 1e-6, 4e-4)
    exact = refit(made, [replace(truth, starts=point[None])], 1e-6, 4e-4)
    assert found is not None
    assert exact is not None
    # As good as from the truth itself but for what more starts cost, and the sizes agree within what is stated.
    assert found.log_evidence > exact.log_evidence - np.log(len(truth.starts)) - 6.0
    u = float(np.sqrt(exact.best.covariance[0, 0]))
    assert exact.best.coefficients[0] == pytest.approx(6e-5, abs=4.0 * u)


def held_at(s, strut: int, middle: float) -> float:
    """The strut's misfit that puts its mean tension at so many standard deviations."""
    return Held.of(s, strut).shifts_m((middle,))[1]


def test_a_yielding_strut_is_named(yielding):
    diagnosis = diagnose(yielding)
    assert diagnosis.verdict == "link_stiffness"
    assert diagnosis.effects[0].place == "right_lower"


def test_a_twin_with_a_curve_there_and_back(yielding):
    _, twin = diagnose_and_add(yielding)
    assert twin.added[0].curve is not None
    again = Twin.from_data(PLANAR.read_text(encoding="utf-8"), twin.to_data())
    moments = moments_of(yielding)
    rows = np.arange(0, len(moments), 40)
    assert np.array_equal(again.places_m(moments, rows), twin.places_m(moments, rows))
