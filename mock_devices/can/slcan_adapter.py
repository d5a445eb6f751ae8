"""A serial CAN adapter with the slcan (LAWICEL) protocol on a pseudo terminal, bridged to a CAN bus of this process.

Not modelled: bit rates (accepted and ignored), time stamps, status flags, CAN FD, remote frames, acceptance filters.
"""

from __future__ import annotations

import logging
import os
import select
import termios
import threading
import tty

import can

_RECEIVE_S = 0.05
_LONGEST = 64
_OK, _BELL = b"\r", b"\a"

_log = logging.getLogger(__name__)


class SlcanAdapter:
    """Owns `bus`. `port` is what a host opens."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._master, self._slave = os.openpty()  # the open slave keeps the line up between hosts
        tty.setraw(self._slave, termios.TCSANOW)
        self.port = os.ttyname(self._slave)
        self._open = False
        self._closed = False
        self._lock = threading.Lock()
        self._wake, self._waker = os.pipe()
        self._threads = [
            threading.Thread(target=work, name="mock-slcan", daemon=True) for work in (self._from_host, self._from_bus)
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Unplug it. May be called again."""
        if self._closed:
            return
        self._closed = True
        os.write(self._waker, b"x")
        for thread in self._threads:
            thread.join(timeout=5.0)
        self._bus.shutdown()
        for end in (self._master, self._slave, self._wake, self._waker):
            os.close(end)

    def _from_host(self) -> None:
        begun = b""
        while not self._closed:
            ready, _, _ = select.select([self._master, self._wake], [], [])
            if self._master not in ready:
                continue
            try:
                *lines, begun = (begun + os.read(self._master, 4096)).split(b"\r")
            except OSError:
                return
            begun = begun[-_LONGEST:]
            for line in lines:
                self._answer(_OK if self._carry_out(line) else _BELL)

    def _carry_out(self, line: bytes) -> bool:
        """One command of the host; false if it is none or cannot be carried out now."""
        if line in (b"O", b"L", b"C"):
            self._open = line != b"C"
            return True
        if line[:1] in (b"S", b"s", b"Y", b"V", b"N", b""):
            return True
        try:
            frame = parse_frame(line)
            if not self._open:
                return False
            self._bus.send(frame)
        except (ValueError, can.CanError) as error:
            _log.info("slcan: %r not sent: %s", line, error)
            return False
        return True

    def _from_bus(self) -> None:
        while not self._closed:
            try:
                frame = self._bus.recv(_RECEIVE_S)
            except (can.CanError, OSError) as error:
                _log.info("slcan: the bus is lost: %s", error)
                return
            if frame is not None and self._open:
                self._answer(format_frame(frame))

    def _answer(self, data: bytes) -> None:
        with self._lock:
            try:
                while data and not self._closed:
                    data = data[os.write(self._master, data) :]
            except OSError as error:
                _log.info("slcan: the host is gone: %s", error)


def parse_frame(line: bytes) -> can.Message:
    """`tIIILDD..` or `TIIIIIIIILDD..`; raises ValueError."""
    kind = line[:1]
    digits = {b"t": 3, b"T": 8}.get(kind)
    if digits is None or len(line) < digits + 2 or not line.isascii():
        raise ValueError(f"no frame: {line!r}")
    length, content = int(line[digits + 1 : digits + 2], 16), bytes.fromhex(line[digits + 2 :].decode())
    if len(content) != length:
        raise ValueError(f"{len(content)} bytes, {length} announced")
    identifier = int(line[1 : digits + 1], 16)
    return can.Message(arbitration_id=identifier, is_extended_id=kind == b"T", data=content, check=True)


def format_frame(frame: can.Message) -> bytes:
    """A received frame as the host reads it."""
    head = f"T{frame.arbitration_id:08X}" if frame.is_extended_id else f"t{frame.arbitration_id:03X}"
    return f"{head}{len(frame.data)}{bytes(frame.data).hex().upper()}\r".encode("ascii")
