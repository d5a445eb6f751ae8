"""What the legs of a drive leave behind: heat, wear, counts of motions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mock_devices.effects.state import Array, Leg, MotionState

FOR_EVER = float("inf")
Leaves = Callable[[Array, Array, Array], Array]


class LegMemory:
    """Sum over the legs of one drive of what each leaves, in parts that fade with time constants of their own.

    `leaves` gives it (n,) from signed travel, speed and start time. It is left at the middle of a leg.
    """

    def __init__(self, leaves: Leaves, *fade_s: float) -> None:
        self._leaves = leaves
        self._fade_s = np.array(fade_s or (FOR_EVER,))
        self._before = [np.zeros(len(self._fade_s))]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        way, speed, start, end, until = (
            np.array([x]) for x in (leg.to_m - leg.from_m, leg.speed_m_per_s, leg.start_s, leg.end_s, leg.until_s)
        )
        self._before.append(self._after(self._before[-1][None], way, speed, start, end, until)[0])

    def at(self, state: MotionState, drive: int) -> Array:
        """The sums (n, parts) at the moments of a state, including the leg under way or the last one."""
        before = np.stack([self._before[k] for k in state.leg[:, drive].tolist()])
        way = state.q_m[:, drive] - state.from_m[:, drive]
        start, end = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        return self._after(before, way, state.speed_m_per_s[:, drive], start, end, state.t_s)

    def _after(self, before: Array, way_m: Array, speed: Array, start_s: Array, end_s: Array, t_s: Array) -> Array:
        since_s = t_s - np.minimum(0.5 * (start_s + end_s), t_s)
        kept, left = (np.exp(-age[:, None] / self._fade_s) for age in (t_s - start_s, since_s))
        return np.asarray(before * kept + self._leaves(way_m, speed, start_s)[:, None] * left)


class PassMemory:
    """Metres that a drive has run within a stretch of its travel, which fade with a time constant.

    They are left at the middle of a leg, and count as many times as `weighs` says by its speed.
    """

    def __init__(
        self, low_m: float, high_m: float, fade_s: float, weighs: Callable[[Array], Array] = np.ones_like
    ) -> None:
        self._low_m, self._high_m, self._fade_s, self._weighs = low_m, high_m, fade_s, weighs
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.from_m, leg.to_m, leg.speed_m_per_s, leg.start_s, leg.end_s, leg.until_s))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """The metres (n,) at the moments of a state."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        start_s, end_s = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        speed = state.speed_m_per_s[:, drive]
        return self._after(before, state.from_m[:, drive], state.q_m[:, drive], speed, start_s, end_s, state.t_s)

    def _after(
        self, before: Array, from_m: Array, to_m: Array, speed: Array, start_s: Array, end_s: Array, t_s: Array
    ) -> Array:
        inside = np.clip(to_m, self._low_m, self._high_m) - np.clip(from_m, self._low_m, self._high_m)
        since_s = t_s - np.minimum(0.5 * (start_s + end_s), t_s)
        kept, left = np.exp(-(t_s - start_s) / self._fade_s), np.exp(-since_s / self._fade_s)
        return np.asarray(before * kept + np.abs(inside) * self._weighs(speed) * left)


class Reversals:
    """How many motions of a drive went against the one before; a motion under way counts."""

    def __init__(self) -> None:
        self._before = [(0.0, 0.0)]  # their number, and the sign of the last motion

    def record(self, leg: Leg) -> None:
        """A leg has ended."""
        count, last = self._before[-1]
        side = float(np.sign(leg.to_m - leg.from_m))
        self._before.append((count + (side * last < 0.0), side or last))

    def at(self, state: MotionState, drive: int) -> Array:
        """Their number (n,) at the moments of a state."""
        count, last = np.array([self._before[k] for k in state.leg[:, drive].tolist()]).T
        return np.asarray(count + ((state.q_m[:, drive] - state.from_m[:, drive]) * last < 0.0))


def ways_m(way_m: Array, _speed: Array, _start_s: Array) -> Array:
    """Metres travelled, in either direction."""
    return np.abs(way_m)


def motions(way_m: Array, _speed: Array, _start_s: Array) -> Array:
    """One for each motion."""
    return (way_m != 0.0).astype(np.float64)
