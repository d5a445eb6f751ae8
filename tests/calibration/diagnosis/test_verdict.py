"""Every threshold of the verdict on hand-made evidence, just below and just above it.

The numbers are those of docs/explanation/diagnosis-method.md, written out: the tests do not ask the settings for them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import ranking, search
from calibration.diagnosis.findings.effect_summary import equivalent_effects
from calibration.diagnosis.findings.remarks import _cut_for_time, _of_verdict
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.diagnosis.verdict import presence_probability, probabilities
from calibration.effects.catalogue import load_catalogue
from calibration.machine.description import load_machine
from calibration.model.payload import PayloadEntry
from calibration.recording.header import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import PLANAR

CATALOGUE = load_catalogue()
MACHINE = load_machine(PLANAR)
INPUTS = SimpleNamespace(machine=MACHINE, once=lambda _, make: make())
E = np.e


@dataclass(frozen=True)
class Evidence:
    """A cause of which only the evidence matters, and the channel that it acts through; a share of the verdict's signal
    is left beside it."""

    name: str
    log_evidence: float
    place: str = "left"
    left_of_signal: float = 0.0
    channel: str = "travel.left"

    @property
    def contributions(self):
        return (((self.channel, np.ones(1)),),)

    @property
    def channels(self):
        return ((self.channel, 1.0),)

    @property
    def effect(self):
        return CATALOGUE.effect(self.name)

    @property
    def best(self):
        return SimpleNamespace(coefficients=np.ones(1))

    @property
    def parts(self):
        return (self,)


def found(*causes: Evidence, explained: float | None = None, excess: float = 0.0) -> SimpleNamespace:
    """The result of a search: all evidence, and how much is explained."""
    explained = max((c.log_evidence for c in causes), default=0.0) if explained is None else explained
    return SimpleNamespace(ranking=causes, causes=causes[:1], log_evidence=explained, excess_log_evidence=excess)


@pytest.mark.parametrize(("log_evidence", "likely"), [(6.9, False), (7.1, True)])
def test_an_effect_needs_log_evidence_of_seven_to_be_likelier_than_none(log_evidence, likely):
    assert (probabilities(found(Evidence("backlash", log_evidence)))[NONE] < 0.5) is likely
    alone = probabilities(found(Evidence("backlash", 1.0), explained=1.0, excess=log_evidence - 1.0))
    assert (alone[NONE] < 0.5) is likely


@pytest.mark.parametrize(("explained", "threshold"), [(0.0, 12.0), (100.0, 15.0), (1000.0, 42.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_unknown_has_even_odds_at_twelve_and_three_per_cent_of_what_is_explained(explained, threshold, side):
    p = probabilities(found(Evidence("backlash", explained), excess=threshold + side))
    assert (p[UNKNOWN] > p["backlash"]) is (side > 0.0)


@pytest.mark.parametrize(("explained", "threshold", "width"), [(0.0, 12.0, 4.0), (1000.0, 42.0, 12.0)])
def test_the_odds_of_unknown_change_by_e_over_a_width_of_four_and_eight_per_mille(explained, threshold, width):
    p = probabilities(found(Evidence("backlash", explained), excess=threshold + width))
    assert p[UNKNOWN] / p["backlash"] == pytest.approx(E)


@pytest.mark.parametrize(("strongest", "temperature"), [(100.0, 1.3), (1000.0, 4.0)])
def test_differences_are_divided_by_one_and_three_per_mille_of_the_strongest_evidence(strongest, temperature):
    p = probabilities(found(Evidence("backlash", strongest), Evidence("latency", strongest - temperature)))
    assert p["backlash"] / p["latency"] == pytest.approx(E)


def test_probabilities_without_any_effect_are_those_of_none_and_unknown():
    p = probabilities(found(excess=20.0))
    assert set(p) == {NONE, UNKNOWN}
    assert p[UNKNOWN] == pytest.approx(1.0 / (1.0 + E ** -(20.0 - 7.0)))


def test_a_further_cause_has_even_odds_at_log_evidence_of_seven():
    ranking = {"backlash": 0.8, NONE: 0.1, UNKNOWN: 0.1}
    assert presence_probability(Evidence("latency", 7.0), ranking) == pytest.approx(0.4)


class FourReadings:
    """Three readings of the platform and one of a slider, of a machine in a plane."""

    moves = MACHINE.dof[MACHINE.dof < 3]
    on_platform = np.array([True, True, False, True])
    rms_sigma = LinearModel.rms_sigma


class HandMade:
    """A likelihood without any algebra: every column is the signal; a rival leaves the share of it that it says."""

    linear = FourReadings()

    def __init__(self, signal: np.ndarray, left: float = 1.0) -> None:
        self.signal, self.left = signal, left

    def columns(self, contributions):
        return self.signal[:, :, None]

    def apply(self, columns):
        return self.left * columns


def equivalent(monkeypatch, main: Evidence, *rivals: Evidence, sigma: float = 1.0) -> tuple[str, ...]:
    """Names that are equivalent to the first, whose signal is `sigma` RMS in both coordinates of the plane."""
    signal = np.zeros((4, 3))
    signal[:, :2] = sigma
    likelihood = HandMade(signal)
    monkeypatch.setattr(
        "calibration.diagnosis.findings.effect_summary.include_cause",
        lambda likelihood, rival: HandMade(likelihood.signal, rival.left_of_signal),
    )
    return equivalent_effects(found(main, *rivals), likelihood, main.name)[0]


@pytest.mark.parametrize(("left", "same"), [(0.299, True), (0.301, False)])
def test_predictions_are_equivalent_below_three_tenths_of_sigma(monkeypatch, left, same):
    rival = Evidence("latency", 99.0, left_of_signal=left)
    assert equivalent(monkeypatch, Evidence("backlash", 100.0), rival) == (("latency",) if same else ())


def test_the_difference_counts_in_sigma_not_over_the_signal(monkeypatch):
    rival = Evidence("latency", 99.0, left_of_signal=0.1)
    assert equivalent(monkeypatch, Evidence("backlash", 100.0), rival, sigma=2.9) == ("latency",)
    assert equivalent(monkeypatch, Evidence("backlash", 100.0), rival, sigma=3.1) == ()


@pytest.mark.parametrize(("verdict", "limit"), [(20.0, 9.8), (100.0, 89.0), (1000.0, 980.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_an_effect_is_excluded_ten_and_a_hundredth_below_the_verdict(monkeypatch, verdict, limit, side):
    rival = Evidence("latency", limit + side)
    assert equivalent(monkeypatch, Evidence("backlash", verdict), rival) == (("latency",) if side > 0.0 else ())


def test_six_rivals_are_compared(monkeypatch):
    names = [name for name in CATALOGUE.names if name != "backlash"][:7]
    rivals = [Evidence(name, 99.0 - 0.1 * k) for k, name in enumerate(names)]
    assert equivalent(monkeypatch, Evidence("backlash", 100.0), *rivals) == tuple(names[:6])


def searched(
    monkeypatch,
    *rounds: list[Evidence],
    rest: float = 100.0,
    alone: float = 0.0,
    by_visit: list[Evidence] | None = None,
):
    """A search that finds these causes, the strongest of each round first; what remains has evidence `rest`.

    by_visit: the first round where effects may be others at each visit.
    """
    steps = {False: iter([*rounds, []]), True: iter([by_visit or [], []])}
    monkeypatch.setattr(search, "rank_effects", lambda *_, by_visit=False, explained=0.0: next(steps[by_visit]))
    monkeypatch.setattr(search, "differs_by_visit", lambda cause: True)
    monkeypatch.setattr(search, "include_cause", lambda likelihood, cause: f"{likelihood}+{cause.name}")
    monkeypatch.setattr(search, "_refit_causes", lambda _, __, causes: (causes, ["refitted"]))
    monkeypatch.setattr(
        search, "rank_non_parametric", lambda likelihood, _: [Evidence("", rest if "+" in likelihood else alone)]
    )
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
    "none": {"refraction": 1000.0, "latency": 800.0, "tracker_drift": 490.0, "smr_reseat": 480.0},
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
    """Fourth of the ranking, but found beside the second."""
    given = TWO_LIKE_A_THIRD | {"none+refraction": {"smr_reseat": 150.0}}
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["latency", "smr_reseat"]
    monkeypatch.setattr(search, "VERDICT", replace(search.VERDICT, leaders=1))
    given["none+latency"] = {}
    assert sorted(c.name for c in search_with(monkeypatch, given).causes) == ["latency", "smr_reseat"]


def test_what_differs_by_visit_need_not_outdo_an_effect_that_a_pair_has_raised(monkeypatch):
    """It explains more than each effect alone, and with another more than the pair does."""
    given = TWO_LIKE_A_THIRD | {"by visit": {"backlash": 1010.0}, "none+backlash": {"tracker_drift": 600.0}}
    result = search_with(monkeypatch, given, rest=200.0)
    assert [cause.name for cause in result.causes] == ["backlash", "tracker_drift"]


def test_no_search_begins_with_an_effect_that_explains_less_than_two_fifths(monkeypatch):
    given = {
        "none": {"refraction": 1000.0, "latency": 390.0},
        "none+refraction": {"tracker_drift": 100.0},
        "none+latency": {"smr_reseat": 3000.0},
    }
    assert [c.name for c in search_with(monkeypatch, given).causes] == ["refraction", "tracker_drift"]


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


@pytest.mark.parametrize(("rest", "left"), [(7.4, 0.0), (7.6, 10.0)])
def test_what_differs_by_visit_is_tried_where_the_verdict_could_be_unknown(monkeypatch, rest, left):
    """Of 100 explained: from half an excess of 12 and three per cent on."""
    first, other = Evidence("latency", 100.0, ""), Evidence("backlash", 110.0)
    result = searched(monkeypatch, [first], rest=rest, by_visit=[other])
    assert result.log_evidence == 100.0 + left
    assert searched(monkeypatch, [first], rest=rest, by_visit=[replace(other, log_evidence=99.0)]).log_evidence == 100.0


def test_what_differs_by_visit_explains_more_than_all_other_effects_together(monkeypatch):
    """Alone it explains more than the strongest of them, and less than two."""
    rounds = [[Evidence("latency", 100.0, "")], [Evidence("refraction", 50.0, "")]]
    result = searched(monkeypatch, *rounds, by_visit=[Evidence("backlash", 110.0)])
    assert result.log_evidence == pytest.approx(150.0 - 10.0 - 0.005 * 150.0)


def place(name: str, log_evidence: float) -> ranking._PlaceEvidence:
    return ranking._PlaceEvidence(name, log_evidence, SimpleNamespace(), ())


@pytest.mark.parametrize(("strongest", "limit"), [(100.0, 25.0), (20.0, 6.0), (100.0, 50.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_effects_are_refined_above_a_quarter_of_the_strongest_evidence_and_six_with_curves_above_half(
    monkeypatch, strongest, limit, side
):
    logs = {"link_stiffness": strongest, "joint_clearance": limit + side}
    refined = []
    curves_of = {name: replace(CATALOGUE.effect(name), curves=lambda *_: ("a law",)) for name in logs}
    monkeypatch.setattr(
        ranking, "_evidence_by_place", lambda _, __, effect, ___: [place("left_upper", logs[effect.name])]
    )
    monkeypatch.setattr(ranking, "_at_several_places", lambda _, __, cause, by_visit: cause)
    monkeypatch.setattr(
        ranking,
        "_refine",
        lambda _, __, effect, places, by_visit, curves: refined.append((effect.name, curves)) or places,
    )
    ranked = ranking.rank_effects(None, INPUTS, list(curves_of.values()))
    other = [("joint_clearance", limit + side > 0.5 * strongest)] if side > 0.0 or limit > 30.0 else []
    assert refined == [("link_stiffness", True), *other]
    assert [c.without_curves for c in ranked] == [False, bool(other) and not other[0][1]]


@pytest.mark.parametrize(("strongest", "limit"), [(100.0, 80.0), (10.0, 5.0), (1.0, -4.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_curves_are_fitted_at_places_with_four_fifths_of_the_best_or_five_less(monkeypatch, strongest, limit, side):
    tried = []
    effect = replace(CATALOGUE.effect("joint_clearance"), curves=lambda _, index: tried.append(index) or ())
    monkeypatch.setattr(ranking, "fit_curves", lambda *_: None)
    exact = SimpleNamespace(gain=0.0, best=None, contributions=())
    monkeypatch.setattr(ranking, "with_departures", lambda *_, by_visit: exact)
    likelihood = SimpleNamespace(linear=SimpleNamespace(machine=None, levels=DisturbanceLevels(), payloads=()))
    places = [place("left_upper", strongest), place("right_lower", limit + side)]
    ranking._refine(likelihood, INPUTS, effect, places, by_visit=False)
    assert tried == ([0, 3] if side > 0.0 else [0])


@pytest.mark.parametrize(
    ("declared_m", "smallest_m"), [(0.0, 2e-6), (0.9e-6, 2e-6), (1.1e-6, 2.2e-6), (2.4e-4, 4.8e-4), (2.6e-4, 5e-4)]
)
def test_twice_what_is_declared_is_the_smallest_size_at_most_half_of_the_largest(declared_m, smallest_m):
    effect = CATALOGUE.effect("tracker_drift")
    assert effect.smallest_size(DisturbanceLevels(drift_m=declared_m)) == pytest.approx(smallest_m)


def test_three_times_what_is_stated_is_the_smallest_size():
    payloads = [
        PayloadEntry(name="none", mass_kg=0.0, u_com_m=0.1),
        PayloadEntry(name="heavy", mass_kg=200.0, u_mass_kg=0.4, u_com_m=0.002),  # 1.6 kg at a lever of 0.25 m
    ]
    payload, expansion = CATALOGUE.effect("payload"), CATALOGUE.effect("expansion_coefficient")
    u_kg, u_per_k = payload.stated_u(INPUTS.machine, payloads), expansion.stated_u(INPUTS.machine, payloads)
    assert payload.smallest_size(DisturbanceLevels(), u_kg) == pytest.approx(1.2)
    assert (
        payload.smallest_size(DisturbanceLevels(), payload.stated_u(INPUTS.machine, payloads[:1])) == payload.size.low
    )
    assert expansion.smallest_size(DisturbanceLevels(), u_per_k) == pytest.approx(3.0 * 0.3e-6)


@pytest.mark.parametrize(("excess", "verdict", "said"), [(9.9, "backlash", 0), (10.1, "backlash", 1), (10.1, NONE, 0)])
def test_a_form_is_called_inexact_where_more_than_ten_of_log_evidence_remains(excess, verdict, said):
    result = found(Evidence("backlash", 100.0), excess=excess)
    result.non_parametric = [SimpleNamespace(channel="travel.left", coordinate="time")]
    remarks = _of_verdict(result, verdict, noise_floor_m=5e-6)
    assert len(remarks) == said
    assert all("travel.left" in remark and "time" in remark for remark in remarks)


def test_several_causes_are_each_fitted_again_beside_the_others(monkeypatch):
    rounds = [[Evidence("backlash", 100.0)], [Evidence("latency", 50.0, "")]]
    assert searched(monkeypatch, *rounds[:1]).likelihoods == ("none", "none+backlash")
    assert searched(monkeypatch, *rounds).likelihoods == ("refitted",)


def test_what_is_not_tried_to_save_time_is_said():
    effects = [CATALOGUE.effect(name) for name in ("latency", "joint_clearance", "refraction", "payload")]
    ranked = [SimpleNamespace(effect=effect, without_curves=effect.name == "joint_clearance") for effect in effects]
    laws, causes = _cut_for_time(SimpleNamespace(ranking=ranked, causes=[*ranked[:1], *ranked]))
    assert "joint_clearance" in laws
    assert "3 causes" in causes
    assert _cut_for_time(SimpleNamespace(ranking=ranked[:1], causes=[ranked[0], *ranked[:2]])) == ()
