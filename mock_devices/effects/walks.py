"""Seeded random courses of time, the same whenever and in whatever order they are asked."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array

HOUR_S = 3600.0
RETURN_S = 900.0
RELAXES_S = (60.0, 240.0, 960.0, 3840.0, 15360.0)
_GRID_S = 60.0


class RandomWalk:
    """A seeded random walk of unit standard deviation after one hour, whenever and in whatever order it is asked."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        self._rng = rng
        self._nodes = np.zeros((1, count))

    def at(self, elapsed_s: Array) -> Array:
        """Values (n, count)."""
        position = elapsed_s / _GRID_S
        last = int(np.floor(position.max())) + 2
        while len(self._nodes) <= last:
            steps = self._rng.standard_normal((256, self._nodes.shape[1])) * np.sqrt(_GRID_S / HOUR_S)
            self._nodes = np.concatenate([self._nodes, self._walked(self._nodes[-1], steps)])
        low = np.floor(position).astype(int)
        share = (position - low)[:, None]
        return np.asarray((1.0 - share) * self._nodes[low] + share * self._nodes[low + 1])

    def _walked(self, last: Array, steps: Array) -> Array:
        """The nodes after `last` by further steps (k, count)."""
        return np.asarray(last + np.cumsum(steps, axis=0))


class HeldWalk(RandomWalk):
    """A random walk that is drawn back to zero: unit standard deviation once it has forgotten its begin there."""

    def __init__(self, rng: np.random.Generator, count: int, return_s: float = RETURN_S) -> None:
        super().__init__(rng, count)
        self._return_s = return_s

    def _walked(self, last: Array, steps: Array) -> Array:
        """Exact for the nodes: each keeps exp(-dt / return_s) of the one before."""
        keep = math.exp(-_GRID_S / self._return_s)
        push = steps * math.sqrt((1.0 - keep**2) * HOUR_S / _GRID_S)
        nodes = np.empty_like(steps)
        for i, step in enumerate(push):
            last = keep * last + step
            nodes[i] = last
        return nodes


class Flicker:
    """Walks that are held back in times from short to long, which together have a spectrum of 1/f; zero at the begin.

    Each has begun long before, so that it has the same variance at all times; together that is one. Each has its own
    generator, so that it is the same in whatever order it is asked.
    """

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        self._starts = rng.standard_normal((len(RELAXES_S), count))
        self._walks = [HeldWalk(own, count, s) for own, s in zip(rng.spawn(len(RELAXES_S)), RELAXES_S, strict=True)]

    def at(self, elapsed_s: Array) -> Array:
        """Values (n, count)."""
        total = np.zeros((len(elapsed_s), self._starts.shape[1]))
        for walk, start, relaxes_s in zip(self._walks, self._starts, RELAXES_S, strict=True):
            total += walk.at(elapsed_s) + np.outer(np.exp(-elapsed_s / relaxes_s) - 1.0, start)
        return total / math.sqrt(len(RELAXES_S))
