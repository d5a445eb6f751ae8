"""What a search does not begin with once there has been work enough, and that it is said."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import search
from calibration.diagnosis.diagnose import _begins_of, diagnose
from calibration.diagnosis.search_budget import BY_VISIT, SearchBudget
from calibration.effects.departures import VISIT
from tests.calibration.diagnosis.campaigns import Arrivals, simulated
from tests.calibration.diagnosis.hand_made import INPUTS, Evidence

READINGS = len(INPUTS.context)
STEP = READINGS * 201.0  # of one column
GIVEN = {
    "none": {"refraction": 1000.0, "latency": 900.0, "payload": 850.0},
    "none+refraction": {"tracker_drift": 100.0},
    "none+latency": {"smr_reseat": 300.0},
    "none+payload": {"smr_reseat": 400.0},
    "by visit": {"backlash": 1300.0},
}


class NumbersForVisits(Evidence):
    """A cause with a number for each of 400 visits."""

    @property
    def contributions(self):
        return super().contributions * 400


@pytest.fixture
def thorough_rankings() -> list[bool]:
    """Of each ranking that a search has asked for, whether it was a thorough one."""
    return []


@pytest.fixture
def search_with(monkeypatch, thorough_rankings):
    """A search in which the effects and alternatives have the given evidence."""

    def ranked(likelihood, *_, by_visit=False, explained=0.0, thorough=False):
        thorough_rankings.append(thorough)
        differing = by_visit and likelihood == "none"
        kind = NumbersForVisits if differing else Evidence
        found = GIVEN.get("by visit" if differing else likelihood, {})
        return sorted((kind(name, log, "") for name, log in found.items()), key=lambda c: -c.log_evidence)

    monkeypatch.setattr(search, "rank_effects", ranked)
    monkeypatch.setattr(search, "include_cause", lambda likelihood, cause: f"{likelihood}+{cause.name}")
    monkeypatch.setattr(search, "_refit_causes", lambda _, __, causes: (causes, ["refitted"]))
    monkeypatch.setattr(search, "rank_non_parametric", lambda *_: [Evidence("", 400.0)])
    monkeypatch.setattr(search, "differs_by_visit", lambda cause: cause.name == "backlash")
    monkeypatch.setattr(search, "acting_elsewhere", lambda *_: set())
    return lambda budget: search.search_causes("none", INPUTS, [], budget)


def names(result) -> list[str]:
    return [cause.name for cause in result.causes]


def test_with_work_left_every_search_is_made(search_with):
    budget = SearchBudget(limit=1e9)
    assert names(search_with(budget)) == ["backlash"]
    assert budget.left_out == {}
    assert budget.spent == 6 * STEP + READINGS * 600.0  # two causes with each of three leaders; that by visit


@pytest.mark.parametrize(("limit", "thorough"), [(1e9, False), (np.inf, True)])
def test_a_thorough_search_leaves_nothing_out_to_save_time(
    search_with, thorough_rankings, monkeypatch, limit, thorough
):
    """It refines all effects, and begins with a fourth one too."""
    monkeypatch.setitem(GIVEN, "none", {**GIVEN["none"], "expansion_coefficient": 800.0})
    monkeypatch.setitem(GIVEN, "none+expansion_coefficient", {"smr_reseat": 600.0})
    monkeypatch.setitem(GIVEN, "by visit", {})
    found = search_with(SearchBudget(limit=limit))
    assert names(found) == (["expansion_coefficient", "smr_reseat"] if thorough else ["payload", "smr_reseat"])
    assert found.not_begun_with == (() if thorough else ("expansion_coefficient",))
    assert set(thorough_rankings) == {thorough}


@pytest.mark.parametrize(
    ("steps", "causes", "left_out"),
    [
        (5.9, ["refraction", "tracker_drift"], ["latency", "payload", BY_VISIT]),  # the first search is made
        (6.1, ["latency", "smr_reseat"], ["payload", BY_VISIT]),  # two steps more are two thirds of it
        (7.9, ["latency", "smr_reseat"], ["payload", BY_VISIT]),
        (8.9, ["latency", "smr_reseat"], ["payload", BY_VISIT]),
        (9.1, ["payload", "smr_reseat"], [BY_VISIT]),
        (11.9, ["payload", "smr_reseat"], [BY_VISIT]),
        (12.0, ["backlash"], []),  # two steps of 400 numbers
    ],
)
def test_no_further_search_begins_that_would_be_too_much_work(search_with, steps, causes, left_out):
    budget = SearchBudget(limit=steps * STEP)
    assert names(search_with(budget)) == causes
    assert list(budget.left_out) == left_out


@pytest.mark.parametrize(("log_evidence", "begins"), [(1484.0, False), (1485.0, True)])
def test_what_differs_by_visit_and_explains_more_than_all_with_any_function_is_searched_for(
    search_with, monkeypatch, log_evidence, begins
):
    """Two causes explain 1,100 less 10 and 5 per mille, and a function beside them 400."""
    monkeypatch.setitem(GIVEN, "by visit", {"backlash": log_evidence})
    budget = SearchBudget(limit=STEP)
    found = search_with(budget)
    assert (names(found) == ["backlash"]) is begins
    assert (BY_VISIT in budget.left_out) is not begins


def test_what_found_something_before_is_searched_for_again_in_any_case(search_with):
    budget = SearchBudget(found={"payload", "smr_reseat"}, limit=STEP)
    assert names(search_with(budget)) == ["payload", "smr_reseat"]
    assert list(budget.left_out) == ["latency", BY_VISIT]


def test_a_search_with_other_weights_of_readings_begins_with_what_was_found():
    def cause(name: str, *coordinates: str) -> SimpleNamespace:
        return SimpleNamespace(effect=SimpleNamespace(name=name), differs_with=coordinates)

    assert _begins_of([cause("backlash", "time"), cause("payload")]) == {"backlash", "payload"}
    assert _begins_of([cause("backlash"), cause("joint_clearance", VISIT)]) == {"backlash", "joint_clearance", BY_VISIT}


def test_what_differs_by_visit_is_not_searched_for_again_where_it_was_in_vain(search_with, monkeypatch):
    budget = SearchBudget(limit=1e9)
    monkeypatch.setattr(search, "acting_elsewhere", lambda *_: {"backlash"})  # it may as well act elsewhere
    assert names(search_with(budget)) == ["payload", "smr_reseat"]
    spent = budget.spent
    assert names(search_with(budget)) == ["payload", "smr_reseat"]
    assert budget.spent - spent == 6 * STEP
    assert budget.left_out == {}  # it was made, in vain


def test_a_step_of_more_columns_and_more_readings_is_more_work():
    assert SearchBudget.work(200, 610) / SearchBudget.work(100, 10) == pytest.approx(2 * 810 / 210)


@pytest.mark.parametrize(("readings", "room"), [(720, False), (800, True)])
def test_numbers_for_the_visits_of_another_cause_leave_most_coordinates_to_be_explained(monkeypatch, readings, room):
    """Of 400 visits, each of the causes has a number for each."""

    class Context(SimpleNamespace):
        def __len__(self):
            return readings

    inputs = SimpleNamespace(context=Context(arrival=np.arange(readings) % 400))
    part = SimpleNamespace(contributions=(None,) * 400, best=None)
    monkeypatch.setattr(search, "differs_by_visit", lambda _: True)
    assert search._has_room_for_visits(inputs, [SimpleNamespace(parts=(part,))]) is room
    monkeypatch.setattr(search, "differs_by_visit", lambda _: False)
    assert search._has_room_for_visits(inputs, [SimpleNamespace(parts=(part,))])


def test_a_diagnosis_says_what_it_left_out_and_leaves_nothing_out_where_it_may_take_any_work():
    """Play of one drive, and a scale error of the other."""

    def two_effects(arrivals: Arrivals) -> np.ndarray:
        off = -2.0e-5 * arrivals.sides
        off[:, 1] = 3.0e-5 * np.sin(7.0 * arrivals.drives[:, 1])
        return off

    recording = simulated("planar4", 80, two_effects)
    of_little, of_any = (diagnose(recording, work=work) for work in (1.0, np.inf))
    assert "no search began with" in " ".join(of_little.remarks)
    assert "no search began with" not in " ".join(of_any.remarks)


@pytest.mark.parametrize(("spent", "room"), [(0.0, True), (0.5, True), (0.6, False)])
def test_weak_effects_begin_searches_within_a_third_of_the_bound(spent, room):
    budget = SearchBudget(limit=3.0)
    budget.spent = spent
    assert budget.has_room_for_weak(0.5) is room
    assert budget.left_out == {}
