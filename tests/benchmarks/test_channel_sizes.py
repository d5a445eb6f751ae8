"""What a true effect does at channels that an answer names (benchmarks/withheld/channel_sizes.py)."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scoring.goals import sizes
from benchmarks.withheld import lane
from benchmarks.withheld.cases import Slot
from benchmarks.withheld.channel_sizes import compared, true_amounts
from benchmarks.withheld.designs import FEW, Designs
from benchmarks.withheld.diagnoser import REAL
from benchmarks.withheld.maker import Maker
from benchmarks.withheld.making import make_case
from benchmarks.withheld.scorer import fixed_answers, score_batch
from calibration.diagnosis.channel_responses import ChannelResponses
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linear_model import linearise_recording
from calibration.recording.folder import read_folder
from mock_devices.recordings.files import write_recording

EFFECT = Slot("effect-a", "effect", ("backlash",), (5.0,))
LEFT, RIGHT = "travel.left", "travel.right"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recording's folder, its linear model and how many readings it has."""
    folder = tmp_path_factory.mktemp("recording")
    case = make_case(EFFECT, np.random.default_rng(5), Designs(3, FEW), final=False)
    write_recording(case.recording, folder / "a")
    return folder / "a", linearise_recording(read_folder(folder / "a"), judge=False), len(case.change_m)


def change_along(linear, readings, by_name):
    """A change of all readings that has an amplitude (v,) at each visit along each channel."""
    change = np.zeros((readings, 3))
    visits = linear.context.arrival
    channels = Channels(linear)
    change[linear.rows] = sum(channels.shift_m(name) * of[visits, None] for name, of in by_name.items())
    return change


def test_the_amount_at_a_channel_is_what_was_put_there(made):
    _, linear, readings = made
    rng = np.random.default_rng(2)
    visits = linear.context.arrival
    left, right = 4e-6 + 1e-5 * rng.normal(size=(2, visits.max() + 1))
    amounts = true_amounts(
        linear, [LEFT, RIGHT], change_along(linear, readings, {LEFT: left, RIGHT: right}), ChannelResponses(linear)
    )
    responding = np.any(Channels(linear).shift_m(LEFT) != 0.0, axis=1)
    at_readings = left[visits[responding]]
    assert amounts[LEFT].rms == pytest.approx(np.sqrt(np.mean(at_readings**2)), rel=1e-6)
    assert amounts[LEFT].about_mean == pytest.approx(at_readings.std(), rel=1e-6)
    assert amounts[RIGHT].rms != pytest.approx(amounts[LEFT].rms, rel=1e-3)


def test_channels_that_readings_cannot_tell_apart_have_no_amount(made):
    _, linear, readings = made
    ones = np.ones(linear.context.arrival.max() + 1)
    names = [f"length.{strut}" for strut in linear.machine.strut_names]
    assert len(names) > len(linear.machine.dof)
    assert (
        true_amounts(linear, names, change_along(linear, readings, {names[0]: 1e-5 * ones}), ChannelResponses(linear))
        == {}
    )


def test_the_channel_of_the_largest_amount_is_compared_at_each_place(made):
    folder, linear, readings = made
    ones = np.ones(linear.context.arrival.max() + 1)
    change = change_along(linear, readings, {LEFT: 2e-5 * ones, RIGHT: 1e-5 * ones})
    found = {
        "places": [
            {"at_channels": [{"name": LEFT, "value": 1.9e-5, "u": 1e-6, "unit": "m"}]},
            {
                "at_channels": [
                    {"name": "turn.right.z", "value": 1e-7, "u": 1e-6, "unit": "rad"},
                    {"name": RIGHT, "value": 9e-6, "u": 1e-6, "unit": "m"},
                    {"name": "sideways.right.y", "value": 0.0, "u": 0.0, "unit": "m"},
                ]
            },
        ]
    }
    at_left, at_right = compared(folder, found, change)
    assert (at_left["channel"], at_right["channel"]) == (LEFT, RIGHT)
    assert at_left["true"] == pytest.approx(2e-5, rel=1e-6)
    assert at_left["true_about_mean"] == pytest.approx(0.0, abs=1e-10)
    assert at_right["true"] == pytest.approx(1e-5, rel=1e-6)
    assert at_right["stated"] == 9e-6


def test_an_effect_found_twice_at_one_channel_is_compared_once(made):
    folder, linear, readings = made
    change = change_along(linear, readings, {LEFT: np.full(linear.context.arrival.max() + 1, 5e-5)})
    twice = [
        {"at_channels": [{"name": LEFT, "value": v, "u": u, "unit": "m"}]} for v, u in ((4e-5, 1e-5), (3e-5, 5e-6))
    ]
    (amount,) = compared(folder, {"places": twice}, change)
    assert amount["stated"] == pytest.approx(5e-5)
    assert amount["u"] == pytest.approx(np.hypot(0.8 * 1e-5, 0.6 * 5e-6))


def test_a_diagnosed_case_is_compared_with_its_plant(tmp_path):
    alike = ("tracker_drift",)  # what else resembles the effect is not asked here
    maker = Maker(4, final=False, slots=[EFFECT], few_designs=True, leave_form_out=False, resembling=alike)
    maker.make(tmp_path / "recordings")
    lane.diagnose(tmp_path / "recordings", tmp_path / "answers", REAL)
    maker.seal(tmp_path / "truth.json", fixed_answers(tmp_path))
    (row,) = score_batch(tmp_path)
    assert row["verdict"] == "backlash"
    (amount,) = row["at_channels"]
    assert amount["channel"].startswith("travel.")
    assert 1e-6 < amount["true"] < 1e-3
    assert abs(amount["stated"] - amount["true"]) < 0.3 * amount["true"]


def test_amounts_within_twice_their_u_are_counted():
    def at(stated):
        return {"channel": LEFT, "stated": stated, "u": 1.0, "true": 5.0, "true_about_mean": 5.0}

    (_, measure) = sizes([{"at_channels": [at(6.9), at(7.1)]}, {"at_channels": [at(3.1)]}, {"at_channels": []}, {}])
    assert measure.name == "size at its channel within its U (k = 2)"
    assert (measure.value, measure.n) == (pytest.approx(2.0 / 3.0), 3)
