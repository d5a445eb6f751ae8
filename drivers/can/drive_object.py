"""An object of a node's dictionary, as SDO transfers read and write it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

OUT_OF_RANGE = 0x06090030
WRONG_STATE = 0x08000022


@dataclass(frozen=True)
class DriveObject:
    """Index, sub-index, `struct` format (little-endian) and name of one object; the format "" is a DOMAIN.

    `reads_back`: reading it returns what was written, so that after a lost answer reading tells whether a write has
    been carried out. `refusals`: meaning of an abort code for this object, and remedy, if they differ from CiA 301.
    """

    index: int
    sub: int
    format: str
    name: str
    reads_back: bool = True
    refusals: Mapping[int, tuple[str, str]] = field(default_factory=dict, compare=False)

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.sub:02X} {self.name}"
