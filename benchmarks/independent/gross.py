"""Plants gross readings into copies of recordings: does a verdict that was sure hold?"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.withheld.gross_readings import with_gross_readings
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.recording import Recording

COUNT = 6


def plant_in(folder: Path) -> None:
    """Replace a recording folder by itself with gross readings; the same ones each time, by its name."""
    recording = with_gross(read_folder(folder), np.random.default_rng([COUNT, *folder.name.encode()]))
    shutil.rmtree(folder)
    write_folder(recording, folder)


def with_gross(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with COUNT gross readings."""
    return replace(recording, columns=with_gross_readings(recording.columns, COUNT, rng))
