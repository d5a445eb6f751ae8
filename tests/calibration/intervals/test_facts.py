"""Facts are checked when they are made."""

from __future__ import annotations

import math

import pytest

from calibration.base.errors import InputError
from calibration.intervals.facts import ErrorFigure, EventFact, InstrumentFact, Postponement, Tolerance
from tests.calibration.intervals.facts_for_tests import DAY_S, START_S, calibration, check, history, machine


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Tolerance(START_S, 0.0), "not above zero"),
        (lambda: Tolerance(math.nan, 1e-5), "finite"),
        (lambda: machine(tolerances=()), "has no tolerance"),
        (lambda: machine(parameter_names=("a", "a")), "'a' is there twice"),
        (lambda: machine(tolerances=(Tolerance(2.0, 1e-5), Tolerance(1.0, 1e-5))), "clock was set back"),
        (lambda: InstrumentFact("T1", "c", math.inf), "finite"),
        (lambda: ErrorFigure(-1e-6, 1e-6), "below zero"),
        (lambda: calibration(parameters=(1.0,)), "needs 2 finite parameters"),
        (lambda: calibration(parameters=(1.0, math.inf)), "finite parameters"),
        (lambda: calibration(covariance=((1.0,),)), "2 by 2"),
        (lambda: calibration(covariance=((1.0, 0.5), (0.2, 1.0))), "symmetric"),
        (lambda: calibration(covariance=((1e-12, 2e-12), (2e-12, 1e-12))), "negative variance"),
        (lambda: calibration(extent="some"), "extent 'some'"),
        (lambda: check(change=(1.0,)), "needs 2 changes"),
        (lambda: check(change_u=(1e-6, 0.0)), "above zero"),
        (lambda: check(change=(math.nan, 0.0)), "finite"),
        (lambda: check(reference_u=(math.nan, 0.0)), "not below zero"),
        (lambda: check(error_per_change=(-1.0, 0.0)), "not below zero"),
        (lambda: check(independent=2.5), "2 watched changes"),
        (lambda: check(known_alignment=(0.1,)), "a correlation for each"),
        (lambda: check(known_alignment=(0.1, 2.0)), "a correlation for each"),
        (lambda: check(poses=0), "at least one"),
        (lambda: EventFact(START_S, "flood"), "'flood'"),
        (lambda: Postponement(2.0, 1.0, "A", "b"), "ends before"),
        (lambda: Postponement(1.0, 2.0, "", "b"), "needs a name"),
        (lambda: history(checks=(check(1, calibration="c9"),)), "c9, which is not there"),
        (lambda: history(checks=(check(1, START_S - 1.0),)), "older than its calibration"),
        (lambda: history(checks=(check(2), check(1))), "number 2 is 604800 s older"),
        (lambda: history(checks=(check(1), check(1))), "'h1' is there twice"),
        (lambda: history(instruments=(InstrumentFact("", "c", 1.0),)), "a name is empty"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(make, words):
    with pytest.raises(InputError) as refused:
        make()
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_row_is_added_only_behind_the_last_one():
    grown = history().with_check(check(1)).with_check(check(2)).with_event(EventFact(START_S + DAY_S, "collision"))
    assert [c.id for c in grown.checks_since_calibration()] == ["h1", "h2"]
    assert [e.kind for e in grown.events_since_calibration()] == ["collision"]
    assert grown.last_time_utc_s == check(2).t_utc_s
    with pytest.raises(InputError, match="set back"):
        grown.with_check(check(3, START_S + DAY_S))
    with pytest.raises(InputError, match="twice"):
        grown.with_calibration(calibration(t_utc_s=START_S + 400 * DAY_S))


def test_after_a_calibration_checks_and_events_begin_anew():
    grown = history(checks=(check(1),), events=(EventFact(START_S + DAY_S, "collision"),))
    anew = grown.with_calibration(calibration("c2", START_S + 30 * DAY_S))
    assert anew.last_calibration is not None
    assert anew.last_calibration.id == "c2"
    assert anew.checks_since_calibration() == ()
    assert anew.events_since_calibration() == ()


def test_the_tolerance_is_that_of_the_day():
    fact = machine(tolerances=(Tolerance(START_S, 25e-6), Tolerance(START_S + DAY_S, 15e-6)))
    assert fact.tolerance_m(START_S - 1.0) == 25e-6
    assert fact.tolerance_m(START_S + DAY_S) == 15e-6


def test_changes_are_standardised_one_by_one():
    assert check(change=(4e-6, -3e-6)).standardised() == pytest.approx([2.0, -1.0])


def test_a_machine_without_rows_has_no_last_time():
    assert history(calibrations=()).last_time_utc_s == -math.inf
    assert history(calibrations=()).last_calibration is None
