"""What flows where a drive moves: coolant that is pumped as fast as that last went, oil that its own heat thins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mock_devices.effects.state import Array, Leg, MotionState


class PumpedCoolant:
    """Nears one over `faster(speed)`, that many times as fast, from one motion of its drive to the next; zero at first.

    What warms it stays the same, and the pump keeps the speed of the last motion.
    """

    def __init__(self, faster: Callable[[Array], Array], tau_s: float) -> None:
        self._faster, self._tau_s = faster, tau_s
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        ends = (np.array([x]) for x in (leg.start_s, leg.until_s, leg.speed_m_per_s))
        self._before.append(float(self._after(np.array([self._before[-1]]), *ends)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """Its warmth at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        return self._after(before, state.leg_start_s[:, drive], state.t_s, state.speed_m_per_s[:, drive])

    def _after(self, before: Array, start_s: Array, t_s: Array, speed: Array) -> Array:
        faster = self._faster(speed)
        left = np.exp(-faster * np.maximum(t_s - start_s, 0.0) / self._tau_s)
        return np.asarray(1.0 / faster + (before - 1.0 / faster) * left)


class ThinnedOil:
    """Warmth that ways leave through oil, which is the thinner, and so heats the less, the warmer it is; zero at first.

    A way leaves `heats(way, speed)` where the warmth is one, by exp(-thins) of that for each one more; it fades with a
    time constant. The heat of a leg is set free in its middle, and thins the oil while it is.
    """

    def __init__(self, heats: Callable[[Array, Array], Array], thins: float, tau_s: float) -> None:
        self._heats, self._thins, self._tau_s = heats, thins, tau_s
        self._before = [0.0]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        way_m, speed, *times = (
            np.array([x]) for x in (leg.to_m - leg.from_m, leg.speed_m_per_s, leg.start_s, leg.end_s, leg.until_s)
        )
        self._before.append(float(self._after(np.array([self._before[-1]]), way_m, speed, *times)[0]))

    def at(self, state: MotionState, drive: int) -> Array:
        """The warmth at the moments of a state (n,)."""
        before = np.array([self._before[k] for k in state.leg[:, drive].tolist()])
        way_m = state.q_m[:, drive] - state.from_m[:, drive]
        start_s, end_s = state.leg_start_s[:, drive], state.leg_end_s[:, drive]
        return self._after(before, way_m, state.speed_m_per_s[:, drive], start_s, end_s, state.t_s)

    def _after(self, before: Array, way_m: Array, speed: Array, start_s: Array, end_s: Array, t_s: Array) -> Array:
        middle_s = np.minimum(0.5 * (start_s + end_s), t_s)
        warm = before * np.exp(-(middle_s - start_s) / self._tau_s)
        heat = self._heats(way_m, speed) * np.exp(-self._thins * (warm - 1.0))
        warm = warm + np.log1p(self._thins * heat) / self._thins  # solves dw = heat exp(-thins (w - warm)) dx, x to 1
        return np.asarray(warm * np.exp(-(t_s - middle_s) / self._tau_s))
