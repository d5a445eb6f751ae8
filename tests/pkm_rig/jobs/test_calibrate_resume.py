"""`calibrate --resume` goes on wherever its campaign ended, on the same machine, whether it was stopped or killed."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import pytest
import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.reduction.nest_checks import usable_readings
from pkm_rig.cli import main
from pkm_rig.jobs import acceptance
from pkm_rig.jobs import calibrate as calibrate_job
from pkm_rig.jobs.acceptance import last_verification_attempt
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.session import pin_to_one_core
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.table_recovery import unfinished_change
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.schema import events
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import Stopped, short_rig_file, silent
from tests.pkm_rig.tables_bench import Killed, TablesBench

POSES, VERIFICATION_POSES = 6, 12
STOPS = (  # where it ends, whether by a kill, and what `pkm-rig list` says then
    ("calibration", False, "interrupted measuring"),
    ("identifying", True, "interrupted measuring"),
    ("identified", True, "interrupted identifying"),
    ("diagnosed", True, "interrupted identifying"),
    ("verification_before", True, "interrupted verifying"),
    ("on trial", True, "interrupted verifying"),
    ("verification_after", True, "interrupted verifying"),
    ("accepted", True, "accepted"),
)
AFTER = {"identified": "identified", "diagnosed": "diagnosed", "on trial": "activated", "accepted": "accepted"}
OFF, KEPT, ON_TRIAL = 0, 1, 2  # modes of compensation


def count_of_events(store):
    """How many events of each kind are stored."""
    with store.reading() as connection:
        return Counter(connection.execute(sa.select(events.c.kind)).scalars())


@dataclass
class Strike:
    """Ends a host where it has come to `where`: by a kill, or by an interrupt."""

    where: str
    kills: bool
    life: object
    left: int = 11
    said: list[str] = field(default_factory=list)

    def progress(self, _advance, _total, what):
        self.left -= what == self.where
        if self.left == 0:
            self.strike()

    def notify(self, line):
        self.said.append(line)
        if self.where == line:
            self.strike()

    def watch(self, store):
        """Strike after a transaction that has stored an event, as soon as it is in the store."""
        writing, after, before = store.writing, AFTER.get(self.where), count_of_events(store)

        @contextmanager
        def then_strike():
            with writing() as connection:
                yield connection
            if count_of_events(store)[after] > before[after]:
                self.strike()

        if after:
            store.writing = then_strike

    def strike(self):
        self.life.dead = self.kills
        raise Killed if self.kills else Stopped


def go_on(bench, where=None, *, kills=False, campaign=None):
    """A new host that calibrates or goes on, up to a strike; its outcome, and what it said."""
    outcome = None
    with bench.host() as (rig, store, life):
        struck = Strike(where, kills, life)
        struck.watch(store)
        try:
            outcome = calibrate(rig, store, struck.notify, struck.progress, campaign)
        except Stopped:
            assert not kills
    assert (outcome is None) == (where is not None)
    return outcome, struck.said


@pytest.fixture
def bench(tmp_path):
    """A mock rig, and a folder for the store of the hosts that come and go. Without diagnosis: it costs most time."""
    file, _ = short_rig_file(
        seed=4, calibration_poses=POSES, verification_poses=VERIFICATION_POSES, verification_payloads=(0,)
    )
    with (
        pytest.MonkeyPatch.context() as patch,
        pin_to_one_core(),
        embedded_mock_rig(file, embedded_rig_path()) as mock,
        mock.clock.activity(),
    ):
        for module in (calibrate_job, acceptance):
            patch.setattr(module, "try_diagnosis", lambda _recording: DiagnosisAttempt(None, "left out here"))
        bench = TablesBench(mock, tmp_path)
        bench.path = tmp_path / STORE_NAME
        yield bench


@pytest.fixture
def command(monkeypatch, capsys):
    """One command in this process: what it prints; it must end well."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["pkm-rig", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
        return capsys.readouterr().out

    return run


def test_a_calibration_goes_on_wherever_it_ended(bench, command, tmp_path):
    campaign, modes = None, []
    for where, kills, listed in STOPS:
        go_on(bench, where, kills=kills, campaign=campaign)
        modes.append(bench.modes())
        line = command("list", "--out", tmp_path)
        assert f"  {listed}  SIMULATED" in line
        campaign = line.split()[0]
    assert modes == [[OFF] * 2] * 5 + [[ON_TRIAL] * 2] * 3
    outcome, said = go_on(bench, campaign=campaign)
    assert "finished: its tables were accepted" in said[0]
    assert outcome.accepted
    assert outcome.verified[0].after.n == VERIFICATION_POSES
    assert bench.modes() == [KEPT, KEPT]
    (generation,) = {table["generation"] for table in outcome.written[0].drives.values()}
    assert bench.used() == [generation, generation]
    with bench.host() as (rig, store, _):
        assert unfinished_change(rig, store) is None
        require_each_planned_reading_once(store, campaign)
        with pytest.raises(InputError, match="was verified already: accepted"):
            calibrate(rig, store, silent, silent, campaign)
    assert "  accepted  SIMULATED" in command("list", "--out", tmp_path)
    assert f"{campaign}  whole  " in command("audit", "--out", tmp_path)


def require_each_planned_reading_once(store, campaign):
    recording = last_verification_attempt(store, campaign)
    usable = recording.take(usable_readings(recording))
    names = ("phase", "pose", "pass", "smr")
    times = Counter(zip(*(usable[name].tolist() for name in names), strict=True))
    phases = Counter(phase for phase, *_ in times)
    assert phases["calibration"] == 4 * POSES * 5
    assert phases["verification_before"] == phases["verification_after"] == VERIFICATION_POSES * 3
    assert {times[key] for key in times if key[0] not in ("nests", "repeatability")} == {1}
    assert np.all(np.diff(store.recording(campaign)["t_rig_s"]) > 0.0)
