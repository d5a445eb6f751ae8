"""Evidence of a basis set: marginal likelihood over its size, its coefficients and all unknowns of the calibration.

With C the covariance of the readings under the model with its priors and the declared disturbances, columns H with
coefficients of standard deviations a d change the log evidence by
1/2 g' D (1/a^2 + D F D)^-1 D g - 1/2 log|1 + a^2 D F D|,  F = H' C^-1 H,  g = H' C^-1 y,  D = diag(d):
Gaussian marginal likelihood (MacKay 2003, ch. 28). The size a has a prior that is uniform in its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.outlying_readings import project_out
from calibration.effects.api import BasisSet, Contributions

SIZES = 9


@dataclass(frozen=True)
class InformationAndScore:
    """Information F (k, k) and score g (k,) of columns (k), the unknowns of the calibration projected out."""

    information: Array
    score: Array


@dataclass(frozen=True)
class BasisSetEvidence:
    """A basis set with its log evidence over `none`, most likely size, coefficients (k,) and covariance (k, k)."""

    basis_set: BasisSet
    log_evidence: float
    size: float
    coefficients: Array
    covariance: Array


class ChannelResponses:
    """Whitened responses (n, 3) of a linear model's readings to one unit of each channel, computed on first use."""

    def __init__(self, linear: LinearModel) -> None:
        self.channels = Channels(linear)
        self._linear = linear
        self._responses: dict[str, Array] = {}

    def __call__(self, channel: str) -> Array:
        """The response (n, 3) to a channel."""
        if channel not in self._responses:
            self._responses[channel] = self._linear.whiten_shift(self.channels.shift_m(channel))
        return self._responses[channel]


class MarginalLikelihood:
    """Marginal likelihood of columns on a linear model, and on columns that are already part of the model.

    weighted_residual (n, 3): C^-1 y; q (n, 3, b): 1 - q q' is C^-1, the inverse covariance of the readings. response:
    whitened response (n, 3) to one unit of a channel.
    """

    def __init__(self, linear: LinearModel, response: ChannelResponses, q: Array, weighted_residual: Array) -> None:
        self.linear = linear
        self.response = response
        self.q = q
        self.weighted_residual = weighted_residual
        self._projections: dict[str, Array] = {}

    @classmethod
    def of(cls, linear: LinearModel) -> MarginalLikelihood:
        """The marginal likelihood of a linear model without any effect."""
        return cls(linear, ChannelResponses(linear), linear.q, linear.apply(linear.residual))

    @property
    def channels(self) -> Channels:
        """The channels of the machine."""
        return self.response.channels

    def including(self, columns: Array) -> MarginalLikelihood:
        """The marginal likelihood with columns (n, 3, j), each times its prior standard deviation, in the model."""
        n, count = len(columns), columns.shape[2]
        projected = self.apply(columns).reshape(-1, count)
        gram = np.eye(count) + columns.reshape(-1, count).T @ projected
        upper = np.linalg.cholesky(gram).T
        added = np.linalg.solve(upper.T, projected.T).T
        explained = (added @ (added.T @ self.linear.residual.ravel())).reshape(n, 3)
        q = np.concatenate([self.q, added.reshape(n, 3, -1)], axis=2)
        return MarginalLikelihood(self.linear, self.response, q, self.weighted_residual - explained)

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times columns (n, 3, k)."""
        return project_out(self.q, columns)

    def columns(self, contributions: Sequence[Contributions]) -> Array:
        """Whitened columns (n, 3, k)."""
        out = np.zeros((*self.weighted_residual.shape, len(contributions)))
        for k, contribution in enumerate(contributions):
            for channel, shape in contribution:
                out[:, :, k] += self.response(channel) * shape[:, None]
        return out

    def information_and_score(self, contributions: Sequence[Contributions]) -> InformationAndScore:
        """Information and score of columns that are never formed explicitly."""
        count = len(contributions)
        by_channel: dict[str, dict[int, Array]] = {}
        for k, contribution in enumerate(contributions):
            for channel, shape in contribution:
                shapes_of_channel = by_channel.setdefault(channel, {})
                shapes_of_channel[k] = shapes_of_channel[k] + shape if k in shapes_of_channel else shape
        along_factor = np.zeros((self.q.shape[2], count))
        score = np.zeros(count)
        information = np.zeros((count, count))
        stacked = {
            channel: (list(shapes), np.stack(list(shapes.values()), axis=1)) for channel, shapes in by_channel.items()
        }
        for channel, (numbers, shapes) in stacked.items():
            response = self.response(channel)
            along_factor[:, numbers] += self._projection(channel).T @ shapes
            score[numbers] += np.sum(response * self.weighted_residual, axis=1) @ shapes
            for other, (other_numbers, other_shapes) in stacked.items():
                product = np.sum(response * self.response(other), axis=1)
                if np.any(product):
                    information[np.ix_(numbers, other_numbers)] += shapes.T @ (product[:, None] * other_shapes)
        return InformationAndScore(information - along_factor.T @ along_factor, score)

    def information_and_score_through(
        self, channels: Sequence[tuple[str, float]], shapes: Array
    ) -> InformationAndScore:
        """The same for shapes (n, k) through each of some channels, each times its unit; ordered by channel."""
        along, score = [], []
        blocks = [[np.empty(0)] * len(channels) for _ in channels]
        for i, (channel, unit) in enumerate(channels):
            response = self.response(channel) * unit
            along.append(self._projection(channel).T @ shapes * unit)
            score.append(np.sum(response * self.weighted_residual, axis=1) @ shapes)
            for j, (other, other_unit) in enumerate(channels[: i + 1]):
                product = np.sum(response * self.response(other), axis=1) * other_unit
                blocks[i][j] = shapes.T @ (product[:, None] * shapes)
                blocks[j][i] = blocks[i][j].T
        along_factor = np.concatenate(along, axis=1)
        return InformationAndScore(np.block(blocks) - along_factor.T @ along_factor, np.concatenate(score))

    def observable_columns(self, channels: Sequence[str], shapes: Array, rows: NDArray[np.intp]) -> Array:
        """Rows (m, 3, k c) of shapes (n, k) acting through channels (c), after the calibration has been refitted."""
        out = []
        for channel in channels:
            along_factor = self._projection(channel).T @ shapes
            response = self.response(channel)[rows]
            q = self.q[rows].reshape(-1, self.q.shape[2])
            absorbed = (q @ along_factor).reshape(len(rows), 3, -1)
            out.append(response[:, :, None] * shapes[rows][:, None, :] - absorbed)
        return np.concatenate(out, axis=2)

    def information_by_visit(self, channel: str, arrival: NDArray[np.intp]) -> tuple[Array, Array]:
        """Information and score (v,) of one unit of a channel during each single visit; arrival (n,): the visit."""
        count = int(arrival.max()) + 1
        response = self.response(channel)
        sums = csr_array((np.ones(len(arrival)), (arrival, np.arange(len(arrival)))), shape=(count, len(arrival)))
        along_factor = sums @ self._projection(channel)
        information = np.bincount(arrival, np.sum(response**2, axis=1), minlength=count)
        information = information - np.sum(along_factor**2, axis=1)
        score = np.bincount(arrival, np.sum(response * self.weighted_residual, axis=1), minlength=count)
        return np.asarray(np.maximum(information, 0.0)), np.asarray(score, dtype=np.float64)

    def _projection(self, channel: str) -> Array:
        """Rows (n, b): a channel's response along q."""
        if channel not in self._projections:
            self._projections[channel] = np.einsum("nj,njb->nb", self.response(channel), self.q)
        return self._projections[channel]


