"""How much of a CAN bus the drives of a machine need while they are led by SYNC, with the most stuffing possible."""

from __future__ import annotations

_FIXED_BITS = 44  # of a standard data frame without data: start, identifier, control, CRC, acknowledge, end
_STUFFED_BITS = 34  # of these may be stuffed: start to CRC
_INTERFRAME_BITS = 3
_TARGET_BYTES, _ANSWER_BYTES = 4, 8
MOST_LOAD = 0.75  # what is left is for heartbeats, SDO and what is sent again


def frame_bits(data_bytes: int) -> int:
    """Bits of a standard data frame with up to 8 bytes, stuffed as often as can be, and the pause after it.

    A bit is stuffed after five equal ones, the first such bit after five, any other after four more (ISO 11898-1).
    """
    if not 0 <= data_bytes <= 8:
        raise ValueError(f"a frame has 0 to 8 bytes, not {data_bytes}")
    data = 8 * data_bytes
    return _FIXED_BITS + data + (_STUFFED_BITS + data - 1) // 4 + _INTERFRAME_BITS


def sync_bits(drives: int) -> int:
    """Bits of one period: SYNC, and for each drive its target and its two answers."""
    return frame_bits(0) + drives * (frame_bits(_TARGET_BYTES) + 2 * frame_bits(_ANSWER_BYTES))


def sync_load(drives: int, period_s: float, bitrate: int) -> float:
    """Share of the bus that SYNC with its targets and answers needs."""
    return sync_bits(drives) / (bitrate * period_s)
