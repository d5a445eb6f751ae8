"""A drive's correction as a sum of tables over single drives, products of two of them, and tables over pairs.

That is what controls can hold (docs/explanation/control-tables.md). What a sum cannot express is its loss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.sparse import csr_matrix

from calibration.base.arrays import Array
from calibration.compensation.piecewise import Nodes, fit_nodes, plane_bends, plane_weights, scaled_rows

ALTERNATIONS = 60  # of the fit of products, at most
LEAST_GAIN = 0.01  # of the sum of squares, below which it has ended
STARTS = 2
EXTREME_NORM = 8.0
REWEIGHTINGS = 40
SEED_DEGREE = 4  # of the polynomials that tell where a product begins
SEED_RIDGE = 1e-3


@dataclass(frozen=True)
class Curve:
    """A table over one drive, `by` number: values (count,) at its nodes, linear between them, held beyond."""

    by: int
    nodes: Nodes
    values: Array

    def at(self, drives: Array) -> Array:
        """Values (n,) at drive positions (n, d)."""
        return np.asarray(self.nodes.weights(drives[:, self.by]) @ self.values)


@dataclass(frozen=True)
class Product:
    """The product of two tables, each over one drive; their units multiply to that of the correction."""

    first: Curve
    second: Curve

    def at(self, drives: Array) -> Array:
        """Values (n,) at drive positions (n, d)."""
        return self.first.at(drives) * self.second.at(drives)


@dataclass(frozen=True)
class Plane:
    """A table over two drives, `by` numbers: values (c1, c2) at the nodes of a grid, bilinear, held beyond."""

    by: tuple[int, int]
    nodes: tuple[Nodes, Nodes]
    values: Array

    def at(self, drives: Array) -> Array:
        """Values (n,) at drive positions (n, d)."""
        return np.asarray(plane_weights(*self.nodes, drives[:, list(self.by)]) @ self.values.ravel())


@dataclass(frozen=True)
class DriveTables:
    """The correction of one drive: the sum of its tables."""

    curves: tuple[Curve, ...] = ()
    products: tuple[Product, ...] = ()
    planes: tuple[Plane, ...] = ()

    def at(self, drives: Array) -> Array:
        """Corrections (n,) at commanded drive positions (n, d)."""
        parts = [curve.at(drives) for curve in self.curves]
        parts += [product.at(drives) for product in self.products]
        parts += [plane.at(drives) for plane in self.planes]
        return np.sum(parts, axis=0) if parts else np.zeros(len(drives))


def corrections_at(tables: Sequence[DriveTables], drives: Array) -> Array:
    """Corrections (n, d) of all drives, each by its own tables."""
    return np.stack([own.at(drives) for own in tables], axis=1)


def fit_curves(drives: Array, values: Array, by: Sequence[int], nodes: Sequence[Nodes]) -> DriveTables:
    """The best sum of tables over single drives for samples `values` (n,) at `drives` (n, d).

    nodes: of every drive of the machine; by: the drives over which there may be a table.
    """
    fitted = fit_nodes([nodes[j].weights(drives[:, j]) for j in by], [nodes[j].bends() for j in by], values)
    return DriveTables(curves=tuple(Curve(j, nodes[j], found) for j, found in zip(by, fitted, strict=True)))


def best_inputs(drives: Array, values: Array, nodes: Sequence[Nodes], count: int) -> tuple[int, ...]:
    """The drives over which `count` tables together explain most, found one after the other, in ascending order."""
    chosen: list[int] = []
    for _ in range(min(count, drives.shape[1])):
        left = {
            j: float(np.sum((values - fit_curves(drives, values, [*chosen, j], nodes).at(drives)) ** 2))
            for j in range(drives.shape[1])
            if j not in chosen
        }
        chosen.append(min(left, key=lambda j: left[j]))
    return tuple(sorted(chosen))


def fit_planes(
    drives: Array,
    values: Array,
    pairs: Sequence[tuple[int, int]],
    grids: Sequence[tuple[Nodes, Nodes]],
    by: Sequence[int] = (),
    nodes: Sequence[Nodes] = (),
) -> DriveTables:
    """The best sum of tables over pairs of drives, and over single ones if there are any in `by`."""
    weights = [plane_weights(*grid, drives[:, list(pair)]) for pair, grid in zip(pairs, grids, strict=True)]
    bends = [plane_bends(*grid) for grid in grids]
    weights += [nodes[j].weights(drives[:, j]) for j in by]
    bends += [nodes[j].bends() for j in by]
    found = fit_nodes(weights, bends, values)
    planes = [
        Plane(pair, grid, part.reshape(grid[0].count, grid[1].count))
        for pair, grid, part in zip(pairs, grids, found[: len(pairs)], strict=True)
    ]
    curves = [Curve(j, nodes[j], part) for j, part in zip(by, found[len(pairs) :], strict=True)]
    return DriveTables(curves=tuple(curves), planes=tuple(planes))


def fit_products(
    drives: Array, values: Array, nodes: Sequence[Nodes], count: int, by: Sequence[int] | None = None
) -> DriveTables:
    """The best sum of tables over every drive, or those in `by`, and of `count` products of two.

    Products are added one after the other and fitted together. One begins at pairs of polynomials that explain most of
    what is left; then first and second factors are fitted in turn, each time together with everything else that is
    linear. Of several beginnings the best is kept, since such a fit may end in a minimum of its own. Of two drives,
    whose samples lie close, samples with large residuals then get more weight, so that the largest falls.
    """
    tables = fit_curves(drives, values, range(drives.shape[1]) if by is None else by, nodes)
    samples = _Samples.of(drives, values, nodes)
    for _ in range(count):
        left = samples.left(tables)
        starts = [_seed_product(drives, left, nodes, rank) for rank in range(STARTS)]
        found = [_alternated(samples, replace(tables, products=(*tables.products, start))) for start in starts]
        more, remaining = min(found, key=lambda pair: pair[1])
        if not remaining < float(np.sum(left**2)):
            break
        tables = more
    if drives.shape[1] == 2:
        tables = _with_smaller_extremes(samples, tables)
    return replace(tables, products=tuple(_balanced(p) for p in tables.products))


@dataclass(frozen=True)
class _Samples:
    """What is fitted: values (n,), and by drive the weights (n, count) and bends of its nodes, which stay the same."""

    values: Array
    weights: tuple[csr_matrix, ...]
    bends: tuple[csr_matrix, ...]

    @classmethod
    def of(cls, drives: Array, values: Array, nodes: Sequence[Nodes]) -> _Samples:
        weights = tuple(n.weights(drives[:, j]) for j, n in enumerate(nodes))
        return cls(values, weights, tuple(n.bends() for n in nodes))

    def at(self, curve: Curve) -> Array:
        return np.asarray(self.weights[curve.by] @ curve.values)

    def left(self, tables: DriveTables) -> Array:
        """What curves and products leave of the values."""
        out = self.values.copy()
        for curve in tables.curves:
            out -= self.at(curve)
        for product in tables.products:
            out -= self.at(product.first) * self.at(product.second)
        return out


def _with_smaller_extremes(samples: _Samples, tables: DriveTables) -> DriveTables:
    """The tables that are nearest in the norm of order EXTREME_NORM, by reweighted least squares.

    Each step goes 1 / (order - 1) of the way to the reweighted solution, which is Newton's step of that norm. Returned
    are those of all steps with the smallest extreme.
    """
    best, left = tables, np.abs(samples.left(tables))
    smallest = float(np.max(left))
    for _ in range(REWEIGHTINGS):
        importance = (left / max(float(np.max(left)), 1e-300)) ** (EXTREME_NORM - 2.0) + 1e-6
        tables = _refit_in_turn(samples, tables, importance / np.mean(importance), 1.0 / (EXTREME_NORM - 1.0))
        left = np.abs(samples.left(tables))
        if float(np.max(left)) < smallest:
            best, smallest = tables, float(np.max(left))
    return best


def _refit_in_turn(
    samples: _Samples, tables: DriveTables, importance: Array | None = None, way: float = 1.0
) -> DriveTables:
    """First factors, then second ones, each time `way` of the way to the (weighted) least squares."""
    for first in (True, False):
        tables = _refit(samples, tables, importance, way, first=first)
    return tables


def _alternated(samples: _Samples, tables: DriveTables) -> tuple[DriveTables, float]:
    """Tables fitted in turn until that gains little, and the sum of squares that they leave."""
    remaining = float(np.sum(samples.left(tables) ** 2))
    for _ in range(ALTERNATIONS):
        before = remaining
        tables = _refit_in_turn(samples, tables)
        remaining = float(np.sum(samples.left(tables) ** 2))
        if remaining > (1.0 - LEAST_GAIN) * before:
            break
    return tables, remaining


def _seed_product(drives: Array, left: Array, nodes: Sequence[Nodes], rank: int) -> Product:
    """The product that explains most of what is left, or the next by rank, among polynomials over a pair of drives."""
    found_products: list[tuple[float, Product]] = []
    bases = [_polynomials(n, drives[:, j]) for j, n in enumerate(nodes)]
    for one, two in combinations(range(drives.shape[1]), 2):
        terms = (bases[one][:, :, None] * bases[two][:, None, :]).reshape(len(left), -1)
        ridge = SEED_RIDGE * np.sqrt(len(left)) * np.eye(SEED_DEGREE**2)
        wanted = np.concatenate([left, np.zeros(len(ridge))])
        found = np.linalg.lstsq(np.vstack([terms, ridge]), wanted, rcond=None)[0]
        u, s, vt = np.linalg.svd(found.reshape(SEED_DEGREE, SEED_DEGREE))
        product = Product(
            Curve(one, nodes[one], _polynomials(nodes[one], nodes[one].positions) @ u[:, rank] * s[rank]),
            Curve(two, nodes[two], _polynomials(nodes[two], nodes[two].positions) @ vt[rank]),
        )
        found_products.append((float(np.sum((left - product.at(drives)) ** 2)), product))
    return min(found_products, key=lambda pair: pair[0])[1]


def _polynomials(nodes: Nodes, at: Array) -> Array:
    """Legendre polynomials (n, SEED_DEGREE) of degrees from 1 over the nodes' range."""
    unit = 2.0 * (at - nodes.start) / (nodes.end - nodes.start) - 1.0
    return np.asarray(np.polynomial.legendre.legvander(unit, SEED_DEGREE)[:, 1:], dtype=np.float64)


