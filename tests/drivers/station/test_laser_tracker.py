"""The station over a scripted line."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import (
    AngleOnly,
    IdentityMismatch,
    LockLost,
    NoAnswer,
    NotSettled,
    ProtocolError,
    SettingsChanged,
    SignalError,
    WrongTarget,
)
from drivers.station.geocom import StationLine
from drivers.station.laser_tracker import LaserTracker, LockState, SettleCriterion
from drivers.station.polar import average, cartesian_to_polar, polar_to_cartesian, to_face_one
from tests.drivers.scripted import NO_CHECKSUM, CountingClock, ScriptedPort, TickingClock

_REQUEST_NUMBER = re.compile(rb"^(%R1Q,\d+,)\d+")
_ANSWER_NUMBER = re.compile(rb"(%R1P,\d+,)\d+")

Make = Callable[..., tuple[LaserTracker, ScriptedPort]]

CONNECT = [
    (b"%R1Q,0,0:", b"%R1P,0,0:0\r\n"),
    (b"%R1Q,107,1:15", b"%R1P,0,1:0\r\n"),
    (b"%R1Q,108,2:", b"%R1P,0,2:0,15\r\n"),
    (b"%R1Q,5004,3:", b'%R1P,0,3:0,"TDRA6000"\r\n'),
    (b"%R1Q,5003,4:", b"%R1P,0,4:0,360001\r\n"),
    (b"%R1Q,5034,5:", b"%R1P,0,5:0,2,20,0\r\n"),
    (b"%R1Q,110,6:", b"%R1P,0,6:0,3,1,0\r\n"),
    (b"%R1Q,2021,7:", b"%R1P,0,7:0,2\r\n"),
    (b"%R1Q,17009,8:", b"%R1P,0,8:0,0\r\n"),
    (b"%R1Q,2023,9:", b"%R1P,0,9:0,0.0\r\n"),
    (b"%R1Q,2020,10:2", b"%R1P,0,10:0\r\n"),
    (b"%R1Q,2021,11:", b"%R1P,0,11:0,2\r\n"),
    (b"%R1Q,17008,12:1", b"%R1P,0,12:0\r\n"),
    (b"%R1Q,2024,13:0.0", b"%R1P,0,13:0\r\n"),
    (b"%R1Q,17009,14:", b"%R1P,0,14:0,1\r\n"),
    (b"%R1Q,2023,15:", b"%R1P,0,15:0,0.0\r\n"),
    (b"%R1Q,2029,16:", b"%R1P,0,16:0,0.000000658,1013.25,12.0,8.0\r\n"),
    (b"%R1Q,2151,17:", b"%R1P,3081,17:0\r\n"),
]


def _reading(n: int, hz: str = "0.5", v: str = "1.5", d: str = "3.0", code: int = 0) -> list[tuple[bytes, bytes]]:
    full = f"%R1P,0,{n + 1}:{code},{hz},{v},0.0,0.0,0.0,0.0,{d},0\r\n".encode()
    return [
        (b"%%R1Q,2008,%d:1,1" % n, b"%%R1P,0,%d:0\r\n" % n),
        (b"%%R1Q,2167,%d:5000,1" % (n + 1), full),
    ]


def _face(n: int, face: int) -> tuple[bytes, bytes]:
    return b"%%R1Q,2026,%d:" % n, b"%%R1P,0,%d:0,%d\r\n" % (n, face)


def _fine_adjust(n: int, code: int = 0) -> tuple[bytes, bytes]:
    return b"%%R1Q,9037,%d:0.01,0.01,0" % n, b"%%R1P,0,%d:%d\r\n" % (n, code)


@pytest.fixture
def make() -> Iterator[Make]:
    opened: list[tuple[LaserTracker, ScriptedPort]] = []

    def build(
        script: list[tuple[bytes, bytes]],
        timeout_s: float = 5.0,
        expected_serial: int | None = None,
        clock: CountingClock | None = None,
    ) -> tuple[LaserTracker, ScriptedPort]:
        port = ScriptedPort(script)
        tracker = LaserTracker(
            port.url,
            clock or CountingClock(),
            line=StationLine(reply_timeout_s=timeout_s, motion_timeout_s=timeout_s),
            expected_serial=expected_serial,
        )
        opened.append((tracker, port))
        return tracker, port

    yield build
    for tracker, port in opened:
        tracker.close()
        port.close()


def test_connect_reads_back_what_it_sets(make: Make) -> None:
    tracker, port = make(CONNECT)
    identity = tracker.connect()
    assert (identity.name, identity.serial) == ("TDRA6000", 360001)
    assert abs(tracker.ppm) < 1.0
    port.finished()


@pytest.mark.parametrize(("prism", "constant", "same"), [(1, "0.0", True), (0, "0.0", False), (1, "0.0175", False)])
def test_settings_that_a_station_had_before_are_told(make: Make, prism: int, constant: str, same: bool) -> None:
    tracker, port = make([*CONNECT[:7], *_settings(7, prism=prism, constant=constant), *CONNECT[10:]])
    tracker.connect()
    assert tracker.settings_unchanged_on_connect is same
    port.finished()


def test_another_serial_number(make: Make) -> None:
    tracker, _ = make(CONNECT, expected_serial=1)
    with pytest.raises(IdentityMismatch, match="360001"):
        tracker.connect()


def test_a_precision_that_is_not_taken(make: Make) -> None:
    tracker, _ = make([*CONNECT[:2], (b"%R1Q,108,2:", b"%R1P,0,2:0,4\r\n")])
    with pytest.raises(ProtocolError, match="digits"):
        tracker.connect()


def test_silence_and_nonsense(make: Make) -> None:
    silent, _ = make([(b"%R1Q,0,0:", b""), (b"%R1Q,0,1:", b"")], 0.1)
    with pytest.raises(NoAnswer):
        silent.connect()
    babbler, _ = make([(b"%%R1Q,0,%d:" % n, b"what?\r\n") for n in range(4)])
    with pytest.raises(ProtocolError):
        babbler.connect()


def test_not_connected() -> None:
    with pytest.raises(RuntimeError, match="connect"):
        LaserTracker("nowhere", CountingClock()).measure()


def test_measure(make: Make) -> None:
    tracker, port = make([*CONNECT, *_reading(18), *_reading(20, d="3.002", code=1284)])
    tracker.connect()
    first, second = tracker.measure(2)
    assert (first.hz_rad, first.v_rad, first.slope_distance_m, first.face) == (0.5, 1.5, 3.0, 1)
    assert first.flags == ()
    assert second.flags == ("accuracy_not_guaranteed",)
    mean = average([first, second])
    assert mean.slope_distance_m == pytest.approx(3.001)
    assert mean.s_distance_m == pytest.approx(0.002 / math.sqrt(2.0))
    port.finished()


def test_a_reading_is_dated_within_its_exchanges(make: Make) -> None:
    clock = TickingClock()
    tracker, _ = make([*CONNECT, *_reading(18)], clock=clock)
    tracker.connect()
    begin_s, begin_host_s = clock.now_s(), time.monotonic()
    reading = tracker.measure()[0]
    end_s, end_host_s = clock.now_s(), time.monotonic()
    assert begin_s < reading.t_rig_s - reading.u_t_s < reading.t_rig_s < reading.t_rig_s + reading.u_t_s < end_s
    assert begin_host_s <= reading.t_host_s <= end_host_s


def test_a_lost_reading_is_fetched_again_not_measured_again(make: Make) -> None:
    lost = [(b"%R1Q,2008,18:1,1", b"%R1P,0,18:0\r\n"), (b"%R1Q,2167,19:5000,1", b"")]
    again = [(b"%R1Q,2167,20:5000,1", b"%R1P,0,20:0,0.5,1.5,0,0,0,0,3.0,0\r\n")]
    tracker, port = make([*CONNECT, *lost, *again], 0.2)
    tracker.connect()
    assert tracker.measure()[0].slope_distance_m == 3.0
    port.finished()


@pytest.mark.parametrize(("code", "kind"), [(1285, AngleOnly), (1292, SignalError), (1294, SignalError)])
def test_no_distance(make: Make, code: int, kind: type[Exception]) -> None:
    tracker, _ = make([*CONNECT, *_reading(18, d="0.0", code=code)])
    tracker.connect()
    with pytest.raises(kind):
        tracker.measure()


@pytest.mark.parametrize("bad", [{"d": "nan"}, {"d": "0.0"}, {"d": "-1.0"}, {"d": "1e9"}, {"hz": "inf"}, {"v": "77"}])
def test_values_that_cannot_be(make: Make, bad: dict[str, str]) -> None:
    tracker, _ = make([*CONNECT, *_reading(18, **bad)])  # type: ignore[arg-type]
    tracker.connect()
    with pytest.raises(ProtocolError, match="cannot be"):
        tracker.measure()


def test_two_faces(make: Make) -> None:
    other = _reading(24, hz=repr(0.5 + math.pi), v=repr(2 * math.pi - 1.5))
    change = [_face(20, 0), (b"%R1Q,9028,21:0,0,0", b"%R1P,0,21:0\r\n"), _face(22, 1), _fine_adjust(23)]
    tracker, port = make([*CONNECT, *_reading(18), *change, *other])
    tracker.connect()
    readings = tracker.measure(1, two_face=True)
    assert [r.face for r in readings] == [1, 2]
    mean = average(readings)
    assert (mean.hz_rad, mean.v_rad) == pytest.approx((0.5, 1.5))
    port.finished()


def test_settling(make: Make) -> None:
    distances = ["3.0", "3.001", "3.0011", "3.0011"]
    script = [step for i, d in enumerate(distances) for step in _reading(18 + 2 * i, d=d)]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    readings = tracker.measure(2, settle=SettleCriterion(window=2, along_m=1e-6, limit_s=1e9))
    assert [r.slope_distance_m for r in readings] == [3.0011, 3.0011]
    port.finished()


def test_never_settling(make: Make) -> None:
    tracker, _ = make([*CONNECT, *_reading(18), *_reading(20, d="3.1")])
    tracker.connect()
    with pytest.raises(NotSettled, match="um along"):
        tracker.measure(1, settle=SettleCriterion(window=2, limit_s=0.0))


def test_atmosphere(make: Make) -> None:
    taken = b"%R1P,0,19:0,0.000000658,990.0,21.0,14.6796\r\n"
    tracker, _ = make(
        [
            *CONNECT,
            (b"%R1Q,2028,18:0.000000658,990.0,21.0,14.608669444089756", b"%R1P,0,18:0\r\n"),
            (b"%R1Q,2029,19:", taken),
        ]
    )
    tracker.connect()
    with pytest.raises(ProtocolError, match="atmosphere"):
        tracker.set_atmosphere(21.0, 990.0, 0.5)


@pytest.mark.parametrize(
    ("temperature_c", "pressure_hpa", "humidity"),
    [(-40.1, 990.0, 0.5), (70.1, 990.0, 0.5), (21.0, 499.0, 0.5), (21.0, 1101.0, 0.5), (21.0, 990.0, -0.01),
     (21.0, 990.0, 1.01), (math.nan, 990.0, 0.5)],
)  # fmt: skip
def test_air_that_no_shop_has_is_refused(
    make: Make, temperature_c: float, pressure_hpa: float, humidity: float
) -> None:
    tracker, port = make(CONNECT)
    tracker.connect()
    with pytest.raises(ValueError, match="implausible air"):
        tracker.set_atmosphere(temperature_c, pressure_hpa, humidity)
    port.finished()


def test_aiming_sends_the_direction(make: Make) -> None:
    aim = [
        (b"%R1Q,9027,18:0.5,1.5,0,0,0", b"%R1P,0,18:0\r\n"),
        (b"%R1Q,9037,19:0.02,0.02,0", b"%R1P,0,19:0\r\n"),
    ]
    tracker, port = make([*CONNECT, *aim])
    tracker.connect()
    tracker.point_and_aim(0.5 - 2 * math.pi, 1.5, window_rad=0.02)
    port.finished()


CHANGE = b"%R1Q,9028,"


def test_a_face_change_whose_answer_is_lost_is_not_made_twice(make: Make) -> None:
    script = [_face(18, 0), (CHANGE + b"19:0,0,0", b""), _face(20, 1), _face(21, 1), _fine_adjust(22)]
    tracker, port = make([*CONNECT, *script], 0.2)
    tracker.connect()
    tracker.change_face()
    port.finished()


def test_a_face_change_that_was_not_understood_is_asked_for_again(make: Make) -> None:
    refused = (CHANGE + b"19:0,0,0", b"%R1P,3101,19:0\r\n")
    script = [_face(18, 0), refused, (CHANGE + b"20:0,0,0", b"%R1P,0,20:0\r\n"), _face(21, 1), _fine_adjust(22)]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    tracker.change_face()
    port.finished()


def test_a_face_that_stays(make: Make) -> None:
    script = [_face(18, 0), (CHANGE + b"19:0,0,0", b"%R1P,0,19:0\r\n"), _face(20, 0)]
    tracker, _ = make([*CONNECT, *script])
    tracker.connect()
    with pytest.raises(ProtocolError, match="did not change"):
        tracker.change_face()


def test_a_station_without_checksums_is_asked_twice_for_each_value(make: Make) -> None:
    probes = [(b"%R1Q,0,0:", NO_CHECKSUM + b"%R1P,0,0:0\r\n")] * 5
    connect = [exchange for exchange in CONNECT for _ in range(2 if b":0," in exchange[1] else 1)]
    first, second = _reading(0), _reading(0)
    other = second[1][0], second[1][1].replace(b"3.0", b"8.0")
    tracker, port = make(_numbered([*probes, *connect, *first, first[1], *second, other]))
    tracker.connect()
    assert not tracker.uses_checksums
    assert tracker.measure()[0].slope_distance_m == 3.0
    with pytest.raises(ProtocolError, match="twice"):
        tracker.measure()
    port.finished()


def _numbered(script: list[tuple[bytes, bytes]], first: int = 0) -> list[tuple[bytes, bytes]]:
    """The same lines with transaction numbers that count from the first."""
    return [
        (_REQUEST_NUMBER.sub(rb"\g<1>%d" % n, line), _ANSWER_NUMBER.sub(rb"\g<1>%d" % n, answer))
        for n, (line, answer) in enumerate(script, start=first)
    ]


def test_search_and_lock(make: Make) -> None:
    script = [
        (b"%R1Q,9029,18:0.1,0.1,0", b"%R1P,0,18:0\r\n"),
        (b"%R1Q,18007,19:1", b"%R1P,0,19:0\r\n"),
        (b"%R1Q,9013,20:", b"%R1P,0,20:0\r\n"),
        (b"%R1Q,6021,21:", b"%R1P,0,21:0,1\r\n"),
        (b"%R1Q,6021,22:", b"%R1P,0,22:0,2\r\n"),
        (b"%R1Q,18007,23:0", b"%R1P,0,23:0\r\n"),
    ]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    tracker.search(0.1)
    tracker.lock()
    assert tracker.lock_state() is LockState.IN
    assert tracker.lock_state() is LockState.PREDICTED
    tracker.unlock()
    port.finished()


def test_a_lost_lock_is_found_again_where_the_reflector_is_predicted(make: Make) -> None:
    script = [
        (b"%R1Q,6021,18:", b"%R1P,0,18:0,1\r\n"),
        (b"%R1Q,6021,19:", b"%R1P,0,19:0,0\r\n"),
        (b"%R1Q,9027,20:0.5,1.5,0,0,0", b"%R1P,0,20:0\r\n"),
        _fine_adjust(21),
        (b"%R1Q,18007,22:1", b"%R1P,0,22:0\r\n"),
        (b"%R1Q,9013,23:", b"%R1P,0,23:0\r\n"),
        (b"%R1Q,6021,24:", b"%R1P,0,24:0,1\r\n"),
    ]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    assert not tracker.keep_lock(0.5, 1.5)
    assert tracker.keep_lock(0.5, 1.5)
    port.finished()


def test_no_lock_is_a_typed_error(make: Make) -> None:
    script = [(b"%R1Q,18007,18:1", b"%R1P,0,18:0\r\n"), (b"%R1Q,9013,19:", b"%R1P,0,19:8725\r\n")]
    tracker, _ = make([*CONNECT, *script])
    tracker.connect()
    with pytest.raises(LockLost, match="8725"):
        tracker.lock()


def test_a_simple_measurement(make: Make) -> None:
    script = [
        (b"%R1Q,2008,18:1,1", b"%R1P,0,18:0\r\n"),
        (b"%R1Q,2108,19:5000,1", b"%R1P,0,19:1283,0.5,1.5,3.0\r\n"),
    ]
    tracker, _ = make([*CONNECT, *script])
    tracker.connect()
    reading = tracker.measure_simple()
    assert (reading.slope_distance_m, reading.flags) == (3.0, ("no_full_correction",))
    assert (reading.edm_mode, reading.prism_type) == (2, 1)


def _settings(n: int, mode: int = 2, prism: int = 1, constant: str = "0.0") -> list[tuple[bytes, bytes]]:
    return [
        (b"%%R1Q,2021,%d:" % n, b"%%R1P,0,%d:0,%d\r\n" % (n, mode)),
        (b"%%R1Q,17009,%d:" % (n + 1), b"%%R1P,0,%d:0,%d\r\n" % (n + 1, prism)),
        (b"%%R1Q,2023,%d:" % (n + 2), b"%%R1P,0,%d:0,%s\r\n" % (n + 2, constant.encode())),
    ]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"mode": 6}, "edm_mode was set to single_standard and is now cont_standard"),
        ({"prism": 7}, "prism_type was set to mini and is now mini360"),
        ({"constant": "0.0175"}, "prism_constant_m was set to 0.0 and is now 0.0175"),
    ],
)
def test_settings_that_somebody_changes_at_the_station_are_noticed(make: Make, changed: dict, complaint: str) -> None:
    tracker, port = make([*CONNECT, *_settings(18), *_settings(21, **changed)])
    tracker.connect()
    tracker.require_settings()
    with pytest.raises(SettingsChanged, match=complaint):
        tracker.require_settings()
    port.finished()


def test_air_that_somebody_changes_at_the_station_is_noticed(make: Make) -> None:
    def air(n: int, dry: str) -> tuple[bytes, bytes]:
        wet = "14.608669444089756"
        return (b"%%R1Q,2029,%d:" % n, b"%%R1P,0,%d:0,0.000000658,990.0,%s,%s\r\n" % (n, dry.encode(), wet.encode()))

    script = [
        (b"%R1Q,2028,18:0.000000658,990.0,21.0,14.608669444089756", b"%R1P,0,18:0\r\n"),
        air(19, "21.0"),
        (b"%R1Q,2151,20:", b"%R1P,0,20:0,7.0\r\n"),
        *_settings(21),
        air(24, "21.0"),
        *_settings(25),
        air(28, "23.0"),
    ]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    tracker.set_atmosphere(21.0, 990.0, 0.5)
    tracker.require_settings()
    with pytest.raises(SettingsChanged, match=r"air .* was set to \(990.0, 21.0, .* is now \(990.0, 23.0"):
        tracker.require_settings()
    port.finished()


def test_a_prism_type_that_the_constant_brings_with_it_is_seen(make: Make) -> None:
    changed = (b"%R1Q,17009,14:", b"%R1P,0,14:0,9\r\n")
    tracker, _ = make([*CONNECT[:14], changed, *CONNECT[15:]])
    with pytest.raises(ProtocolError, match="prism type: mini was set, user is read back"):
        tracker.connect()


def test_another_reflector_than_the_predicted_one(make: Make) -> None:
    tracker, _ = make([*CONNECT, *_reading(18)])
    tracker.connect()
    reading = tracker.measure()[0]
    here_m = polar_to_cartesian(0.5, 1.5, 3.0)
    tracker.require_target(reading, here_m, 1e-3, "P1")
    with pytest.raises(WrongTarget, match=r"'P1' was found 500 mm"):
        tracker.require_target(reading, (here_m[0], here_m[1], here_m[2] + 0.5), 0.02, "P1")


def test_a_late_answer_of_the_session_before_is_dropped(make: Make) -> None:
    again = _numbered(CONNECT, 19)
    late = (b"%R1Q,2026,18:", b"")
    again[0] = (again[0][0], b"%R1P,0,18:0,1\r\n" + again[0][1])
    tracker, port = make([*CONNECT, late, *again], 0.3)
    tracker.connect()
    session = tracker._open()
    with pytest.raises(NoAnswer):
        session._call_when_idle(session.geocom.tmc.get_face, True, 0.3)
    tracker.connect()
    port.finished()


angles = st.floats(-6.0, 12.0)


@given(angles, st.floats(0.01, 3.13), st.floats(0.1, 100.0))
def test_polar_round_trip(hz: float, v: float, d: float) -> None:
    back = cartesian_to_polar(*polar_to_cartesian(hz, v, d))
    assert math.remainder(back[0] - hz, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert back[1:] == pytest.approx((v, d))


@given(angles, st.floats(0.0, 2 * math.pi))
def test_faces_see_the_same_point(hz: float, v: float) -> None:
    reduced = to_face_one(hz, v)
    assert 0.0 <= reduced[1] <= math.pi
    assert polar_to_cartesian(*reduced, 3.0) == pytest.approx(polar_to_cartesian(hz, v, 3.0), abs=1e-12)


def test_north_east_up() -> None:
    assert polar_to_cartesian(0.0, math.pi / 2, 1.0) == pytest.approx((0.0, 1.0, 0.0))
    assert polar_to_cartesian(math.pi / 2, math.pi / 2, 1.0) == pytest.approx((1.0, 0.0, 0.0))
    assert polar_to_cartesian(0.0, 0.0, 1.0) == pytest.approx((0.0, 0.0, 1.0))
