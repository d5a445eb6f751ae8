"""Whether the floor nests stayed where they were while the station was set up anew: distances are of no frame."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from calibration.base.errors import InputError
from calibration.reduction.common_points import NestEstimate

MOST_U = 3.0

Pair = tuple[str, str]


def require_equal_nest_distances(nests: Mapping[float, NestEstimate], range_constant_u_m: float) -> None:
    """InputError, naming the nest, if a distance of nests differs between set-ups by more than three of its u.

    nests: estimates by number of the set-up. u is that of the difference: noise and drift of both set-ups, and the
    range constant, which both have in common. A scale of the ranges changes both alike.
    """
    for (earlier, a), (later, b) in combinations(nests.items(), 2):
        common = [name for name in a.names if name in b.names]
        differences = _differences(a, b, {name: name for name in common}, range_constant_u_m)
        wrong = {pair: d for pair, d in differences.items() if abs(d[0]) > MOST_U * d[1]}
        if not wrong:
            continue
        pair, (shift, u) = max(wrong.items(), key=lambda entry: abs(entry[1][0]) / entry[1][1])
        raise InputError(
            f"set-up {later:g}: {_what_happened(a, b, common, differences, range_constant_u_m)} since set-up "
            f"{earlier:g}: the distance of {' and '.join(pair)} differs by {abs(shift) * 1e6:.0f} um, "
            f"u = {u * 1e6:.0f} um; put it back, or measure a new campaign"
        )


def _differences(
    a: NestEstimate, b: NestEstimate, in_b: Mapping[str, str], range_constant_u_m: float
) -> dict[Pair, tuple[float, float]]:
    """Later minus earlier distance of each pair of nests, in m, with its standard uncertainty; in_b: names in b."""
    out = {}
    for first, second in combinations(in_b, 2):
        length_a, variance_a, by_constant_a = _distance(a, first, second)
        length_b, variance_b, by_constant_b = _distance(b, in_b[first], in_b[second])
        common = (by_constant_b - by_constant_a) * range_constant_u_m
        out[first, second] = length_b - length_a, float(np.sqrt(variance_a + variance_b + common**2))
    return out


def _distance(nests: NestEstimate, first: str, second: str) -> tuple[float, float, float]:
    """Distance of two nests, its variance, and its derivative with the range constant."""
    i, j = nests.names.index(first), nests.names.index(second)
    between = nests.position_m[j] - nests.position_m[i]
    length = float(np.linalg.norm(between))
    gradient = np.zeros_like(nests.position_m)
    gradient[j], gradient[i] = between / length, -between / length
    sight = nests.position_m / np.linalg.norm(nests.position_m, axis=1)[:, None]
    return length, float(gradient.ravel() @ nests.covariance_m2 @ gradient.ravel()), float(np.sum(gradient * sight))


def _what_happened(
    a: NestEstimate,
    b: NestEstimate,
    common: list[str],
    differences: Mapping[Pair, tuple[float, float]],
    range_constant_u_m: float,
) -> str:
    """Two nests that changed places, the one nest that all wrong distances have in common, or those that have some."""
    for one, other in combinations(common, 2):
        swapped = {name: {one: other, other: one}.get(name, name) for name in common}
        if all(abs(d) <= MOST_U * u for d, u in _differences(a, b, swapped, range_constant_u_m).values()):
            return f"nests {one} and {other} were mixed up"
    squares = dict.fromkeys(common, 0.0)
    for pair, (shift, u) in differences.items():
        for name in pair:
            squares[name] += (shift / u) ** 2
    wrong = [pair for pair, (shift, u) in differences.items() if abs(shift) > MOST_U * u]
    suspects = sorted({name for pair in wrong for name in pair if all(name in other for other in wrong)})
    if len(common) == 2:
        return f"nest {' or '.join(suspects)} has moved"
    if suspects:
        return f"nest {max(suspects, key=lambda name: squares[name])} has moved"
    return f"nests {', '.join(sorted({name for pair in wrong for name in pair}))} have moved"
