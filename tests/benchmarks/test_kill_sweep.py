"""The kill sweep's own parts: what it plans, where it strikes, and that its checks find what they are for."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter

import pytest

from benchmarks.kill_sweep.checks import changed_readings, drive_problems
from benchmarks.kill_sweep.host import Killer, is_table_word
from benchmarks.kill_sweep.strikes import plan

COMMITS = """
import sys
from pathlib import Path
import sqlalchemy as sa
from benchmarks.kill_sweep.host import Killer, install
killer = Killer(sys.argv[1], Path(sys.argv[2]))
install(killer)
engine = sa.create_engine("sqlite:///" + sys.argv[3])
for text in ["CREATE TABLE t (n)"] + [f"INSERT INTO t VALUES ({n})" for n in range(5)]:
    with engine.begin() as connection:
        connection.exec_driver_sql(text)
killer.write(struck=None)
"""


def test_the_plan_has_the_kills_that_were_asked_for_and_half_of_the_hosts_fall_while_tables_change():
    strikes = Counter((s.victim, s.window) for chain in plan(12) for s in chain.strikes)
    assert strikes == {
        ("host", "measuring"): 100,
        ("host", "tables"): 100,
        ("host", "recovery"): 20,
        ("mock", "measuring"): 20,
        ("mock", "tables"): 30,
        ("drive", "measuring"): 20,
        ("drive", "tables"): 30,
    }
    assert plan(12) == plan(12)
    assert plan(12) != plan(13)
    for chain in plan(12):
        windows = [strike.window for strike in chain.strikes]
        assert all(windows[i - 1] == "tables" for i, window in enumerate(windows) if window == "recovery")


@pytest.mark.parametrize(("number", "rows"), [(3, 1), (4, 3), (9, 5)])
def test_a_process_dies_at_the_commit_that_was_chosen_before_it_or_after_it(tmp_path, number, rows):
    log, database = tmp_path / "log", tmp_path / "db"
    ran = subprocess.run([sys.executable, "-c", COMMITS, f"start:commit:{number}", log, database], check=False)
    (line,) = log.read_text().splitlines()
    struck = number <= 6
    assert ran.returncode == (-signal.SIGKILL if struck else 0)
    assert json.loads(line)["struck"] == (f"start:commit:{number}" if struck else None)
    query = "import sqlite3, sys; print(sqlite3.connect(sys.argv[1]).execute('SELECT COUNT(*) FROM t').fetchone()[0])"
    counted = subprocess.run([sys.executable, "-c", query, database], check=True, capture_output=True)
    assert int(counted.stdout) == rows


def test_operations_of_the_tables_window_count_from_the_first_word_of_a_table(tmp_path):
    killer = Killer("none", tmp_path / "log")
    for data in ("2f00210100000000", "2101210140000000", "6000000000000000"):  # mode off; a table; a segment
        frame = bytes.fromhex(data)
        killer.around(("can", "sdo"), lambda: None, begins_tables=is_table_word(0x601, frame))
    assert killer.counts == {"start:can": 3, "start:sdo": 3, "tables:can": 2, "tables:sdo": 2}


@pytest.mark.parametrize(
    ("cob_id", "data", "expected"),
    [
        (0x601, "2101210140000000", True),  # download of 0x2101:01 by segments
        (0x602, "c602210140000000", True),  # of 0x2102:01 in blocks
        (0x601, "4001210100000000", False),  # an upload
        (0x601, "2b00210202000000", False),  # another object
        (0x581, "2101210140000000", False),  # an answer
        (0x201, "0f00", False),
    ],
)
def test_the_first_word_of_a_table_is_a_download_into_a_bank(cob_id, data, expected):
    assert is_table_word(cob_id, bytes.fromhex(data)) is expected


def test_the_checks_find_what_they_are_for():
    before = {"a": "1 x", "b": "2 y"}
    assert changed_readings(before, {**before, "c": "3 z"}) == []
    assert changed_readings(before, {"a": "1 x", "b": "2 Y"}) == ["1 of 2 readings from before a kill have changed"]
    assert changed_readings(before, {"a": "1 x"})
    good = {"moving": False, "compensation": 1, "generation": 4}
    assert drive_problems({"drives": {"left": good, "right": good}}) == []
    for wrong in ({"generation": 3}, {"compensation": 0}, {"moving": True}):
        assert len(drive_problems({"drives": {"left": good, "right": {**good, **wrong}}})) == 1
    on_trial = {**good, "compensation": 2}
    assert "on trial" in drive_problems({"drives": {"left": on_trial, "right": on_trial}})[0]
