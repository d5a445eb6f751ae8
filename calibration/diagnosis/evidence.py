"""The marginal likelihood of a recording: information and score of any columns, the calibration projected out.

Of columns H these are F = H' C^-1 H and g = H' C^-1 y, with C the covariance of the readings under the model with its
priors and the declared disturbances; the evidence of a basis set follows from them (`basis_set_evidence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import InformationAndScore
from calibration.diagnosis.channel_responses import (
    ChannelResponses,
    PartOfChannel,
    products_along,
    sums_over_visits,
)
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.effects.columns import ColumnsByChannel, Contributions


class MarginalLikelihood:
    """Marginal likelihood of columns on a linear model, and on columns that are already part of the model.

    q (n, w, b): 1 - q q' is C^-1, the inverse covariance of the readings. response: whitened response (n, w) to one
    unit of a channel. factor: q, or what is added to a parent's. Most models with something added are asked for a few
    channels only, so that nothing of the readings' length is computed of them before it is needed.
    """

    def __init__(
        self,
        linear: LinearisedReadings,
        response: ChannelResponses,
        factor: Array | _AddedFactor,
    ) -> None:
        self.linear = linear
        self.response = response
        self._factor = factor
        self._added = factor if isinstance(factor, _AddedFactor) else None
        self._projections: dict[str, Array] = {}
        self._parts: dict[tuple[str, bool], PartOfChannel] = {}
        self._kept: dict[ColumnsByChannel, InformationAndScore] = {}
        self._scores: dict[str, Array] = {}
        self._by_visit: dict[str, tuple[Array, Array]] = {}
        self._grouped: dict[str, tuple[NDArray[np.intp], InformationAndScore]] = {}

    @classmethod
    def of(cls, linear: LinearisedReadings) -> MarginalLikelihood:
        """The marginal likelihood of a linear model without any effect."""
        return cls(linear, ChannelResponses(linear), linear.q)

    def on(self, linear: LinearisedReadings) -> MarginalLikelihood:
        """The same on a model whose readings respond alike, with other prior standard deviations or other residuals."""
        return MarginalLikelihood(linear, self.response, linear.q)

    @property
    def channels(self) -> Channels:
        """The channels of the machine."""
        return self.response.channels

    def including(self, columns: Array) -> MarginalLikelihood:
        """The marginal likelihood with columns (n, w, j), each times its prior standard deviation, in the model."""
        return MarginalLikelihood(self.linear, self.response, _AddedFactor(self, columns))

    @cached_property
    def weighted_residual(self) -> Array:
        """C^-1 y (n, w)."""
        return self.linear.residual - self.times_q(self.residual_along_q[:, None])[:, :, 0]

    @cached_property
    def q(self) -> Array:
        """The factor (n, w, b); of most models with something added none is needed."""
        if self._added is None:
            return np.asarray(self._factor)
        return np.concatenate([self._added.parent.q, self._added.q], axis=2)

    @cached_property
    def residual_along_q(self) -> Array:
        """q' y (b,)."""
        if self._added is None:
            return self.along_q(self.linear.residual[:, :, None])[:, 0]
        return np.concatenate([self._added.parent.residual_along_q, self._added.along_residual])

    @cached_property
    def _rank(self) -> int:
        return self.q.shape[2] if self._added is None else self._added.parent._rank + self._added.count

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times columns (n, w, k)."""
        return columns - self.times_q(self.along_q(columns))

    def along_q(self, columns: Array) -> Array:
        """Products (b, k) of q with whitened columns (n, w, k)."""
        if self._added is None:
            return np.asarray(self.q.reshape(-1, self.q.shape[2]).T @ columns.reshape(-1, columns.shape[2]))
        along = self._added.parent.along_q(columns)
        return np.concatenate([along, self._added.along_q(columns, along)])

    def times_q(self, coefficients: Array) -> Array:
        """q times coefficients (b, k), as whitened columns (n, w, k)."""
        if self._added is None:
            flat = self.q.reshape(-1, self.q.shape[2]) @ coefficients
            return np.asarray(flat.reshape(*self.q.shape[:2], -1))
        former = self._added.parent._rank
        return self._added.times_q(coefficients[former:], coefficients[:former])

    def columns(self, contributions: Sequence[Contributions]) -> Array:
        """Whitened columns (n, w, k)."""
        out = np.zeros((*self.weighted_residual.shape, len(contributions)))
        for k, contribution in enumerate(contributions):
            for channel, shape in contribution:
                out[:, :, k] += self.response(channel) * shape[:, None]
        return out

    def information_and_score(self, contributions: Sequence[Contributions]) -> InformationAndScore:
        """Information and score of columns that are never formed explicitly."""
        return self._information_and_score(ColumnsByChannel.of(contributions))

    def kept_information_and_score(self, columns: ColumnsByChannel) -> InformationAndScore:
        """The same of columns that are asked for again with further causes in the model, which then change little."""
        if columns not in self._kept:
            self._kept[columns] = (
                self._information_and_score(columns)
                if self._added is None
                else self._added.updated(columns, self._added.parent.kept_information_and_score(columns))
            )
        return self._kept[columns]

    def _information_and_score(self, columns: ColumnsByChannel) -> InformationAndScore:
        along_factor = np.zeros((self._rank, columns.count))
        score = np.zeros(columns.count)
        all_by_visit = self.response.columns_by_visit(columns)
        for channel, (numbers, shapes) in columns.shapes.items():
            by_visit = all_by_visit[channel]
            part = self._part(channel, by_visit=by_visit is not None)
            own_shapes = shapes[self.response.rows(channel)] if by_visit is None else by_visit
            along_factor[:, numbers] += part.along_factor.T @ own_shapes
            score[numbers] += part.score @ own_shapes
        return InformationAndScore(self.response.products(columns) - along_factor.T @ along_factor, score)

    def _part(self, channel: str, *, by_visit: bool) -> PartOfChannel:
        """What a channel adds to information and score, by visit or by reading that responds."""
        if (channel, by_visit) not in self._parts:
            response = self.response(channel)
            values = self._projection(channel), np.sum(response**2, axis=1), self._score(channel)
            if by_visit:
                sums = self.response.sums_over_visits
                along_factor, square, score = (sums @ value for value in values)
            else:
                rows = self.response.rows(channel)
                along_factor, square, score = (value[rows] for value in values)
            self._parts[channel, by_visit] = PartOfChannel(along_factor, np.sqrt(square), score)
        return self._parts[channel, by_visit]

    def of_families(self, families: Sequence[Sequence[Contributions]]) -> list[InformationAndScore]:
        """Information and score of several families of columns, each by itself, of which only few are like another."""
        channels = {channel for family in families for column in family for channel, _ in column}
        if len(channels) != 1 or any(len(column) != 1 for family in families for column in family):
            return [self.information_and_score(family) for family in families]
        (channel,) = channels
        shapes = [np.stack([column[0][1] for column in family], axis=1) for family in families]
        part, rows = self._part(channel, by_visit=False), self.response.rows(channel)
        every = np.concatenate(shapes, axis=1)[rows]
        along, score = part.along_factor.T @ every, part.score @ every
        out, first = [], 0
        for shape in shapes:
            own = slice(first, first + shape.shape[1])
            weighted, first = part.norm[:, None] * every[:, own], own.stop
            information = weighted.T @ weighted - along[:, own].T @ along[:, own]
            out.append(InformationAndScore(information, score[own]))
        return out

    def observable_columns(self, channels: Sequence[str], shapes: Array, rows: NDArray[np.intp]) -> Array:
        """Rows (m, w, k c) of shapes (n, k) acting through channels (c), after the calibration has been refitted."""
        out, q, of_rows = [], self.q[rows].reshape(-1, self.q.shape[2]), shapes[rows]
        for channel in channels:
            part, response = self._part(channel, by_visit=False), self.response(channel)[rows]
            along_factor = part.along_factor.T @ shapes[self.response.rows(channel)]
            absorbed = (q @ along_factor).reshape(*response.shape, -1)
            out.append(response[:, :, None] * of_rows[:, None, :] - absorbed)
        return np.concatenate(out, axis=2)

    def grouped(self, channel: str, group: NDArray[np.intp]) -> InformationAndScore:
        """Information (v, v) and score (v,) of one unit of a channel at all readings of each group; group (n,): its
        number."""
        if (kept := self._grouped.get(channel)) is None or not np.array_equal(kept[0], group):
            sums = sums_over_visits(group)
            along_factor = sums @ self._projection(channel)
            information = np.diag(sums @ np.sum(self.response(channel) ** 2, axis=1)) - along_factor @ along_factor.T
            kept = self._grouped[channel] = (group, InformationAndScore(information, sums @ self._score(channel)))
        return kept[1]

    def information_by_visit(self, channel: str) -> tuple[Array, Array]:
        """Information and score (v,) of one unit of a channel during each single visit."""
        if channel not in self._by_visit:
            self._by_visit[channel] = self._information_by_visit(channel)
        information, score = self._by_visit[channel]
        return np.asarray(np.maximum(information, 0.0)), score

    def _information_by_visit(self, channel: str) -> tuple[Array, Array]:
        if (added := self._added) is None:
            part = self._part(channel, by_visit=True)
            return part.norm**2 - np.sum(part.along_factor**2, axis=1), part.score
        added.parent.information_by_visit(channel)
        information, score = added.parent._by_visit[channel]
        along = added.projection_by_visit(channel)
        return information - np.sum(along**2, axis=1), score - along @ added.along_residual

    def _score(self, channel: str) -> Array:
        """Score (n,) of one unit of a channel at each single reading."""
        if channel not in self._scores:
            self._scores[channel] = (
                np.einsum("nj,nj->n", self.response(channel), self.weighted_residual)
                if (added := self._added) is None
                else added.parent._score(channel) - added.projection(channel) @ added.along_residual
            )
        return self._scores[channel]

    def _projection(self, channel: str) -> Array:
        """Rows (n, b): a channel's response along q."""
        if channel not in self._projections:
            self._projections[channel] = (
                products_along(self.response(channel), self.q)
                if self._added is None
                else np.concatenate([self._added.parent._projection(channel), self._added.projection(channel)], axis=1)
            )
        return self._projections[channel]

    def projected(self, channel: str, coefficients: Array, *, by_visit: bool) -> Array:
        """A channel's response along q times coefficients (b, j): of readings (n, j), or summed over visits (v, j)."""
        if (added := self._added) is None:
            rows = self._part(channel, by_visit=True).along_factor if by_visit else self._projection(channel)
            return np.asarray(rows @ coefficients)
        former = added.parent._rank
        own = added.projection_by_visit(channel) if by_visit else added.projection(channel)
        before = added.parent.projected(channel, coefficients[:former], by_visit=by_visit)
        return np.asarray(before + own @ coefficients[former:])


