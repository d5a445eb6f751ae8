"""Spatial periods that stand out along a drive, down to micrometres: a periodogram of the gap over its coordinate.

Positions are put on a grid so fine that a Fourier transform serves for all periods at once (Press and Rybicki 1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array

SHORTEST_M = 1.0e-5
OVERSAMPLED = 1.6
FEW = 8


@dataclass(frozen=True)
class Periodogram:
    """Power over noise (f,) at frequencies (f,) in 1/m, of scores (n,) at positions (n,); information: their sum."""

    frequency: Array
    power: Array
    position_m: Array
    score: Array
    information: float

    @classmethod
    def of(cls, position_m: Array, score: Array, information: float) -> Periodogram:
        """Power is the likelihood ratio statistic of a sine: 2 in the mean where there is only noise."""
        span = max(float(np.ptp(position_m)), 1e-6)
        step = 0.25 * SHORTEST_M
        size = 2 ** int(np.ceil(np.log2(OVERSAMPLED * span / step)))
        grid = np.zeros(size)
        where = np.round((position_m - position_m.min()) / step).astype(np.intp)
        np.add.at(grid, where, score)
        spectrum = np.fft.rfft(grid)
        frequency = np.arange(len(spectrum)) / (size * step)
        power = 2.0 * np.abs(spectrum) ** 2 / max(information, 1e-300)
        return cls(frequency, power, position_m, score, information)

    @property
    def cell(self) -> float:
        """Width in 1/m of what can be told apart."""
        return 1.0 / max(float(np.ptp(self.position_m)), 1e-6)

    def strongest(self, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        """Periods (m) of the highest peaks within limits, with prior probabilities (uniform in the logarithm)."""
        inside = np.flatnonzero(
            (self.frequency >= 1.0 / longest_m) & (self.frequency <= 1.0 / max(shortest_m, SHORTEST_M))
        )
        inside = inside[(inside > 0) & (inside < len(self.power) - 1)]
        if not inside.size:
            return []
        p = self.power
        peaks = inside[(p[inside] >= p[inside - 1]) & (p[inside] > p[inside + 1])]
        found = peaks[np.argsort(p[peaks])[::-1][:FEW]]
        out = []
        for k in found:
            f = self._refined(float(self.frequency[k]))
            out.append((1.0 / f, min(1.0, self.cell / f / float(np.log(longest_m / shortest_m)))))
        return out

    def _refined(self, frequency: float) -> float:
        middle = self.position_m - 0.5 * (self.position_m.max() + self.position_m.min())
        for width, count in ((0.6, 13), (0.1, 11)):
            near = frequency + np.linspace(-width, width, count) * self.cell
            size = np.abs(np.exp(2.0j * np.pi * np.outer(near, middle)) @ self.score)
            frequency = float(near[np.argmax(size)])
        return frequency
