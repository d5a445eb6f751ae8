"""`identify --all` and `diagnose --all`: each campaign's own result; what failed is named, what broke off goes on."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace

import pytest

from pkm_rig.jobs import many_campaigns
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record
from tests.pkm_rig.store.stores import change, small_recording


@pytest.fixture(scope="module")
def recordings():
    made = [record(seed, calibration_poses=8) for seed in (1, 2)]
    return [
        replace(r, file=r.file.model_copy(update={"campaign": name})) for r, name in zip(made, ("a", "b"), strict=True)
    ]


@pytest.fixture
def out(tmp_path, recordings):
    with closing(Store(tmp_path / "pkm-rig.sqlite")) as store:
        for recording in recordings:
            store.add_recording(recording)
    return tmp_path


def on_all(run, out, *words, command="identify"):
    status, printed, err = run(command, "--all", "--jobs", "1", "--json", "--out", out, *words)
    return status, json.loads(printed) if printed else None, err


@pytest.fixture
def computed(monkeypatch):
    """The campaigns that are identified, in their order; how is another test's matter."""
    names = []

    def identify(recording, estimator, *, robust, draws):
        names.append(recording.file.campaign)
        figures = {"position_rms_m": 1e-5, "orientation_rms_rad": 1e-5}
        return {"parameters": {}, "rank": 0, "chi2_per_dof": 1.0, "held_out": figures, "bound": figures, "dropped": {}}

    monkeypatch.setattr(many_campaigns, "identify_with_checks", identify)
    return names


def test_each_has_the_result_that_it_has_alone(run, out):
    status, found, _ = on_all(run, out)
    assert status == 0
    assert (found["done"], found["kept"], found["failed"], found["skipped"]) == (2, 0, 0, {})
    alone = json.loads(run("identify", "a", "--json", "--out", out).stdout)
    assert found["campaigns"][0] == {"campaign": "a", "rig": "plant", "result": alone, "failure": None, "kept": False}


def test_a_result_is_kept(run, out, computed):
    _, found, _ = on_all(run, out)
    assert computed == ["a", "b"]
    _, again, _ = on_all(run, out)
    assert computed == ["a", "b"]
    assert again["kept"] == 2
    assert [entry["result"] for entry in again["campaigns"]] == [entry["result"] for entry in found["campaigns"]]
    on_all(run, out, "--again")
    assert computed == ["a", "b"] * 2


def test_what_was_computed_of_something_else_is_not_kept(run, out, computed):
    on_all(run, out)
    computed.clear()
    with closing(Store(out / "pkm-rig.sqlite")) as store:
        store.add_event("a", "noted", {})
    on_all(run, out)
    assert computed == ["a"]
    on_all(run, out, "--estimator", "tikhonov")
    assert computed == ["a", "a", "b"]
    (out / "b" / "identify-all.json").write_text('{"key": ')
    on_all(run, out, "--estimator", "tikhonov")
    assert computed == ["a", "a", "b", "b"]


def test_campaigns_that_fail_are_named_and_end_no_other(run, out, computed):
    with closing(Store(out / "pkm-rig.sqlite")) as store:
        store.add_recording(small_recording("damaged"))
        empty = small_recording("empty")
        store.add_campaign(empty.file, empty.machine.text)
    change(out / "pkm-rig.sqlite", "UPDATE readings SET data = '{' WHERE campaign = 'damaged' AND position = 2")
    status, found, err = on_all(run, out)
    assert status == 1
    assert (found["done"], found["failed"]) == (2, 1)
    assert found["skipped"] == {"empty": "nothing was measured"}
    failures = {entry["campaign"]: entry["failure"] for entry in found["campaigns"]}
    assert "reading" in failures["damaged"]
    assert "(row 2): damaged" in failures["damaged"]
    assert failures["a"] is None
    assert "1 of 3 campaigns failed: damaged; " in err.splitlines()[-1]
    shown = run("identify", "--all", "--jobs", "1", "--out", out).stdout
    assert "damaged: FAILED: " in shown
    assert "empty: left out: nothing was measured" in shown
    assert "2 campaigns, 2 of them before; 1 failed, 1 left out" in shown
    change(out / "pkm-rig.sqlite", "UPDATE campaigns SET machine = X'FF' WHERE id = 'b'")
    assert on_all(run, out)[1]["failed"] == 2


def test_what_is_interrupted_goes_on(run, out, computed, monkeypatch):
    """As a signal ends the command, after the first result."""
    from pkm_rig.cli.entry import Interrupted  # noqa: PLC0415
    from pkm_rig.report import terminal  # noqa: PLC0415

    class Interrupting:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def __call__(self, *_):
            raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(terminal, "progress_bar", lambda *_: Interrupting())
        status, _, err = on_all(run, out)
    assert status == 3
    assert err.splitlines()[-1] == (
        "pkm-rig: interrupted; 1 of 2 campaigns are done and kept; the same command goes on"
    )  # no word of drives: none was connected
    assert computed == ["a"]
    assert on_all(run, out)[1]["kept"] == 1
    assert computed == ["a", "b"]


def test_a_diagnosis_has_its_files_where_that_of_one_campaign_has_them(run, out):
    one = json.loads(run("diagnose", "a", "--json", "--out", out).stdout)
    files = {path.name: path.read_bytes() for path in (out / "a" / "diagnosis").iterdir()}
    for path in (out / "a" / "diagnosis").iterdir():
        path.unlink()
    change(out / "pkm-rig.sqlite", "UPDATE campaigns SET machine = X'FF' WHERE id = 'b'")  # one is enough
    status, found, _ = on_all(run, out, command="diagnose")
    assert status == 1
    assert found["campaigns"][0]["result"] == one
    assert {path.name: path.read_bytes() for path in (out / "a" / "diagnosis").iterdir()} == files
    assert not list(out.rglob("*.part"))
    assert on_all(run, out, command="diagnose")[1]["kept"] == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("identify", "a", "--all"), "leave out a"),
        (("identify",), "--all is all of them"),
        (("diagnose", "a", "--jobs", "2"), "go with --all"),
        (("identify", "--all", "--sessions-from-sequence"), "leave out"),
        (("diagnose", "--all", "--estimate-disturbances"), "leave out --all"),
        (("history", "--jobs", "2"), "go with --all"),
        (("diagnose", "--all", "--effects", "nowhere.py"), "check the path"),
        (("identify", "--all", "--jobs", "0"), "1 or more"),
        (("identify", "--all", "--estimator", "x"), "estimator 'x' is unknown"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else "",
)
def test_wishes_without_sense_are_refused(run, out, words, message):
    status, _, err = run(*words, "--out", out)
    assert status == 2
    assert message in err.splitlines()[-1]


def test_a_table_has_a_line_a_campaign(run, out, computed):
    lines = run("identify", "--all", "--jobs", "1", "--out", out).stdout.splitlines()
    assert [line.split()[:2] for line in lines[:3]] == [["campaign", "rig"], ["a", "plant"], ["b", "plant"]]
    assert lines[-1] == "2 campaigns; 0 failed, 0 left out"
