"""Columns with leading zeros, against the same products of full matrices."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.diagnosis.staggered_columns import StaggeredColumns


def test_products_are_those_of_full_matrices():
    rng = np.random.default_rng(7)
    columns = rng.standard_normal((40, 3, 50))
    for reading, zeros in enumerate(rng.integers(0, 50, 40)):
        columns[reading, :, :zeros] = 0.0
    columns[5] = 0.0
    flat = columns.reshape(120, 50).copy()
    staggered = StaggeredColumns(columns)
    assert staggered.gram == pytest.approx(flat.T @ flat, abs=1e-12)
    lower = np.linalg.cholesky(np.eye(50) + flat.T @ flat)
    assert staggered.divide(lower).reshape(120, 50) == pytest.approx(flat @ np.linalg.inv(lower).T, abs=1e-12)
