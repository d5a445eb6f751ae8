"""Gaps that no drive should have, and some do: a scale that is off, nothing but rounding, many turns."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from calibration.axis.diagnose import diagnose_axis
from calibration.axis.effects import ripple_limits
from calibration.axis.likelihood import AxisLikelihood
from calibration.axis.ripple import finest_period, strongest_periods
from calibration.axis.signals import Signals
from calibration.diagnosis.periodogram import SHORTEST_M
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording

COUNT, STEP_S = 400, 0.02
TIME_S = STEP_S * np.arange(COUNT)
MOTOR = 0.07 * np.sin(1.3 * TIME_S) + 0.04 * np.sin(0.8 * TIME_S + 1.0)  # short, for the time a test takes


def recording(motor, second, **header):
    file = AxisFile(format=1, name="odd", **{"kind": "rotary", "time_unit": "s", "position_unit": "rad"} | header)
    return AxisRecording(file, TIME_S[: len(motor)], motor, second)


def noise(size, seed=1):
    return size * np.random.default_rng(seed).standard_normal(COUNT)


def with_play(half_play, half_width):
    """A second position that is behind by half a play, which is crossed within two half widths of motion."""
    side, state = [], 0.0
    for step in np.diff(MOTOR, prepend=MOTOR[0]):
        state = min(1.0, max(-1.0, state + step / half_width))
        side.append(state)
    return MOTOR - half_play * np.array(side) + noise(2e-6)


@pytest.mark.parametrize(
    "second",
    [
        MOTOR + 0.01,
        MOTOR + noise(1e-16),
        1.005 * MOTOR,
        1.02 * MOTOR,
        1.05 * MOTOR,
        np.round(MOTOR, 4) + 0.02,
        np.round(MOTOR + 0.01234, 4),
    ],
)
def test_what_is_no_more_than_rounding_is_none(second):
    motor = np.round(MOTOR, 4) if np.array_equal(second, np.round(second, 4)) else MOTOR
    found = diagnose_axis(recording(motor, second))
    assert found.verdict == "none"
    assert found.ranking["none"] > 0.99
    assert any("no more than the rounding of the positions" in remark for remark in found.remarks)


@pytest.mark.parametrize("scale", [0.95, 1.05])
def test_a_scale_that_is_off_is_no_weight(scale):
    found = diagnose_axis(recording(MOTOR, scale * MOTOR + noise(1e-5)))
    assert found.verdict == "none"
    (remark,) = [r for r in found.remarks if "scale" in r]
    assert float(remark.split()[4]) == pytest.approx(scale, abs=2e-5)
    assert "50 times its stated uncertainty of 0.001" in remark
    assert found.model.scale == pytest.approx(scale - 1.0, abs=2e-5)


def test_what_is_there_beside_a_scale_is_found():
    late = np.interp(TIME_S - 2e-3, TIME_S, MOTOR)
    found = diagnose_axis(recording(MOTOR, 1.05 * late + noise(1e-5)))
    assert found.verdict in {"delay", "viscous"}
    assert found.effects[0].size.value == pytest.approx(2.1e-3, abs=3.0 * found.effects[0].size.u)
    assert any("50 times its stated uncertainty" in remark for remark in found.remarks)


def test_a_weight_is_no_scale():
    """Its sine rises too, fifteen times as much as the scale may, but bends."""
    found = diagnose_axis(recording(MOTOR, MOTOR + 0.02 * np.sin(MOTOR + 0.7) + noise(1e-6)))
    assert found.verdict == "weight"
    assert found.remarks == ()  # what is left is rounded too, but the gap is not


@pytest.mark.parametrize("second_scale_u", [1e-3, 0.1])
def test_a_scale_within_its_uncertainty_says_nothing(second_scale_u):
    second = (1.0 + 2.0 * second_scale_u) * MOTOR + noise(1e-5)
    found = diagnose_axis(recording(MOTOR, second, second_scale_u=second_scale_u))
    assert (found.verdict, found.remarks) == ("none", ())


def test_many_turns_take_no_more_memory_than_a_few():
    """A ripple over tens of turns; a grid of micrometres over all of these would have a hundred million cells."""
    motor = 2.0 * np.pi * 20.0 * (TIME_S / TIME_S[-1] + 0.1 * np.sin(TIME_S))
    signals = Signals.of(recording(motor, motor + 1e-3 * np.sin(motor / 0.7) + noise(1e-5)))
    likelihood = AxisLikelihood.of(signals)
    tracemalloc.start()
    found = strongest_periods(likelihood, signals, *ripple_limits(signals))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 2e8
    assert any(period == pytest.approx(2.0 * np.pi * 0.7, rel=5e-3) for period, _ in found)


def test_a_grid_is_as_fine_as_ever_up_to_a_turn_and_beyond_as_fine_as_the_samples():
    assert finest_period(2.0 * np.pi, 0.01) == SHORTEST_M
    assert finest_period(628.0, 0.5) == 0.5
    assert finest_period(628.0, 1e-9) > SHORTEST_M


@pytest.mark.parametrize("of_motor", [False, True])
def test_one_wrong_sample_hides_nothing(of_motor):
    """Ten radians of one sample, where a play of a quarter of a milliradian is all there is."""
    second = with_play(2.5e-4, 2.5e-4)
    spike = 10.0 * (np.arange(COUNT) == 200)
    given = (MOTOR + spike, second) if of_motor else (MOTOR, second + spike)
    found = diagnose_axis(recording(*given))
    assert found.verdict in {"backlash", "coulomb"}
    assert found.effects[0].size.value == pytest.approx(2.5e-4, rel=0.05)
    name = "motor" if of_motor else "second position"
    assert f"1 wrong sample left out: at 4 s (10 rad off, {name})" in found.remarks
    assert [(w.first, w.count, w.of_motor) for w in found.left_out] == [(200, 1, of_motor)]


@pytest.mark.parametrize(("half_width", "names"), [(3e-4, {"backlash", "coulomb"}), (6e-4, {"coulomb"})])
def test_a_play_is_one_class_with_dry_friction_that_turns_round_within_its_windup(half_width, names):
    """A play is crossed within twice its half; friction may take longer. Samples in motion are farther apart."""
    found = diagnose_axis(recording(MOTOR, with_play(3e-4, half_width)))
    assert {found.verdict, *found.equivalent} == names
    assert found.effects[0].size.value == pytest.approx(3e-4, rel=0.05)
