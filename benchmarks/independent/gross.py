"""Plants gross readings into copies of recordings: does a verdict that was sure hold?"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.recording.folder import read_folder, write_folder
from calibration.recording.recording import Recording

COUNT = 6
SMALLEST_M, LARGEST_M = 1.0e-4, 1.0e-2


def plant_in(folder: Path) -> None:
    """Replace a recording folder by itself with gross readings; the same ones each time, by its name."""
    recording = with_gross(read_folder(folder), np.random.default_rng([COUNT, *folder.name.encode()]))
    shutil.rmtree(folder)
    write_folder(recording, folder)


def with_gross(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with COUNT readings of any reflector off in any direction, sizes spread evenly in the logarithm."""
    rows = rng.choice(len(recording), COUNT, replace=False)
    direction = rng.standard_normal((COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    position = recording.positions_m.copy()
    position[rows] += np.exp(rng.uniform(np.log(SMALLEST_M), np.log(LARGEST_M), (COUNT, 1))) * direction
    distance = np.linalg.norm(position, axis=1)
    now = {
        "x_m": position[:, 0], "y_m": position[:, 1], "z_m": position[:, 2],
        "hz_rad": np.arctan2(position[:, 0], position[:, 1]) % (2.0 * np.pi),
        "v_rad": np.arccos(position[:, 2] / distance),
        "slope_distance_m": distance,
    }  # fmt: skip
    columns = dict(recording.columns)
    for name, values in now.items():
        columns[name] = columns[name].copy()
        columns[name][rows] = values[rows]
    return replace(recording, columns=columns)