def log_sum(logs: Array, axis: int = 0) -> Array:
    """Logarithm of a sum of exponentials."""
    top = logs.max(axis=axis, keepdims=True)
    return np.asarray(np.log(np.sum(np.exp(logs - top), axis=axis)) + np.squeeze(top, axis=axis))


def evidence_of_basis_sets(
    columns: InformationAndScore, basis_sets: Sequence[BasisSet], low: float, high: float
) -> list[BasisSetEvidence]:
    """Evidence of basis sets for sizes between two limits, from the information and score of all their columns."""
    sizes = np.geomspace(low, high, SIZES)
    out: list[BasisSetEvidence | None] = [None] * len(basis_sets)
    by_length: dict[int, list[int]] = {}
    for number, basis_set in enumerate(basis_sets):
        by_length.setdefault(len(basis_set.columns), []).append(number)
    for members in by_length.values():
        pick = np.array([basis_sets[i].columns for i in members])
        relative = np.array([basis_sets[i].relative for i in members])
        f = columns.information[pick[:, :, None], pick[:, None, :]] * relative[:, :, None] * relative[:, None, :]
        g = columns.score[pick] * relative
        values, vectors = np.linalg.eigh(0.5 * (f + f.transpose(0, 2, 1)))
        values = np.maximum(values, 0.0)
        along = np.einsum("mkj,mk->mj", vectors, g)
        square = sizes[None, :, None] ** 2
        grown = 1.0 + square * values[:, None, :]
        logs = np.sum(0.5 * square * along[:, None, :] ** 2 / grown - 0.5 * np.log(grown), axis=2)
        evidence = log_sum(logs, axis=1) - np.log(len(sizes))
        best = np.argmax(logs, axis=1)
        for row, number in enumerate(members):
            a = float(sizes[best[row]])
            shrunk = a * a / (1.0 + a * a * values[row])
            coefficients = relative[row] * (vectors[row] @ (shrunk * along[row]))
            scaled = vectors[row] * relative[row][:, None]
            covariance = (scaled * shrunk) @ scaled.T
            out[number] = BasisSetEvidence(basis_sets[number], float(evidence[row]), a, coefficients, covariance)
    return [entry for entry in out if entry is not None]


def log_evidence_of_sizes(columns: InformationAndScore, sizes: Array) -> Array:
    """Log evidence (a,) of all columns together, their coefficients having each standard deviation (a,)."""
    values, vectors = np.linalg.eigh(0.5 * (columns.information + columns.information.T))
    along, square = vectors.T @ columns.score, sizes[:, None] ** 2
    grown = 1.0 + square * np.maximum(values, 0.0)
    return np.asarray(np.sum(0.5 * square * along**2 / grown - 0.5 * np.log(grown), axis=1))
