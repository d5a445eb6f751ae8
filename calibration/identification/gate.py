"""Wrong readings: each is judged by what the model, fitted to the others, says of it.

For squares with priors the deviation of reading i from the fit without it has the square form r' (1 - H)^-1 r by its
covariance, with the residual r and the block H = J C J^T of the hat matrix (leave_one_out.py); of a reading that the
fit was not given it is r' (1 + H)^-1 r. The worst are left out first, because one wrong reading makes good ones look
wrong; then all are judged anew by the fit of those that remain, and those that agree with it come back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calibration.base.arrays import Array
from calibration.base.outliers import GATE_SIGMAS, own_sigmas
from calibration.identification.problem import LeastSquaresProblem

SUSPECTS = 0.1  # of all readings: so many may be left out before the scales are known
MOST_ROUNDS = 50
LINEARISATIONS = 4
STIFFNESS_LIMIT = 3.0  # prior standard deviations: farther off, the point of linearisation would not be plausible


@dataclass(frozen=True)
class GatedReadings:
    """The readings (n,) of one instrument: which are kept, by how many of its own standard deviations each is off the
    fit of the others, and by how much (n, w), whitened."""

    keep: NDArray[np.bool_]
    sigmas: Array
    deviation: Array


def gate_readings(problem: LeastSquaresProblem, kinds: Sequence[NDArray[np.intp]]) -> tuple[GatedReadings, ...]:
    """Judge all readings of a problem by squares with the priors' full weight; kinds: those of one scale, (n,) each.

    Gauss-Newton steps from the nominal machine, the readings judged anew at each, until the same are kept. Unlike a fit
    it holds the derivatives of all readings at once.
    """
    z = np.zeros(problem.layout.size)
    stiffness = problem.model.parameters.rows("ln_stiffness")
    keep = [np.ones(len(part), dtype=bool) for part in problem.readings]
    for number in range(LINEARISATIONS):
        linear = LinearReadings.of(problem, z, kinds)
        judged = linear.judge(keep)
        same = all(np.array_equal(gated.keep, part) for gated, part in zip(judged, keep, strict=True))
        if same and number:
            break
        keep = [gated.keep for gated in judged]
        z = z + linear.step(keep)
        z[stiffness] = np.clip(z[stiffness], -STIFFNESS_LIMIT, STIFFNESS_LIMIT)
    return judged


@dataclass(frozen=True)
class LinearReadings:
    """Readings of every instrument, linearised at z (u,): residuals (n, w), derivatives (n, w, u) with z."""

    z: Array
    residual: tuple[Array, ...]
    jacobian: tuple[Array, ...]
    kinds: Sequence[NDArray[np.intp]]

    @classmethod
    def of(cls, problem: LeastSquaresProblem, z: Array, kinds: Sequence[NDArray[np.intp]]) -> LinearReadings:
        """Of a problem, linearised at z."""
        residual = tuple(np.empty((len(part), part.width)) for part in problem.readings)
        jacobian = tuple(np.empty((len(part), part.width, z.size)) for part in problem.readings)
        for block in problem.derivatives(z):
            residual[block.instrument][block.rows] = block.residual
            jacobian[block.instrument][block.rows] = block.jacobian * problem.layout.sigma
        return cls(z, residual, jacobian, kinds)

    def step(self, keep: list[NDArray[np.bool_]]) -> Array:
        """From z to the minimum of the readings that are kept."""
        return self._step(self._factor(keep), keep)

    def farthest(self) -> float:
        """Largest distance of a reading from the fit of all others, in standard deviations."""
        distance = self._distances([np.ones(len(part), dtype=bool) for part in self.residual])[0]
        return max(float(np.max(part, initial=0.0)) for part in distance)

    def judge(self, keep: list[NDArray[np.bool_]], gate_sigmas: float | None = None) -> tuple[GatedReadings, ...]:
        """Which readings to keep, beginning with some; gate_sigmas: own standard deviations beyond which one is not,
        by default GATE_SIGMAS."""
        gate_sigmas = GATE_SIGMAS if gate_sigmas is None else gate_sigmas
        keep = [part.copy() for part in keep]
        most = int(np.ceil(SUSPECTS * sum(len(part) for part in keep)))
        for _ in range(MOST_ROUNDS):  # suspects, the worst first
            distance = self._distances(keep)[0]
            worst = max(float(np.max(d[k], initial=0.0)) for d, k in zip(distance, keep, strict=True))
            free = most - sum(int(np.count_nonzero(~part)) for part in keep)
            if worst <= gate_sigmas or free <= 0:
                break
            limit = max(gate_sigmas, 0.5 * worst)
            above = np.sort(np.concatenate([d[k & (d > limit)] for d, k in zip(distance, keep, strict=True)]))
            if above.size > free:
                limit = float(above[-free - 1])
            keep = [k & (d <= limit) for d, k in zip(distance, keep, strict=True)]
        return self._settle(keep, gate_sigmas)

    def _settle(self, keep: list[NDArray[np.bool_]], gate_sigmas: float) -> tuple[GatedReadings, ...]:
        """Judge all readings by their own scales until the same are kept; in the end none comes back any more."""
        for number in range(MOST_ROUNDS):
            distance, deviation = self._distances(keep)
            sigmas = tuple(
                own_sigmas(d, r.shape[1], kind) for d, r, kind in zip(distance, self.residual, self.kinds, strict=True)
            )
            new = [s <= gate_sigmas for s in sigmas]
            if number > MOST_ROUNDS // 2:
                new = [a & b for a, b in zip(new, keep, strict=True)]
            if all(np.array_equal(a, b) for a, b in zip(new, keep, strict=True)):
                break
            keep = new
        return tuple(GatedReadings(*parts) for parts in zip(keep, sigmas, deviation, strict=True))

    def _factor(self, keep: list[NDArray[np.bool_]]) -> Array:
        """R (u, u), R^T R being the information of the readings that are kept and of the priors."""
        information = np.eye(self.z.size) + self._information_of_all
        for j, k in zip(self.jacobian, keep, strict=True):
            left_out = j[~k].reshape(-1, self.z.size)
            information -= left_out.T @ left_out
        return np.asarray(np.linalg.cholesky(information).T)

    @cached_property
    def _information_of_all(self) -> Array:
        """J^T J (u, u) of all readings, the few that are left out among them."""
        rows = [j.reshape(-1, self.z.size) for j in self.jacobian]
        return np.asarray(sum(part.T @ part for part in rows))

    def _step(self, factor: Array, keep: list[NDArray[np.bool_]]) -> Array:
        gradient = self.z.copy()
        for r, j, k in zip(self.residual, self.jacobian, keep, strict=True):
            gradient += j[k].reshape(-1, self.z.size).T @ r[k].ravel()
        return np.asarray(-solve_triangular(factor, solve_triangular(factor, gradient, trans="T")))

    def _distances(self, keep: list[NDArray[np.bool_]]) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Of each reading (n,) the root of its square form, and its deviation (n, w) from the fit of the others."""
        factor = self._factor(keep)
        step = self._step(factor, keep)
        distances, deviations = [], []
        for r, j, k in zip(self.residual, self.jacobian, keep, strict=True):
            left = r + j @ step
            flat = j.reshape(-1, step.size)
            root = solve_triangular(factor, flat.T, trans="T", check_finite=False).T.reshape(j.shape)
            hat = root @ root.transpose(0, 2, 1)
            spread = np.eye(r.shape[1]) + np.where(k, -1.0, 1.0)[:, None, None] * hat
            solved = np.linalg.solve(spread, left[:, :, None])[:, :, 0]
            distances.append(np.sqrt(np.maximum(np.einsum("nw,nw->n", left, solved), 0.0)))
            deviations.append(np.where(k[:, None], solved, left))
        return tuple(distances), tuple(deviations)
