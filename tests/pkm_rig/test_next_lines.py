"""Every line that names the next command is one that works as it stands."""

from __future__ import annotations

import io
import itertools
import json
import os
import shlex
import signal
from contextlib import contextmanager
from pathlib import Path

import pytest
from rich.console import Console

from pkm_rig.jobs.campaign_file import write_campaign_files
from pkm_rig.jobs.next_command import measure_more
from pkm_rig.report import terminal, terminal_live
from pkm_rig.report.diagnosis_json import diagnosis_json
from pkm_rig.report.diagnosis_text import describe_diagnosis
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.store.store import open_store
from tests.pkm_rig.conftest import SHORT, SLIDERS, campaign_lines
from tests.pkm_rig.diagnosis_example import example

CFG = Path(__file__).parents[1] / "data" / "printer.cfg"
FEWER = {
    **SHORT,
    **SLIDERS,
    "calibration_poses": 8,
    "verification_payloads": [0],
    "warm_up_rate_k_per_h": 50.0,
}


@pytest.fixture
def rig_file(tmp_path, monkeypatch):
    """A short campaign on the embedded rig, in a folder whose name a shell would split."""
    monkeypatch.chdir(tmp_path)
    text = embedded_rig_path().read_text(encoding="utf-8")
    text += "\n[campaign]\n" + campaign_lines(FEWER)
    path = tmp_path / "my rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def follow(run):
    """Run the one command that a text names after some words."""

    def command(text, after, *more):
        (line,) = [line for line in text.splitlines() if after in line]
        program, *words = shlex.split(line.partition(after)[2])
        assert program == "pkm-rig"
        return run(*words, *more)

    return command


@pytest.fixture
def interrupted(run, monkeypatch):
    """Run a command and interrupt it at one of its readings."""

    @contextmanager
    def progress_bar(at):
        readings = itertools.count()

        def progress(advance, _total, _what):
            if advance and next(readings) == at:
                os.kill(os.getpid(), signal.SIGINT)

        yield progress

    def command(at, *words):
        with monkeypatch.context() as patched:
            for module in (terminal, terminal_live):
                patched.setattr(module, "progress_bar", lambda: progress_bar(at))
            done = run(*words)
        assert done.returncode == 3, done.stderr
        return done

    return command


def moved_station(rig_text):
    """A rig file whose mock station stands elsewhere."""
    moved = rig_text.replace("heading_rad = 0.0", "heading_rad = 0.1")
    assert moved != rig_text
    return moved


def diagnosis_of(campaign, rig_file):
    """What `diagnose` would print if it had found what the example has."""
    out = Path("my runs")
    (out / "a folder").mkdir()
    file, machine = load_rig(rig_file)
    found = example()
    files = write_campaign_files(list(found.next_measurement), machine, file.payloads, campaign, out / "a folder")
    with open_store(out) as store:
        measure_with = measure_more(store, campaign, out)
    page = io.StringIO()
    console = Console(file=page, width=500)
    result = diagnosis_json(found, files) | {"pictures": {"error-map": "error-map.png"}}
    console.print(describe_diagnosis(found, result, measure_with))
    return page.getvalue()


def test_a_campaign_is_led_from_one_command_to_the_next(run, interrupted, follow, rig_file):
    done = interrupted(60, "measure", "--rig", rig_file, "--out", "my runs")
    rig_file.write_text(moved_station(rig_file.read_text(encoding="utf-8")), encoding="utf-8")
    for status in (1, 0):  # the nest check refuses the station, then it goes on in a new set-up
        done = follow(done.stderr.strip().splitlines()[-1], "go on with: ")
        assert done.returncode == status, done.stderr
    listed = json.loads(run("list", "--out", "my runs", "--json").stdout)["campaigns"]
    assert len(listed) == 1

    printed = diagnosis_of(listed[0]["campaign"], rig_file)
    assert printed.splitlines()[-1].startswith("next: ")
    measured_more = follow(printed, "next: ")
    assert measured_more.returncode == 0, measured_more.stderr
    assert len(json.loads(run("list", "--out", "my runs", "--json").stdout)["campaigns"]) == 1  # the same campaign

    done = follow(measured_more.stdout, "next: ", "--json")
    assert (done.returncode, done.stderr.count("Traceback")) in ((0, 0), (1, 0)), done.stderr
    assert json.loads(done.stdout)["campaign"] == listed[0]["campaign"]


def test_an_imported_printer_is_identified_by_the_line_that_says_so(run, follow, tmp_path):
    done = follow(run("import", CFG, tmp_path / "a printer").stdout, "next: ", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["calibration"]
