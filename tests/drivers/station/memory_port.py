"""A serial port in memory: what is written is answered at once by a mock station, one answer with a bit turned over."""

from __future__ import annotations

import serial

from mock_devices.station.mock_station import MockStation


class MemoryPort(serial.SerialBase):  # type: ignore[misc]
    """The part of a pyserial port that `SerialLine` uses. `flip` is the byte and the bit of the next answer."""

    def __init__(self, station: MockStation) -> None:
        super().__init__()
        self.is_open = True
        self.flip: tuple[int, int] | None = None
        self.answers: list[bytes] = []
        self.calls: list[int] = []
        self._station = station
        self._waiting = b""

    def _reconfigure_port(self) -> None:
        """Nothing to do: bytes take no time."""

    def write(self, data: bytes) -> int:
        self.calls.append(int(data[5:].split(b",")[0].split(b":")[0]))
        answer = self._station.respond(data.removesuffix(b"\r\n")) or b""
        self.answers.append(answer)
        if self.flip is not None:
            (at, bit), self.flip = self.flip, None
            answer = answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]
        self._waiting += answer
        return len(data)

    @property
    def in_waiting(self) -> int:
        return len(self._waiting)

    def read(self, size: int = 1) -> bytes:
        """At most `size` bytes, none where a real port would wait for the time-out."""
        first, self._waiting = self._waiting[:size], self._waiting[size:]
        return first

    def reset_input_buffer(self) -> None:
        self._waiting = b""

    def close(self) -> None:
        self.is_open = False
