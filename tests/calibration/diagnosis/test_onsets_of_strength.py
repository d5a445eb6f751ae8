"""The moments at which the strength of a column changes: found, replayed, and refused where a file holds others."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.cause_size import size_of
from calibration.diagnosis.diagnose import diagnose_and_add
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms, strongest_onsets_of_strength
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.parameter_uncertainty import _refine
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import rank_effects
from calibration.diagnosis.twin.answers import RecordedAnswers
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.basis_sets import BasisSet
from calibration.effects.catalogue import load_catalogue
from calibration.recording.recording import Recording
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import plant, recorded, simulated

BEGIN_S = 2400.0


@pytest.fixture(scope="module")
def likelihood() -> MarginalLikelihood:
    return MarginalLikelihood.of(linearise_recording(simulated("planar4", 40)))


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_moments_are_those_of_least_squares(likelihood, unit):
    """A column through two channels, of which half is left after the fifteenth arrival; against every other moment."""
    context, rng = likelihood.linear.context, np.random.default_rng(7)
    names = ("travel.left", "sideways.left.x")
    column = tuple((name, unit * rng.standard_normal(len(context))) for name in names)
    shifts = sum(likelihood.response(name) * shape[:, None] for name, shape in column)
    scale = float(np.sqrt(np.mean(shifts**2)))
    after = context.t_s > context.history.arrived_s[15] + 1e-6
    read = shifts / scale * np.where(after, 0.5, 1.0)[:, None] + 0.2 * rng.standard_normal(shifts.shape)
    observed = SimpleNamespace(linear=likelihood.linear, response=likelihood.response, weighted_residual=read)
    found = strongest_onsets_of_strength(observed, column)

    def left(at_s: float) -> float:
        of_step = shifts * (context.elapsed_s >= at_s)[:, None]
        columns = np.stack([shifts.ravel(), of_step.ravel()], axis=1) / scale
        return float(np.sum((read.ravel() - columns @ np.linalg.lstsq(columns, read.ravel(), rcond=None)[0]) ** 2))

    in_time = np.argsort(context.t_s, kind="stable")
    t, arrivals = context.elapsed_s[in_time], context.arrival[in_time]
    middles = (0.5 * (t[1:] + t[:-1]))[np.diff(arrivals) != 0]
    assert len(found) == 3
    first = found[0][0]
    assert np.all(after == (context.elapsed_s >= first))
    assert left(first) == pytest.approx(min(left(at) for at in middles))
    assert len({prior for _, prior in found}) == 1
    assert 0.0 < found[0][1] <= 1.0 / (len(context.history.arrived_s) - 1)


def with_play_of(before_m: float, after_m: float) -> Recording:
    """Play of one drive until BEGIN_S, and from then on."""
    first, then = (
        recorded(plant(120, *([EffectChoice("backlash", width_m, "left")] if width_m > 0.0 else [])))
        for width_m in (before_m, after_m)
    )
    late = then["t_rig_s"] - then["t_rig_s"].min() >= BEGIN_S
    mixed = {name: np.where(late, then[name], first[name]) for name in ("x_m", "y_m", "z_m")}
    return replace(then, columns={**then.columns, **mixed})


@pytest.fixture(scope="module")
def loose() -> Recording:
    return with_play_of(0.0, 3.0e-5)


@pytest.mark.parametrize(("before_m", "after_m"), [(0.0, 3.0e-5), (3.0e-5, 0.0), (6.0e-5, 4.0e-5)])
def test_the_size_is_that_of_the_spell_with_more_of_it(before_m, after_m):
    found = MarginalLikelihood.of(linearise_recording(with_play_of(before_m, after_m)))
    inputs = inputs_of_recording(found, periodograms(found))
    (cause,) = rank_effects(found, inputs, [load_catalogue().effect("backlash")])
    assert "onset_s" in cause.best.basis_set.parameters
    size_m, u_m = size_of(cause)
    assert size_m == pytest.approx(max(before_m, after_m), abs=4.0 * u_m + 0.05 * max(before_m, after_m))
    assert u_m < 3.0e-6


@pytest.mark.parametrize(
    ("weights", "coefficients", "expected"),
    [((), (2.0, -3.0), (-3.0, 0.4)), ((-1.0,), (0.0, 10.0), (-10.0, 0.4)), ((-1.0,), (9.0, 1.0), (-9.0, 0.3))],
)
def test_weights_of_a_size_are_those_of_its_spell(weights, coefficients, expected):
    basis_set = BasisSet((0, 1), (1.0, 1.0), size=weights, spells=2)
    best = SimpleNamespace(basis_set=basis_set, coefficients=np.array(coefficients), covariance=np.diag([0.09, 0.16]))
    assert size_of(SimpleNamespace(best=best, differs_with=())) == pytest.approx(expected)


def test_what_comes_loose_at_a_moment_is_told_with_the_moment(loose):
    """By two columns, not by a walk in time."""
    found = MarginalLikelihood.of(linearise_recording(loose))
    inputs = inputs_of_recording(found, periodograms(found))
    backlash = load_catalogue().effect("backlash")
    (cause,) = rank_effects(found, inputs, [backlash])
    assert cause.place == "left"
    assert len(cause.best.basis_set.columns) == 2
    assert cause.best.basis_set.parameters["onset_s"] == pytest.approx(BEGIN_S, abs=60.0)


def test_the_moment_is_stated_and_the_twin_has_it(loose):
    diagnosis, twin = diagnose_and_add(loose)
    assert diagnosis.verdict == "backlash"
    (onset_s,) = (one for one in diagnosis.effects[0].others if one.name == "onset_s")
    assert abs(onset_s.value - BEGIN_S) < 2.0 * onset_s.u + 60.0
    assert 1.0 < onset_s.u < 300.0
    again = Twin.from_data(twin.machine.text, json.loads(json.dumps(twin.to_data())))
    context = twin.campaign.context
    rows = np.arange(0, len(context), 5)
    np.testing.assert_allclose(again.places_m(context, rows), twin.places_m(context, rows), atol=1e-12)
    none = replace(twin, added=())
    moved = np.linalg.norm(twin.places_m(context, rows) - none.places_m(context, rows), axis=1)
    late = context.elapsed_s[rows] > BEGIN_S + 60.0
    early = context.elapsed_s[rows] < BEGIN_S - 60.0
    assert np.sqrt(np.mean(moved[late] ** 2)) > 4.0 * np.sqrt(np.mean(moved[early] ** 2))


def test_the_uncertainty_of_a_moment_comes_from_the_arrivals_around_it(likelihood):
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    column = (("travel.left", np.ones(len(inputs.context))),)
    (reported, prior), *others = inputs.strength_onsets("any", column)
    fine = dict(_refine(inputs, reported).strength_onsets("any", column))
    arrived_s = np.unique(inputs.context.history.arrived_s) - inputs.context.start_s
    between = 0.5 * (arrived_s[1:] + arrived_s[:-1])
    near = between[np.argsort(np.abs(between - reported))[:17]]
    assert set(near.tolist()) <= set(fine)
    assert sum(fine[at] for at in near.tolist()) == pytest.approx(prior)
    assert all(fine[at] == p for at, p in others if not near.min() <= at <= near.max())


def test_answers_are_replayed_by_name(likelihood):
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    columns = {name: ((name, np.ones(len(inputs.context))),) for name in ("travel.left", "travel.right")}

    def ask(of):
        return [[value for value, _ in of.strength_onsets(name, column)] for name, column in columns.items()]

    recording = RecordedAnswers.record(inputs, ask)
    assert len({tuple(answer) for answer in ask(inputs)}) == 2
    assert ask(recording.replay(inputs)) == ask(inputs)
    assert list(recording.replay(inputs).strength_onsets("other", ())) == []
