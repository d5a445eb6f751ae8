"""What follows a drive and remembers where it stood: a part that nears what its place gives it, a part with play."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mock_devices.effects.state import Array, Leg, MotionState


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
