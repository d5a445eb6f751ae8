"""One embedded mock rig through the main job, and its plant afterwards, which knows where everything truly was."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mock_devices.rig import MockRig
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.config import load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.store.store import open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig


@dataclass(frozen=True)
class CalibratedMock:
    """The outcome, the plant's rig, and what it took: polls of the interlocks, seconds of the rig and of the host."""

    outcome: CampaignOutcome
    mock: MockRig
    polls: int
    rig_time_s: float
    host_s: float


@contextmanager
def calibrated_mock(path: Path, seed: int, folder: Path) -> Iterator[CalibratedMock]:
    """A rig file's machine of a seed, calibrated; its plant can be asked inside."""
    file, machine = load_rig(path)
    assert file.mock is not None
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": seed})})
    started = time.monotonic()
    with (
        open_store(folder) as store,
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as rig,
    ):
        outcome = calibrate(rig, store, lambda _line: None, lambda _n, _total, _what: None)
        took_s = time.monotonic() - started
        yield CalibratedMock(outcome, mock.mock, rig.supervisor.polls, mock.clock.now_s(), took_s)
