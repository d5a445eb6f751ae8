"""The mock control's own reader of corrections: the CSV tables of docs/reference/control-files.md, one file a drive.

The correction of a drive is the sum of its tables at the commanded positions; it is added to the command. Linear and
bilinear between nodes, ends held. A node that a grid lacks has the value of the nearest one that it has.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_BYTES = 50_000_000
_HEAD = ("table", "input_1", "position_1", "input_2", "position_2")
_UNITS = ("correction_m", "correction_rad")


class CorrectionError(ValueError):
    """A correction that the control does not take; one line."""


@dataclass(frozen=True)
class Grid:
    """One table: values (n, m) over positions (n,) of a drive and (m,) of another one, or (n, 1) over one alone."""

    inputs: tuple[int, ...]
    positions: tuple[Array, ...]
    values: Array

    def at(self, drives: Sequence[float]) -> float:
        """The value at commanded positions of all drives, ends held."""
        out = self.values
        for drive, nodes in reversed(list(zip(self.inputs, self.positions, strict=True))):
            out = _between(nodes, out, float(drives[drive]))
        return float(out.ravel()[0])


@dataclass(frozen=True)
class Correction:
    """The tables of all drives."""

    tables: tuple[tuple[Grid, ...], ...]

    def corrected(self, drives: Sequence[float]) -> list[float]:
        """Where drives stand that are commanded to `drives`, in m or rad."""
        return [q + sum(grid.at(drives) for grid in own) for q, own in zip(drives, self.tables, strict=True)]


def read_correction(folder: str | Path, drives: Sequence[str]) -> Correction:
    """The correction in a folder: a file of each drive, named after it. Raises CorrectionError and OSError."""
    return Correction(tuple(_read(Path(folder) / f"{name}.csv", drives) for name in drives))


def _between(nodes: Array, values: Array, at: float) -> Array:
    """Linear along the last axis of values (..., n), which goes away; ends held."""
    if len(nodes) == 1:
        return values[..., 0]
    place = min(max(at, float(nodes[0])), float(nodes[-1]))
    k = min(max(int(np.searchsorted(nodes, place)) - 1, 0), len(nodes) - 2)
    share = (place - nodes[k]) / (nodes[k + 1] - nodes[k])
    return np.asarray(values[..., k] * (1.0 - share) + values[..., k + 1] * share)


def _read(path: Path, drives: Sequence[str]) -> tuple[Grid, ...]:
    data = path.read_bytes()
    if len(data) > MOST_BYTES:
        raise CorrectionError(f"{path}: larger than {MOST_BYTES} bytes; no correction")
    lines = [line for line in data.decode("utf-8", "replace").splitlines() if line and not line.startswith("#")]
    rows = list(csv.reader(io.StringIO("\n".join(lines))))
    if not rows or tuple(rows[0][:5]) != _HEAD or len(rows[0]) != 6 or rows[0][5] not in _UNITS:
        raise CorrectionError(f"{path}: its head is not {','.join(_HEAD)},{_UNITS[0]}")
    tables: dict[int, list[tuple[tuple[int, ...], tuple[float, ...], float]]] = {}
    for number, row in enumerate(rows[1:], start=2):
        try:
            table, inputs, at, value = _entry(row, drives)
        except (ValueError, IndexError) as error:
            raise CorrectionError(f"{path}: row {number}: {error}") from error
        tables.setdefault(table, []).append((inputs, at, value))
    try:
        return tuple(_grid(entries) for entries in tables.values())
    except ValueError as error:
        raise CorrectionError(f"{path}: {error}") from error


def _entry(row: Sequence[str], drives: Sequence[str]) -> tuple[int, tuple[int, ...], tuple[float, ...], float]:
    table, first, p, second, q, value = row
    names = [name for name in (first, second) if name]
    unknown = [name for name in names if name not in drives]
    if unknown or not names:
        raise ValueError(f"drive {', '.join(unknown) or 'none'}; the machine has {', '.join(drives)}")
    at = tuple(float(text) for text in (p, q)[: len(names)])
    if not all(map(math.isfinite, (*at, float(value)))):
        raise ValueError("not a number")
    return int(table), tuple(drives.index(name) for name in names), at, float(value)


def _grid(entries: Sequence[tuple[tuple[int, ...], tuple[float, ...], float]]) -> Grid:
    inputs = entries[0][0]
    if any(other != inputs for other, _, _ in entries):
        raise ValueError("a table is over the same drives in all its rows")
    points = np.array([at for _, at, _ in entries])
    values = np.array([value for *_, value in entries])
    positions = tuple(np.unique(column) for column in points.T)
    shape = tuple(len(nodes) for nodes in positions)
    grid = np.full(shape, np.nan)
    grid[tuple(np.searchsorted(n, c) for n, c in zip(positions, points.T, strict=True))] = values
    for hole in np.argwhere(np.isnan(grid)):
        away = [(points[:, a] - positions[a][hole[a]]) / max(np.ptp(positions[a]), 1e-9) for a in range(len(shape))]
        grid[tuple(hole)] = values[int(np.argmin(np.sum(np.square(away), axis=0)))]
    return Grid(inputs, positions, grid)
