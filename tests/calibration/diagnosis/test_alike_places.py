"""An effect at all of its places alike: its evidence by a covariance between them, and when it is told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis import ranking
from calibration.diagnosis.alike_places import CORRELATION, alike_at_all_places
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import rank_effects, smallest_size
from calibration.diagnosis.search import search_causes
from calibration.effects.catalogue import load_catalogue
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import plant, recorded

GROWTH = load_catalogue().effect("link_thermal_growth")
STRUTS = ("left_upper", "left_lower", "right_upper", "right_lower")


def measured(*rises_k: float) -> tuple[MarginalLikelihood, object]:
    """A campaign in which struts grow warm by so much, in order."""
    choices = [EffectChoice("link_thermal_growth", rise, strut) for strut, rise in zip(STRUTS, rises_k, strict=False)]
    likelihood = MarginalLikelihood.of(linearise_recording(recorded(plant(100, *choices)), judge=False))
    return likelihood, inputs_of_recording(likelihood, periodograms(likelihood))


@pytest.fixture(scope="module")
def warm():
    """All struts alike."""
    return measured(2.0, 2.0, 2.0, 2.0)


def test_evidence_is_that_of_correlated_places_and_one_basis_set(warm):
    likelihood, inputs = warm
    (basis_set, *_), low = (GROWTH.basis_sets(inputs, 0).sets, smallest_size(likelihood, GROWTH))
    only = replace(GROWTH, forms=lambda of, place: first_set(GROWTH.forms(of, place)))
    found = alike_at_all_places(likelihood, inputs, only, low)
    at_place = [GROWTH.basis_sets(inputs, place).contributions[basis_set.columns[0]] for place in range(4)]
    columns = likelihood.information_and_score(at_place)

    def log_evidence(covariance) -> float:
        """Mean over the sizes that are tried, with a prior covariance (4, 4) for a size of one."""
        logs = []
        for size in low * (GROWTH.size.high / low) ** np.linspace(0.0, 1.0, 9):
            precision = np.linalg.inv(size**2 * covariance)
            gain = columns.score @ np.linalg.solve(precision + columns.information, columns.score)
            logs.append(0.5 * gain - 0.5 * np.linalg.slogdet(np.eye(4) + size**2 * covariance @ columns.information)[1])
        return float(np.logaddexp.reduce(logs)) - math.log(9)

    ones = np.ones((4, 4))
    spread = log_evidence(CORRELATION * ones + (1.0 - CORRELATION) * np.eye(4))
    common = log_evidence(ones + 1e-9 * np.eye(4))
    assert found.log_evidence == pytest.approx(max(spread, common) - math.log(2.0), abs=1e-4)
    assert [part.place for part in found.parts] == list(STRUTS)


def first_set(built):
    built.sets = [replace(built.sets[0], weight=1.0)]
    return built


def test_what_all_struts_do_is_told_where_no_single_one_shows_it(warm):
    likelihood, inputs = warm
    (cause,) = rank_effects(likelihood, inputs, [GROWTH])
    assert cause.alike
    assert sorted(part.place for part in cause.parts) == sorted(STRUTS)
    alone = [place.log_evidence for place in ranking._evidence_by_place(likelihood, inputs, GROWTH, STRUTS)]
    assert cause.log_evidence > 2.0 * max(alone)
    found = search_causes(likelihood, inputs, load_catalogue().effects)
    assert {part.effect.name for part in found.causes} == {"link_thermal_growth"}
    assert len(found.causes) == 4  # none of them is lost where each is asked for beside the others
    for part in found.causes:
        assert part.best.coefficients[0] == pytest.approx(2.0, abs=4.0 * math.sqrt(part.best.covariance[0, 0]) + 0.5)


def test_no_place_is_lost_that_has_little_beside_the_others():
    likelihood, inputs = measured(0.7, 0.7, 0.7, 0.7)
    found = search_causes(likelihood, inputs, [GROWTH])
    assert sorted(part.place for part in found.causes) == sorted(STRUTS)


def test_one_strut_is_one_strut():
    likelihood, inputs = measured(4.0)
    (cause,) = rank_effects(likelihood, inputs, [GROWTH])
    assert not cause.alike
    assert [part.place for part in cause.parts] == ["left_upper"]


def test_places_without_the_same_basis_sets_are_not_alike(warm):
    likelihood, inputs = warm
    calls = iter(range(9))

    def forms(of, place):
        built = GROWTH.forms(of, place)
        built.sets = built.sets[next(calls) % 2 :]
        return built

    assert alike_at_all_places(likelihood, inputs, replace(GROWTH, forms=forms), 0.1) is None
