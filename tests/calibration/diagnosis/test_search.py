"""Every threshold of the search for causes on hand-made evidence, just below and just above it.

The numbers are those of docs/explanation/diagnosis-method.md, written out: the tests do not ask the settings for them.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from calibration.diagnosis import search
from calibration.diagnosis.verdict import probabilities
from tests.calibration.diagnosis.hand_made import INPUTS, Evidence


def searched(
    monkeypatch,
    *rounds: list[Evidence],
    rest: float = 100.0,
    rest_of_two: float | None = None,
    alone: float = 0.0,
    kept_gain: float = 1.0,
    by_visit: list[Evidence] | None = None,
):
    """A search that finds these causes, the strongest of each round first; what remains has evidence `rest`.

    rest_of_two: the same beside two causes; kept_gain: share of what departures add that is left once causes are fitted
    beside one another. by_visit: the first round where effects may be others at each visit.
    """

    def left(likelihood: str) -> float:
        after = {0: alone, 2: rest if rest_of_two is None else rest_of_two}
        return after.get(likelihood.count("+"), rest)

    def refitted(_, __, causes: list[Evidence]) -> tuple[list[Evidence], list[str]]:
        return [replace(cause, departure_gain=kept_gain * cause.departure_gain) for cause in causes], ["refitted"]

    steps = {False: iter([*rounds, []]), True: iter([by_visit or [], []])}
    monkeypatch.setattr(search, "rank_effects", lambda *_, by_visit=False, **__: next(steps[by_visit], []))
    differing = {cause.name for cause in by_visit or []}
    monkeypatch.setattr(search, "differs_by_visit", lambda cause: cause.name in differing)
    monkeypatch.setattr(search, "acting_elsewhere", lambda *_: set())
    monkeypatch.setattr(search, "include_cause", lambda likelihood, cause: f"{likelihood}+{cause.name}")
    monkeypatch.setattr(search, "_refit_causes", refitted)
    monkeypatch.setattr(search, "rank_non_parametric", lambda likelihood, _: [Evidence("", left(likelihood))])
    return search.search_causes("none", INPUTS, [])


@pytest.mark.parametrize(("gain", "count"), [(5.9, 0), (6.1, 1)])
def test_an_effect_is_included_from_log_evidence_of_six(monkeypatch, gain, count):
    assert len(searched(monkeypatch, [Evidence("backlash", gain)]).causes) == count


@pytest.mark.parametrize(
    ("second", "limit"),
    [
        (Evidence("backlash", 0.0, "left"), 60.0),
        (Evidence("latency", 0.0, ""), 12.0),
        (Evidence("guide_angular", 0.0, "right"), 12.0),
        (Evidence("friction_windup", 0.0, "left"), 60.0),
        (Evidence("guide_angular", 0.0, "left", channel="turn.left.z"), 12.0),
        (Evidence("joint_clearance", 0.0, "left_upper", channel="length.left_upper"), 12.0),
    ],
)
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_a_further_cause_adds_six_per_mille_or_three_per_cent_where_one_acts_alike(monkeypatch, second, limit, side):
    first = Evidence("backlash", 2000.0, "left")
    result = searched(monkeypatch, [first], [replace(second, log_evidence=limit + side)])
    assert len(result.causes) == (2 if side > 0.0 else 1)


@pytest.mark.parametrize(
    ("second", "share"), [(Evidence("latency", 100.0, ""), 0.005), (Evidence("friction_windup", 100.0), 0.02)]
)
def test_a_further_cause_costs_ten_and_five_per_mille_or_two_per_cent_where_one_acts_alike(monkeypatch, second, share):
    result = searched(monkeypatch, [Evidence("backlash", 2000.0)], [second])
    assert result.log_evidence == pytest.approx(2100.0 - 10.0 - share * 2100.0)


@pytest.mark.parametrize(("strut", "limit"), [("left_lower", 60.0), ("right_upper", 12.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_struts_of_one_drive_are_one_part(monkeypatch, strut, limit, side):
    first = Evidence("link_stiffness", 2000.0, "left_upper", channel="length.left_upper")
    second = Evidence("joint_clearance", limit + side, strut, channel=f"length.{strut}")
    result = searched(monkeypatch, [first], [second])
    assert len(result.causes) == (2 if side > 0.0 else 1)


@pytest.mark.parametrize(("departure_gain", "tried"), [(33.0, False), (34.0, True)])
def test_alternatives_without_causes_are_tried_where_departures_count_as_four(monkeypatch, departure_gain, tried):
    """There is something to say of `unknown` where nothing is left over."""
    cause = Evidence("backlash", 100.0, departure_gain=departure_gain)
    result = searched(monkeypatch, [cause], rest=0.0, alone=90.0)
    assert result.departure_gain == departure_gain
    assert bool(result.non_parametric_alone) is tried
    assert result.excess_log_evidence == 0.0


def test_what_departures_add_is_that_of_all_causes_beside_one_another(monkeypatch):
    """One that departed alone may be exact beside another."""
    rounds = [
        [Evidence("backlash", 1000.0, departure_gain=300.0)],
        [Evidence("latency", 500.0, "", departure_gain=200.0)],
    ]
    result = searched(monkeypatch, *rounds, rest_of_two=0.0, kept_gain=0.07)
    assert result.departure_gain == pytest.approx(35.0)


@pytest.mark.parametrize(("alone", "excess"), [(300.0, 0.0), (1500.0, 1500.0 - 1490.0 + 7.5)])
def test_several_causes_are_weighed_against_alternatives_alone_though_they_leave_nothing(monkeypatch, alone, excess):
    """Together they may imitate a single one of no catalogue; a second one costs 10 and five per mille."""
    rounds = [[Evidence("backlash", 1000.0)], [Evidence("latency", 500.0, "")]]
    result = searched(monkeypatch, *rounds, rest_of_two=0.0, alone=alone)
    assert [cause.name for cause in result.causes] == ["backlash", "latency"]
    assert result.excess_log_evidence == pytest.approx(excess)


def test_three_causes_are_enough(monkeypatch):
    rounds = [[Evidence(name, 100.0, "")] for name in ("latency", "refraction", "tracker_drift", "servo_settling")]
    assert [c.name for c in searched(monkeypatch, *rounds).causes] == ["latency", "refraction", "tracker_drift"]


def search_with(
    monkeypatch,
    given: dict[str, dict[str, float]],
    rest: float = 5.0,
    rest_by: dict[str, float] | None = None,
    channel: str = "pose.x",
):
    """A search in which the evidence of each effect is known for what is in the model already ("none+latency").

    "by visit": without any, where effects may be others at each visit. rest: evidence of alternatives, through a
    channel; rest_by: the same for what is in the model.
    """
    rests = rest_by or {}

    def ranked(likelihood, *_, by_visit=False, **__):
        logs = given.get("by visit" if by_visit and likelihood == "none" else likelihood, {})
        places = {"backlash": "left"}
        found = [Evidence(name, log, places.get(name, "")) for name, log in logs.items()]
        return sorted(found, key=lambda c: -c.log_evidence)

    monkeypatch.setattr(search, "rank_effects", ranked)
    monkeypatch.setattr(search, "include_cause", lambda likelihood, cause: f"{likelihood}+{cause.name}")
    monkeypatch.setattr(search, "_refit_causes", lambda _, __, causes: (causes, ["refitted"]))
    monkeypatch.setattr(
        search,
        "rank_non_parametric",
        lambda likelihood, _: [Evidence("", rests.get(likelihood, rest), channel=channel)],
    )
    monkeypatch.setattr(search, "differs_by_visit", lambda cause: cause.name == "backlash")
    monkeypatch.setattr(search, "acting_elsewhere", lambda *_: set())
    return search.search_causes("none", INPUTS, [])


@pytest.mark.parametrize(
    ("instead", "channel", "excess"), [(150.0, "pose.x", 49.75), (90.0, "pose.x", 3.0), (150.0, "travel.right", 32.5)]
)
def test_an_alternative_in_place_of_a_further_cause_costs_what_that_costs(monkeypatch, instead, channel, excess):
    """Each is a second cause; the first of the two is weighed against the named one, not against one cause alone."""
    given = {"none": {"refraction": 1000.0}, "none+refraction": {"latency": 100.0}}
    left = {"none+refraction": instead, "none+refraction+latency": 3.0}
    result = search_with(monkeypatch, given, rest_by=left, channel=channel)
    assert [cause.name for cause in result.causes] == ["refraction", "latency"]
    assert result.excess_log_evidence == pytest.approx(excess)


TWO_LIKE_A_THIRD = {
    "none": {"refraction": 1000.0, "latency": 800.0, "tracker_drift": 600.0, "payload": 595.0, "smr_reseat": 590.0},
    "none+refraction": {"latency": 150.0, "smr_reseat": 100.0},
    "none+latency": {"smr_reseat": 600.0},
    "none+smr_reseat": {"latency": 1010.0},
}


def test_two_effects_that_look_like_a_third_are_found_from_the_weaker_one(monkeypatch):
    """The first of all explains 1,000 and 150 with the next; the second and the last together 1,400."""
    result = search_with(monkeypatch, TWO_LIKE_A_THIRD)
    assert sorted(cause.name for cause in result.causes) == ["latency", "smr_reseat"]
    assert result.log_evidence == pytest.approx(1400.0 - 10.0 - 0.005 * 1400.0)
    first = 1150.0 - 10.0 - 0.005 * 1150.0
    assert result.ranking[0].name == "latency"  # of the two the one that explains more alone
    assert result.ranking[0].log_evidence == pytest.approx(1000.0 + result.log_evidence - first)
    assert max(probabilities(result).items(), key=lambda item: item[1])[0] == "latency"


def test_a_search_begins_with_the_third_of_the_ranking_too(monkeypatch):
    given = {
        "none": {"refraction": 1000.0, "latency": 800.0, "smr_reseat": 780.0, "payload": 770.0},
        "none+refraction": {"latency": 100.0},
        "none+smr_reseat": {"payload": 600.0},
        "none+payload": {"smr_reseat": 700.0},
    }
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["payload", "smr_reseat"]
    assert search_with(monkeypatch, given).not_begun_with == ("payload",)
    given["none+smr_reseat"] = {}
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["latency", "refraction"]
    given["none"]["payload"] = 0.64 * (1100.0 - 10.0 - 0.005 * 1100.0)
    assert search_with(monkeypatch, given).not_begun_with == ()
    given["none+refraction"] = {"payload": 100.0}
    given["none"]["payload"] = 770.0
    assert search_with(monkeypatch, given).not_begun_with == ()  # found later, so that a search began with it


@pytest.mark.parametrize(("rest", "names"), [(16.9, ["refraction"]), (17.1, ["latency", "smr_reseat"])])
def test_where_one_cause_leaves_half_of_what_unknown_needs_the_search_begins_with_others(monkeypatch, rest, names):
    """Half of 12 and 0.022 of 1,000: a single cause that explains most may stand for two."""
    given = TWO_LIKE_A_THIRD | {"none+refraction": {}}
    result = search_with(monkeypatch, given, rest_by={"none+refraction": rest})
    assert sorted(cause.name for cause in result.causes) == names


@pytest.mark.parametrize(("more", "first"), [(-0.1, "refraction"), (0.1, "latency")])
def test_another_beginning_counts_where_it_explains_more(monkeypatch, more, first):
    given = {
        "none": {"refraction": 1000.0, "latency": 900.0},
        "none+refraction": {"tracker_drift": 100.0},
        "none+latency": {"smr_reseat": 200.0 + more},
    }
    result = search_with(monkeypatch, given)
    assert (result.ranking[0].name, result.causes[0].name) == (first, first)


def test_a_weak_effect_begins_a_search_where_it_was_found_later(monkeypatch):
    """Fifth of the ranking, but found beside the second."""
    strong = TWO_LIKE_A_THIRD["none"] | {"tracker_drift": 760.0, "payload": 755.0, "smr_reseat": 750.0}
    given = TWO_LIKE_A_THIRD | {"none": strong, "none+refraction": {"smr_reseat": 150.0}}
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["latency", "smr_reseat"]
    monkeypatch.setattr(search, "VERDICT", replace(search.VERDICT, leaders=1))
    given["none+latency"] = {}
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["latency", "smr_reseat"]


def test_what_differs_by_visit_need_not_outdo_an_effect_that_a_pair_has_raised(monkeypatch):
    """It explains more than each effect alone, and with another more than the pair does."""
    given = TWO_LIKE_A_THIRD | {"by visit": {"backlash": 1010.0}, "none+backlash": {"tracker_drift": 600.0}}
    result = search_with(monkeypatch, given, rest=200.0)
    assert [cause.name for cause in result.causes] == ["backlash", "tracker_drift"]


@pytest.mark.parametrize(
    ("alone", "names"), [(700.0, ["refraction", "tracker_drift"]), (710.0, ["latency", "smr_reseat"])]
)
def test_no_search_begins_with_an_effect_that_explains_less_than_65_per_cent(monkeypatch, alone, names):
    """Of 1,084.5 that two explain together, less what a second one costs."""
    given = {
        "none": {"refraction": 1000.0, "latency": alone},
        "none+refraction": {"tracker_drift": 100.0},
        "none+latency": {"smr_reseat": 3000.0},
    }
    assert [c.name for c in search_with(monkeypatch, given).causes] == names


@pytest.mark.parametrize(
    ("alone", "names"), [(485.0, ["refraction", "tracker_drift"]), (490.0, ["latency", "smr_reseat"])]
)
def test_where_much_is_left_a_search_begins_with_what_explains_45_per_cent(monkeypatch, alone, names):
    """Of 1,084.5 again, beside which an alternative explains 40."""
    given = {
        "none": {"refraction": 1000.0, "latency": alone},
        "none+refraction": {"tracker_drift": 100.0},
        "none+latency": {"smr_reseat": 3000.0},
    }
    result = search_with(monkeypatch, given, rest_by={"none+refraction+tracker_drift": 40.0})
    assert [c.name for c in result.causes] == names


def test_where_one_cause_is_enough_no_other_search_begins(monkeypatch):
    given = {"none": {"refraction": 1000.0, "latency": 990.0}, "none+latency": {"smr_reseat": 500.0}}
    assert [c.name for c in search_with(monkeypatch, given).causes] == ["refraction"]


@pytest.mark.parametrize(("rest", "count"), [(3.9, 1), (4.1, 2)])
def test_the_search_ends_where_what_remains_has_log_evidence_below_four(monkeypatch, rest, count):
    rounds = [[Evidence("backlash", 100.0)], [Evidence("latency", 50.0, "")]]
    assert len(searched(monkeypatch, *rounds, rest=rest).causes) == count


@pytest.mark.parametrize(("rest", "alone"), [(3.9, 0), (4.1, 1)])
def test_alternatives_alone_are_tried_where_the_causes_leave_more_than_four(monkeypatch, rest, alone):
    assert (
        len(searched(monkeypatch, [Evidence("backlash", 100.0)], rest=rest, alone=50.0).non_parametric_alone) == alone
    )


@pytest.mark.parametrize(("rest", "left"), [(7.0, 0.0), (7.2, 10.0)])
def test_what_differs_by_visit_is_tried_where_the_verdict_could_be_unknown(monkeypatch, rest, left):
    """Of 100 explained: from half an excess of 12 and 0.022 of it on."""
    first, other = Evidence("latency", 100.0, ""), Evidence("backlash", 110.0)
    result = searched(monkeypatch, [first], rest=rest, by_visit=[other])
    assert result.log_evidence == 100.0 + left
    assert searched(monkeypatch, [first], rest=rest, by_visit=[replace(other, log_evidence=99.0)]).log_evidence == 100.0


def test_what_differs_by_visit_explains_more_than_all_other_effects_together(monkeypatch):
    """Alone it explains more than the strongest of them, and less than two."""
    rounds = [[Evidence("latency", 100.0, "")], [Evidence("refraction", 50.0, "")]]
    result = searched(monkeypatch, *rounds, by_visit=[Evidence("backlash", 110.0)])
    assert result.log_evidence == pytest.approx(150.0 - 10.0 - 0.005 * 150.0)


@pytest.mark.parametrize(("second", "log_evidence"), [([], 100.0), ([Evidence("refraction", 50.0, "")], 160.0)])
def test_what_differs_by_visit_is_tried_where_only_several_causes_explain_all(monkeypatch, second, log_evidence):
    """Nothing is left beside them, and yet one alone may explain more."""
    rounds = [[Evidence("latency", 100.0, "")], second]
    result = searched(monkeypatch, *rounds, rest=5.0, rest_of_two=1.0, by_visit=[Evidence("backlash", 160.0)])
    assert result.log_evidence == log_evidence


@pytest.mark.parametrize(("alone", "excess"), [(500.0, 200.0), (250.0, 1.0)])
def test_what_differs_by_visit_is_weighed_against_alternatives_alone_though_it_leaves_nothing(
    monkeypatch, alone, excess
):
    given = {"none": {"refraction": 100.0}, "by visit": {"backlash": 300.0}}
    left = {"none": alone, "none+refraction": 50.0, "none+backlash": 1.0}
    result = search_with(monkeypatch, given, rest_by=left)
    assert [cause.name for cause in result.causes] == ["backlash"]
    assert result.excess_log_evidence == excess


def test_several_causes_are_each_fitted_again_beside_the_others(monkeypatch):
    rounds = [[Evidence("backlash", 100.0)], [Evidence("latency", 50.0, "")]]
    assert searched(monkeypatch, *rounds[:1]).likelihoods == ("none", "none+backlash")
    assert searched(monkeypatch, *rounds).likelihoods == ("refitted",)
