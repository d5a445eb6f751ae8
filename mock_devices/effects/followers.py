"""What follows a drive and remembers where it stood: a part that nears what its place gives it, a part with play."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.state import Array, Leg, MotionState

Throws = Callable[[Array, Array], NDArray[np.bool_]]


class PlaceMemory:
    """Nears, with a time constant, an aim that depends on where a drive stands; zero at first.

    On the way between two places the aim is the mean of theirs.
    """

    def __init__(self, aim: Callable[[Array], Array], tau_s: float) -> None:
        self._aim, self._tau_s = aim, tau_s
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.from_m, leg.to_m))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """Where it is at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        start_s, end_s = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        return self._after(before, start_s, end_s, state.t_s, state.from_m[:, drive], state.q_m[:, drive])

    def _after(self, before: Array, start_s: Array, end_s: Array, t_s: Array, from_m: Array, to_m: Array) -> Array:
        there = self._aim(to_m)
        underway = 0.5 * (self._aim(from_m) + there)
        moved_s, rested_s = np.minimum(end_s, t_s) - start_s, np.maximum(t_s - end_s, 0.0)
        arrived = underway + (before - underway) * np.exp(-moved_s / self._tau_s)
        return np.asarray(there + (arrived - there) * np.exp(-rested_s / self._tau_s))


class FieldMemory:
    """As PlaceMemory, of many cells at once: the aim (n, cells) depends on where a drive stands."""

    def __init__(self, aim: Callable[[Array], Array], cells: int, tau_s: float) -> None:
        self._aim, self._tau_s = aim, tau_s
        self._before = [np.zeros(cells)]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.from_m, leg.to_m))
        self._before.append(self._after(self._before[-1][None], *ends)[0])

    def at(self, state: MotionState, drive: int) -> Array:
        """Where they are at the moments of a state (n, cells)."""
        before = np.stack([self._before[k] for k in state.leg[:, drive].tolist()])
        start_s, end_s = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        return self._after(before, start_s, end_s, state.t_s, state.from_m[:, drive], state.q_m[:, drive])

    def _after(self, before: Array, start_s: Array, end_s: Array, t_s: Array, from_m: Array, to_m: Array) -> Array:
        there = self._aim(to_m)
        underway = 0.5 * (self._aim(from_m) + there)
        moved_s, rested_s = np.minimum(end_s, t_s) - start_s, np.maximum(t_s - end_s, 0.0)
        arrived = underway + (before - underway) * np.exp(-moved_s / self._tau_s)[:, None]
        return np.asarray(there + (arrived - there) * np.exp(-rested_s / self._tau_s)[:, None])


class Fanned:
    """Nears one with a time constant at rest, and cools `faster(speed)` times as fast while its drive moves; zero at
    first. What warms it stays the same, so that it nears one over that during a motion."""

    def __init__(self, faster: Callable[[Array], Array], tau_s: float) -> None:
        self._faster, self._tau_s = faster, tau_s
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.speed_m_per_s))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """Its warmth at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        start_s, end_s = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        return self._after(before, start_s, end_s, state.t_s, state.speed_m_per_s[:, drive])

    def _after(self, before: Array, start_s: Array, end_s: Array, t_s: Array, speed: Array) -> Array:
        moved_s, rested_s = np.minimum(end_s, t_s) - start_s, np.maximum(t_s - end_s, 0.0)
        faster = self._faster(speed)
        arrived = 1.0 / faster + (before - 1.0 / faster) * np.exp(-faster * moved_s / self._tau_s)
        return np.asarray(1.0 + (arrived - 1.0) * np.exp(-rested_s / self._tau_s))


class HeldWarm:
    """Nears one with a time constant while its drive rests, and zero `faster` times as fast while that moves; zero at
    first."""

    def __init__(self, faster: float, tau_s: float) -> None:
        self._faster, self._tau_s = faster, tau_s
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """Its warmth at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        return self._after(before, state.leg_start_s[:, drive], state.leg_end_s[:, drive], state.t_s)

    def _after(self, before: Array, start_s: Array, end_s: Array, t_s: Array) -> Array:
        moved_s, rested_s = np.minimum(end_s, t_s) - start_s, np.maximum(t_s - end_s, 0.0)
        arrived = before * np.exp(-self._faster * moved_s / self._tau_s)
        return np.asarray(1.0 + (arrived - 1.0) * np.exp(-rested_s / self._tau_s))


