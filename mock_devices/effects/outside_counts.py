"""What a drive's legs leave besides sums: fast motions since a moment, the place of the last rest, a last long way."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.state import Array, Leg, MotionState


class FastMotions:
    """Starts of the motions of one drive, and which of them were fast."""

    def __init__(self, speed_m_per_s: float) -> None:
        self._speed_m_per_s = speed_m_per_s
        self._starts_s: list[float] = []
        self._counts = [0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        self._starts_s.append(leg.start_s)
        fast = leg.speed_m_per_s > self._speed_m_per_s and leg.to_m != leg.from_m
        self._counts.append(self._counts[-1] + fast)

    def since(self, from_s: Array, state: MotionState, drive: int) -> Array:
        """How many fast ones began since from_s (n,), including the one under way or the last one."""
        counts, leg = np.array(self._counts), state.leg[:, drive]
        first = np.minimum(np.searchsorted(np.array(self._starts_s), from_s, side="left"), leg)
        moved = state.q_m[:, drive] != state.from_m[:, drive]
        last = (state.leg_start_s[:, drive] >= from_s) & moved & (state.speed_m_per_s[:, drive] > self._speed_m_per_s)
        return np.asarray(counts[leg] - counts[first] + last, dtype=np.float64)


class RestedAt:
    """Where a drive has rested last for a while before its leg, and how long; at `first_m` for no time before any."""

    def __init__(self, least_s: float, first_m: float) -> None:
        self._least_s = least_s
        self._before = [(first_m, 0.0)]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        rested_s = leg.until_s - leg.end_s
        self._before.append((leg.to_m, rested_s) if rested_s >= self._least_s else self._before[-1])

    def at(self, state: MotionState, drive: int) -> Array:
        """Place and time of that rest (n, 2) before the leg under way or the last one."""
        return np.array([self._before[k] for k in state.leg[:, drive].tolist()])


class LastLongWay:
    """The last way of a drive, with its sign, that was longer than some; none before the first."""

    def __init__(self, longer_m: float) -> None:
        self._longer_m = longer_m
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg has ended."""
        way_m = leg.to_m - leg.from_m
        self._before.append(way_m if abs(way_m) > self._longer_m else self._before[-1])

    def at(self, state: MotionState, drive: int) -> Array:
        """The way (n,) at the moments of a state; one under way counts once it is long."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        way_m = state.q_m[:, drive] - state.from_m[:, drive]
        return np.where(np.abs(way_m) > self._longer_m, way_m, before)
