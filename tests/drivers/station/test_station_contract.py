"""One contract for the station's driver, run over each kind of line to the mock station."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import pytest

from drivers.errors import AngleOnly, NoAnswer, ProtocolError, TargetNotFound, WrongTarget
from drivers.station.geocom import StationLine
from drivers.station.laser_tracker import LaserTracker, LockState, SettleCriterion, average, cartesian_to_polar
from mock_devices.faults import FAULTS, Fault
from mock_devices.settings import MockSettings
from tests.drivers.mock_rig_bench import TRANSPORTS, Bench, mock_rigs

FLOOR_NEST_M = (-0.80, -1.10, 0.10)


@pytest.fixture(params=TRANSPORTS)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    yield from mock_rigs(request.param)


@pytest.fixture
def tracker(bench: Bench) -> Iterator[LaserTracker]:
    tracker = LaserTracker(bench.mock.station_url, bench.clock)
    yield tracker
    tracker.close()


def _direction(settings: MockSettings, point_m: tuple[float, float, float]) -> tuple[float, float]:
    """Where the station sees a point of the machine: north is -z, east x, up y."""
    dx, dy, dz = (p - s for p, s in zip(point_m, settings.station_position_m, strict=True))
    hz, v, _ = cartesian_to_polar(dx, -dz, dy)
    return hz, v


def test_connecting_to_the_station(tracker: LaserTracker) -> None:
    identity = tracker.connect()
    assert identity.serial > 0
    assert tracker.prism_constant_m == 0.0
    assert abs(tracker.set_atmosphere(21.0, 990.0, 0.5)) < 100.0


def test_a_prism_type_that_is_chosen_at_the_station_brings_its_constant_and_is_noticed(
    bench: Bench, tracker: LaserTracker
) -> None:
    tracker.connect()
    tracker.point_and_aim(*_direction(MockSettings(), FLOOR_NEST_M), window_rad=0.04)
    before = tracker.measure_averaged(4)
    tracker.require_settings()
    bench.mock.station_server._station.respond(b"%R1Q,17008,0:2")
    assert tracker.measure_averaged(4).slope_distance_m - before.slope_distance_m == pytest.approx(0.0344, abs=5e-4)
    with pytest.raises(ProtocolError, match="prism_type was set to mini and is now tape"):
        tracker.require_settings()


def test_measuring_a_floor_nest(bench: Bench, tracker: LaserTracker) -> None:
    tracker.connect()
    tracker.point_and_aim(*_direction(MockSettings(), FLOOR_NEST_M), window_rad=0.04)
    began_s = bench.clock.now_s()
    readings = tracker.measure(4, two_face=True, settle=SettleCriterion(across_m=100e-6))
    assert [reading.face for reading in readings] == [1] * 4 + [2] * 4
    mean = average(readings)
    expected_m = math.dist(FLOOR_NEST_M, MockSettings().station_position_m)
    assert mean.slope_distance_m == pytest.approx(expected_m, abs=0.02)
    assert mean.s_hz_rad < 50e-6
    assert began_s < mean.t_rig_s < bench.clock.now_s()
    assert all(reading.u_t_s >= 0.0 for reading in readings)


def test_nothing_there(tracker: LaserTracker) -> None:
    tracker.connect()
    with pytest.raises(TargetNotFound, match="8710"):
        tracker.point_and_aim(2.0, 1.0)


def test_a_bad_line_to_the_station(bench: Bench) -> None:
    tracker = LaserTracker(
        bench.mock.station_url, bench.clock, line=StationLine(reply_timeout_s=0.2, motion_timeout_s=1.0)
    )
    tracker.connect()
    spoil = itertools.cycle([None, b"R1P,0,", b"?"])
    bench.mock.station_server.tamper = lambda _answer: next(spoil)
    with pytest.raises((NoAnswer, ProtocolError)):
        tracker.read_face()
    bench.mock.station_server.tamper = None
    assert tracker.read_face() == 1
    tracker.close()


def test_search_lock_and_a_lock_that_is_lost(bench: Bench, tracker: LaserTracker) -> None:
    tracker.connect()
    direction = _direction(MockSettings(), FLOOR_NEST_M)
    tracker.point_and_aim(*direction, window_rad=0.04)
    tracker.search(0.04)
    tracker.lock()
    assert tracker.lock_state() is LockState.IN
    assert not tracker.keep_lock(*direction, window_rad=0.04)
    bench.faults.arm([Fault("tracker-beam-break", 1)])
    with pytest.raises(AngleOnly):
        tracker.measure()
    assert tracker.lock_state() is LockState.OUT
    assert tracker.keep_lock(*direction, window_rad=0.04)
    assert tracker.measure()[0].slope_distance_m > 1.0
    tracker.unlock()
    assert tracker.lock_state() is LockState.OUT


def test_simple_full_and_averaged_agree(tracker: LaserTracker) -> None:
    tracker.connect()
    tracker.point_and_aim(*_direction(MockSettings(), FLOOR_NEST_M), window_rad=0.04)
    simple, full, mean = tracker.measure_simple(), tracker.measure()[0], tracker.measure_averaged(3, two_face=True)
    for other in (full, mean):
        assert other.slope_distance_m == pytest.approx(simple.slope_distance_m, abs=1e-3)
        assert other.v_rad == pytest.approx(simple.v_rad, abs=30e-6)
    assert mean.n == 6


def test_another_nest_is_noticed(bench: Bench, tracker: LaserTracker) -> None:
    tracker.connect()
    place = MockSettings().station_position_m
    dx, dy, dz = (p - s for p, s in zip(FLOOR_NEST_M, place, strict=True))
    expected_m = (dx, -dz, dy)
    tracker.point_and_aim(*cartesian_to_polar(*expected_m)[:2], window_rad=0.04)
    tracker.require_target(tracker.measure()[0], expected_m, 0.05, "N1")
    bench.faults.arm([Fault("tracker-wrong-nest", 1)])
    tracker.point_and_aim(*cartesian_to_polar(*expected_m)[:2], window_rad=0.04)
    with pytest.raises(WrongTarget, match="'N1' was found"):
        tracker.require_target(tracker.measure()[0], expected_m, 0.05, "N1")


@pytest.mark.parametrize("name", [name for name, kind in FAULTS.items() if kind.site == "serial" and not kind.lasting])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_after_a_spoilt_answer_the_next_one_is_right(bench: Bench, name: str, number: int) -> None:
    tracker = LaserTracker(
        bench.mock.station_url, bench.clock, line=StationLine(reply_timeout_s=0.3, motion_timeout_s=2.0)
    )
    tracker.connect()
    tracker.point_and_aim(*_direction(MockSettings(), FLOOR_NEST_M), window_rad=0.04)
    distance_m = tracker.measure()[0].slope_distance_m
    bench.faults.arm([Fault(name, number)])
    assert tracker.measure()[0].slope_distance_m == pytest.approx(distance_m, abs=1e-3)
    assert tracker.read_face() == 1
    assert tracker.identity is not None
    assert tracker.measure()[0].slope_distance_m == pytest.approx(distance_m, abs=1e-3)
    assert bench.faults.struck == (name,)
    tracker.close()
