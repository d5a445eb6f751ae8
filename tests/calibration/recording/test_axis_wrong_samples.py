"""Wrong samples of an axis are told from edges, fast waves, noise and rounding."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.recording.axis_wrong_samples import without_wrong_samples

TIME = 0.004 * np.arange(1500)
MOTOR = 0.5 * np.sin(1.3 * TIME) + 0.3 * np.sin(0.8 * TIME + 1.0)
NOISE = 2e-6 * np.random.default_rng(1).standard_normal(1500)


def play(half=3e-4):
    side, state = [], 0.0
    for step in np.diff(MOTOR, prepend=MOTOR[0]):
        state = min(1.0, max(-1.0, state + step / half))
        side.append(state)
    return -half * np.array(side)


def off(at, by, count=1):
    out = np.zeros(1500)
    out[at : at + count] = by
    return out


@pytest.mark.parametrize("of_motor", [False, True])
@pytest.mark.parametrize(("at", "by", "count"), [(700, 10.0, 1), (0, 2e-3, 1), (1497, -0.01, 3), (400, 1e-4, 2)])
def test_a_few_samples_that_are_off_are_mended(at, by, count, of_motor):
    second = MOTOR + play() + NOISE
    spoiled = off(at, by, count)
    given = (MOTOR + spoiled, second) if of_motor else (MOTOR, second + spoiled)
    motor, mended, (found,) = without_wrong_samples(TIME + 5.0, *given)
    assert (found.first, found.count) == (at, count)
    assert found.time_s == pytest.approx(0.004 * at)
    assert found.off == pytest.approx(by, abs=4e-4 if at == 0 else 2e-5)
    assert found.of_motor is of_motor
    np.testing.assert_allclose(mended - motor, second - MOTOR, atol=4e-4 if at == 0 else 2e-5)


def test_several_are_told_beside_one_another():
    spoiled = off(700, 0.1) + off(706, -0.1, 2) + off(900, 3.0)
    _, _, found = without_wrong_samples(TIME, MOTOR, MOTOR + play() + NOISE + spoiled)
    assert [(f.first, f.count) for f in found] == [(700, 1), (706, 2), (900, 1)]


@pytest.mark.parametrize(
    "gap",
    [
        play() + NOISE,
        play(),
        1e-3 * (TIME > 3.0) + NOISE,  # a slip
        off(700, 1e-3, 4) + NOISE,  # too long for a sample that is wrong
        1e-4
        * np.sin(2.0 * np.pi * np.arange(1500) / 3.1)
        * (np.abs(np.gradient(MOTOR)) > 1e-3),  # a fast wave in motion
        1e-5 * np.random.default_rng(2).laplace(size=1500),
        off(700, 1e-4) * 0.0 + np.round(play() + NOISE, 5),
        1e-3 * np.gradient(np.gradient(MOTOR)) / 1.6e-5 + NOISE,
    ],
)
def test_what_is_none_stays(gap):
    motor, second, found = without_wrong_samples(TIME, MOTOR, MOTOR + gap)
    assert found == ()
    assert motor is MOTOR
    np.testing.assert_array_equal(second, MOTOR + gap)


def test_flicker_by_rounding_stays():
    """A count or two of an encoder at rest, whose neighbours do not differ at all."""
    motor, second = np.round(MOTOR, 4), np.round(MOTOR, 4)
    assert without_wrong_samples(TIME, motor, second + off(700, 2e-4))[2] == ()
    assert len(without_wrong_samples(TIME, motor, second + off(700, 2e-3))[2]) == 1


def test_what_is_often_off_is_no_error_of_single_samples():
    spoiled = 1e-3 * (np.arange(1500) % 40 == 7)
    assert without_wrong_samples(TIME, MOTOR, MOTOR + NOISE + spoiled)[2] == ()
