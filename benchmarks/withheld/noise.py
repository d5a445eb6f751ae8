"""Replaces what was measured in a recording by noise: what a diagnosis still finds then, it has not from readings.

Positions become those of the identified model with noise as stated, torques are dealt out anew among the readings.
Design, times, temperatures and everything else stay as they are.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld.baselines import residuals_after_identification
from calibration.instruments.station_geometry import whitening
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.recording import Recording

Array = NDArray[np.float64]


def replace_all(recordings: Path, seed: int) -> int:
    """Replace every recording of a folder; how many."""
    folders = sorted(file.parent for file in recordings.glob("*/recording.toml"))
    for number, folder in enumerate(folders):
        noisy = noise_only(read_folder(folder), np.random.default_rng([seed, number]))
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
        write_folder(noisy, folder)
    return len(folders)


def noise_only(recording: Recording, rng: np.random.Generator) -> Recording:
    """The same campaign on a machine that is exactly as identified."""
    spread = np.linalg.inv(whitening(recording.covariances_m2, recording.positions_m))
    position = recording.positions_m.copy()
    on_pose = np.asarray(recording["phase"]) != "nests"
    # Residuals are whitened differences, model minus measured.
    position[on_pose] += np.einsum("nij,nj->ni", spread[on_pose], residuals_after_identification(recording))
    for name in sorted(set(recording["smr"][~on_pose].tolist())):
        rows = np.flatnonzero(~on_pose & (np.asarray(recording["smr"]) == name))
        position[rows] = position[rows].mean(axis=0)
    position += np.einsum("nij,nj->ni", spread, rng.standard_normal(position.shape))
    distance = np.linalg.norm(position, axis=1)
    columns = dict(recording.columns) | {
        "x_m": position[:, 0], "y_m": position[:, 1], "z_m": position[:, 2],
        "hz_rad": np.arctan2(position[:, 0], position[:, 1]) % (2.0 * np.pi),
        "v_rad": np.arccos(position[:, 2] / distance), "slope_distance_m": distance,
    }  # fmt: skip
    order = rng.permutation(len(recording))
    for drive in recording.file.drives:
        columns[f"{drive}_torque_ratio"] = recording[f"{drive}_torque_ratio"][order]
    return replace(recording, columns=columns)
