"""Periods along a drive, against sines that the test draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.effect_inputs import CHANGING_BY_CHANCE, _periodogram_of_changing_waves
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.periodogram import SHORTEST_M, Periodogram


def positions(count: int, span: float = 0.9, seed: int = 1) -> np.ndarray:
    return 0.4 + span * np.sort(np.random.default_rng(seed).random(count))


@pytest.mark.parametrize("period_m", [2.3e-6, 4.0e-6, 2.0e-5, 1.3e-4, 4.7e-4, 2.0e-3, 5.0e-3, 1.0e-2, 2.3e-2, 4.0e-2])
def test_a_sine_is_found_to_a_thousandth(period_m):
    rng = np.random.default_rng(3)
    q = positions(240)
    y = 3.0 * np.sin(2.0 * np.pi * q / period_m + 0.7) + 0.3 * rng.standard_normal(len(q))
    periodogram = Periodogram.from_scores(q, y, float(len(q)))
    period, prior = periodogram.strongest_periods(max(0.5 * period_m, SHORTEST_M), 3.0 * period_m)[0]
    assert period == pytest.approx(period_m, rel=1e-3)
    assert 0.0 < prior < 1.0


@pytest.mark.parametrize("period_m", [4.7e-4, 5.0e-3, 4.0e-2])
def test_a_coarser_one_finds_the_same_sine_and_nothing_finer(period_m):
    q = positions(240)
    y = 3.0 * np.sin(2.0 * np.pi * q / period_m + 0.7) + 0.3 * np.random.default_rng(3).standard_normal(len(q))
    coarse, fine = (Periodogram.from_scores(q, y, 240.0, finest_m) for finest_m in (2.0e-4, SHORTEST_M))
    (found, _), (also_found, _) = (p.strongest_periods(2.0e-4, 6.0e-2)[0] for p in (coarse, fine))
    assert found == pytest.approx(period_m, rel=1e-3)
    assert found == pytest.approx(also_found, rel=1e-3)
    assert len(coarse.power) < len(fine.power) / 50
    assert coarse.strongest_periods(SHORTEST_M, 1.0e-4) == []


def test_power_is_the_likelihood_ratio_of_a_sine():
    """Against least squares at the same frequency."""
    rng = np.random.default_rng(4)
    q = positions(200)
    y = np.sin(2.0 * np.pi * q / 0.011) + rng.standard_normal(len(q))
    periodogram = Periodogram.from_scores(q, y, float(len(q)))
    for k in np.linspace(100, 20_000, 12).astype(int):
        phase = 2.0 * np.pi * periodogram.frequency[k] * q
        x = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
        assert periodogram.power[k] == pytest.approx(y @ y - left @ left, abs=0.25 + 0.25 * periodogram.power[k])


def test_noise_has_the_power_that_chi_squared_has():
    rng = np.random.default_rng(5)
    q = positions(300)
    periodogram = Periodogram.from_scores(q, rng.standard_normal(300), 300.0)
    inside = periodogram.power[(periodogram.frequency > 20.0) & (periodogram.frequency < 5e4)]
    assert inside.mean() == pytest.approx(2.0, rel=0.1)
    assert np.mean(inside > 2.0 * np.log(100.0)) == pytest.approx(0.01, rel=0.5)


def test_weights_count():
    """Readings that know nothing of the drive (score zero) change nothing but the scale."""
    q = positions(150)
    y = np.sin(2.0 * np.pi * q / 0.008)
    mixed = Periodogram.from_scores(np.concatenate([q, q]), np.concatenate([y, 0.0 * y]), 150.0)
    plain = Periodogram.from_scores(q, y, 150.0)
    np.testing.assert_allclose(mixed.power, plain.power, rtol=1e-9, atol=1e-9)


def test_peaks_lie_within_limits_and_priors_add_up_to_one_at_most():
    q = positions(200)
    periodogram = Periodogram.from_scores(q, np.random.default_rng(6).standard_normal(200), 200.0)
    peaks = periodogram.strongest_periods(4e-3, 4e-2)
    assert peaks
    assert all(0.9 * 4e-3 < p < 1.1 * 4e-2 for p, _ in peaks)
    assert sum(prior for _, prior in peaks) <= 1.0


@pytest.mark.parametrize("q", [np.full(50, 0.7), np.array([0.5]), np.linspace(0.5, 0.5 + 1e-7, 30)])
def test_a_drive_that_stands_still_has_no_period(q):
    periodogram = Periodogram.from_scores(q, np.ones(len(q)), float(len(q)))
    assert periodogram.strongest_periods(4e-3, 4e-2) == []


def test_waves_whose_size_changes_its_sign_are_found_by_what_changes_them():
    """In noise of twice their size no constant wave shows them; several changes add up to one power."""
    rng = np.random.default_rng(9)
    q, t = rng.uniform(0.4, 1.3, 400), np.linspace(-1.0, 1.0, 400)
    by = np.column_stack([t, rng.choice([-1.0, 1.0], 400)])
    wave = np.sin(2.0 * np.pi * q / 4.3e-4 + 0.4) * (t + 0.5 * by[:, 1])
    y = wave + 1.3 * rng.standard_normal(400)
    changing = Periodogram.from_scores(q, y[:, None] * by, np.sum(by**2, axis=0), 1e-5)
    (period_m, _), *_ = changing.strongest_periods(1e-5, 6e-3, by_chance=CHANGING_BY_CHANCE)
    assert period_m == pytest.approx(4.3e-4, rel=1e-3)
    constant = Periodogram.from_scores(q, y, 400.0, 1e-5)
    assert constant.strongest_periods(1e-5, 6e-3, by_chance=CHANGING_BY_CHANCE) == []
    each = [Periodogram.from_scores(q, y * change, float(np.sum(change**2)), 1e-5).power for change in by.T]
    np.testing.assert_allclose(changing.power, np.sum(each, axis=0), rtol=1e-4, atol=1e-3)


def test_much_that_no_wave_explains_gives_no_period_of_changing_waves():
    rng = np.random.default_rng(10)
    q, by = rng.uniform(0.4, 1.3, 400), rng.choice([-1.0, 1.0], (400, 2))
    y = 4.0 * rng.standard_normal(400)
    loud = Periodogram.from_scores(q, y[:, None] * by, np.sum(by**2, axis=0), 1e-5)
    assert loud.power.max() > 300.0
    assert loud.level == pytest.approx(16.0, rel=0.3)
    assert loud.strongest_periods(1e-5, 6e-3, by_chance=CHANGING_BY_CHANCE) == []
    assert Periodogram.from_scores(q, y[:, None] * by / 40.0, np.sum(by**2, axis=0), 1e-5).level == 1.0


@pytest.fixture(scope="module")
def on_a_rig(strong):
    return MarginalLikelihood.of(linearise_recording(strong))


@pytest.mark.parametrize("change", ["side", "time", "warmth"])
def test_waves_that_change_are_found_in_readings_of_a_rig(on_a_rig, change):
    """A wave on the left drive, in what the station reads: its power and period there, and none on the right one."""
    linear, context = on_a_rig.linear, on_a_rig.linear.context
    heat = context.motion_heat(0, 900.0)
    by = {
        "side": context.direction[:, 0],
        "time": np.cos(np.pi * context.elapsed_s / context.elapsed_s.max()),
        "warmth": (heat - heat.mean()) / heat.std(),
    }[change]
    wave = by * np.sin(2.0 * np.pi * context.drives[:, 0] / 3.1e-3)
    shift = on_a_rig.response("travel.left") * wave[:, None]
    noise = np.random.default_rng(12).standard_normal(shift.shape)
    of_wave = on_a_rig.on(replace(linear, residual=2.0 * shift / np.std(shift) + noise))
    (period_m, _), *_ = _periodogram_of_changing_waves(of_wave, 0).strongest_periods(
        1e-3, 6e-2, by_chance=CHANGING_BY_CHANCE
    )
    assert period_m == pytest.approx(3.1e-3, rel=2e-3)
    assert _periodogram_of_changing_waves(of_wave, 1).strongest_periods(1e-3, 6e-2, by_chance=CHANGING_BY_CHANCE) == []
    # Without rig time nothing is known of time and warmth, and what changes with them is not found.
    timeless = replace(linear.context, missing={"t_s": "nobody wrote it down"})
    of_side = _periodogram_of_changing_waves(on_a_rig.on(replace(of_wave.linear, context=timeless)), 0)
    assert of_side.score.shape[1] == 1
    assert bool(of_side.strongest_periods(1e-3, 6e-2, by_chance=CHANGING_BY_CHANCE)) == (change == "side")