class _AddedFactor:
    """What columns H (n, w, j) that were added to a parent's model, of factor p, add to it: q = (H - p t) U^-1 with
    t = p' H and U' U = 1 + H' H - t' t. along_residual (j,): q' y."""

    def __init__(self, parent: MarginalLikelihood, columns: Array) -> None:
        self.parent, self.count = parent, columns.shape[2]
        self._columns = columns
        flat = columns.reshape(-1, self.count)
        self._along = parent.along_q(columns)
        gram = np.eye(self.count) + flat.T @ flat - self._along.T @ self._along
        self._inverse_upper = np.linalg.inv(np.linalg.cholesky(gram).T)
        own = flat.T @ parent.linear.residual.ravel() - self._along.T @ parent.residual_along_q
        self.along_residual = self._inverse_upper.T @ own
        self._projections: dict[str, Array] = {}
        self._by_visit: dict[str, Array] = {}

    @cached_property
    def q(self) -> Array:
        """What is added (n, w, j)."""
        return self.times_q(np.eye(self.count), np.zeros_like(self._along))

    def times_q(self, coefficients: Array, of_parent: Array) -> Array:
        """Coefficients (j, k) times it and (b, k) times the parent's, as whitened columns (n, w, k)."""
        own = self._inverse_upper @ coefficients
        return np.asarray(self._columns @ own + self.parent.times_q(of_parent - self._along @ own))

    def along_q(self, columns: Array, along_parent: Array) -> Array:
        """Products (j, k) with whitened columns (n, w, k), from those of the parent's factor (b, k)."""
        own = self._columns.reshape(-1, self.count).T @ columns.reshape(-1, columns.shape[2])
        return np.asarray(self._inverse_upper.T @ (own - self._along.T @ along_parent))

    def projection(self, channel: str) -> Array:
        """Rows (n, j): a channel's response along q."""
        if channel not in self._projections:
            direct = products_along(self.parent.response(channel), self._columns)
            absorbed = self.parent.projected(channel, self._along, by_visit=False)
            self._projections[channel] = (direct - absorbed) @ self._inverse_upper
        return self._projections[channel]

    def projection_by_visit(self, channel: str) -> Array:
        """The same, summed over the readings of each visit (v, j)."""
        if channel not in self._by_visit:
            response = self.parent.response
            direct = response.sums_over_visits @ products_along(response(channel), self._columns)
            absorbed = self.parent.projected(channel, self._along, by_visit=True)
            self._by_visit[channel] = (direct - absorbed) @ self._inverse_upper
        return self._by_visit[channel]

    def updated(self, columns: ColumnsByChannel, former: InformationAndScore) -> InformationAndScore:
        """Information and score with what was added, from those of the parent."""
        along = np.zeros((self.count, columns.count))
        by_visit = self.parent.response.columns_by_visit(columns)
        for channel, (numbers, shapes) in columns.shapes.items():
            at_visits = by_visit[channel]
            along[:, numbers] += (
                self.projection(channel).T @ shapes
                if at_visits is None
                else self.projection_by_visit(channel).T @ at_visits
            )
        return InformationAndScore(former.information - along.T @ along, former.score - along.T @ self.along_residual)
