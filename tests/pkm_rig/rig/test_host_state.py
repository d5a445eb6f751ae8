"""Which correction the host makes is a generation in the store: whole and verified or not at all, whoever is killed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.samples import CorrectionSamples
from drivers.errors import TableError
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.jobs.former_correction import SAMPLES, former_correction, verified_correction
from pkm_rig.jobs.life_record import key_of
from pkm_rig.jobs.tables import change_to_off, describe_before, last_change, roll_back, show_tables
from pkm_rig.jobs.tables_in_force import require_host
from pkm_rig.report.tables_text import print_tables
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.drive_tables import record_state, tables_line
from pkm_rig.rig.host_state import HostState, host_in_use
from pkm_rig.rig.runner import describe_campaign
from pkm_rig.rig.table_change import VERDICT, TableChange, begin
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import now_text
from pkm_rig.store.life import ACCEPTED, add_to_life
from pkm_rig.store.store import open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import silent

CORRECTION = np.array([[2e-5, -1e-5, 0.0, 3e-5], [1e-5, 4e-5, 0.0, -3e-5]])
SAMPLED = CorrectionSamples(np.zeros((2, 6)), CORRECTION, np.zeros(4))


@pytest.fixture(scope="module")
def pair():
    """Four cranks, which the host corrects, and their mock."""
    path = demo_rig_path("rrr4")
    file, machine = load_rig(path)
    with (
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as connected,
    ):
        yield connected, mock.mock


@pytest.fixture
def rig(pair):
    return pair[0]


@pytest.fixture
def store(tmp_path):
    with open_store(tmp_path) as opened:
        yield opened


def campaign(rig, store, name):
    """A campaign that was verified with payload 0."""
    store.add_campaign(describe_campaign(rig, name, now_text()), rig.machine.text)
    data = {"payload": 0, "payload_kg": 0.0, "temperatures_c": {"struts": 20.5}, SAMPLES: SAMPLED.as_json()}
    store.add_event(name, "activated", data)


def steps(rig, store, name, crc):
    """The writes of a verification, one after the other."""
    change = begin(rig, store, "calibrate", name)
    yield change
    change.try_host(crc)
    yield change
    store.add_event(name, "accepted", {VERDICT: change.id})
    yield change
    change.keep()
    yield change


def accepted(rig, store, name, crc) -> TableChange:
    campaign(rig, store, name)
    return list(steps(rig, store, name, crc))[-1]


def in_use(rig, store):
    return host_in_use(store, rig.file.rig, rig.machine.name)


@pytest.mark.parametrize(("writes", "left"), [(1, "former"), (2, "former"), (3, "new"), (4, "new")])
def test_a_host_that_is_killed_leaves_the_former_or_the_verified_correction(rig, store, writes, left):
    """After any of its writes: the verdict alone decides, and the next command that connects ends the change."""
    accepted(rig, store, "former", 7)
    before = in_use(rig, store)
    assert before == HostState(1, "former", 7)
    campaign(rig, store, "new")
    writing = steps(rig, store, "new", 8)
    for _ in range(writes):
        next(writing)
    writing.close()  # killed
    assert in_use(rig, store) == (before if writes < 4 else HostState(2, "new", 8))
    settle_tables(rig, store, silent)
    assert in_use(rig, store) == (before if left == "former" else HostState(2, "new", 8))
    settle_tables(rig, store, silent)  # nothing is left to end
    assert in_use(rig, store).campaign == left


def test_a_refused_correction_leaves_the_former_one(rig, store):
    accepted(rig, store, "former", 7)
    campaign(rig, store, "new")
    change = next(iter(steps(rig, store, "new", 8)))
    change.try_host(8)
    store.add_event("new", "refused", {VERDICT: change.id})
    change.bring_to_target()
    assert in_use(rig, store) == HostState(1, "former", 7)
    assert change.description == "the host's former correction, generation 1"


def test_off_and_back_and_back_to_the_former_generation(rig, store):
    with pytest.raises(InputError, match="no change of its tables"):
        last_change(rig, store)
    accepted(rig, store, "first", 7)
    accepted(rig, store, "second", 8)
    change_to_off(rig, store)
    assert in_use(rig, store) == HostState(2, "second", 8, on=False)
    assert "does not correct (it did by generation 2 of campaign second)" in tables_line(rig, store)
    change = last_change(rig, store)
    assert describe_before(change) == "the host corrects by generation 2 of campaign second"
    roll_back(rig, store, change)
    assert in_use(rig, store) == HostState(2, "second", 8)
    roll_back(rig, store, last_change(rig, store))
    assert not in_use(rig, store).on
    third = accepted(rig, store, "third", 9)
    assert in_use(rig, store).generation == 3
    roll_back(rig, store, third)
    assert in_use(rig, store) == HostState(2, "second", 8, on=False)
    assert "of campaign second" in tables_line(rig, store)


def test_a_rollback_to_a_campaign_that_was_removed_is_refused(rig, store):
    accepted(rig, store, "first", 7)
    change = accepted(rig, store, "second", 8)
    gone = dataclasses.replace(change.host_former, campaign="gone")
    store.add_table_change(
        rig=rig.file.rig, machine=rig.machine.name, campaign=None, change="ff", kind="begun",
        data={"purpose": "rollback", "former": record_state(rig), "target": {"on": False, "images": {}},
              "host_former": gone.as_json(), "host_target": None},
    )  # fmt: skip
    store.add_table_change(
        rig=rig.file.rig, machine=rig.machine.name, campaign=None, change="ff", kind="done", data={"host": None}
    )
    with pytest.raises(InputError, match="gone"):
        last_change(rig, store)


def test_what_the_host_corrects_is_shown(rig, store, capsys):
    print_tables(show_tables(rig, store))
    assert "host: no correction was accepted" in capsys.readouterr().out
    accepted(rig, store, "first", 7)
    shown = show_tables(rig, store)
    assert shown["host"]["generation"] == 1
    assert shown["host"]["on"] is True
    assert shown["host"]["payloads"][0]["largest_correction"]["b"] == {"value": 4e-5, "unit": "rad"}
    assert show_tables(rig, None)["host"]["campaign"] is None
    print_tables(shown)
    text = capsys.readouterr().out
    assert "host: corrects generation 1, CRC 00000007, campaign first" in text
    assert "0 kg, degC: struts 20.5; up to a 20 µrad, b 40 µrad, c 0 µrad, d 30 µrad" in text
    assert "tables: off on all drives; the host corrects by generation 1 of campaign first" in text


def test_without_the_store_the_host_cannot_be_switched_off(rig):
    with pytest.raises(InputError, match="is in the store; give the --out"):
        change_to_off(rig, None)


def test_a_check_is_refused_where_another_correction_is_in_force(rig, store):
    with pytest.raises(CampaignRefused, match="the host has none in use"):
        require_host(rig, store, "first")
    accepted(rig, store, "first", 7)
    accepted(rig, store, "second", 8)
    with pytest.raises(CampaignRefused, match="generation 2 of campaign second"):
        require_host(rig, store, "first")
    with pytest.raises(InputError, match="not verified with payload 2"):
        verified_correction(store, "second", 2)


def test_the_former_correction_is_that_of_the_last_accepted_campaign_for_the_load(rig, store):
    for name in ("first", "second"):
        campaign(rig, store, name)
        add_to_life(store, "calibrations", rig=rig.file.rig, machine=key_of(rig), kind=ACCEPTED, data={}, campaign=name)
    found = former_correction(rig, store, "third", 0)
    assert found is not None
    assert found[1] == "campaign second"
    assert found[0].correction == pytest.approx(SAMPLED.correction)
    assert former_correction(rig, store, "second", 0)[1] == "campaign first"
    assert former_correction(rig, store, "third", 1) is None


def test_the_host_refuses_to_lead_while_a_drives_own_table_is_on(pair):
    """As another program may have left it: both would correct."""
    rig, mock = pair
    rig.host = lambda pose: np.zeros((len(pose), 4))
    mock.drives[2].compensation.mode = 1
    try:
        with pytest.raises(TableError, match=r"c .*its own table is on: both would correct"):
            rig.lead(np.zeros(3), 0.1)
    finally:
        mock.drives[2].compensation.mode, rig.host = 0, None


def test_a_store_that_cannot_be_written_changes_nothing(rig, store, monkeypatch):
    accepted(rig, store, "first", 7)

    def full(*_, **__):
        raise StoreError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(store, "add_table_change", full)
        with pytest.raises(StoreError):
            change_to_off(rig, store)
    assert in_use(rig, store) == HostState(1, "first", 7)
