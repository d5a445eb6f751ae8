"""Commands as a user types them: what they print and how they end."""

from __future__ import annotations

import inspect
import json
import os
import re
import socket
from contextlib import closing
from pathlib import Path

import pytest

from calibration.recording.folder import write_folder
from pkm_rig.cli.entry import COMMANDS
from pkm_rig.rig import connection
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.store.store import Store, open_store
from tests.pkm_rig.plant_recording import record


def last_line(done):
    return done.stderr.strip().splitlines()[-1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "folder"
    write_folder(record(4, calibration_poses=12), path)
    return path


@pytest.fixture
def rig_file(tmp_path):
    def write(*changes):
        text = embedded_rig_path().read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_identify_import_list_show_export_and_compensate(run, folder, tmp_path):
    document = json.loads(run("identify", folder, "--json").stdout)
    assert document["calibration"] == "plant-4"
    assert json.loads(run("import", folder, "--out", tmp_path, "--json").stdout)["campaign"] == "plant-4"
    assert json.loads(run("identify", "plant-4", "--out", tmp_path, "--json").stdout) == document
    listed = json.loads(run("list", "--out", tmp_path, "--json").stdout)["campaigns"]
    assert [row["campaign"] for row in listed] == ["plant-4"]
    assert "imported" in run("show", "plant-4", "--out", tmp_path).stdout
    assert run("export", "plant-4", tmp_path / "again", "--out", tmp_path).returncode == 0
    assert (tmp_path / "again" / "readings.csv").read_bytes() == (folder / "readings.csv").read_bytes()
    table = json.loads(run("compensate", folder, "--payload", 1, "--out", tmp_path, "--json").stdout)
    assert table["payload_kg"] == 200.0
    assert 1e-6 < table["largest_correction_m"]["left"] < 1e-3


def test_identify_says_what_it_found_in_words(run, folder):
    done = run("identify", folder)
    assert done.returncode == 0
    assert "held-out poses" in done.stdout
    assert re.search(r"\d+ of \d+ directions decided by the data", done.stdout)


@pytest.mark.parametrize(
    ("arguments", "status", "complaint"),
    [
        (("identify", "nowhere"), 2, "no recording folder"),
        (("diagnose", "no/where"), 2, "'no/where' is no folder of a recording; check"),
        (("diagnose", "{folder}/readings.csv"), 2, "is no folder of a recording; check the path"),
        (("identify", "{folder}", "--estimator", "magic"), 2, "least_squares"),
        (("compensate", "{folder}", "--payload", "9"), 2, "payload 9"),
        (("show", "nothing", "--out", "{tmp}"), 2, "there is no store in"),
        (("show", "nothing", "--out", "{stored}"), 2, "no campaign 'nothing'"),
        (("report", "nothing", "--out", "{stored}"), 2, "no campaign 'nothing'"),
        (("verify", "nothing", "--rig", "none.toml", "--out", "{stored}"), 2, "none.toml: No such file"),
        (("verify", "nothing", "--rig", "{rig}", "--out", "{stored}"), 2, "no campaign 'nothing'"),
        (("check", "--rig", "missing.toml"), 2, "check the path"),
        (("import", "missing"), 2, "check the path"),
        (("calibrate", "--rig", "{rig}", "--colour"), 2, "--colour"),
        (("diagnos",), 2, "pkm-rig: No such command 'diagnos'. Did you mean 'diagnose'? See `pkm-rig --help`"),
        ((), 2, "pkm-rig: Missing command"),
        (("demo", "--seed", "-1"), 2, "seed"),
        (("poses",), 2, "give --rig or --machine"),
        (("poses", "--rig", "{rig}", "--machine", "planar4"), 2, "not both"),
    ],
)
def test_bad_input_is_one_line_and_status_2(run, arguments, status, complaint, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stored = tmp_path / "stored"
    with open_store(stored):
        pass
    places = {"folder": folder, "tmp": tmp_path, "stored": stored, "rig": embedded_rig_path()}
    done = run(*(str(a).format(**places) for a in arguments))
    assert done.returncode == status, done.stderr
    assert complaint in last_line(done)
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("command", ["import", "identify", "diagnose", "compensate", "check --rig"])
def test_what_is_no_plain_file_is_called_that_and_not_opened(run, command, tmp_path):
    """Also where there is a store: what is there is not taken for the id of a campaign."""
    pipe, out = tmp_path / "pipe", tmp_path / "runs"
    os.mkfifo(pipe)
    with open_store(out):
        pass
    for path in (pipe, Path("/dev/zero")):
        done = run(*command.split(), path, "--out", out)
        assert done.returncode == 2
        assert last_line(done).startswith(f"pkm-rig: {path}: not a plain file")


CONNECTING = (
    "calibrate",
    "measure",
    "verify",
    "check",
    "health",
    "home",
    "interim-test",
    "recalibrate",
    "tables",
    "panel",
)


@pytest.mark.parametrize("command", CONNECTING)
def test_a_command_that_connects_refuses_without_a_rig(run, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(command, *(["any"] if command == "verify" else []))
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.strip().splitlines()) == 1
    assert "--rig RIG.toml" in done.stderr
    assert "`pkm-rig demo`" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["calibrate", "measure", "demo"])
def test_a_new_set_up_is_one_of_a_campaign(run, command, tmp_path):
    done = run(
        command, "--new-setup", "--out", tmp_path / "runs", *(() if command == "demo" else ("--rig", "embedded"))
    )
    assert done.returncode == 2
    assert "give it with --resume ID" in last_line(done)
    assert list(tmp_path.iterdir()) == []


def test_no_other_command_connects():
    """What takes a rig file and may go without one connects no real rig then: `verify` takes campaigns instead."""
    without = {name for name, function in COMMANDS.items() if takes_rig(function) is False}
    assert without == {"certificate", "poses", "mock", "verify"}
    assert {name for name, function in COMMANDS.items() if takes_rig(function)} == set(CONNECTING) - {"verify"}


def takes_rig(function):
    """Whether a command needs `--rig`, or None if it has none."""
    rig = inspect.signature(function).parameters.get("rig")
    return None if rig is None else rig.default is inspect.Parameter.empty


def test_the_demo_has_the_options_of_calibrate():
    calibrate, demo = (set(inspect.signature(COMMANDS[name]).parameters) for name in ("calibrate", "demo"))
    assert demo - calibrate == {"machine", "real_time", "seed"}
    assert calibrate - demo == {"rig"}


def test_embedded_names_the_rig_of_the_demo(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    named, by_path = (
        json.loads(run("check", "--rig", rig, "--json").stdout) for rig in ("embedded", embedded_rig_path())
    )
    assert named == by_path
    assert named["simulated_devices"] == ["mock station", "drive left", "drive right", "PLC"]
    assert run("check", "--rig", "embedded").stdout.startswith("SIMULATED")
    assert "check the path" in last_line(run("check", "--rig", "./embedded/rig.toml"))


def test_unknown_key_in_the_rig_file(run, rig_file, tmp_path):
    done = run("calibrate", "--rig", rig_file(("[can]", "[can]\nspeed = 1")), "--out", tmp_path)
    assert done.returncode == 2
    assert "unknown key 'can.speed'" in last_line(done)


def test_a_wrong_node_id_is_a_device_error(run, rig_file, monkeypatch):
    monkeypatch.setattr(connection, "EMBEDDED_GUARD_S", 4.0)  # nothing else is waited for
    done = run("check", "--rig", rig_file(("node_id = 2", "node_id = 7")))
    assert done.returncode == 3
    assert "7" in last_line(done)
    assert "Traceback" not in done.stderr


def test_a_missing_device_is_named_with_status_3(run, rig_file):
    port = free_port()
    nothing_there = (
        ('interface = "embedded"', f'interface = "socketcand"\nport = {port}'),
        ("port = 0", f"port = {port}"),
        ('port = "" ', f'port = "socket://127.0.0.1:{port}" '),
    )
    done = run("check", "--rig", rig_file(*nothing_there))
    assert done.returncode == 3
    assert str(port) in last_line(done)
    assert "Traceback" not in done.stderr


def test_a_full_disk_ends_the_campaign_with_status_3_and_keeps_the_readings(run, tmp_path, rig_file, monkeypatch):
    rig = rig_file(("[nuisance]", "[campaign]\nwarm_up_rate_k_per_h = 20.0\n[nuisance]"))
    opened = Store.__init__

    def small(self, path):
        opened(self, path)
        self.limit_pages(40)

    monkeypatch.setattr(Store, "__init__", small)
    done = run("measure", "--rig", rig, "--out", tmp_path)
    monkeypatch.undo()
    assert done.returncode == 3, done.stderr
    assert "free space" in last_line(done)
    assert "Traceback" not in done.stderr
    with closing(Store(tmp_path / "pkm-rig.sqlite")) as store:
        campaign, _, _, readings, *_ = store.campaigns()[0]
        assert readings > 5
        assert len(store.recording(campaign)) == readings


def test_a_station_with_a_poor_place_is_refused_before_anything_moves(run, rig_file, tmp_path):
    rig = rig_file(("position_m = [0.0, 0.3, 3.2]", "position_m = [2.9, 0.3, 1.2]"))
    done = run("calibrate", "--rig", rig, "--out", tmp_path)
    assert done.returncode == 1
    assert "in-plane uncertainty" in last_line(done)


def test_the_interim_test_passes_on_the_mock_station(run):
    document = json.loads(run("interim-test", "--rig", "embedded", "--json").stdout)
    assert document["passed"]
    assert set(document["two_face"]) == {"N1", "N2"}
    assert abs(document["distances"][0]["error_m"]) < 0.5e-3
    done = run("interim-test", "--rig", "embedded")
    assert done.returncode == 0
    assert done.stdout.strip().splitlines()[-1] == "passed"


def test_drives_that_know_where_they_are_are_homed_only_when_told_to(run):
    document = json.loads(run("home", "--rig", "embedded", "--json").stdout)
    assert [drive["homed"] for drive in document["drives"].values()] == [False, False]
    again = json.loads(run("home", "--rig", "embedded", "--again", "--json").stdout)
    assert [drive["homed"] for drive in again["drives"].values()] == [True, True]
