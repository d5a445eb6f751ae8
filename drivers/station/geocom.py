"""A GeoCOM session: geocompy on a pyserial port, kept in step and with typed errors.

geocompy turns every failure into a return code, and after a lost answer takes each answer for that of the next request;
`SerialLine` prevents that. If the station supports it both directions carry a CRC: without one a corrupted digit
would pass as a measured value.
"""

from __future__ import annotations

import errno
import logging
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import serial
from geocompy.communication import Connection
from geocompy.data import Byte
from geocompy.geo import GeoCom
from geocompy.geo.aus import GeoComAUS
from geocompy.geo.aut import GeoComAUT
from geocompy.geo.bap import GeoComBAP
from geocompy.geo.com import GeoComCOM
from geocompy.geo.csv import GeoComCSV
from geocompy.geo.edm import GeoComEDM
from geocompy.geo.gctypes import GeoComResponse
from geocompy.geo.mot import GeoComMOT
from geocompy.geo.tmc import GeoComTMC

from drivers.clock import RigClock
from drivers.errors import ConnectionFailed, DeviceError, NoAnswer, NotExecuted, ProtocolError, StationBusy
from drivers.station import return_codes as codes
from drivers.station.return_codes import station_error
from drivers.station.serial_line import ExchangeTime, SerialLine

_quiet = logging.getLogger("drivers.geocompy")
_quiet.addHandler(logging.NullHandler())
_quiet.propagate = False

_CODES = re.compile(r"%R1P,(\d+),\d+(?:,\d+)?:(\d+)")
_WITHOUT_CHECKSUM = re.compile(r"%R1P,0,\d+:")
_CHECK_LINE = "check cable, baud rate and that nothing else uses the port"
_BUSY_PAUSE_S = 0.1
_NULL_PROCESS_S = 2.0  # the call that does nothing is answered at once: more would only be added to a time-out
_PROBES = 2

Call = Callable[[], GeoComResponse[Any]]


class GeoComCalls(GeoCom):
    """geocompy's calls without its constructor, which sleeps for a second and hides errors.

    Sets the fields that the constructor sets for the subsystems used here; a test compares the two.
    """

    def __init__(self, connection: Connection, first_transaction: int = 0) -> None:
        self.transaction_counter = first_transaction
        self._conn = connection
        self._logger = _quiet
        self._checksum = False
        self.precision = 15
        self.aus = GeoComAUS(self)
        self.aut = GeoComAUT(self)
        self.bap = GeoComBAP(self)
        self.com = GeoComCOM(self)
        self.csv = GeoComCSV(self)
        self.edm = GeoComEDM(self)
        self.mot = GeoComMOT(self)
        self.tmc = GeoComTMC(self)

    @property
    def uses_checksums(self) -> bool:
        """Whether requests carry a checksum."""
        return self._checksum

    @uses_checksums.setter
    def uses_checksums(self, on: bool) -> None:
        self._checksum = on


class GeoComFloat(Byte):
    """A parameter with all its digits.

    geocompy writes floats with six decimals, which turns a wavelength of 658 nm into 1 um; `Byte` is the only kind
    of parameter that it writes unchanged.
    """

    def __init__(self, value: float) -> None:
        self._digits = f"{value:.15f}".rstrip("0")

    def __str__(self) -> str:
        return self._digits + "0" if self._digits.endswith(".") else self._digits


@dataclass(frozen=True)
class StationLine:
    """The serial line to a station and how long calls may take.

    Time-outs are host time: `reply_timeout_s` for calls that answer at once, `motion_timeout_s` for those that move the
    telescope or measure. A call to a busy station is repeated for `busy_limit_s` of rig time.
    """

    baudrate: int = 115200
    reply_timeout_s: float = 5.0
    motion_timeout_s: float = 30.0
    busy_limit_s: float = 5.0


