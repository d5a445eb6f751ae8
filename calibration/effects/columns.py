"""Columns of a model, grouped by the channels that they act through."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array

Contributions = tuple[tuple[str, Array], ...]  # of one column: channels, each with a function (n,) of the readings


@dataclass(frozen=True, eq=False)
class ColumnsByChannel:
    """Columns (k): for each channel the numbers (j,) of those that act through it, and their shapes (n, j)."""

    count: int
    shapes: Mapping[str, tuple[NDArray[np.intp], Array]]

    @classmethod
    def of(cls, contributions: Sequence[Contributions]) -> ColumnsByChannel:
        """The contributions (k) of single columns, grouped."""
        by_channel: dict[str, dict[int, Array]] = {}
        for k, contribution in enumerate(contributions):
            for channel, shape in contribution:
                shapes = by_channel.setdefault(channel, {})
                shapes[k] = shapes[k] + shape if k in shapes else shape
        grouped = {
            channel: (np.array(list(shapes), dtype=np.intp), np.stack(list(shapes.values()), axis=1))
            for channel, shapes in by_channel.items()
        }
        return cls(len(contributions), MappingProxyType(grouped))

    @classmethod
    def through(cls, channels: Sequence[tuple[str, float]], shapes: Array) -> ColumnsByChannel:
        """Shapes (n, j) through each of some channels, each times its unit; ordered by channel."""
        j = shapes.shape[1]
        grouped = {
            channel: (np.arange(i * j, (i + 1) * j, dtype=np.intp), shapes * unit)
            for i, (channel, unit) in enumerate(channels)
        }
        return cls(len(channels) * j, MappingProxyType(grouped))
