"""Effects outside the catalogue that live in a drive, its guide or its carriage."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Departure, Leg, Moments, Remembering
from mock_devices.effects.outside_shapes import FINAL, Outside, shaped


class LooseBolt(Remembering):
    """A carriage plate with a loose bolt has two places: it flips up high and down low on the column."""

    def after(self, drive: int, before: float, leg: Leg) -> float:
        """Which place: changed by passing a quarter from either end."""
        return float(self._flipped(np.array([leg.to_m]), np.array([before]), drive)[0])

    def act(self, m: Moments, d: Departure) -> None:
        """Turn the carriage."""
        y = self._flipped(m.q_m[:, self.place], self.before(m, self.place), self.place)
        d.yaw_rad[:, self.place] += self.size * shaped(np.where(y == 0.0, -1.0, y), self.variant, m.payload_kg)
        if self.variant == "saturating":
            d.sideways_m[:, self.place] += 0.05 * self.size * y

    def _flipped(self, q_m: Array, held: Array, drive: int) -> Array:
        middle, half = self.site.drive_range_m(drive)
        x, limit = (q_m - middle) / half, 0.15 if self.variant == FINAL else 0.3
        return np.where(x > limit, 1.0, np.where(x < -limit, -1.0, held))


class AirBearingLift(Outside):
    """The bearing's gap follows the compressor: pressure falls slowly and is pumped up again."""

    def _unit(self, m: Moments) -> Array:
        return np.asarray(1.0 - 2.0 * ((self.elapsed_s(m) / 640.0 + self.phase) % 1.0))

    def act(self, m: Moments, d: Departure) -> None:
        """Lift the slider off its guide."""
        d.sideways_m[:, self.place] += self.signal(m)


class OilFilm(Outside):
    """A plain guide floats up with speed and sinks slowly at rest."""

    def _unit(self, m: Moments) -> Array:
        speed = m.speed_m_per_s[:, self.place] / 0.5
        return np.asarray(np.sqrt(np.maximum(speed, 0.0)) * np.exp(-m.since_s[:, self.place] / 12.0))

    def act(self, m: Moments, d: Departure) -> None:
        """Lift the slider off its guide."""
        d.sideways_m[:, self.place] += self.signal(m)


class MagnetDetent(Outside):
    """Magnets pull a linear motor into detents, harder from one side than from the other."""

    def _unit(self, m: Moments) -> Array:
        q = m.q_m[:, self.place]
        return np.asarray(np.sin(2.0 * np.pi * q / 0.048 + self.phase) * (1.0 + 0.8 * m.direction[:, self.place]))

    def act(self, m: Moments, d: Departure) -> None:
        """Move the slider."""
        d.travel_m[:, self.place] += self.signal(m)


class LubricationPulse(Remembering):
    """Every few metres of way the lubricator gives a pulse, and the guide floats until it is used up."""

    def after(self, drive: int, before: float, leg: Leg) -> float:
        """The way so far."""
        return before + abs(leg.to_m - leg.from_m)

    def act(self, m: Moments, d: Departure) -> None:
        """Lift the slider off its guide."""
        way = self.before(m, self.place) + np.abs(m.q_m[:, self.place] - m.from_m[:, self.place])
        y = np.exp(-(way % 7.0) / 1.5)
        d.sideways_m[:, self.place] += self.size * shaped(y, self.variant, m.payload_kg)
