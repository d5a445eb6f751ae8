"""Rig files and stores to re-calibrate: the kept life of a mock machine, and a short campaign."""

from __future__ import annotations

import gzip
from contextlib import contextmanager
from pathlib import Path

from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.store.place import STORE_NAME
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import SHORT, SLIDERS, campaign_lines, mock_and_rig

KEPT = Path(__file__).parents[2] / "data" / "life" / "store.db.gz"
RIG, SEED, START_S = "embedded-mock", 4, 1e5
CALIBRATED_S = 1577880000.0  # soon after the kept machine was calibrated, Unix time: 2020-01-01 12:00 UTC
ALWAYS = 'windows = [{ begin = "00:00", end = "00:00" }]'


def write_rig(folder: Path, *recalibration: str, top: str = "", seed: int = SEED) -> Path:
    """A rig file in a folder: the embedded one with a short campaign and further lines in [recalibration]."""
    text = embedded_rig_path().read_text(encoding="utf-8").split("[recalibration]")[0].split("[mock]")[0]
    path = folder / "rig.toml"
    path.write_text(
        f"{text}\n{top}\n[campaign]\n{campaign_lines(SHORT | SLIDERS)}[recalibration]\ntolerance_m = 60e-6\n"
        + "\n".join(recalibration)
        + f"\n[mock]\nseed = {seed}\n",
        encoding="utf-8",
    )
    return path


def keep_store(folder: Path) -> Path:
    """The kept store in a folder; the folder."""
    (folder / STORE_NAME).write_bytes(gzip.decompress(KEPT.read_bytes()))
    return folder


@contextmanager
def connected(path: Path, start_s: float = START_S):
    """The mock of a rig file and the rig that is connected to it."""
    file, machine = load_rig(path)
    with mock_and_rig(file, machine, start_s=start_s) as (mock, rig):
        rig.path = path
        yield mock, rig


@contextmanager
def served(path: Path, start_s: float = START_S):
    """The mock of a rig file, and what connects a rig to it: again and again, as commands do."""
    file, machine = load_rig(path)
    with embedded_mock_rig(file, path, start_s=start_s) as mock, mock.clock.activity():

        @contextmanager
        def connect():
            with connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as rig:
                rig.path = path
                yield rig

        yield mock.mock, connect
