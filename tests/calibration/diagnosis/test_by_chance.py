"""What lies elsewhere at each visit: told from what is the same each time, and from what is no chance."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import anew_at_visits, departure_evidence
from calibration.diagnosis.basis_set_evidence import evidence_of_basis_sets
from calibration.diagnosis.effect_inputs import inputs_of_readings, inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import include_cause, rank_effects, refit_cause
from calibration.diagnosis.search import search_causes
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import BasisSet, Departure
from calibration.effects.catalogue import load_catalogue
from calibration.effects.departures import VISIT
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.diagnosis.dense import HIGH, LOW, explicit, with_forms_at
from tests.calibration.effects.general_functions import typical_inputs

SMALL = DisturbanceLevels(drift_m=2e-6, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.01)


@pytest.fixture(scope="module")
def quiet():
    return MarginalLikelihood.of(linearise_recording(recorded(plant(100, nuisance=SMALL))))


@pytest.fixture(scope="module")
def inputs():
    return typical_inputs(160)


@pytest.mark.parametrize(
    ("channel", "effect", "place", "most"),
    [("length.left_upper", "joint_clearance", "left_upper", 4e-5), ("turn.right.z", "guide_angular", "right", 2e-4)],
)
def test_what_lies_anywhere_in_its_play_is_found_where_it_is(quiet, channel, effect, place, most):
    visits = quiet.linear.context.arrival
    lies = np.random.default_rng(3).uniform(-most, most, int(visits.max()) + 1)[visits]
    shift = quiet.columns([((channel, lies),)])[:, :, 0]
    planted = quiet.on(replace(quiet.linear, residual=quiet.linear.residual + shift))
    found = search_causes(planted, inputs_of_recording(planted, periodograms(planted)), load_catalogue().effects)
    assert [(cause.effect.name, cause.place, cause.differs_with) for cause in found.causes] == [
        (effect, place, (VISIT,))
    ]
    assert found.excess_log_evidence < 0.02 * found.log_evidence


@pytest.mark.parametrize(("least", "differs"), [(VERDICT.least_gain_of_channel, False), (-math.inf, True)])
def test_what_another_channel_explains_as_well_is_not_in_its_play(quiet, monkeypatch, least, differs):
    """A hose that pulls the platform otherwise at each visit: numbers for the visits explain it anywhere."""
    visits = quiet.linear.context.arrival
    pulls = np.random.default_rng(3).uniform(-1.0, 1.0, int(visits.max()) + 1)[visits]
    shift = quiet.columns([(("force.x", pulls),)])[:, :, 0]
    shift *= 4.0 / np.sqrt(np.mean(shift**2))
    planted = quiet.on(replace(quiet.linear, residual=quiet.linear.residual + shift))
    monkeypatch.setattr(anew_at_visits, "VERDICT", replace(VERDICT, least_gain_of_channel=least))
    found = search_causes(planted, inputs_of_recording(planted, periodograms(planted)), load_catalogue().effects)
    assert any(VISIT in cause.differs_with for cause in found.causes) is differs


@pytest.mark.parametrize(("play_m", "sided_m"), [(4e-5, 1e-5), (4e-5, 3e-5)])
def test_beside_another_effect_it_keeps_its_numbers_and_its_place(quiet, play_m, sided_m):
    """Play of a drive, alone a weaker or a stronger one than that of the pin."""
    context = quiet.linear.context
    lies = np.random.default_rng(3).uniform(-play_m, play_m, int(context.arrival.max()) + 1)[context.arrival]
    columns = [(("length.left_upper", lies), ("travel.right", -sided_m * context.direction[:, 1]))]
    planted = quiet.on(replace(quiet.linear, residual=quiet.linear.residual + quiet.columns(columns)[:, :, 0]))
    found = search_causes(planted, inputs_of_recording(planted, periodograms(planted)), load_catalogue().effects)
    named = {(cause.effect.name, cause.place): cause for cause in found.causes}
    assert {("joint_clearance", "left_upper"), ("backlash", "right")} <= set(named)
    assert VISIT in named["joint_clearance", "left_upper"].differs_with
    assert named["joint_clearance", "left_upper"].log_evidence > 100.0


def planted_pin(quiet, place, play_m, seed, *others):
    visits = quiet.linear.context.arrival
    lies = np.random.default_rng(seed).uniform(-play_m, play_m, int(visits.max()) + 1)[visits]
    shift = quiet.columns([((f"length.{place}", lies), *others)])[:, :, 0]
    planted = quiet.on(replace(quiet.linear, residual=quiet.linear.residual + shift))
    return planted, inputs_of_recording(planted, periodograms(planted))


def test_fitted_again_it_keeps_its_numbers(quiet):
    """Of a weak one the basis sets by themselves say nothing."""
    planted, inputs = planted_pin(quiet, "right_upper", 1.5e-5, 8)
    (found,) = rank_effects(planted, inputs, [load_catalogue().effect("joint_clearance")], by_visit=True)
    again = refit_cause(planted, inputs, found, ())
    assert (found.differs_with, again.differs_with) == ((VISIT,), (VISIT,))
    assert again.log_evidence > 50.0


def test_what_other_causes_do_elsewhere_does_not_speak_against_it(quiet):
    """Play of a drive that is stronger than that of the pin."""
    sided = -3e-5 * quiet.linear.context.direction[:, 1]
    planted, inputs = planted_pin(quiet, "left_upper", 2e-5, 3, ("travel.right", sided))
    effects = [load_catalogue().effect(name) for name in ("backlash", "joint_clearance")]
    (play,) = rank_effects(planted, inputs, effects[:1])
    (pin,) = rank_effects(include_cause(planted, play), inputs, effects[1:], by_visit=True)
    assert VISIT in pin.differs_with
    ranking = rank_effects(planted, inputs, effects, by_visit=True)
    assert anew_at_visits.acting_elsewhere(planted, inputs, (play, pin), ranking) == set()


def test_it_is_looked_for_at_places_where_nothing_speaks_for_it(quiet):
    """Beside a pin of another joint that lies where its load has it, of which the form alone says much."""
    inputs, linear = inputs_of_recording(quiet, periodograms(quiet)), quiet.linear
    visits, tension_n = linear.context.arrival, inputs.tension_n[:, 3]
    lies = np.random.default_rng(3).uniform(-4e-5, 4e-5, int(visits.max()) + 1)[visits]
    pressed = 4e-5 * np.tanh((tension_n - tension_n.mean()) / 300.0)
    names = load_catalogue().effect("joint_clearance").places(inputs.machine)
    shift = quiet.columns([((f"length.{names[0]}", lies), (f"length.{names[3]}", pressed))])[:, :, 0]
    planted = quiet.on(replace(linear, residual=linear.residual + shift))
    effects = [load_catalogue().effect("joint_clearance")]
    (same_each_time,) = rank_effects(planted, inputs, effects)
    assert same_each_time.place == names[3]
    (cause,) = rank_effects(planted, inputs, effects, by_visit=True)
    assert (cause.place, cause.differs_with) == (names[0], (VISIT,))


def by_time(context, visit_rows):
    return np.sin(4.0 * context.elapsed_s[visit_rows] / np.ptp(context.t_s))


def by_place(context, visit_rows):
    return np.sin(5.0 * context.drives[visit_rows, 1])


def by_chance(_, visit_rows):
    return np.random.default_rng(1).normal(size=len(visit_rows))


@pytest.mark.parametrize(("law", "expected"), [(by_time, False), (by_place, False), (by_chance, True)])
@pytest.mark.parametrize("columns", [1, 3])
def test_what_follows_from_when_or_where_is_no_chance(inputs, law, expected, columns):
    """Of several columns none may."""
    visits, rows = np.unique(inputs.context.arrival, return_index=True)
    coefficients = np.random.default_rng(2).normal(size=(columns, len(visits)))
    coefficients[-1] = law(inputs.context, rows)
    departures = [Departure(column, VISIT, int(visit)) for column in range(columns) for visit in visits]
    entry = SimpleNamespace(coefficients=np.concatenate([np.ones(columns), coefficients.ravel()]))
    assert departure_evidence._is_by_chance(entry, departures, inputs) is expected


@pytest.mark.parametrize(("visits", "expected"), [(29, False), (30, True)])
def test_of_few_visits_nothing_is_by_chance(visits, expected):
    """The correlation of neighbours could not be large enough to be none."""
    few = SimpleNamespace(context=SimpleNamespace(arrival=np.arange(visits), t_s=np.arange(visits) * 9.0))
    few.context.drives = np.random.default_rng(1).normal(size=(visits, 2))
    entry = SimpleNamespace(coefficients=np.r_[1.0, np.random.default_rng(2).normal(size=visits)])
    departures = [Departure(0, VISIT, visit) for visit in range(visits)]
    assert departure_evidence._is_by_chance(entry, departures, few) is expected


def test_what_is_anew_at_each_visit_follows_no_coordinate(small, likelihood):
    """It is anything at each visit already: with the load alone it would be any function of that at a calibrated
    zero."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), differs_by_visit=True, varies_with=("payload",))
    form = (("travel.left", np.ones(len(small.context))),)
    shift = 8.0e-5 * explicit(small, likelihood, [(("travel.left", small.context.payload_kg / 200.0),)])[:, 0]
    planted = likelihood.on(replace(small, residual=small.residual + shift.reshape(-1, 3)))
    (exact,) = evidence_of_basis_sets(planted.information_and_score([form]), [BasisSet((0,), (1.0,))], LOW, HIGH)
    kinds = {}
    for anew in (False, True):
        found = departure_evidence.with_departures(
            planted, inputs, effect, 0, exact, [form], LOW, by_visit=True, anew=anew
        )
        kinds[anew] = {departure.coordinate for departure in found.best.basis_set.departures}
    assert "payload" in kinds[False]
    assert kinds[True] <= {VISIT}


@pytest.mark.parametrize(("place", "expected"), [("drive", set()), ("smr", {VISIT})])
def test_whatever_moves_a_reflector_is_its_seat(small, likelihood, place, expected):
    """Nothing else acts there, so that it may creep; at a drive something else may creep."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect, arrival = replace(with_forms_at(0), place=place, differs_by_visit=True), small.context.arrival
    form, creeps = (("travel.left", np.ones(len(arrival))),), np.sin(6.0 * arrival / arrival.max())
    shift = 8.0e-5 * explicit(small, likelihood, [(("travel.left", creeps),)])[:, 0]
    planted = likelihood.on(replace(small, residual=small.residual + shift.reshape(-1, 3)))
    (exact,) = evidence_of_basis_sets(planted.information_and_score([form]), [BasisSet((0,), (1.0,))], LOW, HIGH)
    found = departure_evidence.with_departures(planted, inputs, effect, 0, exact, [form], LOW, by_visit=True, anew=True)
    assert {departure.coordinate for departure in found.best.basis_set.departures} == expected
