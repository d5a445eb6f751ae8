"""Periods of transmission and scale: where they overlap both may be it, unless the machine file states one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.periodogram import Periodogram
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.test_context import inputs_of

SCREW, SCALE = "screw_periodic_error", "encoder_interpolation"


@pytest.fixture(scope="module")
def machine_and_context():
    recording = recorded(plant(60))
    return recording.machine, context_of_recording(recording)


def tried(machine_and_context, name: str, period_m: float, **stated_m: float) -> dict[float, float]:
    """Periods that an effect tries with a total prior weight, of a drive whose readings show one period."""
    machine, context = machine_and_context
    entry = machine.file.drives[0].model_copy(update=stated_m)
    file = machine.file.model_copy(update={"drives": (entry, *machine.file.drives[1:])})

    def periods(_drive, shortest_m, longest_m):
        return [(period_m, 0.5)] if shortest_m <= period_m <= longest_m else []

    inputs = replace(inputs_of(replace(machine, file=file), context), periods=periods)
    out: dict[float, float] = {}
    for basis_set in load_catalogue().effect(name).forms(inputs, 0).sets:
        period = basis_set.parameters["period_m"]
        out[period] = out.get(period, 0.0) + basis_set.weight
    return out


@pytest.mark.parametrize(
    ("period_m", "names"),
    [
        (2.1e-6, {SCALE}),
        (1.9e-4, {SCALE}),
        (2.1e-4, {SCREW, SCALE}),
        (5.9e-3, {SCREW, SCALE}),
        (6.1e-3, {SCREW}),
        (5.9e-2, {SCREW}),
    ],
)
def test_there_is_no_gap_between_scale_and_transmission(machine_and_context, period_m, names):
    assert {name for name in (SCREW, SCALE) if tried(machine_and_context, name, period_m)} == names


@pytest.mark.parametrize(("period_m", "usual"), [(3.9e-3, SCALE), (4.1e-3, SCREW)])
def test_where_both_may_be_it_the_usual_one_is_ten_times_as_likely(machine_and_context, period_m, usual):
    (other,) = {SCREW, SCALE} - {usual}
    ratio = (
        tried(machine_and_context, usual, period_m)[period_m] / tried(machine_and_context, other, period_m)[period_m]
    )
    assert ratio == pytest.approx(10.0)


@pytest.mark.parametrize("period_m", [5e-3, 2.5e-3, 5e-3 / 3.0])
@pytest.mark.parametrize(("key", "left"), [("lead_m", SCREW), ("tooth_m", SCREW), ("scale_pitch_m", SCALE)])
def test_a_period_that_the_machine_file_states_is_of_that_part(machine_and_context, period_m, key, left):
    assert {name for name in (SCREW, SCALE) if tried(machine_and_context, name, period_m, **{key: 5e-3})} == {left}


def test_a_period_that_is_stated_of_both_or_of_none_may_be_of_both(machine_and_context):
    both = {"lead_m": 5e-3, "scale_pitch_m": 5e-3}
    for stated, period_m in ((both, 5e-3), ({"lead_m": 5e-3}, 3e-3)):
        assert all(tried(machine_and_context, name, period_m, **stated) for name in (SCREW, SCALE))


def test_positions_that_are_rounded_resolve_no_shorter_periods_than_four_steps():
    q = np.random.default_rng(1).uniform(0.0, 0.5, 200)
    of_step = {step: Periodogram.from_scores(np.round(q / step) * step, q, 1.0).shortest_m for step in (1e-5, 1e-6)}
    assert of_step == pytest.approx({1e-5: 4e-5, 1e-6: 4e-6})
    assert Periodogram.from_scores(q, q, 1.0).shortest_m == 2e-6


@pytest.mark.parametrize(("count", "shortest_m"), [(95, 1e-5), (105, 2e-6)])
def test_few_positions_resolve_no_periods_below_those_of_common_scales(count, shortest_m):
    """A quarter of anything is explained by the best of 250,000 waves where 99 places are measured, however often."""
    q = np.repeat(np.linspace(0.0, 0.5, count) + 1e-4 * np.random.default_rng(1).random(count), 7)
    assert Periodogram.from_scores(q, q, 1.0).shortest_m == shortest_m


def test_a_screw_and_its_pulley_are_one_error_of_two_periods(machine_and_context):
    """Of three periods any two may be it together, if the travel tells them apart; its period is the longer one."""
    machine, context = machine_and_context
    q, travel_m = context.drives[:, 0], float(np.ptp(context.drives[:, 0]))
    long_m, short_m = 8.0e-3, 5.0e-3
    near_m = 1.0 / (1.0 / short_m + 0.5 / travel_m)

    def periods(_drive, shortest_m, longest_m):
        return [(p, 0.1) for p in (short_m, long_m, near_m) if shortest_m <= p <= longest_m]

    built = load_catalogue().effect(SCREW).forms(replace(inputs_of(machine, context), periods=periods), 0)
    of_two = [basis_set for basis_set in built.sets if len(basis_set.main) == 4]
    assert [basis_set.parameters["period_m"] for basis_set in of_two] == [long_m, long_m]
    assert all(basis_set.weight == pytest.approx(0.01) for basis_set in of_two)
    law = 0.7 * np.sin(2.0 * np.pi * q / long_m + 1.0) + 0.6 * np.sin(2.0 * np.pi * q / short_m)
    for basis_set, exact in zip(of_two, (True, False), strict=True):
        columns = np.stack([built.contributions[c][0][1] for c in basis_set.columns], axis=1)
        left = law - columns @ np.linalg.lstsq(columns, law, rcond=None)[0]
        assert bool(np.sum(left**2) < 1e-12 * np.sum(law**2)) is exact
