"""What happens to a machine between two campaigns, as parts move and wear; plants carry it out in their own physics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Change:
    """Changes of parts by their numbers in the machine file; all of them zero is the machine as it was.

    travel: what a drive goes further than it says, by its coordinate. column_shift_m, column_tilt_rad: of what guides a
    slider, the tilt about the place of coordinate zero. ln_stiffness: logarithm of the ratio, of a strut.
    """

    travel: Mapping[int, Curve] = field(default_factory=dict)
    column_shift_m: Mapping[int, Vector] = field(default_factory=dict)
    column_tilt_rad: Mapping[int, Vector] = field(default_factory=dict)
    length_m: Mapping[int, float] = field(default_factory=dict)
    ln_stiffness: Mapping[int, float] = field(default_factory=dict)
    platform_joint_m: Mapping[int, Vector] = field(default_factory=dict)
    base_joint_m: Mapping[int, Vector] = field(default_factory=dict)
    smr_m: Mapping[int, Vector] = field(default_factory=dict)

    def times(self, factor: float) -> Change:
        """The same, so many times as large."""

        def vectors(of: Mapping[int, Vector]) -> dict[int, Vector]:
            return {i: (factor * x, factor * y, factor * z) for i, (x, y, z) in of.items()}

        def numbers(of: Mapping[int, float]) -> dict[int, float]:
            return {i: factor * x for i, x in of.items()}

        return Change(
            travel={a: _times(curve, factor) for a, curve in self.travel.items()},
            column_shift_m=vectors(self.column_shift_m),
            column_tilt_rad=vectors(self.column_tilt_rad),
            length_m=numbers(self.length_m),
            ln_stiffness=numbers(self.ln_stiffness),
            platform_joint_m=vectors(self.platform_joint_m),
            base_joint_m=vectors(self.base_joint_m),
            smr_m=vectors(self.smr_m),
        )


def _times(curve: Curve, factor: float) -> Curve:
    return lambda q: factor * curve(q)


def both(one: Change, other: Change) -> Change:
    """Two changes of different parts, or of the same drive's travel, together."""
    travel = dict(one.travel)
    for a, curve in other.travel.items():
        travel[a] = _sum(travel[a], curve) if a in travel else curve
    return Change(
        travel=travel,
        column_shift_m={**one.column_shift_m, **other.column_shift_m},
        column_tilt_rad={**one.column_tilt_rad, **other.column_tilt_rad},
        length_m={**one.length_m, **other.length_m},
        ln_stiffness={**one.ln_stiffness, **other.ln_stiffness},
        platform_joint_m={**one.platform_joint_m, **other.platform_joint_m},
        base_joint_m={**one.base_joint_m, **other.base_joint_m},
        smr_m=_vectors(one.smr_m, other.smr_m),
    )


def _sum(one: Curve, other: Curve) -> Curve:
    return lambda q: one(q) + other(q)


def _vectors(one: Mapping[int, Vector], other: Mapping[int, Vector]) -> dict[int, Vector]:
    out = dict(one)
    for i, v in other.items():
        u = out.get(i, (0.0, 0.0, 0.0))
        out[i] = (u[0] + v[0], u[1] + v[1], u[2] + v[2])
    return out
