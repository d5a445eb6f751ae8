"""What a mock drive is built with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MockAxis:
    """What a mock drive is built with.

    `machine_id` is that of table images. Positions in metres are true encoder positions, whatever the drive counts; it
    starts under its brake at `start_m`. A rotary axis is in radians where it says metres. A drive has a partner, whose
    command its table depends on, where a machine has two. Faults of the drives strike the one that `is_first`. Many
    real drives have no `absolute_encoder`, and many no SDO `block_transfer`.
    """

    name: str
    partner_node_id: int | None
    machine_id: bytes
    travel_m: tuple[float, float]
    start_m: float
    is_first: bool = True
    absolute_encoder: bool = True
    block_transfer: bool = True
