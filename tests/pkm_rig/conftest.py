from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from contextlib import contextmanager
from typing import NamedTuple

import pytest

from pkm_rig.cli import main
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.virtual.mock_rig import embedded_mock_rig

SHORT = {
    "calibration_poses": 12,
    "repeatability_visits": 3,
    "verification_poses": 30,
    "readings_per_nest": 1,
    "warm_up_rate_k_per_h": 20.0,
    "nest_every_visits": 8,
    # Drives and interlocks are polled through all rig time, which costs more than all else: little of it passes.
    "speeds_m_per_s": (1.0, 0.5),
    "dwells_s": (0.5, 1.0),
}
FEWER = {"verification_poses": 15}  # than a rig file may have; each is measured four times
SLIDERS = {"acceleration_m_per_s2": 8.0}  # the same; more than cranks can have


def campaign_lines(settings: Mapping[str, object]) -> str:
    """Settings as lines of a rig file's campaign section."""
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())


class Done(NamedTuple):
    """A command that has ended: its status and what it printed."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def run(monkeypatch, capsys):
    """One command, in this process."""

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["pkm-rig", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return Done(int(ended.value.code or 0), printed.out, printed.err)

    return command


class Stopped(BaseException):
    """As an operator's interrupt ends a command: what it does on leaving still reaches drives and store."""


def silent(*_):
    """Says nothing, for `notify` and `progress`."""


def stop_after(readings):
    """A `progress` that stops the command after so many readings of the calibration."""
    left = iter(range(readings))

    def progress(_advance, _total, what):
        if what == "calibration" and next(left, None) is None:
            raise Stopped

    return progress


def short_rig_file(seed: int = 5, **changes: object):
    """The embedded rig with a short campaign; `changes` go into its campaign section."""
    file, machine = load_rig(embedded_rig_path())
    campaign = file.campaign.model_copy(update={**SHORT, **FEWER, **SLIDERS, **changes})
    mock = file.mock.model_copy(update={"seed": seed})
    return file.model_copy(update={"campaign": campaign, "mock": mock}), machine


@contextmanager
def mock_and_rig(file, machine, start_s=0.0):
    """A started embedded mock rig and the connected rig on it."""
    with (
        embedded_mock_rig(file, embedded_rig_path(), start_s=start_s) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
    ):
        yield mock.mock, rig


@pytest.fixture
def short_rig():
    file, machine = short_rig_file()
    with mock_and_rig(file, machine) as both:
        yield both
