"""Lines of GeoCOM: parse a request, write an answer.

Request `%R1Q,<rpc>[,<trid>[,<crc>]]:<params>`, answer `%R1P,<com>,<trid>[,<crc>]:<rpc code>[,<values>]`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

COM_CANT_DECODE_REQUEST = 3080
COM_CHECKSUM = 3101
MOST_TRANSACTION = 32767

_REQUEST = re.compile(r"%R1Q,(\d{1,5})(?:,(\d{1,5}))?(?:,(\d{1,5}))?:([\x20-\x7e]*)")

Value = bool | int | float | str


class LineError(ValueError):
    """A malformed request. `com_code` and `transaction` go into the answer."""

    def __init__(self, com_code: int, transaction: int = 0) -> None:
        super().__init__(f"GeoCOM {com_code}")
        self.com_code = com_code
        self.transaction = transaction


@dataclass(frozen=True)
class Request:
    """One request; `checked` tells that it carried a checksum, which the answer then carries too."""

    rpc: int
    transaction: int
    params: tuple[str, ...]
    checked: bool


def parse_request(line: bytes) -> Request:
    """Parse a line without its end; raises LineError."""
    match = _REQUEST.fullmatch(line.decode("ascii", "replace"))
    if match is None:
        raise LineError(COM_CANT_DECODE_REQUEST)
    rpc, transaction, crc, params = match[1], int(match[2] or 0), match[3], match[4]
    if transaction > MOST_TRANSACTION:
        raise LineError(COM_CANT_DECODE_REQUEST)
    if crc is not None:
        without = f"%R1Q,{rpc},{match[2]}:{params}"
        if crc16(without.encode("ascii")) != int(crc):
            raise LineError(COM_CHECKSUM, transaction)
    return Request(int(rpc), transaction, tuple(params.split(",")) if params else (), crc is not None)


def format_answer(
    com_code: int,
    transaction: int,
    rpc_code: int,
    values: Sequence[Value] = (),
    *,
    decimals: int = 4,
    checked: bool = False,
) -> bytes:
    """An answer with its line end; floats with so many decimals."""
    tail = ":" + ",".join([str(rpc_code), *(format_value(value, decimals) for value in values)])
    head = f"%R1P,{com_code},{transaction}"
    crc = f",{crc16((head + tail).encode('ascii'))}" if checked else ""
    return (head + crc + tail + "\r\n").encode("ascii")


def format_value(value: Value, decimals: int) -> str:
    """One value as the station writes it."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return f"{value:.{decimals}f}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ 0xA001 if byte & 1 else byte >> 1
    return byte


_CRC_OF_BYTES = tuple(_crc_of_byte(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """CRC-16/ARC: polynomial 0x8005 reflected, start 0."""
    crc = 0
    for byte in data:
        crc = (crc >> 8) ^ _CRC_OF_BYTES[(crc ^ byte) & 0xFF]
    return crc
