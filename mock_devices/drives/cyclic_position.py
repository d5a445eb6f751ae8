"""Cyclic synchronous position mode (CiA 402, mode 8) of a mock drive: how it gets from SYNC to SYNC.

The target at a SYNC, however old, is reached one interpolation time period (0x60C2) later, at constant speed, whenever
the next SYNC arrives; the axis waits there. A step that the motor cannot make in that time is a following error. An
axis that is away from its target at a SYNC and receives none for three periods has lost its master: a fault. One that
is on its target is not affected; other makes may require SYNC for as long as they are enabled.
Statusword bit 12: the axis is enabled and the last target was acceptable.
Not modelled: limits of acceleration, extrapolation over a missing SYNC, targets that arrive too late.
"""

from __future__ import annotations

from dataclasses import dataclass

from mock_devices.can.sdo_abort import VALUE_RANGE, RefusedWrite
from mock_devices.drives.axis_motion import Dynamics

FASTEST_INC_PER_S = 200_000_000.0
_PERIODS_WITHOUT_SYNC = 3.0
_SMALLEST_INC = 0.5
_STEEP_INC_PER_S2 = 1e14


@dataclass
class CyclicPosition:
    """Object 0x60C2 as units times a power of ten of a second, and the state of the cyclic motion.

    `under_way`: it was away from its target at the last SYNC. `ignores`: the last target was refused.
    """

    units: int = 50
    exponent: int = -3
    under_way: bool = False
    ignores: bool = False

    @property
    def period_s(self) -> float:
        """The interpolation time period."""
        return float(self.units * 10.0**self.exponent)

    @property
    def patience_s(self) -> float:
        """For how long the axis may move without a SYNC; 0: no limit."""
        return _PERIODS_WITHOUT_SYNC * self.period_s if self.under_way else 0.0

    def set_units(self, units: int) -> None:
        """Object 0x60C2:01. Raises RefusedWrite."""
        if not 1 <= units <= 255:
            raise RefusedWrite(VALUE_RANGE)
        self.units = units

    def set_exponent(self, exponent: int) -> None:
        """Object 0x60C2:02. Raises RefusedWrite."""
        if not -6 <= exponent <= 0:
            raise RefusedWrite(VALUE_RANGE)
        self.exponent = exponent

    def step(self, way_inc: float, window_inc: int) -> Dynamics | None:
        """How to travel the remaining distance at a SYNC; None if there is none."""
        self.under_way = abs(way_inc) > window_inc
        if abs(way_inc) < _SMALLEST_INC:
            return None
        return Dynamics(abs(way_inc) / self.period_s, _STEEP_INC_PER_S2, _STEEP_INC_PER_S2)
