"""The image of a compensation table as a drive stores it (docs/reference/drive-objects.md)."""

from __future__ import annotations

import hashlib
import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import TableError

MAGIC = b"PKMT"
VERSION, BY_DIRECTION = 1, 2  # of the image: the second has a value for each direction
FEWEST, MOST = 2, 64
_HEAD = struct.Struct("<4sHHIIi16siiHiiH")
_SIDES = struct.Struct("<ii")
_CRC = struct.Struct("<I")
_INT32 = 2**31
_UINT32 = 2**32


@dataclass(frozen=True)
class TableImage:
    """One table: corrections in metres over both commanded positions, `corrections_m[own, partner]`.

    They are added to the command. `partner_metres_per_increment` of 0 means the value of the own axis.
    up_m, down_m: added as well, after the drive's motion in positive and in negative direction; both 0: an image of
    version 1, which every drive with a table bank reads.
    """

    node_id: int
    generation: int
    payload_kg: float
    temperature_c: float
    machine_id: bytes
    own_start_m: float
    own_step_m: float
    partner_start_m: float
    partner_step_m: float
    corrections_m: NDArray[np.float64]
    metres_per_increment: float = 1e-8
    partner_metres_per_increment: float = 0.0
    up_m: float = 0.0
    down_m: float = 0.0

    @property
    def partner_increment_m(self) -> float:
        """Metres per increment of the partner's axis."""
        return self.partner_metres_per_increment or self.metres_per_increment


def machine_id_of(machine_name: str) -> bytes:
    """The 16 bytes that identify the machine to a drive."""
    return hashlib.sha256(machine_name.encode()).digest()[:16]


def image_crc(data: bytes) -> int:
    """The CRC in the last four bytes of an image. Raises TableError if the image is too short."""
    if len(data) < _HEAD.size + _CRC.size:
        raise _error(f"{len(data)} bytes are too few")
    return int(_CRC.unpack(data[-_CRC.size :])[0])


def encode_table(image: TableImage) -> bytes:
    """The image's bytes; positions and corrections are rounded to whole increments.

    Raises TableError for values that the format or a drive cannot hold.
    """
    corrections = np.asarray(image.corrections_m, dtype=np.float64)
    if corrections.ndim != 2 or not all(FEWEST <= n <= MOST for n in corrections.shape):
        raise _error(f"a grid of {corrections.shape} points; {FEWEST} to {MOST} per side are allowed")
    if len(image.machine_id) != 16:
        raise _error("the machine id is not 16 bytes long")
    own_m, partner_m = image.metres_per_increment, image.partner_increment_m
    if not (np.isfinite(corrections).all() and own_m > 0.0 and partner_m > 0.0):
        raise _error("a correction or an increment is not a usable number")
    counts = np.rint(corrections / own_m)
    if np.abs(counts).max() >= _INT32:
        raise _error("a correction does not fit")
    own_axis = (_int32(image.own_start_m / own_m), _positive(image.own_step_m / own_m))
    partner_axis = (_int32(image.partner_start_m / partner_m), _positive(image.partner_step_m / partner_m))
    try:
        axes = (*own_axis, corrections.shape[0], *partner_axis, corrections.shape[1])
        payload_g, temperature_mdegc = _uint32(image.payload_kg * 1e3), _int32(image.temperature_c * 1e3)
        contents = (image.node_id, image.generation, payload_g, temperature_mdegc, image.machine_id)
        sides = (_int32(image.up_m / own_m), _int32(image.down_m / own_m))
        head = _HEAD.pack(MAGIC, BY_DIRECTION if any(sides) else VERSION, *contents, *axes)
    except struct.error as error:
        raise _error(f"a number does not fit: {error}") from error
    body = head + (_SIDES.pack(*sides) if any(sides) else b"") + counts.astype("<i4").tobytes()
    return body + _CRC.pack(zlib.crc32(body))


def decode_table(
    data: bytes, metres_per_increment: float = 1e-8, partner_metres_per_increment: float = 0.0
) -> TableImage:
    """The table in an image. Raises TableError unless it is complete and valid."""
    if image_crc(data) != zlib.crc32(data[: -_CRC.size]):
        raise _error("the CRC is wrong")
    magic, version, node_id, generation, payload, temperature, machine_id, *axes = _HEAD.unpack_from(data)
    if magic != MAGIC or version not in (VERSION, BY_DIRECTION):
        raise _error(f"no table of version {VERSION} or {BY_DIRECTION}")
    own_start, own_step, own_count, partner_start, partner_step, partner_count = axes
    if not (FEWEST <= own_count <= MOST and FEWEST <= partner_count <= MOST):
        raise _error(f"a grid of {own_count} x {partner_count} points")
    if own_step <= 0 or partner_step <= 0:
        raise _error("a step is not positive")
    first = _HEAD.size + (_SIDES.size if version == BY_DIRECTION else 0)
    if len(data) != first + 4 * own_count * partner_count + _CRC.size:
        raise _error(f"{len(data)} bytes do not match {own_count} x {partner_count} points")
    up, down = _SIDES.unpack_from(data, _HEAD.size) if version == BY_DIRECTION else (0, 0)
    counts = np.frombuffer(data, dtype="<i4", count=own_count * partner_count, offset=first)
    partner_m = partner_metres_per_increment or metres_per_increment
    return TableImage(
        node_id=node_id,
        generation=generation,
        payload_kg=payload * 1e-3,
        temperature_c=temperature * 1e-3,
        machine_id=machine_id,
        own_start_m=own_start * metres_per_increment,
        own_step_m=own_step * metres_per_increment,
        partner_start_m=partner_start * partner_m,
        partner_step_m=partner_step * partner_m,
        corrections_m=counts.reshape(own_count, partner_count) * metres_per_increment,
        metres_per_increment=metres_per_increment,
        partner_metres_per_increment=partner_metres_per_increment,
        up_m=up * metres_per_increment,
        down_m=down * metres_per_increment,
    )


def _int32(value: float) -> int:
    if not math.isfinite(value) or abs(value) >= _INT32 - 1:
        raise _error(f"{value} does not fit")
    return round(value)


def _positive(value: float) -> int:
    step = _int32(value)
    if step <= 0:
        raise _error(f"a step of {value} increments is not positive")
    return step


def _uint32(value: float) -> int:
    if not (math.isfinite(value) and 0.0 <= value < _UINT32 - 1):
        raise _error(f"a payload of {value} g does not fit")
    return round(value)


def _error(what: str) -> TableError:
    return TableError("compensation table", "image", what, "compute the table anew")
