"""Disturbances that are stronger than stated, on the mock plant: no effect, and no excuse for one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import levels_and_causes
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.levels_and_causes import SearchAtLevels, SearchOfLevelsAndCauses
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import rank_effects
from calibration.diagnosis.result import NONE
from calibration.diagnosis.search import search_causes
from calibration.effects.catalogue import load_catalogue
from calibration.recording.header import DeclaredLevels
from mock_devices.effects import EffectChoice
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded, simulated

SMALL = {"drift_m": 2e-6, "reseat_m": 1e-6, "reversal_m": 5e-7, "temperature_k": 0.01}
STRONGER = {"drift_m": 1.5e-5, "reseat_m": 8e-6}
LOOKS_LIKE = {"drift_m": "tracker_drift", "reseat_m": "smr_reseat"}


def strong(key: str, **declared: float):
    """A campaign with one strong disturbance, by what it declares."""
    made = recorded(plant(60, nuisance=DisturbanceLevels(**SMALL | {key: STRONGER[key]})))
    return replace(made, file=made.file.model_copy(update={"nuisance": DeclaredLevels(**declared)}))


@pytest.mark.parametrize("key", STRONGER)
def test_a_disturbance_that_is_stronger_than_stated_is_no_effect(key):
    recording = strong(key)
    likelihood = MarginalLikelihood.of(linearise_recording(recording))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    believed = search_causes(likelihood, inputs, load_catalogue().effects)
    assert [cause.effect.name for cause in believed.causes] == [LOOKS_LIKE[key]]  # if the levels were believed
    found = diagnose(recording)
    assert found.verdict == NONE
    (said,) = (remark for remark in found.remarks if remark.startswith("stronger disturbances than stated"))
    assert f"{key} = " in said
    assert f"(the default: {getattr(DeclaredLevels(), key):.2g})" in said


@pytest.mark.parametrize(("times", "seed"), [(2.0, 10), (5.0, 2)])
def test_geometry_beyond_its_tolerances_is_no_effect(times, seed):
    bench = plant(120, seed=seed, nuisance=DisturbanceLevels(**SMALL), error_scale=times)
    found = diagnose(recorded(bench))
    assert found.verdict == NONE
    (said,) = (remark for remark in found.remarks if "tolerances" in remark)
    assert 1.5 <= float(said.partition("most likely ")[2].split()[0]) <= 3.2


@pytest.mark.parametrize(("machine", "times"), [("planar4", 1.5), ("delta8", 1.5), ("gough8", 2.0)])
def test_readings_that_scatter_more_than_stated_are_no_effect(machine, times):
    found = diagnose(simulated(machine, 60, noise=times))
    assert found.verdict == NONE
    (said,) = (remark for remark in found.remarks if "scatter" in remark)
    assert float(said.partition("scatter ")[2].split()[0]) == pytest.approx(times, rel=0.1)


def test_where_noise_explains_everything_no_second_search_is_made(monkeypatch):
    searches = []

    def counted(*arguments):
        searches.append(arguments)
        return search_causes(*arguments)

    monkeypatch.setattr(levels_and_causes, "search_causes", counted)
    assert diagnose(simulated("planar4", 60, noise=1.5)).verdict == NONE
    assert len(searches) == 1


def test_an_effect_is_found_beside_readings_that_scatter_more_than_stated():
    def comes_from_two_sides(arrivals):
        return 6e-5 * np.array([1.0, 0.0]) * arrivals.sides

    found = diagnose(simulated("planar4", 60, comes_from_two_sides, noise=1.3))
    (first,) = found.effects
    assert (first.effect, first.place) == ("backlash", "left")
    (at_channel,) = first.places[0].at_channels
    assert abs(at_channel.value - 6e-5) < at_channel.u
    (said,) = (remark for remark in found.remarks if "scatter" in remark)
    assert float(said.partition("scatter ")[2].split()[0]) == pytest.approx(1.3, rel=0.1)


def test_unknowns_keep_their_units_at_other_levels():
    """Columns over the prior standard deviations are derivatives, whatever these are."""
    linear = linearise_recording(recorded(plant(60)))
    count, scales = len(linear.sigma), np.ones(linear.columns.shape[2])
    scales[:count] = np.linspace(1.0, 3.0, count)
    other = linear.with_levels(linear.levels, scales)
    np.testing.assert_allclose(other.columns[:, :, :count] / other.sigma, linear.columns[:, :, :count] / linear.sigma)
    assert not np.allclose(other.columns[:, :, :count], linear.columns[:, :, :count])


def test_declared_levels_that_are_right_are_not_spoken_of():
    recording = strong("reseat_m", **SMALL | {"reseat_m": STRONGER["reseat_m"]})
    assert not any("disturbances" in remark for remark in diagnose(recording).remarks)


def test_an_effect_is_found_beside_a_disturbance_stronger_than_stated():
    effect = EffectChoice("screw_periodic_error", 4e-5, "right")
    levels = DisturbanceLevels(**SMALL | {"drift_m": STRONGER["drift_m"]})
    made = recorded(plant(60, effect, nuisance=levels))
    found = diagnose(replace(made, file=made.file.model_copy(update={"nuisance": DeclaredLevels()})))
    assert [effect.effect for effect in found.effects] == ["screw_periodic_error"]


def test_what_is_no_larger_than_its_disturbance_may_be_is_searched_for_no_more(monkeypatch):
    """Where no other levels were tried, an effect of that kind explains most, and is too small to be told from them."""
    recording = strong("drift_m")
    likelihood = MarginalLikelihood.of(linearise_recording(recording))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    search = SearchOfLevelsAndCauses(likelihood, inputs, load_catalogue().effects)
    monkeypatch.setattr(levels_and_causes, "WORTH_SEARCHING", np.inf)
    monkeypatch.setattr(levels_and_causes, "TOLD_BY_FORM", -np.inf)  # an effect however little its form says
    kept = search.most_likely()
    assert [cause.effect.name for cause in kept.result.causes] == ["tracker_drift"]
    assert kept.told_by_form.names == ("tracker_drift",)
    assert kept.told_by_form.log_posterior < 20.0
    monkeypatch.undo()
    monkeypatch.setattr(levels_and_causes, "WORTH_SEARCHING", np.inf)
    found = search.most_likely()
    assert found.result.causes == ()
    assert found.told_by_form is None
    assert found.likelihood.linear.recording.file.nuisance.drift_m > 2.0 * DeclaredLevels().drift_m


@pytest.mark.parametrize(("size_m", "kept"), [(4.0e-5, ["backlash"]), (3.0e-6, [])])
def test_what_need_not_be_more_than_disturbances_beside_others_remains_in_the_ranking_if_alone_it_is(size_m, kept):
    effect = EffectChoice("backlash", size_m, "right")
    recording = recorded(plant(60, effect, nuisance=DisturbanceLevels(**SMALL)))
    likelihood = MarginalLikelihood.of(linearise_recording(recording))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    effects = load_catalogue().effects
    search, ranking = SearchOfLevelsAndCauses(likelihood, inputs, effects), rank_effects(likelihood, inputs, effects)
    backlash = [effect for effect in effects if effect.name == "backlash"]
    remaining = search._beyond_alone(ranking, backlash)
    assert [cause.effect.name for cause in remaining] == kept
    without = search_causes(likelihood, inputs, [effect for effect in effects if effect not in backlash])
    names = [cause.effect.name for cause in without.with_ranked(remaining).ranking]
    assert names[: len(kept)] == kept  # in its order
    assert sorted(names) == sorted([*(cause.effect.name for cause in without.ranking), *kept])


def test_an_effect_that_is_searched_for_no_more_is_still_ranked(monkeypatch):
    """Where it is said to be ordinary beside the other causes, and not when it is alone."""
    recording = recorded(plant(60, EffectChoice("backlash", 4.0e-5, "right"), nuisance=DisturbanceLevels(**SMALL)))
    likelihood = MarginalLikelihood.of(linearise_recording(recording))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    effects = load_catalogue().effects
    search = SearchOfLevelsAndCauses(likelihood, inputs, effects)
    dropped = [[effect for effect in effects if effect.name == name] for name in ("backlash", "friction_windup")]
    # Of the causes, of what is dropped alone, and so on.
    answers = [dropped[0], [], dropped[1], [], []]
    monkeypatch.setattr(search, "_no_more_than_disturbances", lambda causes: answers.pop(0))
    monkeypatch.setattr(levels_and_causes, "TOLD_BY_FORM", np.inf)
    found = search.most_likely().result
    assert answers == []
    assert not {"backlash", "friction_windup"} & {cause.effect.name for cause in found.causes}
    names = [cause.effect.name for cause in found.ranking]
    assert {"backlash", "friction_windup"} <= set(names)
    assert names[0] not in ("backlash", "friction_windup")  # at these levels neither is likelier than what was found
    assert found.ranking[names.index("backlash")].log_evidence <= found.ranking[0].log_evidence


def test_what_is_far_beyond_a_disturbance_is_an_effect_where_levels_could_explain_it():
    """One drive of two: their levels would be likely enough, the size is not."""
    nothing_declared = DeclaredLevels()
    for size_m, verdict in ((1.0e-5, NONE), (4.0e-5, "backlash")):
        made = recorded(plant(100, EffectChoice("backlash", size_m, "right"), nuisance=DisturbanceLevels(**SMALL)))
        found = diagnose(replace(made, file=made.file.model_copy(update={"nuisance": nothing_declared})))
        assert found.verdict == verdict


def test_a_level_is_believed_up_to_what_is_likely_of_it_only(monkeypatch):
    """However well a level would explain an effect: beyond twice the 95 % point of its prior it is none."""
    size = EffectChoice("backlash", 4.0e-5, "right")
    made = recorded(plant(100, size, nuisance=DisturbanceLevels(**SMALL)))
    recording = replace(made, file=made.file.model_copy(update={"nuisance": DeclaredLevels()}))
    likelihood = MarginalLikelihood.of(linearise_recording(recording))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    search = SearchOfLevelsAndCauses(likelihood, inputs, load_catalogue().effects)
    of_posterior = levels_and_causes.LevelPosterior.standard_deviations

    def wide(posterior, x):
        return 100.0 * of_posterior(posterior, x)

    monkeypatch.setattr(levels_and_causes.LevelPosterior, "standard_deviations", wide)
    assert [cause.effect.name for cause in search.most_likely().result.causes] == ["backlash"]


@pytest.mark.parametrize(
    ("explained", "excess", "more"),
    [(1000.0, 33.0, 0.0), (1000.0, 40.0, 6.0), (9000.0, 264.0, 0.0), (9000.0, 270.0, 5.0), (0.0, 10.0, 0.0)],
)
def test_of_what_an_alternative_explains_only_what_makes_it_unknown_speaks_for_levels(explained, excess, more):
    """Twelve and 0.022 of what is explained, and as much again of what is beyond 6,500; a cause must be worth eight."""
    result = SimpleNamespace(log_evidence=explained, excess_log_evidence=excess)
    at_levels = SearchAtLevels(None, result, np.zeros(3), log_evidence=-2.0)
    assert at_levels.log_posterior == pytest.approx(-2.0 + max(0.0, explained - 8.0) + more)
