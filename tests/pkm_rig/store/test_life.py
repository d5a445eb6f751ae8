"""A machine's life in the store: rows that outlast campaigns, and the facts that they say."""

from __future__ import annotations

import gzip
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.parameters import ParameterSet
from pkm_rig.errors import StoreError
from pkm_rig.jobs.history import chosen_rig, history, largest_changes
from pkm_rig.store import schema
from pkm_rig.store.former_life import calibration_rows, rigs_with_campaigns
from pkm_rig.store.life import add_to_life, life_rows, machine_key
from pkm_rig.store.life_facts import end_of_day_utc_s, machine_history
from pkm_rig.store.store import Store
from tests.pkm_rig.store.stores import rows

SCHEMA_0002 = Path(__file__).parents[2] / "data" / "schema_0002" / "store.db.gz"
CAMPAIGN = "embedded-mock-20261123-142614-242b"
RIG, KEY = "saw", "planar4/0123456789ab"
NAMES = ["drive_offset.left", "drive_offset.right"]
TABLES = {"left": {"generation": 3, "crc": 7, "active": True}}


@pytest.fixture
def store(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")) as made:
        yield made


@pytest.fixture
def former(tmp_path):
    path = tmp_path / "former.sqlite"
    path.write_bytes(gzip.decompress(SCHEMA_0002.read_bytes()))
    return path


def add(store, table, kind, data, *, rig=RIG, machine=KEY, **own):
    add_to_life(store, table, rig=rig, machine=machine, kind=kind, data=data, **own)


def add_calibration(store, campaign, t_utc_s, *, left_m=8e-6, found_m=None, value=1e-5, **own):
    data = {
        "t_utc_s": t_utc_s,
        "extent": "full",
        "instrument": "990001",
        "parameters": NAMES,
        "units": ["m", "m"],
        "values": [value, -2e-5],
        "unknowns": {"names": NAMES, "values": [value, -2e-5], "covariance": [[4e-12, 1e-12], [1e-12, 9e-12]]},
        "temperatures_c": {"struts": 21.0, "base": 23.0},
        "operating_h": 10.0,
    }
    verdict = {
        "t_utc_s": t_utc_s,
        "as_found": None if found_m is None else {"position_m": found_m, "u_m": 1e-6},
        "as_left": {"position_m": left_m, "u_m": 1e-6},
        "tables": TABLES,
        "effects": ["thermal_gradient"],
    }
    add(store, "calibrations", "identified", data, campaign=campaign, **own)
    add(store, "calibrations", "accepted", verdict, campaign=campaign, **own)


def add_check(store, name, t_utc_s, kind="fit", *, calibration="c1", error_m=9e-6):
    data = {
        "id": name,
        "t_utc_s": t_utc_s,
        "calibration": calibration,
        "instrument": "990001",
        "error": {"position_m": error_m, "u_m": 1e-6},
        "watched": NAMES,
        "change": [1e-6, 0.0],
        "change_u": [1e-6, 2e-6],
        "reference_u": [1e-6, 1e-6],
        "error_per_change": [0.7, 0.7],
        "independent": 1.0,
        "temperature_c": 22.0,
        "poses": 6,
        "operating_h": 20.0,
        "duration_s": 240.0,
        "tolerance_m": 3e-5,
        "reasons": [],
        "simulated": False,
    }
    add(store, "checks", kind, data, campaign=name)


def test_a_store_of_schema_0002_keeps_every_value_and_tells_its_calibration(former):
    queries = [
        f"SELECT * FROM {table} ORDER BY 1, 2"
        for table in ("campaigns", "readings", "events", "heads", "table_changes", "removed_campaigns")
    ]
    before = [rows(former, query) for query in queries]
    assert before[1]
    with closing(Store(former)) as store:
        assert store.recording(CAMPAIGN).file.campaign == CAMPAIGN
        identified, verdict = calibration_rows(store, "embedded-mock")
        assert rigs_with_campaigns(store) == ["embedded-mock"]
    assert [rows(former, query) for query in queries] == before
    assert rows(former, "SELECT version_num FROM alembic_version") == [(schema.REVISION,)]
    assert rows(former.with_name("former-schema-0002.sqlite"), "SELECT version_num FROM alembic_version") == [("0002",)]
    machine = load_machine(shipped_machine("planar4"))
    assert identified.machine == machine_key(machine, ParameterSet.of(machine).names)
    assert (identified.kind, verdict.kind, verdict.campaign) == ("identified", "refused", CAMPAIGN)
    assert verdict.data["as_left"]["position_m"] == pytest.approx(9.496e-6, rel=1e-3)
    assert len(identified.data["u"]) == len(identified.data["values"]) == len(machine_parameters(machine))


def machine_parameters(machine):
    return ParameterSet.of(machine).names


def test_rows_are_kept_by_rig_and_in_order_and_never_changed(store):
    for number, rig in enumerate(("a", "b", "a")):
        add(store, "machine_events", "collision", {"part": f"column {number}"}, rig=rig, campaign=None)
    assert [row.data["part"] for row in life_rows(store, "machine_events", "a")] == ["column 0", "column 2"]
    with closing(sqlite3.connect(store.path)) as other:
        for table in ("machines", "instruments", "calibrations", "checks", "machine_events"):
            other.execute(
                f"INSERT INTO {table} (created, rig, machine, kind, data"
                + {"instruments": ", serial", "calibrations": ", campaign"}.get(table, "")
                + ") VALUES ('', 'x', '', '', '{}'"
                + (", ''" if table in ("instruments", "calibrations") else "")
                + ")"
            )
            for statement in (f"UPDATE {table} SET kind = 'other'", f"DELETE FROM {table}"):
                with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                    other.execute(statement)


def test_a_half_written_row_is_named(store):
    add(store, "checks", "fit", {"id": "x"}, campaign=None)
    with closing(sqlite3.connect(store.path)) as other, other:
        other.execute("DROP TRIGGER keep_checks_update")
        other.execute("UPDATE checks SET data = '{\"id\": '")
    with pytest.raises(StoreError, match="row 1 of checks: damaged"):
        life_rows(store, "checks", RIG)


def test_a_row_that_lacks_what_it_must_have_is_damage(store):
    add(store, "calibrations", "identified", {"t_utc_s": 1.0, "extent": "full"}, campaign="c1")
    with pytest.raises(StoreError, match=r"the life of rig saw is damaged \(KeyError"):
        history(store, RIG)


def test_facts_are_those_of_the_rows(store):
    add(store, "machine_events", "tolerance changed", {"position_m": 3e-5}, campaign=None)
    add(store, "instruments", "station", {"name": "station", "make": "TM50"}, serial="990001")
    add(store, "instruments", "certificate", {"name": "station", "number": "K-1", "due": "2027-03-31"}, serial="")
    add_calibration(store, "c1", 1000.0)
    add_check(store, "k1", 2000.0)
    add(store, "machine_events", "drive replaced", {"part": "left", "serial": "8"}, campaign=None)
    facts = machine_history(store, RIG, KEY)
    assert (facts.machine.name, facts.machine.identity) == ("planar4", "0123456789ab")
    (calibration,) = facts.calibrations
    assert (calibration.id, calibration.parameter_names) == ("c1", tuple(NAMES))
    assert calibration.covariance == ((4e-12, 1e-12), (1e-12, 9e-12))
    assert calibration.temperature_c == 22.0
    assert calibration.tables == "left:3:7"
    assert facts.checks[0].change_u == (1e-6, 2e-6)
    assert [(e.kind, e.part) for e in facts.events] == [("drive replaced", "left")]  # the first tolerance is no change
    assert facts.instrument("990001").due_utc_s == end_of_day_utc_s("2027-03-31") == 1806537600.0


def test_a_clock_that_was_set_back_is_said(store):
    add(store, "machine_events", "tolerance changed", {"position_m": 3e-5}, campaign=None)
    add_calibration(store, "c1", 1000.0)
    add_check(store, "k1", 2000.0)
    add_check(store, "k2", 1500.0)
    with pytest.raises(InputError, match="500 s older than the one stored before it"):
        machine_history(store, RIG, KEY)


def test_another_machine_begins_its_history_anew(store):
    add(store, "machines", "history begins", {"name": "planar4"})
    add_calibration(store, "c1", 1000.0)
    add(store, "machines", "history begins", {"name": "planar4"}, machine="planar4/ffffffffffff")
    life = history(store, RIG)
    assert (life["machine"], life["former_machines"]) == ("planar4/ffffffffffff", [KEY])
    assert life["calibrations"] == []


def test_work_since_the_last_good_check_is_in_doubt(store):
    add(store, "machine_events", "tolerance changed", {"position_m": 3e-5}, campaign=None)
    add_calibration(store, "c1", 1000.0)
    for number, kind in enumerate(("fit", "due", "out of tolerance", "out of tolerance"), start=1):
        add_check(store, f"k{number}", 1000.0 + number, kind, error_m=1e-5 * number)
    life = history(store, RIG)
    created = {check["id"]: check["created"] for check in life["checks"]}
    (period,) = life["in_doubt"]
    assert (period["since"], period["until"]) == (created["k2"], created["k3"])
    assert period["found_by"] == "check k3"


def test_a_parameter_that_has_changed_is_shown_first(store):
    for number, value in enumerate((1e-5, 1.1e-5, 9e-5)):
        add_calibration(store, f"c{number}", 1000.0 + number, value=value)
    life = history(store, RIG)
    assert largest_changes(life["parameters"], 1) == ["drive_offset.left"]
    points = life["parameters"]["drive_offset.left"]["points"]
    assert [(p["value"], p["u"]) for p in points] == [(1e-5, 2e-6), (1.1e-5, 2e-6), (9e-5, 2e-6)]


def test_a_rig_has_to_be_named_where_there_are_several(store):
    add_calibration(store, "c1", 1000.0)
    assert chosen_rig(store, None) == RIG
    add_calibration(store, "c2", 1000.0, rig="mill")
    with pytest.raises(InputError, match="name a rig; there are mill, saw"):
        chosen_rig(store, None)
    with pytest.raises(InputError, match="no rig 'lathe'; there are mill, saw"):
        chosen_rig(store, "lathe")


def test_a_machine_file_with_other_tolerances_is_the_same_machine():
    machine = load_machine(shipped_machine("planar4"))
    names = machine_parameters(machine)
    key = machine_key(machine, names)
    tolerances = machine.file.tolerances.model_copy(update={"smr_position_m": 0.5})
    moved = machine.file.platform.model_copy(update={"moving_mass_kg": 1.0})
    assert machine_key(with_file(machine, tolerances=tolerances), names) == key
    assert machine_key(with_file(machine, platform=moved), names) != key
    assert machine_key(machine, (*names[:-1], "renamed")) != key


def with_file(machine, **sections):
    return replace(machine, file=machine.file.model_copy(update=sections))