def _refit(samples: _Samples, tables: DriveTables, importance: Array | None, way: float, *, first: bool) -> DriveTables:
    """All single tables and one factor of each product, the other factors held."""
    free = [p.first if first else p.second for p in tables.products]
    held = [samples.at(p.second if first else p.first) for p in tables.products]
    size = [max(float(np.sqrt(np.mean(h**2))), 1e-300) for h in held]
    together = (*tables.curves, *free)
    weights = [samples.weights[c.by] for c in tables.curves]
    weights += [scaled_rows(samples.weights[c.by], h / s) for c, h, s in zip(free, held, size, strict=True)]
    found = fit_nodes(weights, [samples.bends[c.by] for c in together], samples.values, importance)
    count = len(tables.curves)
    found = found[:count] + [v / s for v, s in zip(found[count:], size, strict=True)]
    new = [replace(c, values=c.values + way * (v - c.values)) for c, v in zip(together, found, strict=True)]
    products = [
        replace(p, first=c) if first else replace(p, second=c)
        for p, c in zip(tables.products, new[count:], strict=True)
    ]
    return DriveTables(curves=tuple(new[:count]), products=tuple(products))


def _balanced(product: Product) -> Product:
    """Both factors of the same size, so that rounding costs both the same."""
    one, two = (float(np.max(np.abs(c.values))) for c in (product.first, product.second))
    if not (one > 0.0 and two > 0.0):
        return product
    share = np.sqrt(two / one)
    return Product(
        replace(product.first, values=product.first.values * share),
        replace(product.second, values=product.second.values / share),
    )


@dataclass(frozen=True)
class Loss:
    """What tables leave of corrections, and how large those were: (d,) each, in m (rad for a crank)."""

    max_left: Array
    rms_left: Array
    max_before: Array
    rms_before: Array

    @classmethod
    def of(cls, tables: Sequence[DriveTables], drives: Array, correction: Array) -> Loss:
        """At samples (n, d) other than those that were fitted."""
        left = correction - corrections_at(tables, drives)
        return cls(
            np.max(np.abs(left), axis=0),
            np.sqrt(np.mean(left**2, axis=0)),
            np.max(np.abs(correction), axis=0),
            np.sqrt(np.mean(correction**2, axis=0)),
        )

    @property
    def remaining_share(self) -> float:
        """RMS over all drives of what is left, as a share of that of the corrections."""
        return float(np.sqrt(np.sum(self.rms_left**2) / max(float(np.sum(self.rms_before**2)), 1e-300)))
