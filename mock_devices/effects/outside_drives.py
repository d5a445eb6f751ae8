"""Effects outside the catalogue that live in a drive, its guide or its carriage."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, Leg, MotionState, StatefulEffect
from mock_devices.effects.outside_shapes import CUBIC, OutsideEffect, apply_variant


class LooseBolt(StatefulEffect):
    """A carriage plate with a loose bolt has two places: it flips up high and down low on the column."""

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """Which place: changed by passing a quarter from either end."""
        return float(self._flip(np.array([leg.to_m]), np.array([before]), drive)[0])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the carriage."""
        y = self._flip(state.q_m[:, self.place], self.state_before(state, self.place), self.place)
        deviation.yaw_rad[:, self.place] += self.size * apply_variant(
            np.where(y == 0.0, -1.0, y), self.variant, state.payload_kg
        )
        if self.variant == "saturating":
            deviation.sideways_m[:, self.place] += 0.05 * self.size * y

    def _flip(self, q_m: Array, held: Array, drive: int) -> Array:
        middle, half = self.site.drive_range_m(drive)
        x, limit = (q_m - middle) / half, 0.15 if self.variant == CUBIC else 0.3
        return np.where(x > limit, 1.0, np.where(x < -limit, -1.0, held))


class AirBearingLift(OutsideEffect):
    """The bearing's gap follows the compressor: pressure falls slowly and is pumped up again."""

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(1.0 - 2.0 * ((self.elapsed_s(state) / 640.0 + self.phase) % 1.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lift the slider off its guide."""
        deviation.sideways_m[:, self.place] += self.signal(state)


class OilFilm(OutsideEffect):
    """A plain guide floats up with speed and sinks slowly at rest."""

    def _unit(self, state: MotionState) -> Array:
        speed = state.speed_m_per_s[:, self.place] / 0.5
        return np.asarray(np.sqrt(np.maximum(speed, 0.0)) * np.exp(-state.since_s[:, self.place] / 12.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lift the slider off its guide."""
        deviation.sideways_m[:, self.place] += self.signal(state)


class MagnetDetent(OutsideEffect):
    """Magnets pull a linear motor into detents, harder from one side than from the other."""

    def _unit(self, state: MotionState) -> Array:
        q = state.q_m[:, self.place]
        return np.asarray(np.sin(2.0 * np.pi * q / 0.048 + self.phase) * (1.0 + 0.8 * state.direction[:, self.place]))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


class LubricationPulse(StatefulEffect):
    """Every few metres of way the lubricator gives a pulse, and the guide floats until it is used up."""

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The way so far."""
        return before + abs(leg.to_m - leg.from_m)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lift the slider off its guide."""
        way = self.state_before(state, self.place) + np.abs(state.q_m[:, self.place] - state.from_m[:, self.place])
        y = np.exp(-(way % 7.0) / 1.5)
        deviation.sideways_m[:, self.place] += self.size * apply_variant(y, self.variant, state.payload_kg)
