"""Whitened responses of the readings to channels, and which readings a channel moves.

Most shapes depend on what was commanded, which the readings of a visit share: sums over readings are then sums over
visits, several times fewer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.effects.columns import ColumnsByChannel

UNKNOWN_CHANNEL = "unknown."  # followed by the name of an unknown that the calibration does not fit
FEW = 16  # readings that mostly tell already whether a shape differs within visits


@dataclass(frozen=True)
class PartOfChannel:
    """Sums over groups (g) of readings, for one unit of a channel: projection along_factor (g, b), norm (g,) of the
    response, score (g,)."""

    along_factor: Array
    norm: Array
    score: Array


class ChannelResponses:
    """Whitened responses (n, w) of a linear model's readings to one unit of each channel, computed on first use."""

    def __init__(self, linear: LinearisedReadings) -> None:
        self.channels = Channels(linear)
        self._linear = linear
        self._responses: dict[str, Array] = {}
        self._rows: dict[str, NDArray[np.intp]] = {}
        self._visits: dict[str, _Visits] = {}
        self._by_visit: WeakKeyDictionary[ColumnsByChannel, Mapping[str, Array | None]] = WeakKeyDictionary()
        self._products: WeakKeyDictionary[ColumnsByChannel, Array] = WeakKeyDictionary()

    def __call__(self, channel: str) -> Array:
        """The response (n, w) to a channel."""
        if channel not in self._responses:
            self._responses[channel] = (
                self._linear.left_alone[channel.removeprefix(UNKNOWN_CHANNEL)]
                if channel.startswith(UNKNOWN_CHANNEL)
                else self._linear.whiten_shift(self.channels.shift_m(channel))
            )
        return self._responses[channel]

    def rows(self, channel: str) -> NDArray[np.intp]:
        """The readings (m,) that respond to a channel."""
        if channel not in self._rows:
            self._rows[channel] = np.flatnonzero(np.any(self(channel) != 0.0, axis=1))
        return self._rows[channel]

    def columns_by_visit(self, columns: ColumnsByChannel) -> Mapping[str, Array | None]:
        """For each channel of some columns the shapes (v, k) at each visit if all of its readings that respond to the
        channel have the same; else None."""
        if columns not in self._by_visit:
            self._by_visit[columns] = {
                name: self._at_visits(name, shapes) for name, (_, shapes) in columns.shapes.items()
            }
        return self._by_visit[columns]

    def products(self, columns: ColumnsByChannel) -> Array:
        """Products (k, k) of whitened columns with each other; they are alike at all levels of the disturbances."""
        if columns not in self._products:
            self._products[columns] = self._products_of(columns)
        return self._products[columns]

    def _products_of(self, columns: ColumnsByChannel) -> Array:
        out, done = np.zeros((columns.count, columns.count)), list[str]()
        all_by_visit = self.columns_by_visit(columns)
        for channel, (numbers, shapes) in columns.shapes.items():
            by_visit, square = all_by_visit[channel], np.sum(self(channel) ** 2, axis=1)
            if by_visit is None:
                rows = self.rows(channel)
                weighted = np.sqrt(square[rows])[:, None] * shapes[rows]
            else:
                weighted = np.sqrt(self.sums_over_visits @ square)[:, None] * by_visit
            out[_block(numbers, numbers)] += weighted.T @ weighted
            for other in done:
                product = np.einsum("nj,nj->n", self(channel), self(other))
                if not (rows := np.flatnonzero(product)).size:
                    continue
                (other_numbers, other_shapes), other_by_visit = columns.shapes[other], all_by_visit[other]
                if by_visit is not None and other_by_visit is not None:
                    block = by_visit.T @ ((self.sums_over_visits @ product)[:, None] * other_by_visit)
                else:
                    block = shapes[rows].T @ (product[rows, None] * other_shapes[rows])
                out[_block(numbers, other_numbers)] += block
                out[_block(other_numbers, numbers)] += block.T
            done.append(channel)
        return out

    def _at_visits(self, channel: str, shapes: Array) -> Array | None:
        if channel not in self._visits:
            self._visits[channel] = _Visits(self.rows(channel), self._linear.context.arrival)
        return self._visits[channel].of_shapes(shapes)

    @cached_property
    def sums_over_visits(self) -> csr_array:
        """(v, n): sums up what readings (n,) have at each visit."""
        return sums_over_visits(self._linear.context.arrival)


class _Visits:
    """Visits (v) of those readings (m,) that respond to a channel; arrival (n,): the visit of each of all readings."""

    def __init__(self, rows: NDArray[np.intp], arrival: NDArray[np.intp]) -> None:
        self._one = np.zeros(int(arrival.max()) + 1, dtype=np.intp)  # without a reading that responds: any will do
        self._one[arrival[rows[::-1]]] = rows[::-1]
        one = self._one[arrival[rows]]
        self._others, self._same_as = rows[rows != one], one[rows != one]
        self._few = slice(None, None, len(self._others) // FEW + 1)

    def of_shapes(self, shapes: Array) -> Array | None:
        """As `ChannelResponses.columns_by_visit`, of one channel."""
        for some in (self._few, slice(None)):
            if not np.array_equal(shapes[self._others[some]], shapes[self._same_as[some]]):
                return None
        return shapes[self._one]


def sums_over_visits(arrival: NDArray[np.intp]) -> csr_array:
    """Matrix (v, n) that sums up what readings have at each visit; arrival (n,): the visit of each."""
    return csr_array((np.ones(len(arrival)), (arrival, np.arange(len(arrival)))))


def products_along(response: Array, q: Array) -> Array:
    """Products (n, j) of responses (n, w) with q (n, w, j)."""
    return np.asarray(np.matmul(response[:, None, :], q)[:, 0])


def _block(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> tuple[slice | NDArray[np.intp], ...]:
    """Index of a block of a matrix by its rows and columns, both ascending; slices where no number is left out."""
    if all(numbers[-1] - numbers[0] + 1 == len(numbers) for numbers in (rows, columns)):
        return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return np.ix_(rows, columns)
