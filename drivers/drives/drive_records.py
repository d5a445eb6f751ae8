"""What a drive is, what it is expected to be, and what it sends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from drivers.drives import cia402
from drivers.drives.cia402 import State

_EMERGENCY_TEXTS = {
    0x2310: "over-current",
    0x3210: "over-voltage",
    0x3220: "under-voltage",
    0x7305: "encoder 1",
    0x7306: "encoder 2",
    0x8120: "CAN passive",
    0x8130: "heartbeat lost",
    0x8611: "following error",
    0x8700: "no SYNC",
    0xFF20: "a strut bears more than it may",
    0xFF11: "the master stayed away: the table on trial is not used any more",
    0xFF10: "partner's command unknown, stale or outside the table's grid",
}


class Heartbeat(Enum):
    """State of the drive's heartbeat."""

    NEVER = "never seen"
    ALIVE = "alive"
    LATE = "late"
    LOST = "lost"


@dataclass(frozen=True)
class DriveExpectation:
    """What the drive must be, and its travel; None is not checked."""

    vendor: int | None = None
    product: int | None = None
    metres_per_increment: float = 1e-8
    travel_m: tuple[float, float] = (-math.inf, math.inf)
    serial: int | None = None


@dataclass(frozen=True)
class DriveTimeouts:
    """How long a drive may take. Rig time, except `sdo_s` for one SDO answer, which is host time.

    `state_s` is the limit for a change of state. The drive sends its heartbeat every `heartbeat_ms`; it is late after
    `heartbeat_late_s` and lost after `heartbeat_lost_s`. `master_lost_ms`: after that time without the master's
    heartbeat the drive stops by itself.
    """

    sdo_s: float = 1.0
    state_s: float = 3.0
    poll_period_s: float = 0.02
    heartbeat_ms: int = 500
    heartbeat_late_s: float = 1.0
    heartbeat_lost_s: float = 2.5
    master_lost_ms: int = 1500


@dataclass(frozen=True)
class DriveIdentity:
    """Identity object 0x1018."""

    vendor: int
    product: int
    revision: int
    serial: int

    @property
    def simulated(self) -> bool:
        """Whether the serial number says so: its three high bytes are "SIM" (docs/reference/devices.md)."""
        return self.serial >> 8 == int.from_bytes(b"SIM", "big")


@dataclass(frozen=True)
class Emergency:
    """One EMCY message; code 0 reports that the error is gone."""

    code: int
    register: int
    t_rig_s: float
    t_host_s: float = 0.0

    @property
    def is_error(self) -> bool:
        """False for the message that reports the end of an error."""
        return self.code & 0xFF00 != 0

    def __str__(self) -> str:
        text = _EMERGENCY_TEXTS.get(self.code, "see the drive's manual")
        return f"EMCY 0x{self.code:04X} ({text})"


@dataclass(frozen=True)
class DriveSample:
    """What a drive sent at one SYNC.

    Torque is a fraction of the rated one, the following error is demand minus actual.
    """

    statusword: int
    position_m: float
    demand_m: float
    velocity_m_per_s: float
    torque_fraction: float
    following_error_m: float
    t_rig_s: float
    t_host_s: float

    @property
    def state(self) -> State:
        """State of the drive's state machine."""
        return cia402.state_of(self.statusword)
