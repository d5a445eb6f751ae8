"""What a part does to a machine that is held more than it must be, where nobody knows how stiff its other parts are."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import alike_places
from calibration.diagnosis.alike_places import CORRELATIONS, alike_at_all_places
from calibration.diagnosis.departure_evidence import stiffnesses_left_open
from calibration.diagnosis.diagnose import diagnose, diagnose_and_add
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_folder import linearise_measurements
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.place_evidence import evidence_by_place, refine, smallest_size
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.api import BasisSets
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from calibration.effects.departures import STIFFNESS, through_stiffened
from calibration.machine.description import shipped_machine
from tests.calibration.diagnosis.campaigns import Arrivals, plant, recorded, simulated
from tests.calibration.diagnosis.dense import dense, flat, log_density
from tests.calibration.diagnosis.measured import Wanted, made

PLAY_M = 6.0e-5


def play_of_first(arrivals: Arrivals) -> np.ndarray:
    """The first drive has a play, and no other."""
    return -0.5 * PLAY_M * arrivals.sides * (np.arange(arrivals.sides.shape[1]) == 0)


@pytest.mark.parametrize(("machine", "seed"), [("delta8", 10), ("gough8", 10)])
def test_play_of_one_drive_is_the_only_cause(machine, seed):
    """Stiffnesses within 30 %: taken as they are stated, another drive's play by the place was a second cause."""
    diagnosis = diagnose(simulated(machine, 100, play_of_first, seed=seed))
    (found,) = diagnosis.effects
    assert (diagnosis.verdict, found.effect) == ("backlash", "backlash")
    assert found.place == simulated(machine, 8).machine.drive_names[0]
    assert abs(found.size.value - PLAY_M) < 2.0 * 2.0 * found.size.u
    # It is the machine that yields otherwise, not the play that departs from its form.
    assert found.differs_with == ()
    assert not any("form is not exact" in remark for remark in diagnosis.remarks)
    assert [quantity.name for place in found.places for quantity in place.at_channels] == [f"travel.{found.place}"]


def gains(recording) -> tuple[float, float]:
    """Log evidence of the first drive's play: as the readings were linearised, and with the stiffnesses left open."""
    likelihood = MarginalLikelihood.of(linearise_recording(recording, judge=False))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    effect = load_catalogue().effect("backlash")
    exact = evidence_by_place(likelihood, inputs, effect, effect.places(recording.machine)[:1])
    (with_departures,) = refine(likelihood, inputs, effect, exact, by_visit=False)
    return exact[0].log_evidence, with_departures.log_evidence


@pytest.mark.parametrize("machine", ["delta8", "gough8"])
def test_it_explains_more_with_stiffnesses_left_open(machine):
    exact, left_open = gains(simulated(machine, 100, play_of_first, seed=10))
    assert left_open > exact + 20.0


def test_where_stiffness_matters_little_it_costs_little():
    exact, left_open = gains(simulated("planar4", 100, play_of_first, seed=10))
    assert exact - 3.0 < left_open < exact + 6.0


def u_of_dense(linear) -> np.ndarray:
    """Of every unknown, by the inverse of the whole information."""
    a = linear.columns.reshape(-1, linear.columns.shape[2])
    return np.sqrt(np.diag(np.linalg.inv(np.eye(a.shape[1]) + a.T @ a)))[: len(linear.names)]


@pytest.mark.parametrize("payload", [True, False])
def test_what_is_left_of_a_stiffness_is_that_of_the_dense_posterior(payload):
    recording = recorded(plant(60)) if payload else simulated("prs3", 40)
    linear = linearise_recording(recording, judge=False)
    parts = (*linear.machine.strut_names, *linear.machine.guide_names)
    assert list(linear.u_of_ln_stiffness) == list(range(len(parts)))
    dense = u_of_dense(linear)
    for c, u in linear.u_of_ln_stiffness.items():
        number = linear.names.index(f"ln_stiffness.{parts[c]}")
        assert u == pytest.approx(dense[number] * linear.sigma[number], rel=1e-4)
        assert (u < 0.12) is payload  # two hundred kilograms tell it, its own weight hardly does


def test_in_a_folder_too():
    linear = linearise_measurements(made(Wanted("delta8", ("x_m", "y_m", "z_m"), visits=40)))
    stiffness = [name for name in linear.names if name.startswith("ln_stiffness.")]
    assert len(linear.u_of_ln_stiffness) == len(stiffness)
    for c, u in linear.u_of_ln_stiffness.items():
        assert 0.0 < u <= linear.sigma[linear.names.index(f"ln_stiffness.{linear.machine.strut_names[c]}")] + 1e-12


