"""How much the readings speak for a form: evidence marginalised over its size, its coefficients and all of calibration.

With C the readings' covariance under the model with its priors and the declared nuisance, columns H with coefficients
of standard deviations a d change the logarithm of the evidence by
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
from calibration.diagnosis.linear_model import Baseline, taken_out
from calibration.effects.api import Acts, Form

SIZES = 9


@dataclass(frozen=True)
class Judged:
    """Columns (k) as the readings see them: information F (k, k) and scores g (k,), calibration taken out."""

    information: Array
    score: Array


@dataclass(frozen=True)
class Weighed:
    """A form with its evidence over `none` (natural logarithm), best size, coefficients (k,) and their covariance."""

    form: Form
    log_evidence: float
    size: float
    coefficients: Array
    covariance: Array


class Readout:
    """Judges columns on one baseline, and on what is left of it once some columns belong to the model.

    left (n, 3): C^-1 y; q (n, 3, b): one minus q q' is C^-1, the inverse covariance of the readings.
    """

    def __init__(self, baseline: Baseline) -> None:
        self.baseline = baseline
        self.channels = Channels(baseline)
        self.left = baseline.apply(baseline.residual)
        self.q = baseline.q
        self._projected: dict[str, Array] = {}
        self._responses: dict[str, Array] = {}

    def response(self, channel: str) -> Array:
        """Whitened response (n, 3) to one unit of a channel."""
        if channel not in self._responses:
            self._responses[channel] = self.baseline.whitened(self.channels.shift_m(channel))
        return self._responses[channel]

    def given(self, columns: Array) -> Readout:
        """The readout once columns (n, 3, j), each times its prior standard deviation, belong to the model."""
        other = Readout.__new__(Readout)
        other.baseline, other.channels = self.baseline, self.channels
        rest = self.apply(columns)
        flat, n = rest.reshape(-1, columns.shape[2]), len(rest)
        gram = np.eye(columns.shape[2]) + columns.reshape(-1, columns.shape[2]).T @ flat
        upper = np.linalg.cholesky(gram).T
        more = np.linalg.solve(upper.T, flat.T).T
        other.q = np.concatenate([self.q, more.reshape(n, 3, -1)], axis=2)
        other.left = self.left - (more @ (more.T @ self.baseline.residual.ravel())).reshape(n, 3)
        other._projected, other._responses = {}, self._responses
        return other

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times columns (n, 3, k)."""
        return taken_out(self.q, columns)

    def columns(self, acts: Sequence[Acts]) -> Array:
        """Whitened columns (n, 3, k)."""
        out = np.zeros((*self.left.shape, len(acts)))
        for k, act in enumerate(acts):
            for channel, shape in act:
                out[:, :, k] += self.response(channel) * shape[:, None]
        return out

    def judge(self, acts: Sequence[Acts]) -> Judged:
        """Information and scores of columns, without ever building them."""
        count = len(acts)
        by_channel: dict[str, dict[int, Array]] = {}
        for k, act in enumerate(acts):
            for channel, shape in act:
                known = by_channel.setdefault(channel, {})
                known[k] = known[k] + shape if k in known else shape
        along = np.zeros((self.q.shape[2], count))
        score = np.zeros(count)
        information = np.zeros((count, count))
        stacked = {
            channel: (list(found), np.stack(list(found.values()), axis=1)) for channel, found in by_channel.items()
        }
        for channel, (numbers, shapes) in stacked.items():
            response = self.response(channel)
            along[:, numbers] += self._projection(channel).T @ shapes
            score[numbers] += np.sum(response * self.left, axis=1) @ shapes
            for other, (theirs, second) in stacked.items():
                product = np.sum(response * self.response(other), axis=1)
                if np.any(product):
                    information[np.ix_(numbers, theirs)] += shapes.T @ (product[:, None] * second)
        return Judged(information - along.T @ along, score)

    def judge_through(self, channels: Sequence[tuple[str, float]], shapes: Array) -> Judged:
        """The same of shapes (n, k) through each of some channels, each times a unit: the channels' columns in turn."""
        along, score = [], []
        blocks = [[np.empty(0)] * len(channels) for _ in channels]
        for i, (channel, unit) in enumerate(channels):
            response = self.response(channel) * unit
            along.append(self._projection(channel).T @ shapes * unit)
            score.append(np.sum(response * self.left, axis=1) @ shapes)
            for j, (other, theirs) in enumerate(channels[: i + 1]):
                product = np.sum(response * self.response(other), axis=1) * theirs
                blocks[i][j] = shapes.T @ (product[:, None] * shapes)
                blocks[j][i] = blocks[i][j].T
        joined = np.concatenate(along, axis=1)
        return Judged(np.block(blocks) - joined.T @ joined, np.concatenate(score))

    def seen_through(self, channels: Sequence[str], shapes: Array, rows: NDArray[np.intp]) -> Array:
        """What is left of shapes (n, k) through channels once calibration is fitted again: rows (m, 3, k times c)."""
        out = []
        for channel in channels:
            along = self._projection(channel).T @ shapes
            response = self.response(channel)[rows]
            q = self.q[rows].reshape(-1, self.q.shape[2])
            out.append(response[:, :, None] * shapes[rows][:, None, :] - (q @ along).reshape(len(rows), 3, -1))
        return np.concatenate(out, axis=2)

    def by_visit(self, channel: str, arrival: NDArray[np.intp]) -> tuple[Array, Array]:
        """Information and score (v,) of a unit of a channel in each single visit."""
        count = int(arrival.max()) + 1
        response = self.response(channel)
        sums = csr_array((np.ones(len(arrival)), (arrival, np.arange(len(arrival)))), shape=(count, len(arrival)))
        along = sums @ self._projection(channel)
        information = np.bincount(arrival, np.sum(response**2, axis=1), minlength=count) - np.sum(along**2, axis=1)
        score = np.bincount(arrival, np.sum(response * self.left, axis=1), minlength=count)
        return np.asarray(np.maximum(information, 0.0)), np.asarray(score, dtype=np.float64)

    def _projection(self, channel: str) -> Array:
        """Rows (n, b): the channel's response along q."""
        if channel not in self._projected:
            response = self.response(channel)
            self._projected[channel] = np.einsum("nj,njb->nb", response, self.q)
        return self._projected[channel]


