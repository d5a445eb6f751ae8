"""The station's serial line: one exchange at a time, each answer matched to its request and time-stamped.

Each answer must carry the number of its request; older ones are dropped, and remains of a failed exchange are discarded
before the next one.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

import serial
from geocompy.communication import Connection

from drivers.clock import RigClock

_REQUEST = re.compile(r"%R1Q,\d+,(\d+)")
_ANSWER = re.compile(rb"^%R1P,\d+,(\d+)[,:]")
_NOT_TEXT = re.compile(r"[^\x20-\x7e]")
_MOST_OLD_ANSWERS = 8
_LONGEST_LINE = 4096


@dataclass(frozen=True)
class ExchangeTime:
    """When an exchange took place: its middle, and half the round trip as the uncertainty, in seconds."""

    t_rig_s: float
    t_host_s: float
    u_t_s: float


class SerialLine(Connection):
    """geocompy's connection: a pyserial port with time stamps.

    `reply_timeout_s` is host time. An exchange that fails leaves nothing behind for the next one.
    """

    def __init__(self, port: serial.Serial, clock: RigClock, reply_timeout_s: float) -> None:
        self._port = port
        self._clock = clock
        self.reply_timeout_s = reply_timeout_s
        self.last_time = ExchangeTime(0.0, 0.0, 0.0)
        self._received = bytearray()

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
        """Read one line of text, as `exchange` returns it."""
        return _text(self.receive_binary())

    def exchange_binary(self, data: bytes) -> bytes:
        """Send a request and return the answer that carries its number."""
        return self.exchange(data.decode("ascii", "ignore")).encode("ascii", "replace")

    def exchange(self, cmd: str) -> str:
        """Send a request and return the answer that carries its number, or the first line that is not an answer.

        A line with any other byte than printable ASCII is spoilt: it is marked, so that nobody takes it for an answer.
        """
        self.reset()
        host_s, rig_s = time.monotonic(), self._clock.now_s()
        self.send(cmd)
        answer = self._answer_to(cmd, host_s + self.reply_timeout_s)
        end_host_s, end_rig_s = time.monotonic(), self._clock.now_s()
        self.last_time = ExchangeTime(0.5 * (rig_s + end_rig_s), 0.5 * (host_s + end_host_s), 0.5 * (end_rig_s - rig_s))
        return _text(answer)

    def reset(self) -> None:
        """Discard data in the port that belongs to no request."""
        self._received.clear()
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
        """The next line without its end; what came behind it waits for the next call."""
        while b"\n" not in self._received:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0.0 or len(self._received) > _LONGEST_LINE:
                line = self._take(len(self._received))
                if line:  # half a line must not count as an answer: its last number may be cut
                    return b"(cut off) " + line
                raise TimeoutError("no answer")
            try:
                self._port.timeout = remaining_s
                # All that has come at once: one byte a read costs a system call or two for each.
                self._received += self._port.read(min(max(1, self._port.in_waiting), _LONGEST_LINE))
            except (OSError, ValueError) as error:
                raise ConnectionError(str(error)) from error
        return self._take(self._received.index(b"\n") + 1).rstrip(b"\r\n")

    def _take(self, count: int) -> bytes:
        first, self._received = self._received[:count], self._received[count:]
        return bytes(first)


def _text(line: bytes) -> str:
    text = line.decode("latin-1")
    return "(spoilt) " + _NOT_TEXT.sub("?", text) if _NOT_TEXT.search(text) else text
