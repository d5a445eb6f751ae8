"""What follows a recorded quantity late: against the exact answer to a step and to a ramp."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.effects.memory import fading, following, lag_behind

TAU_S = 300.0


def test_what_follows_steps_comes_nearer_by_the_exponential_of_the_time_whatever_the_order_of_the_readings():
    t_s = np.concatenate([np.linspace(0.0, 600.0, 31), np.linspace(600.1, 2000.0, 70)])
    load = (t_s > 600.0).astype(np.float64)
    order = np.random.default_rng(1).permutation(len(t_s))
    got = np.empty(len(t_s))
    got[order] = following(t_s[order], load[order], TAU_S)
    assert got == pytest.approx(load * (1.0 - np.exp(-(t_s - 600.0) / TAU_S)), abs=1e-3)


def test_what_follows_a_ramp_stays_behind_by_its_time_constant():
    t_s = np.linspace(0.0, 6000.0, 500)
    got = lag_behind(t_s, 1e-3 * t_s, TAU_S)
    assert got == pytest.approx(-1e-3 * TAU_S * (1.0 - np.exp(-t_s / TAU_S)), abs=0.03 * 1e-3 * TAU_S)


def test_what_fades_is_the_sum_of_what_each_moment_has_added():
    rng = np.random.default_rng(2)
    t_s, added = np.cumsum(rng.uniform(5.0, 200.0, 40)), rng.normal(size=40)
    expected = [np.sum(added[: k + 1] * np.exp(-(t_s[k] - t_s[: k + 1]) / TAU_S)) for k in range(40)]
    assert fading(t_s, added, TAU_S) == pytest.approx(np.array(expected))