class Stirred:
    """What every metre of a drive's way mixes, down by e in `mixes_m`, and what forms anew with a time constant; one
    at first. A leg mixes at its middle."""

    def __init__(self, mixes_m: float, forms_s: float) -> None:
        self._mixes_m, self._forms_s = mixes_m, forms_s
        self._before = [1.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.to_m - leg.from_m))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """What is left at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        way_m = state.q_m[:, drive] - state.from_m[:, drive]
        return self._after(before, state.leg_start_s[:, drive], state.leg_end_s[:, drive], state.t_s, way_m)

    def _after(self, before: Array, start_s: Array, end_s: Array, t_s: Array, way_m: Array) -> Array:
        middle_s = np.minimum(0.5 * (start_s + end_s), t_s)
        formed = 1.0 + (before - 1.0) * np.exp(-(middle_s - start_s) / self._forms_s)
        mixed = formed * np.exp(-np.abs(way_m) / self._mixes_m)
        return np.asarray(1.0 + (mixed - 1.0) * np.exp(-(t_s - middle_s) / self._forms_s))


class LastThrow:
    """The sign of the last motion that `throws`, by its speed and start: -1 or 1, and 0 before the first."""

    def __init__(self, throws: Throws) -> None:
        self._throws = throws
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg has ended with a stop."""
        way_m, speed, start_s = (np.array([x]) for x in (leg.to_m - leg.from_m, leg.speed_m_per_s, leg.start_s))
        thrown = self._throws(speed, start_s)
        self._before.append(float(np.where(thrown & (way_m != 0.0), np.sign(way_m), self._before[-1])[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """The sign at the moments of a state (n,); a motion under way has not stopped yet."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        way_m = state.q_m[:, drive] - state.from_m[:, drive]
        stopped = (state.t_s >= state.leg_end_s[:, drive]) & (way_m != 0.0)
        thrown = self._throws(state.speed_m_per_s[:, drive], state.leg_start_s[:, drive])
        return np.where(stopped & thrown, np.sign(way_m), before)


class Dragged:
    """Is dragged along by a drive once its play of `half_m` either way is used up; in `first_m` at first."""

    def __init__(self, half_m: float, first_m: float) -> None:
        self._half_m = half_m
        self._before = [first_m]

    def record(self, leg: Leg) -> None:
        """A leg has ended."""
        self._before.append(float(np.clip(self._before[-1], leg.to_m - self._half_m, leg.to_m + self._half_m)))

    def at(self, state: MotionState, drive: int) -> Array:
        """Where it is at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        q_m = state.q_m[:, drive]
        return np.clip(before, q_m - self._half_m, q_m + self._half_m)


class Flipped:
    """A relay with two thresholds: 1 once a drive has been above the higher one, -1 once below the lower one, and as it
    was in between; -1 at first."""

    def __init__(self, low_m: float, high_m: float) -> None:
        self._low_m, self._high_m = low_m, high_m
        self._before = [-1.0]

    def record(self, leg: Leg) -> None:
        """A leg has ended, which has been farthest at its ends."""
        self._before.append(float(self._after(np.array([self._before[-1]]), np.array([leg.to_m]))[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """The side at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        return self._after(before, state.q_m[:, drive])

    def _after(self, before: Array, q_m: Array) -> Array:
        return np.where(q_m > self._high_m, 1.0, np.where(q_m < self._low_m, -1.0, before))
