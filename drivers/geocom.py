"""A GeoCOM session: geocompy on a pyserial port, kept in step and with typed errors.

geocompy turns every failure into a return code and stays one answer behind after a lost answer.
Here each answer must carry the number of its request; older ones are dropped, and what is left
in the port from an exchange that failed is thrown away before the next one.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import serial
from geocompy.communication import Connection
from geocompy.data import Byte
from geocompy.geo import GeoCom
from geocompy.geo.aut import GeoComAUT
from geocompy.geo.bap import GeoComBAP
from geocompy.geo.com import GeoComCOM
from geocompy.geo.csv import GeoComCSV
from geocompy.geo.edm import GeoComEDM
from geocompy.geo.gctypes import GeoComResponse
from geocompy.geo.tmc import GeoComTMC

from drivers import return_codes as codes
from drivers.clock import RigClock
from drivers.errors import ConnectionFailed, NoAnswer, ProtocolError, StationBusy
from drivers.return_codes import station_error

_quiet = logging.getLogger("drivers.geocompy")
_quiet.addHandler(logging.NullHandler())
_quiet.propagate = False

_REQUEST = re.compile(r"%R1Q,\d+,(\d+)")
_CODES = re.compile(r"%R1P,(\d+),\d+(?:,\d+)?:(\d+)")
_ANSWER = re.compile(rb"^%R1P,\d+,(\d+)[,:]")
_MOST_OLD_ANSWERS = 8
_LONGEST_LINE = 4096
_CHECK_LINE = "check cable, baud rate and that nothing else uses the port"


@dataclass(frozen=True)
class ExchangeTime:
    """When an exchange took place: its middle, and half the round trip as the uncertainty, in seconds."""

    t_rig_s: float
    t_host_s: float
    u_t_s: float


class SerialLine(Connection):
    """geocompy's way to the wire: a pyserial port, its lock and time stamps.

    `reply_timeout_s` is host time. An exchange that fails leaves nothing behind for the next one.
    """

    def __init__(self, port: serial.Serial, clock: RigClock, reply_timeout_s: float) -> None:
        self._port = port
        self._clock = clock
        self.reply_timeout_s = reply_timeout_s
        self.last_time = ExchangeTime(0.0, 0.0, 0.0)

    def is_open(self) -> bool:
        """Whether the port is open."""
        return bool(self._port.is_open)

    def send_binary(self, data: bytes) -> None:
        """Write one line."""
        try:
            self._port.write(data if data.endswith(b"\r\n") else data + b"\r\n")
        except serial.SerialTimeoutException as error:
            raise TimeoutError(str(error)) from error
        except (OSError, ValueError) as error:
            raise ConnectionError(str(error)) from error

    def send(self, message: str) -> None:
        """Write one line of text."""
        self.send_binary(message.encode("ascii", "ignore"))

    def receive_binary(self) -> bytes:
        """Read one line, without its end. Raises TimeoutError and ConnectionError."""
        return self._read_line(time.monotonic() + self.reply_timeout_s)

    def receive(self) -> str:
        """Read one line of text; what is not ASCII shows as a replacement character."""
        return self.receive_binary().decode("ascii", "replace")

    def exchange_binary(self, data: bytes) -> bytes:
        """Send a request and return the answer that carries its number."""
        return self.exchange(data.decode("ascii", "ignore")).encode("ascii", "replace")

    def exchange(self, cmd: str) -> str:
        """Send a request and return the answer that carries its number, or the first line that is none."""
        self.reset()
        host_s, rig_s = time.monotonic(), self._clock.now_s()
        self.send(cmd)
        answer = self._answer_to(cmd, host_s + self.reply_timeout_s)
        end_host_s, end_rig_s = time.monotonic(), self._clock.now_s()
        self.last_time = ExchangeTime(0.5 * (rig_s + end_rig_s), 0.5 * (host_s + end_host_s), 0.5 * (end_rig_s - rig_s))
        return answer.decode("ascii", "replace")

    def reset(self) -> None:
        """Throw away what waits in the port: nobody asked for it any more."""
        try:
            self._port.reset_input_buffer()
        except (OSError, ValueError) as error:
            raise ConnectionError(str(error)) from error

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _answer_to(self, cmd: str, deadline_s: float) -> bytes:
        request = _REQUEST.match(cmd)
        answer = b""
        for _ in range(_MOST_OLD_ANSWERS):
            answer = self._read_line(deadline_s)
            numbered = _ANSWER.match(answer)
            if request is None or numbered is None or int(numbered[1]) == int(request[1]):
                break
        return answer

    def _read_line(self, deadline_s: float) -> bytes:
        line = bytearray()
        while not line.endswith(b"\n"):
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0 or len(line) > _LONGEST_LINE:
                if line:  # half a line must not pass for an answer: its last number may be cut
                    return b"(cut off) " + bytes(line)
                raise TimeoutError("no answer")
            try:
                self._port.timeout = left_s
                line += self._port.read_until(b"\n", _LONGEST_LINE)
            except (OSError, ValueError) as error:
                raise ConnectionError(str(error)) from error
        return bytes(line).rstrip(b"\r\n")


class QuietGeoCom(GeoCom):
    """geocompy's calls without its constructor, which sleeps a second and swallows what goes wrong.

    Sets the fields that the constructor sets for the subsystems used here; a test compares the two.
    """

    def __init__(self, connection: Connection) -> None:
        self.transaction_counter = 0
        self._conn = connection
        self._logger = _quiet
        self._checksum = False
        self.precision = 15
        self.aut = GeoComAUT(self)
        self.bap = GeoComBAP(self)
        self.com = GeoComCOM(self)
        self.csv = GeoComCSV(self)
        self.edm = GeoComEDM(self)
        self.tmc = GeoComTMC(self)


class Real(Byte):
    """A parameter with all its digits.

    geocompy writes floats with six decimals, which turns a wavelength of 658 nm into 1 um; `Byte` is the one kind
    of parameter that it writes as it is.
    """

    def __init__(self, value: float) -> None:
        self._digits = f"{value:.15f}".rstrip("0")

    def __str__(self) -> str:
        return self._digits + "0" if self._digits.endswith(".") else self._digits


class GeoComSession:
    """Calls to one station, one at a time, from any thread.

    Time-outs are host time: `reply_timeout_s` for calls that answer at once, `motion_timeout_s` for
    those that move the telescope or measure. A busy station is asked again for `busy_limit_s` of rig time.
    """

    def __init__(
        self,
        device: str,
        port_url: str,
        clock: RigClock,
        *,
        baudrate: int = 115200,
        reply_timeout_s: float = 5.0,
        motion_timeout_s: float = 30.0,
        busy_limit_s: float = 5.0,
    ) -> None:
        self.device = device
        self.where = port_url
        self._clock = clock
        self._lock = threading.RLock()
        self._reply_timeout_s = reply_timeout_s
        self._motion_timeout_s = motion_timeout_s
        self._busy_limit_s = busy_limit_s
        try:
            port = serial.serial_for_url(
                port_url, baudrate=baudrate, timeout=reply_timeout_s, write_timeout=reply_timeout_s
            )
        except (OSError, ValueError) as error:
            raise ConnectionFailed(device, port_url, f"the port cannot be opened: {error}", _CHECK_LINE) from error
        self._line = SerialLine(port, clock, reply_timeout_s)
        self.geocom = QuietGeoCom(self._line)

    def call(self, rpc: int, *parameters: float) -> Callable[[], GeoComResponse[Any]]:
        """A call without values in its answer, floats written with all their digits, for `ask` and `command`."""
        written = [Real(p) if isinstance(p, float) else p for p in parameters]
        return lambda: self.geocom.request(rpc, written)

    @property
    def last_time(self) -> ExchangeTime:
        """When the last exchange took place."""
        return self._line.last_time

    def close(self) -> None:
        """Close the port."""
        self._line.close()

    def ask(self, call: Callable[[], GeoComResponse[Any]], *, values: bool = True) -> Any:
        """Make a call that may be repeated without harm, and return its values.

        Asked a second time after a lost or garbled answer. `values` tells that the answer must hold some.
        Raises NoAnswer, ProtocolError, ConnectionFailed and StationError.
        """
        try:
            return self._settled(call, values, self._reply_timeout_s)
        except (NoAnswer, ProtocolError):
            return self._settled(call, values, self._reply_timeout_s)

    def command(self, call: Callable[[], GeoComResponse[Any]]) -> None:
        """Make a call that moves or measures: never repeated unless the station says that it was busy."""
        self._settled(call, False, self._motion_timeout_s)

    def ask_flagged(self, call: Callable[[], GeoComResponse[Any]]) -> tuple[Any, tuple[str, ...]]:
        """Like `ask` for a measurement: values, and the flags that the station puts on them."""
        try:
            return self._settled_flagged(call, True, self._motion_timeout_s)
        except (NoAnswer, ProtocolError):
            return self._settled_flagged(call, True, self._motion_timeout_s)

    def _settled(self, call: Callable[[], GeoComResponse[Any]], values: bool, timeout_s: float) -> Any:
        result, _ = self._settled_flagged(call, values, timeout_s)
        return result

    def _settled_flagged(
        self, call: Callable[[], GeoComResponse[Any]], values: bool, timeout_s: float
    ) -> tuple[Any, tuple[str, ...]]:
        end_s = self._clock.now_s() + self._busy_limit_s
        while True:
            with self._lock:
                self._line.reply_timeout_s = timeout_s
                response = call()
            try:
                return self._judge(response, values)
            except StationBusy:
                if self._clock.now_s() >= end_s:
                    raise
            self._clock.sleep_s(0.1)

    def _judge(self, response: GeoComResponse[Any], values: bool) -> tuple[Any, tuple[str, ...]]:
        name, code = response.rpcname, int(response.error)
        where = f"{self.where}, {name}"
        if code == codes.COM_TIMED_OUT:
            raise NoAnswer(self.device, where, "no answer", _CHECK_LINE)
        if code == codes.COM_CANT_SEND:
            raise ConnectionFailed(self.device, where, "the line is broken", _CHECK_LINE)
        if code in codes.GARBLED:
            shown = response.response[:60]
            raise ProtocolError(self.device, where, f"cannot make sense of {shown!r}", _CHECK_LINE)
        flag = codes.VALUES_WITH_FLAG.get(code)
        if code != codes.OK and not (flag and response.params is not None):
            raise station_error(_code_in(response.response, code), name, self.device, self.where)
        if values and response.params is None:
            raise ProtocolError(self.device, where, "the answer holds no values", _CHECK_LINE)
        return response.params, ((flag,) if flag else ())


def _code_in(answer: str, code: int) -> int:
    """The return code as it came: geocompy turns codes that it does not know into 1."""
    match = _CODES.match(answer)
    if match is None:
        return code
    return int(match[1]) or int(match[2])
