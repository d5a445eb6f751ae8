"""The tables by hand: what is shown, off, back, and what is refused."""

from __future__ import annotations

import base64
import dataclasses
import json
import sys

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.error_map import correction_at
from drivers.drives.table_image import TableImage, encode_table
from drivers.errors import DriveFault, InterlockOpen
from pkm_rig.cli import entry, main
from pkm_rig.errors import StoreError
from pkm_rig.jobs.tables import change_to_off, describe_before, last_change, roll_back, show_tables
from pkm_rig.report.tables_text import print_tables
from pkm_rig.rig.kept_tables import kept_tables
from pkm_rig.rig.runner import describe_campaign
from pkm_rig.rig.table_change import VERDICT, changing_tables
from pkm_rig.rig.table_recovery import end_unfinished_change, settle_tables, unfinished_change
from pkm_rig.store.append import now_text
from tests.pkm_rig.conftest import silent
from tests.pkm_rig.tables_bench import CAMPAIGN, FORMER, images, table, tables_bench

NEW = 8


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with tables_bench(tmp_path_factory.mktemp("tables")) as made:
        with made.host() as (rig, _, _life):
            made.former = images(rig, FORMER)
        yield made


@pytest.fixture
def bench(running, tmp_path):
    running.path = tmp_path / "store.sqlite"
    running.reset(running.former)
    return running


def calibrate(rig, store, made=None):
    """A campaign whose tables were accepted."""
    store.add_campaign(describe_campaign(rig, CAMPAIGN, now_text()), rig.machine.text)
    with changing_tables(rig, store, "verify", CAMPAIGN) as change:
        change.compensate(rig.images(made or table(), NEW))
        store.add_event(CAMPAIGN, "accepted", {VERDICT: change.id})
        change.keep()


def test_each_bank_is_shown_with_its_campaign_and_machine(bench, capsys):
    with bench.host() as (rig, store, _):
        calibrate(rig, store)
        shown = json.loads(json.dumps(show_tables(rig, store)))
        elsewhere = show_tables(rig, None)
    assert shown["tables"] == f"generation {NEW} of campaign {CAMPAIGN} on all drives"
    left = shown["drives"]["left"]
    assert (left["mode"], left["bank"], left["valid"], left["payload_kg"]) == ("kept", 2, True, 0.0)
    assert [(b["generation"], b["campaign"], b["of_this_machine"]) for b in left["banks"]] == [
        (FORMER, None, True),
        (NEW, CAMPAIGN, True),
    ]
    assert elsewhere["drives"]["left"]["banks"][1]["campaign"] is None
    print_tables(shown)
    text = capsys.readouterr().out
    assert "drive left: uses bank 2\n" in text
    assert f"generation {NEW} for 0 kg" in text
    assert f"tables: generation {NEW} of campaign {CAMPAIGN} on all drives" in text


def test_the_next_campaign_names_the_tables_that_the_store_knows(bench):
    made = dataclasses.replace(table(), correction_m=1e-5 * np.random.default_rng(2).standard_normal((2, 3, 3)))
    with bench.host() as (rig, store, _):
        assert kept_tables(rig, store) == ()
        calibrate(rig, store, made)
        kept = kept_tables(rig, store)
        header = describe_campaign(rig, "next", now_text(), kept)
    assert {(known.generation, known.drive, known.partner) for known in kept} == {
        (generation, *drives) for generation in (FORMER, NEW) for drives in (("left", "right"), ("right", "left"))
    }
    assert header.known_tables == kept
    left, right = (known for known in kept if known.generation == NEW)
    drives = (
        made.start_m + np.random.default_rng(1).uniform(0.0, made.correction_m.shape[1] - 1.0, (20, 2)) * made.step_m
    )
    expected = correction_at(made, drives)
    assert left.correction_m(drives[:, 0], drives[:, 1]) == pytest.approx(expected[:, 0], abs=2e-8)
    assert right.correction_m(drives[:, 1], drives[:, 0]) == pytest.approx(expected[:, 1], abs=2e-8)


def test_off_and_back_and_back_again(bench):
    with bench.host() as (rig, store, _):
        with pytest.raises(InputError, match="no change of its tables"):
            last_change(rig, store)
        calibrate(rig, store)
        change_to_off(rig, store)
        assert bench.used() == [0, 0]
        change = last_change(rig, store)
        assert describe_before(change) == f"generation {NEW} on all drives"
        roll_back(rig, store, change)
        assert bench.used() == [NEW, NEW]
        change = last_change(rig, store)
        assert describe_before(change) == "off on all drives"
        roll_back(rig, store, change)
        assert bench.modes() == [0, 0]
        assert unfinished_change(rig, store) is None