def test_a_twin_yields_alike_and_is_kept_as_plain_data():
    recording = simulated("delta8", 100, play_of_first, seed=10)
    _, twin = diagnose_and_add(recording)
    assert any(departure.coordinate == STIFFNESS for effect in twin.added for departure in effect.departures)
    text = shipped_machine("delta8").read_text(encoding="utf-8")
    again = Twin.from_data(text, json.loads(json.dumps(twin.to_data(), allow_nan=False)))
    context = context_of_recording(recording)
    assert np.array_equal(again.places_m(context), twin.places_m(context))
    assert again.to_data() == twin.to_data()


@pytest.mark.parametrize("common", [False, True])
def test_stiffnesses_left_open_gain_what_a_dense_covariance_says(common):
    """Play of the four drives of delta8, all alike or each its own; one amount of each stiffness for all of them."""
    likelihood = MarginalLikelihood.of(linearise_recording(simulated("delta8", 24, seed=3), judge=False))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    play = load_catalogue().effect("backlash")
    effect = replace(play, forms=lambda of, place: only_first(play.forms(of, place)))
    places = len(play.places(inputs.machine))
    own = [effect.basis_sets(inputs, place).contributions[0] for place in range(places)]
    columns, left_open = likelihood.columns(own), likelihood.linear.u_of_ln_stiffness
    of_each = [likelihood.columns([through_stiffened(inputs, c, one) for one in own]) for c in left_open]
    assert len(of_each) == 8
    plays_m = np.full(places, 1.5e-4) if common else np.linspace(-1.0e-4, 2.0e-4, places)
    softer = np.random.default_rng(4).normal(size=8) * 0.4
    shift = columns @ plays_m + sum(h * (one @ plays_m) for h, one in zip(softer, of_each, strict=True))
    moved = likelihood.on(replace(likelihood.linear, residual=likelihood.linear.residual + shift))
    low = smallest_size(moved, effect)
    found = alike_at_all_places(moved, inputs, effect, low, [np.zeros(1)] * places)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(alike_places, "stiffnesses_left_open", lambda _: {})
        exact = alike_at_all_places(moved, inputs, effect, low, [np.zeros(1)] * places)
    # What the exact coefficients make of each stiffness, over the size at which these were found.
    coefficients = np.array([part.best.coefficients[0] for part in exact.parts])
    of_stiffness = np.stack([(one @ coefficients).ravel() for one in of_each], axis=1) * list(left_open.values())
    of_stiffness /= exact.parts[0].best.size
    y, every, h = moved.linear.residual.ravel(), dense(moved.linear), flat(columns)

    def gain(correlation: float) -> float:
        of_places = h @ (correlation + (1.0 - correlation) * np.eye(places)) @ h.T
        with_all = of_places + of_stiffness @ of_stiffness.T
        sizes = low * (effect.size.high / low) ** np.linspace(0.0, 1.0, 9)
        logs = [[log_density(y, every + size**2 * one) for one in (of_places, with_all)] for size in sizes]
        return float(np.subtract(*np.logaddexp.reduce(logs, axis=0)[::-1]))

    gained = found.log_evidence - exact.log_evidence
    assert gained > 5.0
    # But for directions that the priors alone determine, which the projection omits.
    assert min(abs(gained - gain(correlation)) for correlation in CORRELATIONS) < 0.3
    # Each place has its own column and its part of each stiffness's, in proportion.
    assert all(len(part.contributions) == len(part.best.coefficients) == 9 for part in found.parts)
    amounts = [
        part.best.coefficients[1:] / coefficient for part, coefficient in zip(found.parts, coefficients, strict=True)
    ]
    np.testing.assert_allclose(amounts, [amounts[0]] * places, rtol=1e-9)
    predicted = sum(likelihood.columns(part.contributions) @ part.best.coefficients for part in found.parts)
    left = [
        np.sum(likelihood.linear.after_calibration(shift - one) ** 2) for one in (predicted, columns @ coefficients)
    ]
    assert left[0] < 0.5 * left[1]


def only_first(built: BasisSets) -> BasisSets:
    """The first basis set, whose sign nobody knows."""
    built.sets = [replace(built.sets[0], weight=1.0, sign=0.0)]
    return built


def test_what_is_known_within_one_percent_changes_no_response():
    linear = SimpleNamespace(u_of_ln_stiffness={0: 0.009, 1: 0.011, 2: 0.17})
    assert stiffnesses_left_open(SimpleNamespace(linear=linear)) == {1: 0.011, 2: 0.17}
