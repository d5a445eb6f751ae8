"""Piecewise linear functions of drive positions, as controls interpolate tables, and their least-squares fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import block_diag, csr_matrix, hstack, identity, kron, vstack
from scipy.sparse.linalg import spsolve

from calibration.base.arrays import Array
from calibration.base.errors import InputError

# Bends are penalised by so little that the samples decide wherever there are any, and a straight line where there are
# none.
SMOOTHNESS = 1e-7
RIDGE = 1e-10  # decides which of two tables holds a constant that both could
MOST_DENSE = 700  # unknowns up to which a dense factorisation is faster


@dataclass(frozen=True)
class Nodes:
    """Equidistant nodes of one drive: `start` and `step` in m (rad for a crank), `count` of them."""

    start: float
    step: float
    count: int

    def __post_init__(self) -> None:
        if self.count < 2 or not self.step > 0.0:
            raise InputError(
                f"table: {self.count} nodes {self.step:g} apart; there must be two or more, some way apart"
            )

    @classmethod
    def over(cls, values: Array, count: int, resolution: float = 0.0) -> Nodes:
        """Nodes that cover values (n,); start and step are multiples of `resolution` where one is given."""
        low, high = float(np.min(values)), float(np.max(values))
        if not high > low:
            raise InputError(
                "table: a drive does not move over the measured workspace; nothing can be tabulated over it"
            )
        if not resolution:
            return cls(low, (high - low) / (count - 1), count)
        start = float(np.floor(low / resolution))
        step = float(np.ceil((high / resolution - start) / (count - 1)))
        return cls(start * resolution, step * resolution, count)

    @property
    def positions(self) -> Array:
        """Positions (count,) of the nodes."""
        return np.asarray(self.start + self.step * np.arange(self.count), dtype=np.float64)

    @property
    def end(self) -> float:
        """Position of the last node."""
        return self.start + self.step * (self.count - 1)

    def cells(self, at: Array) -> tuple[NDArray[np.intp], Array]:
        """Left node (n,) of the cell of positions (n,), and how far into it they lie (0 to 1); ends are held."""
        x = np.clip((at - self.start) / self.step, 0.0, self.count - 1.0)
        left = np.minimum(x.astype(np.intp), self.count - 2)
        return left, np.asarray(x - left, dtype=np.float64)

    def weights(self, at: Array) -> csr_matrix:
        """Weights (n, count) of the nodes in linear interpolation at positions (n,)."""
        left, share = self.cells(at)
        rows = np.arange(len(at), dtype=np.intp)
        return _sparse(rows, [left, left + 1], [1.0 - share, share], self.count)

    def bends(self) -> csr_matrix:
        """Second differences (count - 2, count)."""
        rows = np.arange(self.count - 2, dtype=np.intp)
        one = np.ones(len(rows))
        return _sparse(rows, [rows, rows + 1, rows + 2], [one, -2.0 * one, one], self.count)


def _sparse(
    rows: NDArray[np.intp], columns: Sequence[NDArray[np.intp]], values: Sequence[Array], width: int
) -> csr_matrix:
    places = (np.tile(rows, len(columns)), np.concatenate(columns))
    return csr_matrix((np.concatenate(values), places), shape=(len(rows), width))


def plane_weights(first: Nodes, second: Nodes, at: Array) -> csr_matrix:
    """Weights (n, c1 * c2) of a grid's nodes, the second axis fastest, in bilinear interpolation at (n, 2)."""
    (i, a), (j, b) = first.cells(at[:, 0]), second.cells(at[:, 1])
    corner = i * second.count + j
    columns = [corner, corner + 1, corner + second.count, corner + second.count + 1]
    values = [(1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b]
    return _sparse(np.arange(len(at), dtype=np.intp), columns, values, first.count * second.count)


def plane_bends(first: Nodes, second: Nodes) -> csr_matrix:
    """Second differences of a grid along both of its axes."""
    return vstack(
        [kron(first.bends(), identity(second.count)), kron(identity(first.count), second.bends())], format="csr"
    )


def fit_nodes(
    weights: Sequence[csr_matrix], bends: Sequence[csr_matrix], values: Array, importance: Array | None = None
) -> list[Array]:
    """Node values of functions whose sum is nearest to `values` (n,), in least squares; one array a function.

    importance: weights (n,) of the squares, of mean 1.
    """
    matrix = hstack(weights, format="csr")
    if importance is not None:
        root = np.sqrt(importance)
        matrix, values = scaled_rows(matrix, root), values * root
    scale = max(float(np.sqrt(np.mean(values**2))), 1e-300)
    # A diagonal of the normal matrix is about the number of samples a node has: penalties keep their share of it.
    size = matrix.shape[1]
    per_node = float(matrix.data @ matrix.data) / size
    bend = block_diag(bends, format="csr")
    normal = matrix.T @ matrix + per_node * SMOOTHNESS * (bend.T @ bend) + per_node * RIDGE * identity(size)
    wanted = matrix.T @ (values / scale)
    if size <= MOST_DENSE:
        solution = cho_solve(cho_factor(normal.toarray(), overwrite_a=True, check_finite=False), wanted)
    else:
        solution = spsolve(normal.tocsc(), wanted)
    ends = np.cumsum([w.shape[1] for w in weights])[:-1]
    return np.split(np.asarray(solution * scale, dtype=np.float64), ends)


def scaled_rows(matrix: csr_matrix, by: Array) -> csr_matrix:
    """A sparse matrix with its rows multiplied by factors (n,)."""
    data = matrix.data * np.repeat(by, np.diff(matrix.indptr))
    return csr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)
