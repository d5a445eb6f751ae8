"""Golden transcripts of a GeoCOM session, and what happens when the line misbehaves."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest
from geocompy.communication import Connection
from geocompy.geo import GeoCom
from geocompy.geo.gctypes import GeoComCode
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import (
    AimingFailed,
    ConnectionFailed,
    DeviceError,
    MultipleTargets,
    NoAnswer,
    NotImplementedByStation,
    ProtocolError,
    StationBusy,
    StationError,
    TargetNotFound,
)
from drivers.station.geocom import GeoComCalls, GeoComSession, StationLine
from drivers.station.return_codes import station_error
from drivers.station.serial_line import SerialLine
from tests.drivers.scripted import CountingClock, ScriptedPort
from tests.either import either

SHORT_S = 0.2  # where an answer is lost on purpose; elsewhere a loaded machine gets its time
Open = Callable[..., tuple[GeoComSession, ScriptedPort]]


@pytest.fixture
def opened() -> Iterator[Open]:
    sessions: list[GeoComSession] = []
    ports: list[ScriptedPort] = []

    def make(script: list[tuple[bytes, bytes]], timeout_s: float = 5.0) -> tuple[GeoComSession, ScriptedPort]:
        port = ScriptedPort(script)
        ports.append(port)
        session = GeoComSession(
            "station",
            port.url,
            CountingClock(),
            line=StationLine(reply_timeout_s=0.05, motion_timeout_s=0.05, busy_limit_s=1.0),
        )
        session.geocom.uses_checksums = True
        sessions.append(session)
        return session, port

    yield make
    for session in sessions:
        session.close()
    for port in ports:
        port.close()


def _serial_number(session: GeoComSession) -> object:
    return session.ask(session.geocom.csv.get_serial_number)


def test_an_answer_comes_back(opened: Open) -> None:
    session, port = opened([(b"%R1Q,5003,0:", b"%R1P,0,0:0,123456\r\n")])
    assert _serial_number(session) == 123456
    assert session.last_time.t_host_s > 0.0
    port.finished()


def test_a_lost_answer_is_asked_for_again(opened: Open) -> None:
    session, port = opened([(b"%R1Q,5003,0:", b""), (b"%R1Q,5003,1:", b"%R1P,0,1:0,7\r\n")], SHORT_S)
    assert _serial_number(session) == 7
    port.finished()


def test_two_lost_answers_are_an_error_and_the_session_goes_on(opened: Open) -> None:
    session, port = opened(
        [
            (b"%R1Q,5003,0:", b""),
            (b"%R1Q,5003,1:", b""),
            (b"%R1Q,5003,2:", b"%R1P,0,0:0,1\r\n%R1P,0,1:0,2\r\n%R1P,0,2:0,3\r\n"),
        ],
        SHORT_S,
    )
    with pytest.raises(NoAnswer, match="no answer"):
        _serial_number(session)
    assert _serial_number(session) == 3  # the two late ones are dropped
    port.finished()


@pytest.mark.parametrize("there", [True, False])
def test_before_a_long_call_is_repeated_the_station_is_asked_whether_it_is_there(opened: Open, there: bool) -> None:
    answer = [(b"%R1Q,0,1:", b"%R1P,0,1:0\r\n"), (b"%R1Q,9037,2:0.1,0.1,0", b"%R1P,0,2:0\r\n")]
    session, port = opened([(b"%R1Q,9037,0:0.1,0.1,0", b""), *(answer if there else [(b"%R1Q,0,1:", b"")])])
    session._motion_timeout_s = 0.2
    call = session.call(9037, 0.1, 0.1, 0)
    if there:
        session.command(call, idempotent=True)
    else:
        with pytest.raises(NoAnswer):
            session.command(call, idempotent=True)
    port.finished()


def test_a_command_is_never_sent_twice(opened: Open) -> None:
    session, port = opened([(b"%R1Q,9028,0:0,0,0", b"")], SHORT_S)
    with pytest.raises(NoAnswer):
        session.command(session.geocom.aut.change_face)
    port.finished()


@pytest.mark.parametrize(
    "garbage",
    [
        b"R1P,0,0:0,123456\r\n",
        b"\xff\xfe%%\x00\r\n",
        b"%R1P,0,0:0,12x\r\n",
        b"%R1P,0,0:0\r\n",
        b"%R1P,0,0\r\n",
        b"%R1P,0,0:0,1",
    ],
)
def test_garbled_then_good(opened: Open, garbage: bytes) -> None:
    session, port = opened([(b"%R1Q,5003,0:", garbage), (b"%R1Q,5003,1:", b"%R1P,0,1:0,5\r\n")], SHORT_S)
    assert _serial_number(session) == 5
    port.finished()


def test_nonsense_is_a_protocol_error(opened: Open) -> None:
    session, port = opened([(b"%R1Q,5003,0:", b"hello\r\n"), (b"%R1Q,5003,1:", b"hello\r\n")])
    with pytest.raises(ProtocolError, match="hello"):
        _serial_number(session)
    port.finished()


@pytest.mark.parametrize("old", [7, 8])
def test_up_to_seven_answers_to_other_requests_are_passed_over(opened: Open, old: int) -> None:
    """After more than that the question is put again."""
    first = (b"%R1Q,5003,0:", b"%R1P,0,77:0,1\r\n" * old + b"%R1P,0,0:0,5\r\n")
    session, port = opened([first, *([(b"%R1Q,5003,1:", b"%R1P,0,1:0,6\r\n")] if old > 7 else [])])
    assert _serial_number(session) == (6 if old > 7 else 5)
    port.finished()


def test_answers_to_other_requests_for_ever_are_a_protocol_error(opened: Open) -> None:
    many = b"%R1P,0,77:0,1\r\n" * 20
    session, _ = opened([(b"%R1Q,5003,0:", many), (b"%R1Q,5003,1:", many)])
    with pytest.raises(ProtocolError):
        _serial_number(session)


@pytest.mark.parametrize(
    ("code", "kind"),
    [(8710, TargetNotFound), (8711, MultipleTargets), (5, NotImplementedByStation), (4242, StationError)],
)
def test_return_codes(opened: Open, code: int, kind: type[StationError]) -> None:
    session, port = opened([(b"%R1Q,9037,0:0.01,0.01,0", b"%%R1P,0,0:%d\r\n" % code)])
    with pytest.raises(kind, match=str(code)) as caught:
        session.command(lambda: session.geocom.aut.fine_adjust(0.01, 0.01))
    assert caught.value.code == code
    assert "\n" not in str(caught.value)
    port.finished()


@pytest.mark.parametrize(
    ("code", "text"),
    [(8704, "in time"), (8705, "end stop"), (8707, "motor"), (8708, "accuracy"), (8709, "deviation"), (8712, "light"),
     (8719, "aiming failed")],
)  # fmt: skip
def test_aiming_that_failed_says_why(code: int, text: str) -> None:
    error = station_error(code, "AUT_FineAdjust", "station", "COM1")
    assert isinstance(error, AimingFailed)
    assert text in str(error)


def test_a_call_that_the_model_does_not_know(opened: Open) -> None:
    session, _ = opened([(b"%R1Q,2151,0:", b"%R1P,3081,0:0\r\n")])
    with pytest.raises(NotImplementedByStation):
        session.ask(session.geocom.tmc.get_atmospheric_correction_ppm)


def test_a_busy_station_is_asked_again(opened: Open) -> None:
    session, port = opened([(b"%R1Q,9028,0:0,0,0", b"%R1P,0,0:1293\r\n"), (b"%R1Q,9028,1:0,0,0", b"%R1P,0,1:0\r\n")])
    session.command(session.geocom.aut.change_face)
    port.finished()


def test_a_station_busy_for_ever(opened: Open) -> None:
    script = [(b"%%R1Q,9028,%d:0,0,0" % i, b"%%R1P,0,%d:1293\r\n" % i) for i in range(20)]
    session, _ = opened(script)
    with pytest.raises(StationBusy):
        session.command(session.geocom.aut.change_face)


def test_values_with_a_flag(opened: Open) -> None:
    session, _ = opened([(b"%R1Q,2108,0:5000,1", b"%R1P,0,0:1284,1.0,1.5,3.0\r\n")])
    values, flags = session.ask_flagged(session.geocom.tmc.get_simple_measurement)
    assert float(values[2]) == 3.0
    assert flags == ("accuracy_not_guaranteed",)


def test_no_port() -> None:
    with pytest.raises(ConnectionFailed, match="no-such-port"):
        GeoComSession("station", "no-such-port", CountingClock())


def test_a_port_that_goes_away(opened: Open) -> None:
    session, _ = opened([])
    session.close()
    with pytest.raises(ConnectionFailed):
        _serial_number(session)


class _Stub(Connection):
    """Answers whatever geocompy's constructor asks."""

    def is_open(self) -> bool:
        return True

    def send(self, message: str) -> None: ...
    def send_binary(self, data: bytes) -> None: ...
    def receive(self) -> str:
        return ""

    def receive_binary(self) -> bytes:
        return b""

    def exchange_binary(self, data: bytes) -> bytes:
        return b""

    def exchange(self, cmd: str) -> str:
        return f"%R1P,0,{cmd.split(',')[2].split(':', maxsplit=1)[0]}:0"

    def close(self) -> None: ...
    def reset(self) -> None: ...


