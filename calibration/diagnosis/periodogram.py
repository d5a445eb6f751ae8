"""Periodogram of the residuals along a drive: prominent spatial periods down to micrometres.

Positions are put on a grid that is fine enough for one Fourier transform to serve all periods (Press and Rybicki 1989).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from calibration.base.arrays import Array

SHORTEST_M = 2.0e-6
COMMON_M = 1.0e-5
MOST_BY_CHANCE = 0.25
SAME_M = 1.0e-6  # within which positions are the same
CELLS_PER_PERIOD = 4
STEPS_M = (1.0e-5, 5.0e-6, 2.0e-6, 1.0e-6)  # by which a display or a file may round positions
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
        step = SHORTEST_M / CELLS_PER_PERIOD
        size = 2 ** int(np.ceil(np.log2(OVERSAMPLING * span / step)))
        grid = np.zeros(size, dtype=np.float32)  # peaks are refined by direct sums
        cell = np.round((position_m - position_m.min()) / step).astype(np.intp)
        np.add.at(grid, cell, score)
        spectrum = rfft(grid)
        frequency = np.arange(len(spectrum)) / (size * step)
        power = (spectrum.real**2 + spectrum.imag**2).astype(np.float64) * (2.0 / max(information, 1e-300))
        return cls(frequency, power, position_m, score, information)

    @cached_property
    def shortest_m(self) -> float:
        """Shortest period that the positions resolve: four steps of what rounds them.

        Of N values of whatever kind the best of M waves explains 2 ln M / N by chance; where that is much, periods
        below those of common scales are not tried.
        """
        positions = np.unique(np.round(self.position_m / SAME_M))
        by_chance = 2.0 * np.log(max(1.0 / (self.resolution * SHORTEST_M), 1.0)) / len(positions)
        shortest = COMMON_M if by_chance > MOST_BY_CHANCE else SHORTEST_M
        for step in STEPS_M:
            if np.all(np.abs(self.position_m / step - np.round(self.position_m / step)) < 1e-3):
                return max(shortest, CELLS_PER_PERIOD * step)
        return shortest

    @property
    def resolution(self) -> float:
        """Distance in 1/m at which two frequencies can be distinguished."""
        return 1.0 / max(float(np.ptp(self.position_m)), 1e-6)

    def strongest_periods(self, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        """Periods (m) of the highest peaks within limits, with prior probabilities (uniform in the logarithm)."""
        inside = np.flatnonzero(
            (self.frequency >= 1.0 / longest_m) & (self.frequency <= 1.0 / max(shortest_m, self.shortest_m))
        )
        inside = inside[(inside > 0) & (inside < len(self.power) - 1)]
        if not inside.size:
            return []
        p = self.power
        peaks = inside[(p[inside] >= p[inside - 1]) & (p[inside] > p[inside + 1])]
        octave = np.floor(np.log2(self.frequency[peaks])).astype(np.intp)
        of_octaves = np.split(peaks, np.flatnonzero(np.diff(octave)) + 1)
        in_octave = [_highest(p, of_one, MAX_PEAKS) for of_one in of_octaves]
        highest_first = _highest(p, np.concatenate(in_octave), MAX_PEAKS)
        out = []
        for k in dict.fromkeys(
            np.concatenate([highest_first, *(i[:MAX_PEAKS_PER_OCTAVE] for i in in_octave)]).tolist()
        ):
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


def _highest(power: Array, of: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The places `of` (k,) with the most power, the highest first; at most `count`."""
    some = of if len(of) <= count else of[np.argpartition(power[of], -count)[-count:]]
    return some[np.argsort(power[some], kind="stable")[::-1]]
