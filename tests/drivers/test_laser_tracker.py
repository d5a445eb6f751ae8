"""The laser tracker over a scripted line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import CountingClock, ScriptedPort

from drivers.errors import AngleOnly, IdentityMismatch, NoAnswer, NotSettled, ProtocolError, SignalError
from drivers.laser_tracker import LaserTracker, SettleCriterion
from drivers.polar import average, cartesian_to_polar, polar_to_cartesian, to_face_one

Make = Callable[..., tuple[LaserTracker, ScriptedPort]]

CONNECT = [
    (b"%R1Q,0,0:", b"%R1P,0,0:0\r\n"),
    (b"%R1Q,107,1:15", b"%R1P,0,1:0\r\n"),
    (b"%R1Q,108,2:", b"%R1P,0,2:0,15\r\n"),
    (b"%R1Q,5004,3:", b'%R1P,0,3:0,"TDRA6000"\r\n'),
    (b"%R1Q,5003,4:", b"%R1P,0,4:0,360001\r\n"),
    (b"%R1Q,5034,5:", b"%R1P,0,5:0,2,20,0\r\n"),
    (b"%R1Q,110,6:", b"%R1P,0,6:0,3,1,0\r\n"),
    (b"%R1Q,2020,7:2", b"%R1P,0,7:0\r\n"),
    (b"%R1Q,2021,8:", b"%R1P,0,8:0,2\r\n"),
    (b"%R1Q,17008,9:1", b"%R1P,0,9:0\r\n"),
    (b"%R1Q,17009,10:", b"%R1P,0,10:0,1\r\n"),
    (b"%R1Q,2024,11:0.0", b"%R1P,0,11:0\r\n"),
    (b"%R1Q,2023,12:", b"%R1P,0,12:0,0.0\r\n"),
    (b"%R1Q,2029,13:", b"%R1P,0,13:0,0.000000658,1013.25,12.0,8.0\r\n"),
    (b"%R1Q,2151,14:", b"%R1P,3081,14:0\r\n"),
]


def _reading(n: int, hz: str = "0.5", v: str = "1.5", d: str = "3.0", code: int = 0) -> list[tuple[bytes, bytes]]:
    full = f"%R1P,0,{n + 1}:{code},{hz},{v},0.0,0.0,0.0,0.0,{d},0\r\n".encode()
    return [
        (b"%%R1Q,2008,%d:1,1" % n, b"%%R1P,0,%d:0\r\n" % n),
        (b"%%R1Q,2167,%d:5000,1" % (n + 1), full),
    ]


@pytest.fixture
def make() -> Iterator[Make]:
    opened: list[tuple[LaserTracker, ScriptedPort]] = []

    def build(
        script: list[tuple[bytes, bytes]], timeout_s: float = 5.0, **settings: object
    ) -> tuple[LaserTracker, ScriptedPort]:
        port = ScriptedPort(script)
        tracker = LaserTracker(
            port.url,
            CountingClock(),
            reply_timeout_s=timeout_s,
            motion_timeout_s=timeout_s,
            **settings,  # type: ignore[arg-type]
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
    babbler, _ = make([(b"%R1Q,0,0:", b"what?\r\n"), (b"%R1Q,0,1:", b"what?\r\n")])
    with pytest.raises(ProtocolError):
        babbler.connect()


def test_not_connected() -> None:
    with pytest.raises(RuntimeError, match="connect"):
        LaserTracker("nowhere", CountingClock()).measure()


def test_measure(make: Make) -> None:
    tracker, port = make([*CONNECT, *_reading(15), *_reading(17, d="3.002", code=1284)])
    tracker.connect()
    first, second = tracker.measure(2)
    assert (first.hz_rad, first.v_rad, first.slope_distance_m, first.face) == (0.5, 1.5, 3.0, 1)
    assert first.flags == ()
    assert second.flags == ("accuracy_not_guaranteed",)
    mean = average([first, second])
    assert mean.slope_distance_m == pytest.approx(3.001)
    assert mean.s_distance_m == pytest.approx(0.002 / math.sqrt(2.0))
    port.finished()


def test_a_lost_reading_is_fetched_again_not_measured_again(make: Make) -> None:
    lost = [(b"%R1Q,2008,15:1,1", b"%R1P,0,15:0\r\n"), (b"%R1Q,2167,16:5000,1", b"")]
    again = [(b"%R1Q,2167,17:5000,1", b"%R1P,0,17:0,0.5,1.5,0,0,0,0,3.0,0\r\n")]
    tracker, port = make([*CONNECT, *lost, *again], 0.2)
    tracker.connect()
    assert tracker.measure()[0].slope_distance_m == 3.0
    port.finished()


@pytest.mark.parametrize(("code", "kind"), [(1285, AngleOnly), (1292, SignalError), (1294, SignalError)])
def test_no_distance(make: Make, code: int, kind: type[Exception]) -> None:
    tracker, _ = make([*CONNECT, *_reading(15, d="0.0", code=code)])
    tracker.connect()
    with pytest.raises(kind):
        tracker.measure()


@pytest.mark.parametrize("bad", [{"d": "nan"}, {"d": "-1.0"}, {"d": "1e9"}, {"hz": "inf"}, {"v": "77"}])
def test_values_that_cannot_be(make: Make, bad: dict[str, str]) -> None:
    tracker, _ = make([*CONNECT, *_reading(15, **bad)])  # type: ignore[arg-type]
    tracker.connect()
    with pytest.raises(ProtocolError, match="cannot be"):
        tracker.measure()


def test_two_faces(make: Make) -> None:
    change = [(b"%R1Q,9028,17:0,0,0", b"%R1P,0,17:0\r\n"), (b"%R1Q,9037,18:0.01,0.01,0", b"%R1P,0,18:0\r\n")]
    other = _reading(19, hz=repr(0.5 + math.pi), v=repr(2 * math.pi - 1.5))
    tracker, port = make([*CONNECT, *_reading(15), *change, *other])
    tracker.connect()
    readings = tracker.measure(1, two_face=True)
    assert [r.face for r in readings] == [1, 2]
    mean = average(readings)
    assert (mean.hz_rad, mean.v_rad) == pytest.approx((0.5, 1.5))
    port.finished()


def test_settling(make: Make) -> None:
    distances = ["3.0", "3.001", "3.0011", "3.0011"]
    script = [step for i, d in enumerate(distances) for step in _reading(15 + 2 * i, d=d)]
    tracker, port = make([*CONNECT, *script])
    tracker.connect()
    readings = tracker.measure(2, settle=SettleCriterion(window=2, along_m=1e-6, limit_s=1e9))
    assert [r.slope_distance_m for r in readings] == [3.0011, 3.0011]
    port.finished()


def test_never_settling(make: Make) -> None:
    tracker, _ = make([*CONNECT, *_reading(15), *_reading(17, d="3.1")])
    tracker.connect()
    with pytest.raises(NotSettled, match="um along"):
        tracker.measure(1, settle=SettleCriterion(window=2, limit_s=0.0))


def test_atmosphere(make: Make) -> None:
    taken = b"%R1P,0,16:0,0.000000658,990.0,21.0,14.6796\r\n"
    tracker, _ = make(
        [
            *CONNECT,
            (b"%R1Q,2028,15:0.000000658,990.0,21.0,14.608669444089756", b"%R1P,0,15:0\r\n"),
            (b"%R1Q,2029,16:", taken),
        ]
    )
    tracker.connect()
    with pytest.raises(ProtocolError, match="atmosphere"):
        tracker.set_atmosphere(21.0, 990.0, 0.5)
    with pytest.raises(ValueError, match="no such air"):
        tracker.set_atmosphere(21.0, 99.0, 0.5)


def test_aiming_sends_the_direction(make: Make) -> None:
    aim = [
        (b"%R1Q,9027,15:0.5,1.5,0,0,0", b"%R1P,0,15:0\r\n"),
        (b"%R1Q,9037,16:0.02,0.02,0", b"%R1P,0,16:0\r\n"),
    ]
    tracker, port = make([*CONNECT, *aim])
    tracker.connect()
    tracker.point_and_aim(0.5 - 2 * math.pi, 1.5, window_rad=0.02)
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
