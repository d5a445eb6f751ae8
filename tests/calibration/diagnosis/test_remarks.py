"""What a diagnosis remarks, on hand-made evidence just below and just above each threshold.

The numbers are those of docs/explanation/diagnosis-method.md, written out: the tests do not ask the settings for them.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis.findings.remarks import _as_many_as_are_looked_for, _cut_for_time, _of_verdict, remarks
from calibration.diagnosis.levels_and_causes import LevelsAndCauses, ToldByForm
from calibration.diagnosis.result import NONE, UNKNOWN, GapFigures
from calibration.diagnosis.search_budget import BY_VISIT
from calibration.recording.header import DisturbanceLevels
from tests.calibration.diagnosis.hand_made import CATALOGUE, Evidence, found

GAP = GapFigures(219.4e-6, 424.5e-6, 13.0e-6, -0.89, (-1.2, -0.6), "four passes")


def found_beside(departure_gain: float, *, excess: float = 0.0, differs_with=("rest", "side.left")) -> SimpleNamespace:
    """Two causes, of which the second departs, and an alternative of evidence 12 beside them."""
    result = found(Evidence("latency", 300.0, place=""), explained=400.0, excess=excess, departure_gain=departure_gain)
    result.non_parametric = (SimpleNamespace(channel="travel.left", coordinate="time", log_evidence=12.0),)
    result.non_parametric_alone = ()
    result.causes = [
        SimpleNamespace(
            effect=CATALOGUE.effect(name), place=place, departure_gain=gain, differs_with=differs_with, alike=False
        )
        for name, place, gain in (("backlash", "right", departure_gain), ("latency", "", 0.0))
    ]
    return result


@pytest.mark.parametrize(("excess", "verdict", "said"), [(9.9, "backlash", 0), (10.1, "backlash", 1), (10.1, NONE, 0)])
def test_a_form_is_called_inexact_where_more_than_ten_of_log_evidence_remains(excess, verdict, said):
    remarks = _of_verdict(found_beside(0.0, excess=excess), verdict, noise_floor_m=5e-6)
    assert len(remarks) == said
    assert all("travel.left" in remark and "time" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("verdict", "gap", "said"),
    [
        ("backlash", GAP, True),
        ("backlash", replace(GAP, shrink=-0.01, shrink_interval=(-0.2, 0.1)), True),
        ("backlash", replace(GAP, shrink=0.0, shrink_interval=(-0.2, 0.1)), False),
        ("backlash", replace(GAP, shrink=0.9, shrink_interval=(0.8, 0.95)), False),
        (NONE, GAP, False),
    ],
)
def test_an_effect_with_which_readings_are_predicted_worse_is_said_to_do_so(verdict, gap, said):
    linear = SimpleNamespace(levels=DisturbanceLevels(), far_off=np.zeros(0), sensors={})
    result = found_beside(0.0)
    result.ranking, result.not_begun_with = (), ()
    all_remarks = remarks(linear, DisturbanceLevels(), LevelsAndCauses(None, result, 0.0), verdict, 5e-6, gap)
    worse = [remark for remark in all_remarks if "predicted worse" in remark]
    sentence = (
        "with backlash and latency withheld readings are predicted worse than without, from a gap of 219.4 to 424.5 "
        "um: do not add them to the model"
    )
    assert worse == ([sentence] if said else [])


@pytest.mark.parametrize(("alike", "verdict", "said"), [(True, "backlash", 1), (False, "backlash", 0), (True, NONE, 0)])
def test_sizes_that_lean_on_one_another_are_said_to(alike, verdict, said):
    result = found_beside(0.0)
    result.causes = [replace_of(cause, alike=alike and cause.effect.name == "backlash") for cause in result.causes]
    remarks = _of_verdict(result, verdict, noise_floor_m=5e-6)
    assert [remark.startswith("backlash: at all places of its kind alike") for remark in remarks] == [True] * said


def replace_of(cause: SimpleNamespace, **changes: object) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(cause), **changes})


@pytest.mark.parametrize(("departure_gain", "said"), [(83.0, 0), (84.0, 1)])
def test_a_form_is_called_inexact_too_where_departures_count_as_more_than_ten(departure_gain, said):
    remarks = _of_verdict(found_beside(departure_gain), "latency", noise_floor_m=5e-6)
    assert len(remarks) == said
    assert all("not exact: backlash at right has to depart far" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("excess", "alone", "said"),
    [
        (11.9, 0.0, "depart far from its form, with rest and side.left (departures add 100 of the 400"),
        (12.1, 0.0, "something at travel.left that depends on time remains (12 more)"),
        (50.0, 400.0 + 11.9, "something at travel.left that depends on time remains (50 more)"),
        (50.0, 400.0 + 12.1, "an arbitrary function of place at pose.x alone explains more (50 more)"),
    ],
)
def test_unknown_says_what_speaks_against_the_likest_effect_what_departs_or_what_remains(excess, alone, said):
    result = found_beside(100.0, excess=excess)
    result.non_parametric_alone = (SimpleNamespace(channel="pose.x", coordinate="place", log_evidence=alone),)
    (remark,) = _of_verdict(result, UNKNOWN, noise_floor_m=5e-6)
    assert remark.startswith("most like latency (300")
    assert said in remark
    assert ("backlash at right" in remark) is (excess < 12.0)


@pytest.mark.parametrize(
    ("causes", "said"),
    [
        (
            (Evidence("backlash", 3.5), Evidence("latency", 1.0, "")),
            "nearest comes backlash at left (3.5 of log evidence), which lacks 2.5 to count as a cause; an arbitrary "
            "function of time at travel.left explains 40",
        ),
        (
            (Evidence("latency", 0.1, ""),),
            "nearest comes latency (0.1 of log evidence), which lacks 5.9 to count as a cause; an arbitrary function "
            "of time at travel.left explains 40",
        ),
        (
            (Evidence("latency", -0.1, ""),),
            "nothing in the catalogue explains any of it; an arbitrary function of time at travel.left explains 40 of "
            "log evidence",
        ),
        (
            (),
            "nothing in the catalogue explains any of it; an arbitrary function of time at travel.left explains 40 of "
            "log evidence",
        ),
    ],
)
def test_unknown_without_a_cause_says_which_effect_comes_nearest_and_what_it_lacks(causes, said):
    result = found(*causes, explained=0.0, excess=40.0)
    result.causes = ()
    result.non_parametric = (SimpleNamespace(channel="travel.left", coordinate="time", log_evidence=40.0),)
    assert _of_verdict(result, UNKNOWN, noise_floor_m=5e-6) == (said,)
    assert _of_verdict(result, NONE, noise_floor_m=5e-6) == ()


def test_an_effect_that_is_kept_for_its_form_alone_is_named():
    told = ToldByForm(("tracker_drift", "backlash"), 37.4)
    linear = SimpleNamespace(levels=DisturbanceLevels(), far_off=np.zeros(0), sensors={})
    result = found(Evidence("latency", 300.0, ""))
    result.ranking = result.causes = ()
    result.non_parametric, result.not_begun_with = (), ()
    by_form, without = (
        remarks(linear, DisturbanceLevels(), LevelsAndCauses(None, result, 0.0, kept), NONE, 5e-6, GAP)
        for kept in (told, None)
    )
    assert without == ()
    (said,) = by_form
    assert said.startswith("tracker_drift and backlash: less than 2 times what an ordinary disturbance may do")
    assert (
        "kept only because the form tells it from one (37 of log posterior over disturbances alone, 20 needed)" in said
    )


def test_a_departure_with_more_than_three_coordinates_is_one_with_all_that_varies():
    result = found_beside(200.0, differs_with=("rest", "time", "payload", "side.left"))
    (remark,) = _of_verdict(result, UNKNOWN, noise_floor_m=5e-6)
    assert "with all that varies (departures add 200" in remark


def cut_of(*, unrefined=(), not_begun_with=(), causes=("latency",), left_out=()) -> tuple[str, ...]:
    """The remark on a search in whose ranking these effects were cut."""
    ranked = {
        name: SimpleNamespace(effect=CATALOGUE.effect(name), unrefined=name in unrefined)
        for name in ("latency", "joint_clearance", "refraction", "payload")
    }
    result = SimpleNamespace(
        ranking=tuple(ranked.values()), causes=[ranked[name] for name in causes], not_begun_with=not_begun_with
    )
    return _cut_for_time(LevelsAndCauses(None, result, 0.0, left_out=left_out))


@pytest.mark.parametrize(
    ("cut", "said"),
    [
        ({"unrefined": ("refraction",)}, "of refraction neither departures from the form nor nonlinear laws nor"),
        ({"unrefined": ("refraction", "payload", "latency")}, "of refraction and payload neither"),
        ({"unrefined": ("joint_clearance", "refraction", "payload")}, "of joint_clearance, refraction and payload"),
        ({"unrefined": ("refraction",)}, "less than 60 % of the strongest's log evidence"),
        ({"not_begun_with": ("payload",)}, "no search for several causes began with payload: 3 stronger ones did"),
        ({"not_begun_with": ("a", "b", "c", "d")}, "began with a, b, c and d: 3 stronger"),
        ({"not_begun_with": ("a", "b", "c", "d", "e")}, "began with a, b, c and 2 more: 3 stronger"),
        (
            {"left_out": ("payload", BY_VISIT)},
            "began with payload and effects that are another at each visit: others",
        ),
        ({"unrefined": ("refraction",)}, "(diagnose --thorough tries them)"),
        ({"not_begun_with": ("payload",)}, "(diagnose --thorough begins with these too)"),
    ],
)
def test_what_is_not_tried_to_save_time_is_said_with_its_name(cut, said):
    (remark,) = cut_of(**cut)
    assert remark.startswith("to save time ")
    assert said in remark


@pytest.mark.parametrize(("names", "said"), [(("latency", "refraction"), 0), (("latency", "refraction", "payload"), 1)])
def test_that_no_more_than_three_causes_are_looked_for_is_not_to_save_time(names, said):
    """No option finds more."""
    causes = [SimpleNamespace(effect=CATALOGUE.effect(name)) for name in (*names, names[0])]
    remarks = _as_many_as_are_looked_for(SimpleNamespace(causes=causes))
    assert remarks == ("no more than 3 causes are looked for: there may be others",) * said
    assert cut_of(causes=names) == ()


def test_what_is_not_tried_is_one_remark_and_none_where_all_was_tried():
    assert len(cut_of(unrefined=("payload",), not_begun_with=("refraction",))) == 1
    assert cut_of(causes=("latency", "latency", "refraction"), left_out=("latency",)) == ()
    assert cut_of(unrefined=("latency",), not_begun_with=("latency",)) == ()  # refined beside the other causes
