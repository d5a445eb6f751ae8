"""Laws of what drives report, of payloads that press, of cooling, guides and a station's feet: as `test_structures`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose
from calibration.effects.context import context_of_recording
from tests.calibration.diagnosis.campaigns import Arrivals, changed, simulated
from tests.calibration.effects.general_functions import typical_inputs
from tests.calibration.effects.test_structures import LEAST, explained, faded, moved_m, scaled

REPORTED_SHARE = 0.4  # of its error that a drive's encoder sees


@pytest.fixture(scope="module")
def long_inputs():
    """So many visits that no curve goes through all of them."""
    inputs = typical_inputs(160)
    errors_m = 1e-5 * np.random.default_rng(5).standard_normal((len(inputs.context.history.arrived_s), 2))
    late = np.exp(-inputs.context.dwell_s / 5.0)[:, None]
    return replace(inputs, context=replace(inputs.context, following_error_m=errors_m[inputs.context.arrival] * late))


def servo_settling__reported(inputs):
    """It stops anywhere within a window and closes up; its encoder sees a share of that."""
    return {"travel.left": -2.0 * inputs.context.following_error_m[:, 0] * ~inputs.context.moving}


def foundation_settling__pressed(inputs):
    """Whatever brings a payload presses the foot down, each time by another amount."""
    numbers = inputs.context.exchanges.astype(int)
    sinks = np.random.default_rng(6).uniform(0.2, 1.0, numbers.max() + 1)
    sinks[0] = 0.0
    return {"travel.left": -np.cumsum(sinks)[numbers]}


def screw_thermal_growth__cooled(inputs):
    """Oil that flows as soon as it is too warm, nine times; the screw is held in its middle."""
    return {"travel.left": np.cos(18.0 * np.pi * scaled(inputs.context.elapsed_s)) * inputs.normalised_travel(0)}


def friction_windup__in_its_guides(inputs):
    """What the struts press the carriage aside into its guides, whatever they pull along them."""
    across_n = np.abs(inputs.pull_n[:, 0] @ np.array([1.0, 0.0, 0.0]))
    return {"travel.left": -inputs.context.direction[:, 0] * across_n}


def tracker_drift__levelled(inputs):
    """A foot sinks, and somebody levels the station, twice."""
    leans = 1.0 - np.exp(-2.0 * (scaled(inputs.context.elapsed_s) * 2.5 % 1.0))
    return {"station.rx": leans, "station.ry": -0.4 * leans, "station.z": 0.2 * leans}


def servo_settling__wound_up(inputs):
    """Integral action, wound up over every way as far as its limit lets it, carries the drive on and unwinds."""
    limited = np.clip(moved_m(inputs, 0) / 0.12, -1.0, 1.0)
    return {"travel.left": faded(inputs, limited, 2.0)}


def guide_straightness__pushed_by_the_next(inputs):
    """The other carriage pushes this one aside as it comes abreast; by how much in the mean is calibrated."""
    pushed = np.exp(-(((inputs.context.drives[:, 1] - inputs.context.drives[:, 0]) / 0.3) ** 2))
    return {"sideways.left.x": pushed - pushed.mean()}


def payload__parts_wait(inputs):
    """Somebody lays parts onto the platform and takes them away again, whatever is mounted."""
    return {"payload.mass": np.floor(4.0 * scaled(inputs.context.elapsed_s)) % 3.0}


def payload__rope(inputs):
    """A rope's friction adds to the pull of a counterweight on the way down, and takes from it on the way up."""
    context = inputs.context
    return {"payload.mass": context.direction.mean(axis=1) * (300.0 + context.payload_kg)}


LAWS = (
    payload__parts_wait, payload__rope,
    servo_settling__wound_up, guide_straightness__pushed_by_the_next,
    servo_settling__reported, foundation_settling__pressed, screw_thermal_growth__cooled,
    friction_windup__in_its_guides,
)  # fmt: skip
LEAST_OF = {"foundation_settling__pressed": 1.0 - 1e-8, "friction_windup__in_its_guides": 0.99}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_that_shows_in_many_visits_is_within_one_basis_set(long_inputs, law):
    assert explained(long_inputs, law) > LEAST_OF.get(law.__name__, LEAST)


def test_a_station_that_sinks_and_is_levelled_is_within_one_basis_set_of_its_drift():
    """Any course of all six coordinates has too many functions for so few readings."""
    assert explained(typical_inputs(100), tracker_drift__levelled) > 0.97


def test_a_drive_that_reports_a_part_of_where_it_stops_has_not_settled():
    """At a grid of positions a fine wave over what it reports would fit as well, and no drive needs an encoder's."""
    rng, put_in = np.random.default_rng(8), []

    def anywhere(arrivals: Arrivals) -> np.ndarray:
        put_in.append(
            np.column_stack([3e-5 * rng.uniform(-1.0, 1.0, len(arrivals.drives)), np.zeros(len(arrivals.drives))])
        )
        return put_in[-1]

    recording = simulated("planar4", 80, anywhere, grid_m=1e-4)
    by_visit = np.vstack([put_in[-1], np.zeros((1, 2))])
    error_m = by_visit[np.where(recording["visit"] >= 0, recording["visit"], -1).astype(int), 0]
    reported_m = -REPORTED_SHARE * error_m
    telling = changed(
        recording,
        left_actual_m=recording["left_actual_m"] - reported_m,
        left_following_error_m=reported_m,
    )
    assert np.array_equal(context_of_recording(telling).following_error_m[:, 0], reported_m)
    found = diagnose(telling)
    assert (found.verdict, found.effects[0].place) == ("servo_settling", "left")
    assert found.gap.shrink > 0.5
    assert diagnose(recording).verdict != "servo_settling"
