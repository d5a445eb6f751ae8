"""Images of compensation tables as a drive keeps them (docs/reference/drive-objects.md): decode, check, interpolate."""

from __future__ import annotations

import hashlib
import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

_HEAD = struct.Struct("<4sHHIIi16s")
_AXIS = struct.Struct("<iiH")
_SIDES = struct.Struct("<ii")
_BY_DIRECTION = 2  # the version whose head goes on with a value for each direction
_MAGIC = b"PKMT"
_FEWEST, _MOST = 2, 64
_INT32_MAX = 2**31 - 1


class ImageError(ValueError):
    """The bytes are not a whole table for this drive; says why."""


class BankStatus(IntEnum):
    """Object 0x2101:05."""

    EMPTY = 0
    WHOLE = 1
    DAMAGED = 2


@dataclass(frozen=True)
class GridAxis:
    """Equally spaced commanded positions in increments."""

    start_inc: int
    step_inc: int
    count: int

    @property
    def end_inc(self) -> int:
        """The last position of the grid."""
        return self.start_inc + self.step_inc * (self.count - 1)

    def covers(self, position_inc: float) -> bool:
        """Whether a position is on the grid, its ends included."""
        return self.start_inc <= position_inc <= self.end_inc

    def cell(self, position_inc: float) -> tuple[int, float]:
        """Index of the cell and the share within it; positions beyond the ends count as the ends."""
        where = (position_inc - self.start_inc) / self.step_inc
        index = min(max(int(where), 0), self.count - 2)
        return index, min(max(where - index, 0.0), 1.0)


@dataclass(frozen=True)
class Table:
    """A compensation table: corrections in increments, own index major.

    up_inc, down_inc: added after the drive's motion in positive and in negative direction.
    """

    node_id: int
    generation: int
    payload_g: int
    temperature_mdegc: int
    machine_id: bytes
    own: GridAxis
    partner: GridAxis
    corrections_inc: tuple[int, ...]
    crc: int
    up_inc: int = 0
    down_inc: int = 0

    def correction_inc(self, own_inc: float, partner_inc: float, direction: int = 0) -> float:
        """Bilinear, and what the last `direction` adds (0: not moved yet, the mean of both).

        Beyond the grid that of its edge (set-points there are refused).
        """
        i, u = self.own.cell(own_inc)
        j, v = self.partner.cell(partner_inc)
        n, c = self.partner.count, self.corrections_inc
        low = c[i * n + j] * (1.0 - v) + c[i * n + j + 1] * v
        high = c[(i + 1) * n + j] * (1.0 - v) + c[(i + 1) * n + j + 1] * v
        share_up = 0.5 * (1 + direction)
        return low * (1.0 - u) + high * u + share_up * self.up_inc + (1.0 - share_up) * self.down_inc

    def covers(self, own_inc: float, partner_inc: float) -> bool:
        """Whether both positions are on the grid."""
        return self.own.covers(own_inc) and self.partner.covers(partner_inc)


def machine_id_of(name: str) -> bytes:
    """First 16 bytes of SHA-256 of a machine's name."""
    return hashlib.sha256(name.encode()).digest()[:16]


def decode_image(image: bytes, node_id: int, machine_id: bytes) -> Table:
    """Decode and check an image for one drive of one machine; raises ImageError."""
    if len(image) < _HEAD.size + 2 * _AXIS.size + 4:
        raise ImageError(f"{len(image)} bytes are too few")
    magic, version, node, generation, payload_g, mdegc, machine = _HEAD.unpack_from(image)
    if magic != _MAGIC or version not in (1, _BY_DIRECTION):
        raise ImageError("not a table of version 1 or 2")
    own = GridAxis(*_AXIS.unpack_from(image, _HEAD.size))
    partner = GridAxis(*_AXIS.unpack_from(image, _HEAD.size + _AXIS.size))
    for axis in (own, partner):
        if not _FEWEST <= axis.count <= _MOST or axis.step_inc <= 0 or axis.end_inc > _INT32_MAX:
            raise ImageError(f"an axis of {axis.count} positions, {axis.step_inc} increments apart")
    first, number = _HEAD.size + 2 * _AXIS.size, own.count * partner.count
    up_inc = down_inc = 0
    if version == _BY_DIRECTION:
        up_inc, down_inc = _SIDES.unpack_from(image, first)
        first += _SIDES.size
    if len(image) != first + 4 * number + 4:
        raise ImageError(f"{len(image)} bytes do not hold {own.count} x {partner.count} corrections")
    (crc,) = struct.unpack_from("<I", image, len(image) - 4)
    if crc != stored_crc(image):
        raise ImageError("the CRC does not match")
    if node != node_id or machine != machine_id:
        raise ImageError(f"made for node {node} or another machine")
    corrections = struct.unpack_from(f"<{number}i", image, first)
    return Table(
        node_id=node,
        generation=generation,
        payload_g=payload_g,
        temperature_mdegc=mdegc,
        machine_id=machine,
        own=own,
        partner=partner,
        corrections_inc=corrections,
        crc=crc,
        up_inc=up_inc,
        down_inc=down_inc,
    )


def stored_crc(image: bytes) -> int:
    """CRC-32 of an image without its last four bytes, where its own CRC stands."""
    return zlib.crc32(image[:-4])


class Bank:
    """One of a drive's two places for a table. Keeps whatever is written, checks when asked."""

    def __init__(self, node_id: int, machine_id: bytes) -> None:
        self._node_id, self._machine_id = node_id, machine_id
        self.image = b""
        self.table: Table | None = None

    def write(self, image: bytes) -> None:
        """Store an image, whole or not."""
        self.image = bytes(image)
        try:
            self.table = decode_image(self.image, self._node_id, self._machine_id)
        except ImageError:
            self.table = None

    @property
    def status(self) -> BankStatus:
        """Object 05."""
        if self.table is not None:
            return BankStatus.WHOLE
        return BankStatus.DAMAGED if self.image else BankStatus.EMPTY

    @property
    def crc(self) -> int:
        """Object 02: of what is stored, 0 if nothing is."""
        return stored_crc(self.image) if self.image else 0
