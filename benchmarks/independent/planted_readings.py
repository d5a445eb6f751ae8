"""Plants wrong readings into copies of recordings: does a verdict that was sure hold?"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.withheld.gross_readings import moved_readings, with_gross_readings
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.recording import Recording

COUNT = 6
FAR_SHARE, FAR_SIGMAS = 0.05, (5.0, 12.0)  # of the readings; standard deviations by which they are off


def with_gross(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with COUNT gross readings."""
    return replace(recording, columns=with_gross_readings(recording.columns, COUNT, rng))


def with_far(recording: Recording, rng: np.random.Generator, sigmas: tuple[float, float] = FAR_SIGMAS) -> Recording:
    """The recording with a share of readings off by more than noise and less than gross, in any direction."""
    rows = rng.choice(len(recording), round(FAR_SHARE * len(recording)), replace=False)
    away = rng.standard_normal((len(rows), 3))
    away *= rng.uniform(*sigmas, (len(rows), 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    by_m = np.einsum("nij,nj->ni", np.linalg.cholesky(recording.covariances_m2[rows]), away)
    return replace(recording, columns=moved_readings(recording.columns, rows, by_m))


def _plant(made: Callable[[Recording, np.random.Generator], Recording], folder: Path) -> None:
    """Replace a recording folder by itself with wrong readings; the same ones each time, by its name."""
    recording = made(read_folder(folder), np.random.default_rng([COUNT, *folder.name.encode()]))
    shutil.rmtree(folder)
    write_folder(recording, folder)


PLANTED: dict[str, Callable[[Path], None]] = {"gross": partial(_plant, with_gross), "far": partial(_plant, with_far)}
"""What replaces a recording folder by itself with wrong readings, by their kind."""
