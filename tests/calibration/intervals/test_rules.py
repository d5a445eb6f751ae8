"""Each rule alone, all together, and what is refused before any of them speaks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals import rules
from calibration.intervals.extent import what_to_measure
from calibration.intervals.facts import ErrorFigure, EventFact, Postponement, Tolerance
from calibration.intervals.health import health_test
from calibration.intervals.settings import IntervalSettings
from calibration.intervals.validity import comparable, require_certificate
from tests.calibration.intervals.facts_for_tests import (
    DAY_S,
    NAMES,
    START_S,
    WEEK_S,
    calibration,
    check,
    history,
    machine,
)

SETTINGS = IntervalSettings()
NOW = START_S + 8 * WEEK_S


def quiet(count=8, **last):
    rows = [check(i) for i in range(1, count)]
    return history(checks=(*rows, check(count, **last)))


def rule_states(verdict):
    return {r.rule: r.state for r in verdict.results}


def test_a_quiet_machine_is_fit_and_says_when_it_will_be_due():
    verdict = rules.judge_all(quiet(), SETTINGS, NOW)
    assert verdict.state == "fit"
    assert verdict.exit_status == 0
    assert set(rule_states(verdict).values()) == {"fit"}
    assert verdict.measurement is None
    assert verdict.due_utc_s <= START_S + 365.0 * DAY_S
    assert verdict.reasons == ()


def test_calendar_counts_full_calibrations_only():
    facts = quiet().with_calibration(calibration("c2", NOW, extent="expansion"))
    at = START_S + 365.0 * DAY_S
    assert rules.calendar(facts, SETTINGS, at - 1.0).state == "fit"
    assert rules.calendar(facts, SETTINGS, at).state == "due"
    assert rules.calendar(history(calibrations=()), SETTINGS, at).state == "due"


def test_operating_hours_count_since_the_calibration():
    limited = replace(SETTINGS, operating_h=300.0)
    assert rules.operating_hours(quiet(), limited, NOW).state == "due"
    assert rules.operating_hours(quiet(7), limited, NOW).state == "fit"
    with pytest.raises(InputError, match="operating hours"):
        rules.operating_hours(quiet(operating_h=10.0), limited, NOW)


@pytest.mark.parametrize(("warm_c", "state"), [(24.9, "fit"), (25.1, "due"), (17.1, "fit"), (16.9, "due")])
def test_temperature_counts_on_both_sides(warm_c, state):
    assert rules.temperature(quiet(temperature_c=warm_c), SETTINGS, NOW).state == state


def test_an_event_since_the_calibration_is_due():
    struck = quiet().with_event(EventFact(NOW, "collision", "left"))
    assert rules.event(struck, SETTINGS, NOW).state == "due"
    assert "collision left" in rules.event(struck, SETTINGS, NOW).reason
    assert rules.event(struck.with_calibration(calibration("c2", NOW + 1.0)), SETTINGS, NOW + 2.0).state == "fit"
    assert rules.event(quiet().with_event(EventFact(NOW, "tolerance changed")), SETTINGS, NOW).state == "fit"


def test_a_check_beyond_its_limit_is_due():
    found = rules.check_limit(quiet(change=(1.2e-5, 0.0)), SETTINGS, NOW)
    assert found.state == "due"
    assert "drive_scale.left off by +5." in found.reason
    assert rules.check_limit(quiet(change=(3e-6, 0.0)), SETTINGS, NOW).state == "fit"


@pytest.mark.parametrize(("count", "marked"), [(8, True), (30, False)])
def test_limits_are_marked_provisional_until_the_machine_has_its_own_history(count, marked):
    found = rules.check_limit(quiet(count), SETTINGS, START_S + (count + 1) * WEEK_S)
    assert ("(provisional)" in found.reason) is marked


def test_another_instrument_s_first_difference_is_no_alarm():
    found = rules.check_limit(quiet(change=(1.2e-5, 0.0), instrument="T2"), SETTINGS, NOW)
    assert found.state == "fit"


@pytest.mark.parametrize(
    ("error_um", "state"), [(20.0, "fit"), (24.0, "due"), (26.0, "due"), (28.0, "out of tolerance")]
)
def test_the_error_is_decided_with_a_guard_band(error_um, state):
    found = rules.check_limit(quiet(error=ErrorFigure(error_um * 1e-6, 1.5e-6)), SETTINGS, NOW)
    assert found.state == state


def test_a_tolerance_that_was_tightened_counts_from_its_day_on():
    tight = machine(tolerances=(Tolerance(START_S, 25e-6), Tolerance(NOW, 12e-6)))
    facts = replace(quiet(error=ErrorFigure(14e-6, 1e-6)), machine=tight)
    assert rules.check_limit(facts, SETTINGS, NOW - 1.0).state == "fit"
    assert rules.check_limit(facts, SETTINGS, NOW).state == "out of tolerance"


def test_wear_is_due_before_the_next_slot_and_not_earlier():
    def worn(count):
        return history(checks=tuple(check(i, change=(1.9e-6 * i, 0.0)) for i in range(1, count + 1)))

    assert rules.predicted(worn(6), SETTINGS, START_S + 6 * WEEK_S).state == "fit"
    assert rules.predicted(worn(15), SETTINGS, START_S + 15 * WEEK_S).state == "due"


def test_the_worst_state_counts_and_reasons_are_given():
    facts = quiet(error=ErrorFigure(40e-6, 1.5e-6), temperature_c=26.0)
    verdict = rules.judge_all(facts, SETTINGS, NOW)
    assert verdict.state == "out of tolerance"
    assert verdict.exit_status == 1
    assert [r.split(":")[0] for r in verdict.reasons] == ["temperature", "check"]
    assert verdict.measurement.extent == "full"
    assert verdict.due_utc_s == NOW
    due = rules.judge_all(quiet(temperature_c=26.0), SETTINGS, NOW)
    assert (due.exit_status, due.measurement.extent) == (10, "expansion")


def test_the_next_check_s_limits_are_known_before_it():
    looks = health_test(quiet(), SETTINGS, check(9, poses=12)).looks
    assert list(looks.upper) == sorted(looks.upper, reverse=True)
    assert looks.miss < 0.12


def test_a_clock_set_back_is_refused():
    with pytest.raises(InputError, match="clock was set back"):
        rules.judge_all(quiet(), SETTINGS, NOW - DAY_S)
    rules.judge_all(quiet(), SETTINGS, NOW - 30.0)


def test_a_tolerance_below_2_u_is_refused_with_the_figure():
    with pytest.raises(InputError, match=r"below 2 U = 28\.0 um"):
        rules.judge_all(quiet(error=ErrorFigure(3e-6, 7e-6)), SETTINGS, NOW)


def test_renamed_parameters_begin_another_history():
    renamed = replace(quiet(), machine=machine(parameter_names=("drive_scale.left", "new_name")))
    kept, remarks = comparable(renamed)
    assert kept.calibrations == ()
    assert kept.checks == ()
    assert "drive_offset.left, new_name" in remarks[0]
    assert "begins anew" in remarks[0]
    assert rules.judge_all(renamed, SETTINGS, NOW).state == "due"
    reordered = replace(quiet(), machine=machine(parameter_names=NAMES[::-1]))
    assert comparable(reordered)[1] == ()


def test_another_instrument_is_said():
    _, remarks = comparable(quiet(instrument="T2"))
    assert remarks == (
        "check h8: instrument T2 in place of T1: its first difference is not taken for a change of the machine",
    )


def test_a_certificate_must_be_known_and_valid():
    require_certificate(history(), "T1", NOW)
    with pytest.raises(InputError, match="expired"):
        require_certificate(history(), "T1", START_S + 500 * DAY_S)
    with pytest.raises(InputError, match="has no certificate"):
        require_certificate(history(), "T9", NOW)


def test_a_postponement_ends_and_does_not_outlive_a_new_event():
    facts = replace(quiet(), postponements=(Postponement(NOW, NOW + WEEK_S, "A. Person", "urgent parts"),))
    assert rules.is_postponed(facts, NOW + DAY_S)
    assert not rules.is_postponed(facts, NOW + WEEK_S)
    assert not rules.is_postponed(facts.with_event(EventFact(NOW + DAY_S, "collision")), NOW + 2 * DAY_S)


def test_least_is_measured():
    lost, hit = EventFact(NOW, "reference lost", "left"), EventFact(NOW, "collision", "left")
    assert what_to_measure(("event",), (lost,)).extent == "drive offset"
    assert what_to_measure(("event",), (lost, lost)).drives == ("left",)
    assert what_to_measure(("event",), (lost,)).visits <= 10
    assert what_to_measure(("event",), (lost, hit)).extent == "full"
    assert what_to_measure(("event", "check"), (lost,)).extent == "full"
    assert what_to_measure(("event",), (EventFact(NOW, "reference lost"),)).extent == "full"
    assert what_to_measure(("temperature",), ()).extent == "expansion"
    assert what_to_measure(("temperature",), (lost,)).extent == "full"
    assert what_to_measure(("check",), ()).extent == "full"


@pytest.mark.parametrize(
    "make",
    [
        lambda: IntervalSettings(calendar_s=0.0),
        lambda: IntervalSettings(slot_s=np.inf),
        lambda: IntervalSettings(temperature_k=np.nan),
        lambda: IntervalSettings(drift=rules.IntervalSettings().drift.__class__(full_poses=8)),
    ],
)
def test_settings_that_cannot_be_are_refused(make):
    with pytest.raises(InputError):
        make()
