"""Builds table images by docs/reference/drive-objects.md, independently of the decoder."""

from __future__ import annotations

import hashlib
import zlib

import numpy as np

MACHINE_ID = hashlib.sha256(b"planar4").digest()[:16]


def image(
    corrections,
    *,
    node=1,
    generation=3,
    payload_g=0,
    own=(32_000_000, 8_625_000),
    partner=(32_000_000, 8_625_000),
    sides=None,
):
    corrections = np.asarray(corrections, dtype="<i4")
    rows, columns = corrections.shape
    head = b"PKMT" + np.array([1 if sides is None else 2, node], dtype="<u2").tobytes()
    head += np.array([generation, payload_g], dtype="<u4").tobytes() + np.array([20_000], dtype="<i4").tobytes()
    head += MACHINE_ID
    for (start, step), count in ((own, rows), (partner, columns)):
        head += np.array([start, step], dtype="<i4").tobytes() + np.array([count], dtype="<u2").tobytes()
    if sides is not None:
        head += np.array(sides, dtype="<i4").tobytes()
    body = head + corrections.tobytes()
    return body + zlib.crc32(body).to_bytes(4, "little")


def sealed(body):
    """Bytes with a right CRC behind."""
    return body + zlib.crc32(body).to_bytes(4, "little")