class GeoComSession:
    """Calls to one station, one at a time, from any thread.

    `first_transaction` continues the numbers of the previous session, so that its late answers cannot be taken for
    new ones. Raises ConnectionFailed if the port cannot be opened.
    """

    def __init__(
        self,
        device: str,
        port_url: str,
        clock: RigClock,
        line: StationLine | None = None,
        *,
        first_transaction: int = 0,
    ) -> None:
        line = line or StationLine()
        self.device = device
        self.where = port_url
        self._clock = clock
        self._lock = threading.RLock()
        self._reply_timeout_s = line.reply_timeout_s
        self._motion_timeout_s = line.motion_timeout_s
        self._busy_limit_s = line.busy_limit_s
        try:
            port = serial.serial_for_url(
                port_url,
                baudrate=line.baudrate,
                timeout=line.reply_timeout_s,
                write_timeout=line.reply_timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError) as error:
            if getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY):
                raise ConnectionFailed(device, port_url, "another program has the port", "end that program") from error
            raise ConnectionFailed(device, port_url, f"the port cannot be opened: {error}", _CHECK_LINE) from error
        self._line = SerialLine(port, clock, line.reply_timeout_s)
        self.geocom = GeoComCalls(self._line, first_transaction)

    def call(self, rpc: int, *parameters: float) -> Call:
        """A call without values in its answer, floats written with all their digits, for `ask` and `command`."""
        written = [GeoComFloat(p) if isinstance(p, float) else p for p in parameters]
        return lambda: self.geocom.request(rpc, written)

    @property
    def last_time(self) -> ExchangeTime:
        """When the last exchange took place."""
        return self._line.last_time

    @property
    def uses_checksums(self) -> bool:
        """Whether every request and answer carries a checksum."""
        return self.geocom.uses_checksums

    @property
    def next_transaction(self) -> int:
        """The number that the next request will have."""
        return self.geocom.transaction_counter

    def close(self) -> None:
        """Close the port."""
        self._line.close()

    def agree_on_checksums(self) -> bool:
        """Use checksums if the station answers with them; returns whether it does.

        It takes two good answers without one to conclude that it does not: a single one may be a line error.
        Raises NoAnswer, ProtocolError, ConnectionFailed and StationError.
        """
        for _ in range(_PROBES):
            self.geocom.uses_checksums = True
            try:
                self.ask(self.geocom.com.nullprocess, values=False)
            except ProtocolError:
                self.geocom.uses_checksums = False
                self.ask(self.geocom.com.nullprocess, values=False)
            else:
                return True
        return False

    def ask(self, call: Call, *, values: bool = True, changing: bool = False) -> Any:
        """Make a call that may safely be repeated, and return its values.

        It is repeated once after a lost or garbled answer. `values`: the answer must contain some; without checksums
        they are asked for twice, unless they may be `changing` in between. Raises NoAnswer, ProtocolError,
        ConnectionFailed and StationError.
        """
        if changing:
            return self._call_again_if_lost(call, values, self._reply_timeout_s)[0]
        return self._ask(call, values, self._reply_timeout_s)[0]

    def command(self, call: Call, *, idempotent: bool = False) -> None:
        """Make a call that moves or measures.

        Repeated only if the station reports that it was busy or could not read the request, so that nothing was done;
        an `idempotent` one (turn to a direction) also once after a lost or garbled answer.
        """
        try:
            self._call_when_idle(call, False, self._motion_timeout_s)
        except NotExecuted:
            self._call_when_idle(call, False, self._motion_timeout_s)
        except (NoAnswer, ProtocolError) as error:
            if not idempotent:
                raise
            self._require_answering(error, self._motion_timeout_s)
            self._call_when_idle(call, False, self._motion_timeout_s)

    def ask_flagged(self, call: Call) -> tuple[Any, tuple[str, ...]]:
        """Like `ask`, for a measurement: its values, and the flags of the station for them."""
        return self._ask(call, True, self._motion_timeout_s)

    def _ask(self, call: Call, values: bool, timeout_s: float) -> tuple[Any, tuple[str, ...]]:
        result = self._call_again_if_lost(call, values, timeout_s)
        if values and not self.uses_checksums and self._call_again_if_lost(call, values, timeout_s) != result:
            raise ProtocolError(self.device, self.where, "the same was read twice with different values", _CHECK_LINE)
        return result

    def _call_again_if_lost(self, call: Call, values: bool, timeout_s: float) -> tuple[Any, tuple[str, ...]]:
        try:
            return self._call_when_idle(call, values, timeout_s)
        except (NoAnswer, ProtocolError) as error:
            self._require_answering(error, timeout_s)
            return self._call_when_idle(call, values, timeout_s)

    def _require_answering(self, error: DeviceError, timeout_s: float) -> None:
        """Before a long call is repeated, ask a station that has been silent whether it is there at all."""
        if isinstance(error, NoAnswer) and timeout_s > self._reply_timeout_s:
            limit_s = min(self._reply_timeout_s, _NULL_PROCESS_S)
            self._call_when_idle(self.geocom.com.nullprocess, False, limit_s)

    def _call_when_idle(self, call: Call, values: bool, timeout_s: float) -> tuple[Any, tuple[str, ...]]:
        end_s = self._clock.now_s() + self._busy_limit_s
        while True:
            with self._lock:
                self._line.reply_timeout_s = timeout_s
                response = call()
            try:
                return self._values_or_raise(response, values)
            except StationBusy:
                if self._clock.now_s() >= end_s:
                    raise
            self._clock.sleep_s(_BUSY_PAUSE_S)

    def _values_or_raise(self, response: GeoComResponse[Any], values: bool) -> tuple[Any, tuple[str, ...]]:
        name, code = response.rpcname, int(response.error)
        where = f"{self.where}, {name}"
        if code == codes.COM_TIMED_OUT:
            raise NoAnswer(self.device, where, "no answer", _CHECK_LINE)
        if code == codes.COM_CANT_SEND:
            raise ConnectionFailed(self.device, where, "the line is broken", _CHECK_LINE)
        answer_text = response.response[:60]
        if code in codes.NOT_EXECUTED:
            raise NotExecuted(
                self.device, where, f"the station could not read the request (GeoCOM {code})", _CHECK_LINE
            )
        if code in codes.GARBLED or (self.uses_checksums and _WITHOUT_CHECKSUM.match(answer_text)):
            raise ProtocolError(self.device, where, f"cannot interpret {answer_text!r}", _CHECK_LINE)
        flag = codes.VALUES_WITH_FLAG.get(code)
        if code != codes.OK and not (flag and response.params is not None):
            raise station_error(_code_in(response.response, code), name, self.device, self.where)
        if values and response.params is None:
            raise ProtocolError(self.device, where, "the answer contains no values", _CHECK_LINE)
        return response.params, ((flag,) if flag else ())


def _code_in(answer: str, code: int) -> int:
    """The return code as received: geocompy turns unknown codes into 1."""
    match = _CODES.match(answer)
    if match is None:
        return code
    return int(match[1]) or int(match[2])
