"""How much of a change is left to see once both campaigns are fitted again with one machine that has not changed.

From the plants alone: derivatives are difference quotients of the plants, no column is one of the comparison's.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Protocol

import numpy as np

from benchmarks.comparison.change import Array, Change, Curve
from calibration.machine.description import Machine

STEP = 0.05  # of a prior deviation: the plants are linear far beyond
OF_UNIFORM = 1.0 / np.sqrt(3.0)
FLOOR_M = 3.0e-3
WIDE = 1.0e-2  # m and rad, of a station's frame: wider than any data leave


class Campaign(Protocol):
    """What is asked of a campaign of either plant; r readings."""

    @property
    def places_m(self) -> Array:
        """Where the readings (r, 3) are in the machine's frame."""

    @property
    def weight(self) -> Array:
        """Inverse standard deviations (r, 3) or roots of the inverse covariances (r, 3, 3), machine's axes."""

    def shifted_m(self, change: Change) -> Array:
        """Shift (r, 3) of the readings by a change, machine's axes."""


def unit_errors(machine: Machine) -> Iterator[Change]:
    """Every error of the machine and of its reflectors, each of one prior deviation."""
    width, axes = machine.file.tolerances, "xy" if machine.planar else "xyz"

    def along(c: str, size: float) -> tuple[float, float, float]:
        x, y, z = (size if c == d else 0.0 for d in "xyz")
        return x, y, z

    for i in range(len(machine.strut_names)):
        yield Change(length_m={i: width.strut_length_m * OF_UNIFORM})
        yield Change(ln_stiffness={i: width.ln_stiffness * OF_UNIFORM})
        for c in axes:
            yield Change(platform_joint_m={i: along(c, width.platform_joint_m * OF_UNIFORM)})
            yield Change(base_joint_m={i: along(c, width.base_joint_m * OF_UNIFORM)})
    for a, kind in enumerate(machine.drive_kinds):
        yield Change(travel={a: straight(width.drive_scale * OF_UNIFORM)})
        if kind != "leg" and width.axis_tilt_rad is not None:
            for c in "z" if machine.planar else "xy":
                yield Change(column_tilt_rad={a: along(c, width.axis_tilt_rad * OF_UNIFORM)})
    for i, smr in enumerate(machine.smrs):
        for c in "xyz":
            size = FLOOR_M if smr.on == "floor" else width.smr_position_m
            yield Change(smr_m={i: along(c, size * OF_UNIFORM)})


def straight(slope: float) -> Curve:
    """A drive that counts wrongly."""
    return lambda q: slope * q


def even(offset_m: float) -> Curve:
    """A drive that has another zero."""
    return lambda q: np.full_like(q, offset_m)


_DERIVATIVES: dict[tuple[str, int], Array] = {}


def derivatives(key: tuple[str, int], machine: Machine, reference: Campaign) -> Array:
    """Shifts (r, 3, p) of the readings of a design by every error, of a reference machine; computed once a design."""
    if key not in _DERIVATIVES:
        columns = [reference.shifted_m(error.times(STEP)) / STEP for error in unit_errors(machine)]
        _DERIVATIVES[key] = np.stack(columns, axis=2)
    return _DERIVATIVES[key]


@lru_cache(maxsize=1)
def _axes() -> Array:
    return np.eye(3)


def _frame(places_m: Array, stand_m: Array, range_constant_m: float, range_scale: float) -> Array:
    """Shifts (r, 3, 8) by a motion of the station's frame, and by an error of its ranges."""
    sight = places_m - stand_m
    turns = np.stack([np.cross(axis, sight) for axis in _axes()], axis=2) * WIDE
    shifts = np.broadcast_to(_axes() * WIDE, (len(sight), 3, 3))
    ranges = sight / np.linalg.norm(sight, axis=1)[:, None] * range_constant_m
    return np.concatenate([turns, shifts, ranges[:, :, None], (sight * range_scale)[:, :, None]], axis=2)


def _weighted(weight: Array, columns: Array) -> Array:
    if weight.ndim == 2:
        return np.asarray((columns * weight[:, :, None]).reshape(-1, columns.shape[2]))
    return np.asarray((weight @ columns).reshape(-1, columns.shape[2]))


class VisibleScale:
    """Visible sizes of changes between two campaigns.

    errors: `derivatives` of each; stands_m: where the stations are; ranges: standard uncertainty of constant and scale.
    """

    def __init__(
        self,
        campaigns: tuple[Campaign, Campaign],
        errors: tuple[Array, Array],
        stands_m: tuple[Array, Array],
        ranges: tuple[float, float],
    ) -> None:
        self.after = campaigns[1]
        common = [_weighted(c.weight, e) for c, e in zip(campaigns, errors, strict=True)]
        own = [
            _weighted(c.weight, _frame(c.places_m, stand, *ranges))
            for c, stand in zip(campaigns, stands_m, strict=True)
        ]
        self._first = len(common[0])
        p, k = common[0].shape[1], own[0].shape[1]
        rows = np.zeros((self._first + len(common[1]), p + 2 * k))
        rows[: self._first, :p], rows[self._first :, :p] = common
        rows[: self._first, p : p + k], rows[self._first :, p + k :] = own
        self._q, _ = np.linalg.qr(np.concatenate([rows, np.eye(p + 2 * k)]))

    def left(self, change: Change) -> Array:
        """What is left of a change in the readings after (r, 3), in their standard deviations."""
        shift = _weighted(self.after.weight, self.after.shifted_m(change)[:, :, None])[:, 0]
        rows = np.zeros(len(self._q))
        rows[self._first : self._first + len(shift)] = shift
        rest = rows - self._q @ (self._q.T @ rows)
        return np.asarray(rest[self._first : self._first + len(shift)].reshape(-1, 3))


def rms(left: Array, rows: Array, samples: Array, moving: int) -> float:
    """RMS in sigma of one measurement, over the coordinates in which the machine moves, of some readings (r,)."""
    single = left[rows] / np.sqrt(samples[rows])[:, None]
    return float(np.sqrt(np.sum(single**2) / (moving * max(int(np.sum(rows)), 1))))
