"""A scripted far end of a serial line: bytes expected, bytes answered; and a clock that only counts."""

from __future__ import annotations

import os
import re
import threading
import tty
from collections.abc import Sequence

from mock_devices.station.geocom_line import crc16

NO_CHECKSUM = b"(bare)"  # before an answer: it goes out without a checksum
_CHECKED = re.compile(rb"(%R1Q,\d+,\d+),(\d+)(:.*)")
_WHOLE = re.compile(rb"(%R1P,\d+,\d+)(:[^\r\n]*\r\n)")


class CountingClock:
    """Rig time that advances by what is slept, at once."""

    def __init__(self) -> None:
        self.t_s = 0.0

    def now_s(self) -> float:
        return self.t_s

    def sleep_s(self, duration_s: float) -> None:
        self.t_s += max(0.0, duration_s)


class TickingClock(CountingClock):
    """Rig time that advances whenever somebody asks for it, too."""

    def now_s(self) -> float:
        self.t_s += 1e-3
        return self.t_s


class ScriptedPort:
    """A pty whose far end answers each line by the script; `errors` holds what did not go by it.

    An answer of b"" is a lost one. Scripts are written without checksums: that of a request is checked and taken off,
    whole answers to such a request get theirs (`literal`: scripts are taken as they are). Does not model baud rates.
    """

    def __init__(self, script: Sequence[tuple[bytes, bytes]]) -> None:
        self._master, slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self._slave = slave
        self.url = os.ttyname(slave)
        self.script = list(script)
        self.literal = False
        self.errors: list[str] = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        buffer = b""
        while True:
            try:
                data = os.read(self._master, 1024)
            except OSError:
                return
            buffer += data
            while b"\r\n" in buffer:
                line, buffer = buffer.split(b"\r\n", 1)
                if line == b"quit":
                    return
                self._answer(line)

    def _answer(self, line: bytes) -> None:
        if not self.script:
            self.errors.append(f"nothing more expected, got {line!r}")
            return
        expected, answer = self.script.pop(0)
        checked = _CHECKED.fullmatch(line)
        if checked and not self.literal:
            line = checked[1] + checked[3]
            if int(checked[2]) != crc16(line):
                self.errors.append(f"wrong checksum in {line!r}")
            answer = answer if answer.startswith(NO_CHECKSUM) else _WHOLE.sub(_with_checksum, answer)
        answer = answer.removeprefix(NO_CHECKSUM)
        if line != expected:
            self.errors.append(f"expected {expected!r}, got {line!r}")
        if answer:
            os.write(self._master, answer)

    def close(self) -> None:
        os.write(self._slave, b"quit\r\n")
        self._thread.join(timeout=5.0)
        os.close(self._slave)
        os.close(self._master)

    def finished(self) -> None:
        """Assert that the whole script was played."""
        assert not self.errors, self.errors
        assert self.script == []


def _with_checksum(match: re.Match[bytes]) -> bytes:
    crc = crc16((match[1] + match[2]).rstrip())
    return match[1] + b",%d" % crc + match[2]
