"""Rows of the numbers that a measurement folder holds: which number each is, and how it answers to shifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.diagnosis.linearised_readings import inverse_covariance_factor
from calibration.instruments.distances import Distances
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import HEIGHT, ToolCoordinates
from calibration.model.model import Poses

OPEN = 1.0e4  # standard deviation, in those of a reading, of what is not known of the two ends of a distance
NO_AXIS = -1


@dataclass(frozen=True)
class FolderRows:
    """Rows (n) of one whitened number each.

    whiten (n, 1, 3): by a shift of the tool or by a rotation vector, in the instrument's frame. visit (n,): where it
    acts; home (n,): the reading's first visit. partner (n,): row of the other end of a distance, -1 where there is
    none. is_first (n,): False for second ends. turns (n,): rotations. axis (n,): of a place, NO_AXIS for anything else.
    sigma, value (n,): stated standard deviation and reading, m or rad. instrument, reading, entry (n,): whose number.
    """

    whiten: Array
    visit: NDArray[np.intp]
    home: NDArray[np.intp]
    partner: NDArray[np.intp]
    turns: NDArray[np.bool_]
    axis: NDArray[np.intp]
    sigma: Array
    value: Array
    instrument: NDArray[np.intp]
    reading: NDArray[np.intp]
    entry: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.visit)

    @property
    def is_length(self) -> NDArray[np.bool_]:
        """Rows (n,) that are no rotations."""
        return ~self.turns

    @property
    def has_two_ends(self) -> NDArray[np.bool_]:
        """Rows (n,) of distances between two visits."""
        return np.asarray(self.partner >= 0)

    @property
    def is_first(self) -> NDArray[np.bool_]:
        """Rows (n,) that are not second ends: one for each number read."""
        return np.asarray(~self.has_two_ends | (np.arange(len(self)) < self.partner))

    def of_numbers(self, by_instrument: Sequence[Array]) -> Array:
        """Whitened figures (n, 1, ...) of the rows from those of the numbers, (r, w, ...) an instrument."""
        out = np.empty((len(self), 1, *by_instrument[0].shape[2:]))
        for number, figures in enumerate(by_instrument):
            rows = self.instrument == number
            out[rows, 0] = figures[self.reading[rows], self.entry[rows]]
        out[self.has_two_ends] /= np.sqrt(2.0)
        return out

    def joined(self, whitened: Array) -> Array:
        """The mean of the two ends of a distance at each of them, from whitened numbers (n, 1, ...)."""
        other = np.where(self.has_two_ends, self.partner, np.arange(len(self)))
        return np.asarray(0.5 * (whitened + whitened[other]))

    def factor_of(self, columns: Array) -> Array:
        """q (n, 1, r) such that 1 - q q' is the inverse covariance of the rows with columns (n, 1, b), the same at both
        ends of a distance; with what is open of the ends."""
        return np.concatenate([inverse_covariance_factor(columns), self.open_ends()], axis=2)

    def open_ends(self) -> Array:
        """The part (n, 1, r) of such a factor by which the ends of distances are open to one another."""
        first = np.flatnonzero(self.has_two_ends & self.is_first)
        ends = np.zeros((len(self), 1, first.size))
        share = np.sqrt(OPEN**2 / (1.0 + 2.0 * OPEN**2))
        ends[first, 0, np.arange(first.size)] = share
        ends[self.partner[first], 0, np.arange(first.size)] = -share
        return ends


def rows_of(
    readings: Sequence[Readings], local: Sequence[NDArray[np.intp]], poses: Poses, frame: Frame, bowl_m: float
) -> FolderRows:
    """The rows of all readings; local: rows of the poses, (r, 1) or (r, 2) an instrument. bowl_m: depth as fitted."""
    parts = [
        _rows_of_distances(part, at, poses, frame)
        if isinstance(part, Distances)
        else _rows_of_coordinates(part, at, poses, bowl_m)
        for part, at in zip(readings, local, strict=True)
        if isinstance(part, Distances | ToolCoordinates)
    ]
    before = np.cumsum([0, *(len(part["visit"]) for part in parts)])
    for number, (part, offset) in enumerate(zip(parts, before[:-1].tolist(), strict=True)):
        part["instrument"] = np.full(len(part["visit"]), number)
        part["partner"] = np.where(part["partner"] >= 0, part["partner"] + offset, -1)
    return FolderRows(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _rows_of_coordinates(
    part: ToolCoordinates, local: NDArray[np.intp], poses: Poses, bowl_m: float
) -> dict[str, NDArray]:  # type: ignore[type-arg]
    count, width = len(part), part.width
    chosen = np.array(part.coordinates)
    whiten = np.zeros((count, width, 1, 3))
    for entry, c in enumerate(chosen.tolist()):
        whiten[:, entry, 0, c % 3] = 1.0
        if c == HEIGHT and bowl_m != 0.0:  # the bed that is touched rises outwards
            steeper = -2.0 * bowl_m / part.bowl_radius_m**2
            whiten[:, entry, 0, :2] = steeper * poses.tool_m()[local[:, 0], :2]
    whiten /= part.sigma[:, :, None, None]
    axis = np.where(chosen < 3, chosen, NO_AXIS)
    visit = np.repeat(local[:, 0], width)
    return {
        "whiten": whiten.reshape(-1, 1, 3),
        "visit": visit,
        "home": visit,
        "partner": np.full(count * width, -1),
        "turns": np.tile(chosen > 2, count),
        "axis": np.tile(axis, count),
        "sigma": part.sigma.ravel(),
        "value": part.value[:, chosen].ravel(),
        "reading": np.repeat(np.arange(count), width),
        "entry": np.tile(np.arange(width), count),
    }


def _rows_of_distances(part: Distances, local: NDArray[np.intp], poses: Poses, frame: Frame) -> dict[str, NDArray]:  # type: ignore[type-arg]
    """One row an end; the first ends before the second ones."""
    count, tool_m = len(part), poses.tool_m()
    second_m = tool_m[local[:, 1]] if part.second is not None else np.array(part.centre_m)
    between = tool_m[local[:, 0]] - second_m
    along = between / np.linalg.norm(between, axis=1)[:, None] @ frame.rotation.T / part.sigma_m[:, None]
    ends = local.shape[1]
    whiten = along if ends == 1 else np.sqrt(2.0) * np.concatenate([along, -along])
    rows = np.arange(count)
    return {
        "whiten": whiten[:, None],
        "visit": local.T.ravel(),
        "home": np.tile(local[:, 0], ends),
        "partner": np.full(count, -1) if ends == 1 else np.concatenate([rows + count, rows]),
        "turns": np.zeros(ends * count, dtype=bool),
        "axis": np.full(ends * count, NO_AXIS),
        "sigma": np.tile(part.sigma_m, ends),
        "value": np.tile(part.distance_m, ends),
        "reading": np.tile(rows, ends),
        "entry": np.zeros(ends * count, dtype=np.intp),
    }
