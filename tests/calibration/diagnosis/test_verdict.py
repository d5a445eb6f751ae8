"""Every threshold of probabilities and equivalents on hand-made evidence, just below and just above it.

The numbers are those of docs/explanation/diagnosis-method.md, written out: the tests do not ask the settings for them.
"""

from __future__ import annotations

import numpy as np
import pytest

from calibration.diagnosis.findings.effect_summary import equivalent_effects
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.diagnosis.verdict import presence_probability, probabilities
from calibration.model.payload import PayloadEntry
from calibration.recording.header import DisturbanceLevels
from tests.calibration.diagnosis.hand_made import CATALOGUE, INPUTS, MACHINE, Evidence, found

E = np.e


@pytest.mark.parametrize(("log_evidence", "likely"), [(7.9, False), (8.1, True)])
def test_an_effect_needs_log_evidence_of_eight_to_be_likelier_than_none(log_evidence, likely):
    assert (probabilities(found(Evidence("backlash", log_evidence)))[NONE] < 0.5) is likely


def test_what_only_an_arbitrary_function_explains_names_no_effect():
    """Of odds of 10 against `none` by an alternative alone, an effect that explains nothing has its own exp(1 - 8);
    what neither names is `unknown` by how far it is beyond twelve."""
    excess = 8.0 + np.log(10.0)
    p = probabilities(found(Evidence("backlash", 1.0), explained=0.0, excess=excess))
    any_effect, named = 10.0 / 11.0, 1.0 / (1.0 + E**7)
    beyond = any_effect * exceeded(excess / 12.0)
    unknown = beyond + (any_effect - beyond - named) / (1.0 + E ** (12.0 - excess))
    assert p[UNKNOWN] == pytest.approx(unknown)
    assert p["backlash"] == pytest.approx(named)
    assert sum(p.values()) == pytest.approx(1.0)


def exceeded(left_over):
    """Probability of something of no catalogue: odds that grow with the power 0.8 of what is left over, and 0.03."""
    odds = ((left_over + 0.03) / 1.03) ** 0.8
    return odds / (1.0 + odds)


@pytest.mark.parametrize(("explained", "threshold"), [(100.0, 14.2), (1000.0, 34.0), (9000.0, 265.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_unknown_has_even_odds_at_twelve_and_a_share_of_what_is_explained(explained, threshold, side):
    """The share is 0.022, and as much again of what is explained beyond 6,500."""
    p = probabilities(found(Evidence("backlash", explained), excess=threshold + side))
    assert (p[UNKNOWN] > p["backlash"]) is (side > 0.0)


@pytest.mark.parametrize("explained", [1000.0, 1e5])
@pytest.mark.parametrize("times", [0.0, 0.2, 1.0, 5.0, 300.0])
def test_the_odds_of_unknown_grow_with_a_power_of_what_is_left_over(explained, times):
    threshold = 12.0 + 0.022 * (explained + max(explained - 6500.0, 0.0))
    p = probabilities(found(Evidence("backlash", explained), excess=times * threshold))
    assert p[UNKNOWN] == pytest.approx(exceeded(times))
    assert p["backlash"] == pytest.approx(1.0 - exceeded(times))


def test_without_any_excess_an_effect_of_no_catalogue_may_be_imitated():
    """About one in eighteen, whatever is explained."""
    for explained in (100.0, 1e5):
        p = probabilities(found(Evidence("backlash", explained)))
        assert p[UNKNOWN] == pytest.approx(1.0 / (1.0 + (1.03 / 0.03) ** 0.8))
        assert 1.0 / 19.0 < p[UNKNOWN] < 1.0 / 17.0


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_unknown_has_even_odds_where_departures_explain_a_sixth_and_a_hundred(side):
    # Of what departures add 0.12 counts as excess: 0.12 x 283.3 = 12 + 0.022 x 1000.
    p = probabilities(found(Evidence("backlash", 1000.0), departure_gain=283.333 + side))
    assert (p[UNKNOWN] > 0.5) is (side > 0.0)


@pytest.mark.parametrize(("strongest", "told", "misleading"), [(100.0, 1.3, 18.0), (1000.0, 4.0, 171.0)])
@pytest.mark.parametrize("difference", [1.0, 60.0])
def test_differences_of_evidence_are_divided_by_a_temperature_and_mislead_in_fifteen_of_a_hundred(
    strongest, told, misleading, difference
):
    """By one and three per mille of the strongest evidence; where they mislead, by one and 17 per cent of it."""
    p = probabilities(found(Evidence("backlash", strongest), Evidence("latency", strongest - difference)))
    second = 0.85 / (1.0 + E ** (difference / told)) + 0.15 / (1.0 + E ** (difference / misleading))
    assert p["latency"] / (p["backlash"] + p["latency"]) == pytest.approx(second)


def test_an_overwhelming_excess_leaves_nothing_for_none():
    """Whether an effect that explains nothing could be tested does not decide between `none` and `unknown`."""
    p = probabilities(found(Evidence("backlash", 1.0), explained=0.0, excess=1000.0))
    assert p[NONE] == pytest.approx(0.0, abs=1e-6)
    assert p[UNKNOWN] == pytest.approx(1.0 - p["backlash"])
    assert p["backlash"] == pytest.approx(1.0 / (1.0 + E**7))


def test_none_at_other_levels_counts_against_the_causes_too():
    """Nine, less eight and the prior's eight, whatever an alternative explains."""
    p = probabilities(found(Evidence("backlash", 9.0), excess=8.0), none_elsewhere=8.0)
    assert p["backlash"] == pytest.approx(1.0 / (1.0 + E**7))


def test_probabilities_without_any_effect_are_those_of_none_and_unknown():
    p = probabilities(found(excess=20.0))
    assert set(p) == {NONE, UNKNOWN}
    assert p[UNKNOWN] == pytest.approx(1.0 / (1.0 + E ** -(20.0 - 8.0)))


@pytest.mark.parametrize(
    ("gain", "explained", "expected"),
    [(8.0, 100.0, 0.0), (2.0, 100.0, 0.0), (22.2, 100.0, 0.34), (50.6, 100.0, 0.51), (1008.0, 0.0, 0.68 / 1.012)],
)
def test_a_further_effect_has_even_odds_where_it_explains_what_model_error_may(gain, explained, expected):
    """Of 0.8 that something is named and 0.85 that forms do not mislead; model error: 12, and 2.2 % of what is."""
    ranking = {"backlash": 0.8, NONE: 0.1, UNKNOWN: 0.1}
    assert presence_probability(gain, explained, ranking) == pytest.approx(expected)


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
