"""Wrong readings that are planted into recordings: how many, how far off, and the same ones each time."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from benchmarks.independent.planted_readings import PLANTED, with_far
from calibration.recording.folder import read_folder

ROOT = Path(__file__).parents[2]


def test_six_gross_readings_are_planted_the_same_each_time(tmp_path):
    for name in ("a", "b"):
        shutil.copytree(ROOT / "tests/data/version_0_1/recording", tmp_path / name / "rec002")
        PLANTED["gross"](tmp_path / name / "rec002")
    before = read_folder(ROOT / "tests/data/version_0_1/recording")
    after, again = (read_folder(tmp_path / name / "rec002") for name in ("a", "b"))
    off = np.linalg.norm(after.positions_m - before.positions_m, axis=1)
    assert np.sum(off > 0.0) == 6
    assert np.all((off[off > 0.0] > 0.99e-4) & (off[off > 0.0] < 1.01e-2))
    np.testing.assert_array_equal(after.positions_m, again.positions_m)
    np.testing.assert_allclose(after["slope_distance_m"], np.linalg.norm(after.positions_m, axis=1), atol=1e-4)
    assert np.sum(after["hz_rad"] != before["hz_rad"]) <= 6


def test_one_reading_in_twenty_is_planted_far_off():
    before = read_folder(ROOT / "tests/data/version_0_1/recording")
    after = with_far(before, np.random.default_rng(4))
    by_m = after.positions_m - before.positions_m
    rows = np.flatnonzero(np.any(by_m != 0.0, axis=1))
    assert len(rows) == round(0.05 * len(before))
    by_sigmas = np.linalg.solve(np.linalg.cholesky(before.covariances_m2[rows]), by_m[rows][:, :, None])
    sigmas = np.linalg.norm(by_sigmas, axis=(1, 2))
    assert 4.9 < np.min(sigmas) < 7.0
    assert 10.0 < np.max(sigmas) < 12.1
