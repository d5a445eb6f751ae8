"""What a part does to a machine that is held more than it must be, where nobody knows how stiff its other parts are."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose, diagnose_and_add
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_folder import linearise_measurements
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.place_evidence import evidence_by_place, refine
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from calibration.effects.departures import STIFFNESS
from calibration.machine.description import shipped_machine
from tests.calibration.diagnosis.campaigns import Arrivals, plant, recorded, simulated
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
