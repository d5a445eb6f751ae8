"""An object of a node's dictionary, as SDO transfers read and write it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DriveObject:
    """Index, sub-index, `struct` format (little-endian) and name of one object; format "" is a DOMAIN.

    `holds`: it reads back what was written, so that a write whose answer was lost can be cleared up by reading.
    """

    index: int
    sub: int
    format: str
    name: str
    holds: bool = True

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.sub:02X} {self.name}"
