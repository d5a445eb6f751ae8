"""Evidence of a basis set: marginal likelihood over its size, its coefficients and all unknowns of the calibration.

With C the covariance of the readings under the model with its priors and the declared disturbances, columns H with
coefficients of standard deviations a d change the log evidence by
1/2 g' D (1/a^2 + D F D)^-1 D g - 1/2 log|1 + a^2 D F D|,  F = H' C^-1 H,  g = H' C^-1 y,  D = diag(d):
Gaussian marginal likelihood (MacKay 2003, ch. 28). The size a has a prior that is uniform in its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack
from scipy.special import log_ndtr

from calibration.base.arrays import Array
from calibration.effects.api import BasisSet

SIZES = 9
SIZE_STEPS = np.linspace(0.0, 1.0, SIZES)  # logarithms of the sizes tried, over the plausible range
LOG_2 = float(np.log(2.0))
LEAST_PIVOT = 1e-6  # of 1 and what is not negative but for rounding


@dataclass(frozen=True)
class InformationAndScore:
    """Information F (k, k) and score g (k,) of columns (k), the unknowns of the calibration projected out."""

    information: Array
    score: Array


@dataclass(frozen=True)
class BasisSetEvidence:
    """A basis set with its log evidence over `none`, most likely size, coefficients (k,) and covariance (k, k)."""

    basis_set: BasisSet
    log_evidence: float
    size: float
    coefficients: Array
    covariance: Array


def log_sum(logs: Array, axis: int = 0) -> Array:
    """Logarithm of a sum of exponentials."""
    top = logs.max(axis=axis, keepdims=True)
    return np.asarray(np.log(np.sum(np.exp(logs - top), axis=axis)) + np.squeeze(top, axis=axis))


def evidence_of_basis_sets(
    columns: InformationAndScore, basis_sets: Sequence[BasisSet], low: float, high: float
) -> list[BasisSetEvidence]:
    """Evidence of basis sets for sizes between two limits, from the information and score of all their columns."""
    out: list[BasisSetEvidence | None] = [None] * len(basis_sets)
    by_length: dict[int, list[int]] = {}
    for number, basis_set in enumerate(basis_sets):
        by_length.setdefault(len(basis_set.columns), []).append(number)
    for members in by_length.values():
        pick = np.array([basis_sets[i].columns for i in members])
        information = columns.information[pick[:, :, None], pick[:, None, :]]
        alike = [basis_sets[i] for i in members]
        for number, entry in zip(members, _evidence(information, columns.score[pick], alike, low, high), strict=True):
            out[number] = entry
    return [entry for entry in out if entry is not None]


def evidence_of_families(
    families: Sequence[InformationAndScore], basis_sets: Sequence[BasisSet], low: float, high: float
) -> list[BasisSetEvidence]:
    """Evidence of basis sets of equally many columns, each of all columns of a family of its own."""
    information = np.array([family.information for family in families])
    return _evidence(information, np.array([family.score for family in families]), basis_sets, low, high)


def _evidence(
    information: Array, score: Array, basis_sets: Sequence[BasisSet], low: float, high: float
) -> list[BasisSetEvidence]:
    """The same from the information (m, k, k) and score (m, k) of the columns of each."""
    sizes = low * (high / low) ** SIZE_STEPS
    relative = np.array([basis_set.relative for basis_set in basis_sets])
    f = information * relative[:, :, None] * relative[:, None, :]
    values, vectors = np.linalg.eigh(0.5 * (f + f.transpose(0, 2, 1)))
    values = np.maximum(values, 0.0)
    along = np.einsum("mkj,mk->mj", vectors, score * relative)
    square = sizes[None, :, None] ** 2
    grown = 1.0 + square * values[:, None, :]
    logs = np.sum(0.5 * square * along[:, None, :] ** 2 / grown - 0.5 * np.log(grown), axis=2)
    evidence = log_sum(logs, axis=1) - np.log(len(sizes))
    best = sizes[np.argmax(logs, axis=1)]
    shrunk = best[:, None] ** 2 / (1.0 + best[:, None] ** 2 * values)
    scaled = vectors * relative[:, :, None]
    coefficients = np.einsum("mkj,mj->mk", scaled, shrunk * along)
    covariances = (scaled * shrunk[:, None, :]) @ scaled.transpose(0, 2, 1)
    for row, basis_set in enumerate(basis_sets):
        if basis_set.sign:
            evidence[row] += _log_share_of_sign(basis_set.sign * coefficients[row, 0], covariances[row, 0, 0])
    entries = zip(basis_sets, evidence.tolist(), best.tolist(), coefficients, covariances, strict=True)
    return [BasisSetEvidence(*entry) for entry in entries]


def _log_share_of_sign(mean: float, variance: float) -> float:
    """What it changes in the log evidence that a coefficient is positive: its posterior probability over the prior's.

    The prior is then half a normal distribution (Gelman et al., Bayesian Data Analysis, CRC 2013, ch. 2).
    """
    return float(log_ndtr(mean / np.sqrt(max(variance, 1e-300)))) + LOG_2


def log_evidence_of_sizes(columns: InformationAndScore, sizes: Array) -> Array:
    """Log evidence (a,) of all columns together, their coefficients having each standard deviation (a,).

    By a tridiagonal matrix that has the eigenvalues of the information and the score along its first axis: a third of
    the time of eigenvectors. Householder's reflections leave the first row of a matrix alone: there the score is put. A
    column of zeros more changes nothing; the interface to LAPACK takes no matrix of one element.
    """
    k = len(columns.score) + 1
    bordered = np.zeros((k + 1, k + 1))
    bordered[1:-1, 0], bordered[1:-1, 1:-1] = columns.score, 0.5 * (columns.information + columns.information.T)
    work = int(lapack.dsytrd_lwork(k + 1, lower=1)[0])
    _, diagonal, beside, _, _ = lapack.dsytrd(bordered, lower=1, lwork=work, overwrite_a=1)
    first, square_of_score = np.eye(k, 1), beside[0] ** 2
    logs = []
    for square in sizes**2:
        # Rounding may leave an eigenvalue a little below zero.
        pivots, ratios, _ = lapack.dpttrf(1.0 + square * diagonal[1:], square * beside[1:])
        pivots = np.maximum(pivots, LEAST_PIVOT)
        solved, _ = lapack.dpttrs(pivots, ratios, first)
        logs.append(0.5 * square * square_of_score * solved[0, 0] - 0.5 * np.sum(np.log(pivots)))
    return np.array(logs)
