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
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.plans import visits
from pkm_rig.rig.runner import describe_campaign, open_runner
from pkm_rig.rig.schedule import Block, calibration_blocks
from pkm_rig.rig.table_change import VERDICT, changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.audit import audit
from pkm_rig.store.store import now_text
from tests.faults.short_campaign import CAMPAIGN, EXPECTED, bench, flat_table, recorded, rows_by_key, still

SEED = 12
PATIENT_S = 10.0
KEPT = 1  # mode of compensation: off, kept, on trial
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


def calibrate(made):
    """What a command does: end what was left unfinished, measure what is missing, try tables, accept and keep them."""
    file, store = made.mock.file, made.store
    station = file.station.model_copy(update={"port": made.mock.mock.station_url})
    file = file.model_copy(update={"station": station})
    with connect_rig(file, made.machine, made.mock.clock, made.mock.bus_factory, guard_s=PATIENT_S) as rig:
        settle_tables(rig, store, lambda _said: None)
        if not store.campaigns():
            store.add_campaign(describe_campaign(rig, CAMPAIGN, now_text()), rig.machine.text)
        if store.events(CAMPAIGN, "accepted"):
            return
        with (
            open_runner(rig, store, CAMPAIGN, lambda _n, _what: None) as runner,
            changing_tables(rig, store, "calibrate", CAMPAIGN) as change,
        ):
            if store.has_readings(CAMPAIGN):
                runner.resume(store.recording(CAMPAIGN))
            rig.drives.fault_reset()
            rig.enable()
            rig.compensate(None)
            rig.refresh_atmosphere()
            block = Block(0, calibration_blocks(rig.machine, file.campaign)[0].visits[:2])
            runner.run(visits(runner.devices, block, "calibration", runner.devices.smrs("platform")), "short")
            change.compensate(rig.images(flat_table(), rig.next_generation()))
            store.add_event(CAMPAIGN, "accepted", {VERDICT: change.id})
            change.keep()


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
                calibrate(made)
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


def drawn(counts, window, kind, number):
    """A kill in a window, from a seed."""
    rng = random.Random(f"{SEED} {window} {number}")
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
        assert not live(drawn(counts, "tables", "can", number)).alive
    host = live(drawn(counts, window, ("commit", "can", "can")[number], number))
    assert not host.alive, "nothing struck"
    assert still(rig)
    before = stored(rig)
    assert live().alive
    after = stored(rig)
    assert {uid: after.get(uid) for uid in before} == before
    rows = rows_by_key(recorded(rig))
    assert planned(rows) == keys
    drives = [drive.compensation for drive in rig.mock.mock.drives]
    assert [drive.mode for drive in drives] == [KEPT, KEPT]
    assert drives[0].table.generation == drives[1].table.generation
    assert [(found.state, found.problem) for found in audit(rig.store, CAMPAIGN)] == [("whole", "")]
