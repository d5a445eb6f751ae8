"""Periodogram of the residuals along a drive: prominent spatial periods down to micrometres.

Positions are put on a grid that is fine enough for one Fourier transform to serve all periods (Press and Rybicki 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.base.arrays import Array

SHORTEST_M = 1.0e-5
OVERSAMPLING = 1.6
MAX_PEAKS = 8
MAX_PEAKS_PER_OCTAVE = 2  # among few positions, aliases at short periods outnumber the true one and outdo it by chance


@dataclass(frozen=True)
class Periodogram:
    """Power over noise (f,) at frequencies (f,) in 1/m, of scores (n,) at positions (n,) with a total information."""

    frequency: Array
    power: Array
    position_m: Array
    score: Array
    information: float

    @classmethod
    def from_scores(cls, position_m: Array, score: Array, information: float) -> Periodogram:
        """Power is the likelihood ratio statistic of a sine: 2 on average for pure noise."""
        span = max(float(np.ptp(position_m)), 1e-6)
        step = 0.25 * SHORTEST_M
        size = 2 ** int(np.ceil(np.log2(OVERSAMPLING * span / step)))
        grid = np.zeros(size)
        cell = np.round((position_m - position_m.min()) / step).astype(np.intp)
        np.add.at(grid, cell, score)
        spectrum = np.fft.rfft(grid)
        frequency = np.arange(len(spectrum)) / (size * step)
        power = 2.0 * np.abs(spectrum) ** 2 / max(information, 1e-300)
        return cls(frequency, power, position_m, score, information)

    @property
    def resolution(self) -> float:
        """Distance in 1/m at which two frequencies can be distinguished."""
        return 1.0 / max(float(np.ptp(self.position_m)), 1e-6)

    def strongest_periods(self, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        """Periods (m) of the highest peaks within limits, with prior probabilities (uniform in the logarithm)."""
        inside = np.flatnonzero(
            (self.frequency >= 1.0 / longest_m) & (self.frequency <= 1.0 / max(shortest_m, SHORTEST_M))
        )
        inside = inside[(inside > 0) & (inside < len(self.power) - 1)]
        if not inside.size:
            return []
        p = self.power
        peaks = inside[(p[inside] >= p[inside - 1]) & (p[inside] > p[inside + 1])]
        highest_first = peaks[np.argsort(p[peaks])[::-1]]
        octave = np.floor(np.log2(self.frequency[highest_first])).astype(np.intp)
        in_octave = [highest_first[octave == o][:MAX_PEAKS_PER_OCTAVE] for o in np.unique(octave)]
        out = []
        for k in dict.fromkeys(np.concatenate([highest_first[:MAX_PEAKS], *in_octave]).tolist()):
            f = self._refine(float(self.frequency[k]))
            out.append((1.0 / f, min(1.0, self.resolution / f / float(np.log(longest_m / shortest_m)))))
        return out

    @cached_property
    def _refined(self) -> dict[float, float]:
        return {}

    def _refine(self, frequency: float) -> float:
        """The frequency of a peak, by direct sums on finer and finer grids."""
        if frequency not in self._refined:
            self._refined[frequency] = self._sum_directly(frequency)
        return self._refined[frequency]

    def _sum_directly(self, frequency: float) -> float:
        centred = self.position_m - 0.5 * (self.position_m.max() + self.position_m.min())
        for width, count in ((0.6, 13), (0.1, 11)):
            near = frequency + np.linspace(-width, width, count) * self.resolution
            turned = self.score * np.exp(2.0j * np.pi * near[0] * centred)
            step = np.exp(2.0j * np.pi * (near[1] - near[0]) * centred)
            amplitude = np.empty(count)
            for k in range(count):
                amplitude[k] = abs(turned.sum())
                turned *= step
            frequency = float(near[np.argmax(amplitude)])
        return frequency
