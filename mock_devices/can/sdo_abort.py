"""Refusals of an SDO transfer."""

from __future__ import annotations


class RefusedWrite(Exception):
    """A write that the drive refuses; `abort_code` is that of SDO."""

    def __init__(self, abort_code: int) -> None:
        super().__init__(f"0x{abort_code:08X}")
        self.abort_code = abort_code


STATE_FORBIDS = 0x08000022
VALUE_RANGE = 0x06090030
