"""Quiet machines: what is counted, and that a stopped run goes on."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import quiet_machines
from benchmarks.quiet_machines import FOLDERS, conditions, main, row
from calibration.machine.description import shipped_machines
from tests.calibration.diagnosis.campaigns import simulated


def quiet(seed):
    return simulated("planar4", 25, seed=seed % 1000)


def with_backlash(seed):
    return simulated("planar4", 25, lambda a: 8e-5 * np.array([1.0, 0.0]) * a.sides, seed=seed % 1000)


@pytest.fixture
def made(monkeypatch):
    """Of two conditions of one machine each, the seeds of which recordings are made."""
    seeds = []

    def counted(make):
        def one(seed):
            seeds.append(seed)
            return make(seed)

        return one

    monkeypatch.setattr(quiet_machines, "KINDS", 3)
    monkeypatch.setattr(
        quiet_machines, "conditions", lambda: {"nothing": [counted(quiet)], "backlash": [counted(with_backlash)]}
    )
    return seeds


def test_every_shipped_machine_states_too_little():
    assert {len(makers) for makers in conditions().values()} == {1, len(shipped_machines()), len(FOLDERS)}


def test_a_stopped_run_goes_on_and_counts_what_was_called_an_effect(tmp_path, capsys, made, monkeypatch):
    arguments = ["--n", "1", "--out", str(tmp_path)]
    diagnose = quiet_machines.diagnose

    def stopped(recording):
        if len(made) > 4:
            raise KeyboardInterrupt
        return diagnose(recording)

    monkeypatch.setattr(quiet_machines, "diagnose", stopped)
    with pytest.raises(KeyboardInterrupt):
        main(arguments)
    first = capsys.readouterr().out.splitlines()
    assert first[1:] == [row("nothing", ["none"] * 3)]
    monkeypatch.setattr(quiet_machines, "diagnose", diagnose)
    assert main(arguments) == 1
    assert len(made) == len(set(made)) + 1  # the one at which it was stopped is made once more
    table = capsys.readouterr().out.splitlines()
    assert table[:2] == first
    name, n, called, unknown = table[2].rsplit(maxsplit=3)
    assert (name, n) == ("backlash", "3")
    assert int(called) >= 2
    assert int(called) + int(unknown) == 3


def test_bad_numbers_are_one_line(capsys):
    for bad in (["--n", "0"], ["--seed", "-1"]):
        with pytest.raises(SystemExit):
            main(bad)
        assert "give" in capsys.readouterr().err.splitlines()[-1]