def log_sum(logs: Array, axis: int = 0) -> Array:
    """Logarithm of a sum of exponentials."""
    top = logs.max(axis=axis, keepdims=True)
    return np.asarray(np.log(np.sum(np.exp(logs - top), axis=axis)) + np.squeeze(top, axis=axis))


def weigh(judged: Judged, forms: Sequence[Form], low: float, high: float) -> list[Weighed]:
    """Evidence of forms for sizes within limits."""
    sizes = np.geomspace(low, high, SIZES)
    out: list[Weighed | None] = [None] * len(forms)
    by_length: dict[int, list[int]] = {}
    for number, form in enumerate(forms):
        by_length.setdefault(len(form.columns), []).append(number)
    for members in by_length.values():
        pick = np.array([forms[i].columns for i in members])
        relative = np.array([forms[i].relative for i in members])
        f = judged.information[pick[:, :, None], pick[:, None, :]] * relative[:, :, None] * relative[:, None, :]
        g = judged.score[pick] * relative
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
            out[number] = Weighed(forms[number], float(evidence[row]), a, coefficients, covariance)
    return [w for w in out if w is not None]


def log_evidence_of_sizes(judged: Judged, sizes: Array) -> Array:
    """Logarithm (a,) of the evidence of all columns alike, with coefficients of each standard deviation (a,)."""
    values, vectors = np.linalg.eigh(0.5 * (judged.information + judged.information.T))
    along, square = vectors.T @ judged.score, sizes[:, None] ** 2
    grown = 1.0 + square * np.maximum(values, 0.0)
    return np.asarray(np.sum(0.5 * square * along**2 / grown - 0.5 * np.log(grown), axis=1))
