"""PDOs of a node by its own object dictionary: what canopen's LocalNode leaves to its user.

Not modelled: inhibit times, remote requests, mappings that cut an object.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

NOT_VALID = 0x80000000
_FIRST_TPDO = 0x1800
_FORMATS = {8: "B", 16: "H", 32: "I"}
_SYNCHRONOUS_MOST = 240
_EVENT = 254

ReadBytes = Callable[[int, int], bytes]


@dataclass(frozen=True)
class Mapping:
    """One PDO as its communication and mapping objects describe it."""

    cob_id: int
    enabled: bool
    transmission_type: int
    objects: tuple[tuple[int, int, int], ...]  # index, sub-index, length in bytes
    event_timer_s: float = 0.0

    @property
    def length(self) -> int:
        """Number of bytes of data."""
        return sum(length for _, _, length in self.objects)

    @property
    def on_sync(self) -> bool:
        """Whether it is sent at SYNC."""
        return self.enabled and 1 <= self.transmission_type <= _SYNCHRONOUS_MOST

    @property
    def on_timer(self) -> bool:
        """Whether it is sent by its event timer."""
        return self.enabled and self.transmission_type >= _EVENT and self.event_timer_s > 0.0

    def pack(self, read: ReadBytes) -> bytes:
        """Data of a TPDO."""
        return b"".join(read(index, sub) for index, sub, _ in self.objects)

    def unpack(self, data: bytes) -> list[tuple[int, int, bytes]]:
        """Objects of an RPDO; raises ValueError if the data are too short."""
        if len(data) < self.length:
            raise ValueError(f"{len(data)} bytes for a mapping of {self.length}")
        parts, at = [], 0
        for index, sub, length in self.objects:
            parts.append((index, sub, bytes(data[at : at + length])))
            at += length
        return parts


def read_mapping(read: ReadBytes, communication: int, mapping: int) -> Mapping:
    """Read a PDO's description from the dictionary, e.g. 0x1800 and 0x1A00."""
    cob_id = _unsigned(read(communication, 1))
    is_tpdo = communication >= _FIRST_TPDO
    entries = [_unsigned(read(mapping, i)) for i in range(1, _unsigned(read(mapping, 0)) + 1)]
    return Mapping(
        cob_id=cob_id & 0x7FF,
        enabled=not cob_id & NOT_VALID,
        transmission_type=_unsigned(read(communication, 2)),
        event_timer_s=_unsigned(read(communication, 5)) * 1e-3 if is_tpdo else 0.0,
        objects=tuple((e >> 16, (e >> 8) & 0xFF, (e & 0xFF) // 8) for e in entries),
    )


def _unsigned(data: bytes) -> int:
    (value,) = struct.unpack("<" + _FORMATS[8 * len(data)], data)
    return int(value)
