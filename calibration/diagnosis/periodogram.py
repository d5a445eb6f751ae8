"""Periodogram of the residuals along a drive: prominent spatial periods down to micrometres.

Positions are put on a grid that is fine enough for one Fourier transform to serve all periods (Press and Rybicki 1989).
Periods of less than CELLS_PER_PERIOD cells, three quarters of all frequencies, are not computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.stats import chi2

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
    """Power over noise (f,) at frequencies (f,) in 1/m, of scores at positions (n,): the sum over m of them (n, m).

    finest_m: shortest period for which it was computed.
    """

    frequency: Array
    power: Array
    position_m: Array
    score: Array
    finest_m: float = SHORTEST_M

    @classmethod
    def from_scores(
        cls, position_m: Array, score: Array, information: Array | float, finest_m: float = SHORTEST_M
    ) -> Periodogram:
        """Of scores (n, m), or (n,), with the total information of each (m,), or a single one. Power is the likelihood
        ratio statistic of m sines at once: 2 m on average for pure noise."""
        scores = np.atleast_2d(score.T).T / np.sqrt(np.maximum(information, 1e-300))
        span = max(float(np.ptp(position_m)), 1e-6)
        step = finest_m / CELLS_PER_PERIOD
        size = max(2 ** int(np.ceil(np.log2(OVERSAMPLING * span / step))), 2 * CELLS_PER_PERIOD)
        cell = np.round((position_m - position_m.min()) / step).astype(np.intp)
        power = np.zeros(1)
        for column in scores.T:
            grid = np.zeros((CELLS_PER_PERIOD, size // CELLS_PER_PERIOD), dtype=np.float32)  # direct sums refine peaks
            np.add.at(grid, (cell % CELLS_PER_PERIOD, cell // CELLS_PER_PERIOD), column)
            power = power + 2.0 * _lowest_quarter(grid)
        frequency = np.arange(len(power)) / (size * step)
        return cls(frequency, power, position_m, scores, finest_m)

    @cached_property
    def shortest_m(self) -> float:
        """Shortest period that the positions resolve: four steps of what rounds them.

        Of N values of whatever kind the best of M waves explains 2 ln M / N by chance; where that is much, periods
        below those of common scales are not tried.
        """
        positions = np.unique(np.round(self.position_m / SAME_M))
        by_chance = 2.0 * np.log(max(1.0 / (self.resolution * self.finest_m), 1.0)) / len(positions)
        shortest = max(COMMON_M, self.finest_m) if by_chance > MOST_BY_CHANCE else self.finest_m
        for step in STEPS_M:
            if np.all(np.abs(self.position_m / step - np.round(self.position_m / step)) < 1e-3):
                return max(shortest, CELLS_PER_PERIOD * step)
        return shortest

    @property
    def resolution(self) -> float:
        """Distance in 1/m at which two frequencies can be distinguished."""
        return 1.0 / max(float(np.ptp(self.position_m)), 1e-6)

    @cached_property
    def level(self) -> float:
        """Its median over that of pure noise, if that is more than one: what no wave explains raises it everywhere."""
        return max(float(np.median(self.power)) / float(chi2.median(2 * self.score.shape[1])), 1.0)

    def strongest_periods(
        self, shortest_m: float, longest_m: float, *, by_chance: float = 1.0
    ) -> list[tuple[float, float]]:
        """Periods (m) of the highest peaks within limits, with prior probabilities (uniform in the logarithm).

        by_chance: probability with which noise as strong as the periodogram's level has as much power as a peak, at
        most.
        """
        lowest, highest = 1.0 / longest_m, 1.0 / max(shortest_m, self.shortest_m)
        first = max(int(np.searchsorted(self.frequency, lowest)), 1)
        last = min(int(np.searchsorted(self.frequency, highest, side="right")), len(self.power) - 1)
        if first >= last:
            return []
        p, inside = self.power, self.power[first:last]
        peaks = first + np.flatnonzero((inside >= p[first - 1 : last - 1]) & (inside > p[first + 1 : last + 1]))
        if by_chance < 1.0:
            peaks = peaks[p[peaks] >= self.level * chi2.isf(by_chance, 2 * self.score.shape[1])]
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

    @cached_property
    def _score_by_position(self) -> tuple[Array, Array]:
        """Distinct positions (d,) about their middle, and the sums (m, d) of the scores at each."""
        distinct, index = np.unique(self.position_m, return_inverse=True)
        sums = [np.bincount(index, column).astype(np.float64) for column in self.score.T]
        return distinct - 0.5 * (distinct[-1] + distinct[0]), np.stack(sums)

    def _sum_directly(self, frequency: float) -> float:
        centred, score = self._score_by_position
        for width, count in ((0.6, 13), (0.1, 11)):
            near = frequency + np.linspace(-width, width, count) * self.resolution
            turned = score * np.exp(2.0j * np.pi * near[0] * centred)
            step = np.exp(2.0j * np.pi * (near[1] - near[0]) * centred)
            amplitude = np.empty(count)
            for k in range(count):
                amplitude[k] = float(np.sum(np.abs(turned.sum(axis=1)) ** 2))
                turned *= step
            frequency = float(near[np.argmax(amplitude)])
        return frequency


def _lowest_quarter(grid: NDArray[np.float32]) -> Array:
    """Power (m + 1,) of the lowest frequencies of a series (4 m,), of which row p of the grid (4, m) is every fourth
    number from number p on.

    The last step of a transform by fours, for one quarter of its results; short transforms stay within the cache.
    """
    rows, m = grid.shape
    half = m // 2 + 1
    turn = _unit_circle(rows * m, half)
    zeroth, first, second, third = (rfft(row) for row in grid)
    # Horner's rule twice: sums over even rows and over odd rows.
    turn_twice = turn * turn
    second *= turn_twice
    third *= turn_twice
    even, odd = zeroth + second, (first + third) * turn
    zeroth -= second
    first -= third
    first *= 1j * turn
    power = np.empty(m + 1)
    power[:half] = _square(even + odd)
    power[half - 1 :] = _square(zeroth + first)[: m + 2 - half][::-1]
    return power


def _unit_circle(size: int, count: int) -> NDArray[np.complex64]:
    """exp(-2 pi i k / size) for k (count,): products of coarse steps and fine ones within each."""
    fine = int(np.ceil(np.sqrt(count)))
    steps = [np.exp(-2.0j * np.pi * np.arange(fine) * step / size) for step in (fine, 1)]
    return np.outer(*steps).ravel()[:count].astype(np.complex64)


def _square(amplitude: NDArray[np.complexfloating]) -> Array:
    return amplitude.real**2 + amplitude.imag**2


def _highest(power: Array, of: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The places `of` (k,) with the most power, the highest first; at most `count`."""
    some = of if len(of) <= count else of[np.argpartition(power[of], -count)[-count:]]
    return some[np.argsort(power[some], kind="stable")[::-1]]
