"""The host dies at seeded store commits and CAN writes of the short campaign, three times in each phase.

In one process, so that it takes seconds: the host that has died reaches neither its bus nor its store any more, while
the mock rig goes on in virtual time. `make kill-sweep` kills real processes.
"""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field

import can
import pytest
from sqlalchemy.engine.default import DefaultDialect

from benchmarks.kill_sweep.host import is_table_word
from tests.faults.short_campaign import EXPECTED, bench, recorded, rows_by_key, run, still

SEED = 12
PATIENT_S = 10.0
WINDOWS = ("measuring", "tables", "recovery")
RECOVERY_OPERATIONS = {"commit": 4, "can": 120}


@dataclass
class Host:
    """Counts what a host does, and whether it lives; `kill` is a window, a kind and a number, odd ones before it."""

    kill: tuple[str, str, int] | None = None
    counts: dict[tuple[str, str], int] = field(default_factory=dict)
    alive: bool = True
    tables: bool = False

    def does(self, kind: str, work: Callable[[], None], dead: Exception) -> None:
        """One operation; raises `dead` where the host is, or has just died."""
        if not self.alive:
            raise dead
        due = False
        for window in ("recovery", "tables" if self.tables else "measuring"):
            self.counts[window, kind] = self.counts.get((window, kind), 0) + 1
            due = due or (window, kind, self.counts[window, kind]) == self.kill
        if due and self.kill is not None and self.kill[2] % 2:
            self.alive = False
            raise dead
        work()
        if due:
            self.alive = False
            raise dead


class DyingBus(can.BusABC):
    """The bus of a host: nothing passes once the host is dead."""

    def __init__(self, bus: can.BusABC, host: Host) -> None:
        self._bus, self._host = bus, host
        super().__init__(channel=str(bus.channel_info))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._host.tables = self._host.tables or is_table_word(msg.arbitration_id, bytes(msg.data))
        try:
            self._host.does("can", lambda: self._bus.send(msg, timeout), can.CanOperationError("dead"))
        finally:
            self._leave_if_dead()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._leave_if_dead()
        if not self._host.alive:
            raise can.CanOperationError("dead")
        return self._bus.recv(timeout), False

    def shutdown(self) -> None:
        super().shutdown()
        self._bus.shutdown()

    def _leave_if_dead(self) -> None:
        if not self._host.alive:
            self._bus.shutdown()  # frames for a dead host must not wait to be fetched


@contextmanager
def rig_and_hosts():
    """A mock rig in virtual time with an empty store, and how to run a host on it."""
    commit, hosts = DefaultDialect.do_commit, [Host()]

    def do_commit(self, connection):
        hosts[-1].does("commit", lambda: commit(self, connection), sqlite3.OperationalError("dead"))

    with pytest.MonkeyPatch.context() as patch, bench(None) as made:
        patch.setattr(DefaultDialect, "do_commit", do_commit)
        bus_factory = made.mock.bus_factory

        def live(kill=None):
            """Run a host, which may die on the way; what it did."""
            host = Host(kill)
            hosts.append(host)
            made.mock.bus_factory = lambda: DyingBus(bus_factory(), host)
            try:
                run(made, PATIENT_S)
            except EXPECTED:
                if host.alive:
                    raise
            hosts.append(Host())  # whoever looks afterwards
            made.mock.clock.sleep_s(10.0)
            return host

        yield made, live


@pytest.fixture(scope="module")
def untouched():
    """How often an untouched host does what, and what it has stored."""
    with rig_and_hosts() as (made, live):
        counts = live().counts
        return counts, planned(rows_by_key(recorded(made)))


def planned(rows):
    """How often each planned reading is there; nests are checked as often as it helps."""
    return {key: len(found) for key, found in rows.items() if key[0] == "calibration"}


def drawn(counts, window, number):
    """A kill in a window, from a seed."""
    rng = random.Random(f"{SEED} {window} {number}")
    kind = "can" if window == "tables" else ("commit", "can", "can")[number]
    most = RECOVERY_OPERATIONS[kind] if window == "recovery" else counts[window, kind]
    return window, kind, rng.randint(1, most)


def stored(made):
    recording = recorded(made)
    if recording is None:
        return {}
    names = list(recording.columns)
    return {str(recording["uid"][row]): str([recording[n][row] for n in names]) for row in range(len(recording))}


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("window", WINDOWS)
def test_nothing_is_lost_changed_or_measured_twice_where_a_host_died(untouched, window, number):
    counts, keys = untouched
    with rig_and_hosts() as (rig, live):
        _check(rig, live, counts, keys, (window, number))


def _check(rig, live, counts, keys, which):
    window, number = which
    if window == "recovery":  # it had died while tables were written, and now dies again
        assert not live(drawn(counts, "tables", number)).alive
    host = live(drawn(counts, window, number))
    assert not host.alive, "nothing struck"
    assert still(rig)
    before = stored(rig)
    assert live().alive
    after = stored(rig)
    assert {uid: after.get(uid) for uid in before} == before
    rows = rows_by_key(recorded(rig))
    assert planned(rows) == keys
    drives = [drive.compensation for drive in rig.mock.mock.drives]
    assert drives[0].mode == drives[1].mode != 0
    assert drives[0].table.generation == drives[1].table.generation