def test_the_quiet_session_has_the_librarys_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geocompy.geo.sleep", lambda _seconds: None)
    theirs, ours = GeoCom(_Stub()), GeoComCalls(_Stub())
    unused = {"bmm", "cam", "ctl", "dna", "ftr", "img", "kdm", "sup", "wir"}
    assert set(vars(theirs)) - set(vars(ours)) == unused


def test_checksums_by_the_byte(opened: Open) -> None:
    script = [(b"%R1Q,0,0,10948:", b"%R1P,0,0,18235:0\r\n"), (b"%R1Q,5003,1,5982:", b"%R1P,0,1,54323:0,7\r\n")]
    session, port = opened(script)
    port.literal = True
    assert session.agree_on_checksums()
    assert _serial_number(session) == 7
    port.finished()


@pytest.mark.parametrize("code", [int(code) for code in GeoComCode if code not in (0, 13, 1293)])
def test_every_code_is_a_typed_error_in_one_line(code: int) -> None:
    error = station_error(code, "call", "station", "port")
    assert error.code == code
    assert str(code) in str(error)
    assert "\n" not in str(error)


class _Wire:
    """A port that holds whatever bytes came."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.timeout = 0.0

    def write(self, data: bytes) -> int:
        return len(data)

    def reset_input_buffer(self) -> None: ...

    def read_until(self, _end: bytes, size: int) -> bytes:
        if not self._data:
            raise OSError("the line is gone")
        taken, self._data = self._data[:size], self._data[size:]
        return taken


_LINES = st.one_of(
    st.binary(max_size=80),
    st.from_regex(rb"\A%R1P,[0-9]{1,4},[0-9]{1,5}(,[0-9]{1,5})?:[0-9]{1,4}(,[-0-9.e\"a]{0,9}){0,9}\r\n\Z"),
)


@given(st.lists(_LINES, min_size=1, max_size=4), st.booleans())
def test_any_bytes_give_values_or_a_declared_error(lines: list[bytes], checked: bool) -> None:
    session = GeoComSession.__new__(GeoComSession)
    clock = CountingClock()
    session.device, session.where, session._clock = "station", "port", clock
    session._lock, session._busy_limit_s = threading.RLock(), 0.0
    session._reply_timeout_s = session._motion_timeout_s = 5.0
    session._line = SerialLine(_Wire(b"".join(lines) + b"\n"), clock, 5.0)  # type: ignore[arg-type]
    session.geocom = GeoComCalls(session._line)
    session.geocom.uses_checksums = checked
    told, complaint = either(lambda: session.ask_flagged(session.geocom.tmc.get_complete_measurement), DeviceError)
    if told is not None:
        assert len(told[0]) == 8
    else:
        assert complaint is not None
        assert complaint.startswith("station")


def test_a_busy_station_is_asked_for_five_seconds_of_rig_time() -> None:
    port = ScriptedPort([(b"%%R1Q,9028,%d:0,0,0" % n, b"%%R1P,0,%d:1293\r\n" % n) for n in range(60)])
    clock = CountingClock()
    session = GeoComSession("station", port.url, clock, line=StationLine())
    session.geocom.uses_checksums = True
    try:
        with pytest.raises(StationBusy):
            session.command(session.geocom.aut.change_face)
    finally:
        session.close()
        port.close()
    assert 5.0 <= clock.t_s < 6.0
    assert not port.errors