def test_what_was_interrupted_says_which_tables_are_active(bench, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    def notes(job, *arguments):
        with pytest.raises(KeyboardInterrupt) as caught:
            job(*arguments)
        return caught.value.__notes__

    with bench.host() as (rig, store, _):
        calibrate(rig, store)
        change, active = last_change(rig, store), [f"tables: generation {NEW} of campaign {CAMPAIGN} on all drives"]
        monkeypatch.setattr(rig, "bring_tables_to", interrupt)
        assert notes(change_to_off, rig, store) == active
        assert notes(settle_tables, rig, store, silent) == active
        assert notes(end_unfinished_change, rig, store, silent) == active
        assert notes(roll_back, rig, store, change) == active

        def unreadable(*_):
            raise StoreError("the disk is gone")

        monkeypatch.setattr(store, "table_changes", unreadable)
        assert notes(roll_back, rig, store, change) == [f"tables: generation {NEW} on all drives"]


def test_a_rollback_goes_to_before_the_campaign_and_not_to_a_state_within_it(bench):
    with bench.host() as (rig, store, _):
        calibrate(rig, store)
        for comp in bench.compensations:
            comp.banks[1].write(b"")  # the former table is in no bank any more
        roll_back(rig, store, last_change(rig, store))
    assert bench.used() == [FORMER, FORMER]
    assert [c.banks[c.active_bank].image for c in bench.compensations] == bench.former


def test_tables_of_another_machine_or_drive_are_refused(bench):
    with bench.host() as (rig, store, _):
        calibrate(rig, store)
        serial = rig.banks[1].drive.identity
        rig.banks[1].drive.identity = dataclasses.replace(serial, serial=4711)
        with pytest.raises(InputError, match="not of drive right as it is now"):
            last_change(rig, store)
        rig.banks[1].drive.identity = serial
        step = next(s for s in store.table_changes() if s.kind == "begun")
        foreign = _foreign(step.data, rig)
        store.add_table_change(
            rig=rig.file.rig, machine=rig.machine.name, campaign=None, change="x", kind="begun", data=foreign
        )
        store.add_table_change(
            rig=rig.file.rig, machine=rig.machine.name, campaign=None, change="x", kind="done", data={}
        )
        with pytest.raises(InputError, match="not of machine planar4"):
            last_change(rig, store)
        for kind in ("begun", "done"):
            store.add_table_change(
                rig=rig.file.rig,
                machine="rrr3",
                campaign=None,
                change="y",
                kind=kind,
                data={**step.data, "purpose": "off"},
            )
        with pytest.raises(InputError, match="of machine rrr3"):
            last_change(rig, store)
    assert bench.used() == [NEW, NEW]


def _foreign(data, rig):
    records = []
    for record, image in zip(data["former"], rig.images(table(), FORMER), strict=True):
        foreign: TableImage = dataclasses.replace(image, machine_id=b"m" * 16)
        records.append({**record, "image": base64.b64encode(encode_table(foreign)).decode()})
    return {"purpose": "off", "former": records, "target": None}


def test_nothing_is_changed_in_motion_or_with_an_open_interlock(bench):
    with bench.host() as (rig, store, _):
        calibrate(rig, store)
        axis = bench.mock.mock.drives[1].axis
        rig.compensate(None)
        for drive in rig.drives.drives:
            drive.set_profile(0.01)
        drive = rig.drives.drives[1]
        drive.write_target(drive.position_actual_m() + 0.02)
        drive.send_controlword(0x3F)
        rig.clock.sleep_s(0.5)
        with pytest.raises(DriveFault, match=r"right.*it moves at 10 mm/s"):
            change_to_off(rig, store)
        with pytest.raises(DriveFault, match="standstill only"):
            roll_back(rig, store, last_change(rig, store))
        assert axis.motion.is_moving(bench.mock.clock.now_s())
        rig.drives.disable()
        bench.mock.mock.plc.set_interlock(0, False)
        with pytest.raises(InterlockOpen) as caught:
            change_to_off(rig, store)
        assert caught.value.__notes__ == ["tables: off on all drives"]
        bench.mock.mock.plc.set_interlock(0, True)
    assert [step.data["purpose"] for step in store_steps(bench)] == ["verify"]


def store_steps(bench):
    with bench.host() as (_, store, _life):
        return [step for step in store.table_changes() if step.kind == "begun"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("tables", "--rig", "embedded"), 0, "tables: off on all drives"),
        (("tables", "--rig", "embedded"), 0, "SIMULATED: by simulated devices"),
        (("tables", "show", "--rig", "embedded", "--json"), 0, '"simulated": true'),
        (("tables", "show", "--rig", "embedded", "--json"), 0, '"tables": "off on all drives"'),
        (("tables", "off", "--rig", "embedded"), 2, "nobody can be asked here; give --yes"),
        (("tables", "off", "--rig", "embedded", "--yes"), 0, "tables: off on all drives"),
        (("tables", "rollback", "--rig", "embedded", "--yes"), 2, "so nothing is known of before; give --out"),
        (("tables", "on", "--rig", "embedded"), 2, "is not one of"),
    ],
)
def test_the_command(monkeypatch, capsys, tmp_path, arguments, status, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pkm-rig", *arguments])
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False, raising=False)
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert (ended.value.code or 0) == status
    assert words in (printed.err if status else printed.out)
    assert not list(tmp_path.iterdir())  # looking makes no store


def test_what_was_added_to_an_error_is_part_of_the_last_line(monkeypatch, capsys):
    def fails(**_options):
        error = InputError("the reason")
        error.add_note("tables: off on all drives")
        raise error

    monkeypatch.setattr(entry, "app", fails)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.strip() == "pkm-rig: the reason; tables: off on all drives"
