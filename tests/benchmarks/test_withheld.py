"""The check on withheld data: its seals, its statistics, and a small run from end to end."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.withheld import lane, over_the_wire, run
from benchmarks.withheld.cases import DECLARED, Slot
from benchmarks.withheld.maker import Maker
from benchmarks.withheld.score_rows import answerable, overall_right
from benchmarks.withheld.scorer import Tampered, achieved, fixed_answers, score_batch
from benchmarks.withheld.second_round import MORE, longer_recordings
from benchmarks.withheld.sizes import platform_rows
from calibration.recording.folder import read_folder
from mock_devices.effects import CATALOGUE, OUTSIDE, OUTSIDE_FINAL
from mock_devices.recordings.files import write_recording
from tests.benchmarks.withheld_cases import DECOY, EFFECT, NEXT, NULL, OUT, REMOVED, UNDECLARED, case_of

STAND_IN = "stand_in:diagnose"
RESEMBLING = ("backlash", "tracker_drift")  # those that the tests below make themselves


def maker(*slots, seed=4):
    """A maker that looks for what resembles a true effect among some effects only: all take longest of all it does."""
    return Maker(seed, final=False, slots=list(slots), few_designs=True, resembling=RESEMBLING)


# --- seals


def test_truth_is_not_on_disk_before_the_hash_of_the_answers(tmp_path):
    m = maker(EFFECT, REMOVED, NULL, DECOY, OUT)
    folder = tmp_path / "batch" / "recordings"
    assert m.make(folder) == 5
    told = [file.read_bytes().decode() for file in sorted((tmp_path).rglob("*")) if file.is_file()]
    names = {file.name for file in tmp_path.rglob("*")}
    seeds = {str(case.truth["seed"]) for case in m._cases.values()} | {str(m._batch_seed), str(m._secret)}
    listed = json.loads((folder / "options.json").read_text())
    shown = [text for text in told if text != (folder / "options.json").read_text()]
    # Keys of every recording and machine file, which effects of the same name do not betray.
    of_format = {"payload", "drive_scale"}
    for text in shown:
        words = set(text.replace(",", " ").replace('"', " ").split())
        told_of = {*CATALOGUE, *OUTSIDE, *OUTSIDE_FINAL} - of_format
        assert not words & (told_of | {"seed", "effects", *m._cases} | (seeds - {"4"}))
    assert not any(name.startswith("truth") for name in names)
    assert {tuple(entry) for entry in listed.values()} == {("without", "without_forms")}
    effects_named = [{name.partition("/")[0] for name in entry["without_forms"]} for entry in listed.values()]
    assert all(len(named) >= 2 for named in effects_named)  # of whatever kind, at least two effects lack something
    assert sorted(len(entry["without"]) for entry in listed.values()) == [0, 0, 0, 1, 1]
    with pytest.raises(ValueError, match="SHA-256"):
        m.seal(tmp_path / "truth.json", "x" * 64)
    assert not (tmp_path / "truth.json").exists()
    m.seal(tmp_path / "truth.json", "a" * 64)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["answers_sha256"] == "a" * 64
    assert set(truth["cases"]) == set(listed)
    compared = {case["key"]: set(case["mimics_sigma"]) for case in truth["cases"].values() if "mimics_sigma" in case}
    assert compared == {
        slot.key: set(RESEMBLING) - set(slot.effects) for slot in (EFFECT, REMOVED, OUT)
    }  # those with one effect


def test_all_recordings_of_a_design_look_alike(tmp_path):
    """Columns, rows in their order, and header but for the levels that are declared, whatever the kind."""
    m = maker(
        EFFECT, NULL, UNDECLARED, OUT, Slot("effect-c", "effect", ("friction_windup",), (5.0,), gross=True),
        Slot("misdeclared-a", "misdeclared", ("smr_reseat",), (5.0,), declared="not"),
    )  # fmt: skip
    m.leave_form_out = False  # tells of options, not of recordings
    m.make(tmp_path / "recordings")
    rows, headers, machines = {}, {}, set()
    for name, case in m._cases.items():
        folder = tmp_path / "recordings" / name
        lines = (folder / "readings.csv").read_text().splitlines()
        names = lines[0].split(",")
        told = [names.index(column) for column in ("uid", "phase", "smr", "visit", "payload", "speed_m_per_s")]
        order = tuple(tuple(line.split(",")[k] for k in told) for line in lines[1:])
        rows.setdefault(case.truth["design"], set()).add((lines[0], order))
        header = tomllib.loads((folder / "recording.toml").read_text())
        assert ("nuisance" in header) == (case.truth["declared"] != "not")
        undeclared = repr([(key, value) for key, value in header.items() if key != "nuisance"])
        headers.setdefault(case.truth["design"], set()).add(undeclared)
        machines.add((folder / "machine.toml").read_text())
        assert sorted(file.name for file in folder.iterdir()) == ["machine.toml", "readings.csv", "recording.toml"]
    assert all(len(kinds) == 1 for kinds in (*rows.values(), *headers.values()))
    assert len(headers) < len(m._cases)
    assert len(machines) == 1


def test_a_sure_verdict_is_asked_for_again_with_six_gross_readings(tmp_path):
    m, case = maker(), case_of(replace(NULL, spoiled=True))
    m._cases = {"sure": case, "other": case_of(NULL)}
    assert m.add_cases(tmp_path / "unsure", {}, []) == 0
    assert m.add_cases(tmp_path / "longer", {}, ["sure", "other"]) == 1
    ((name, asked),) = m._longer.items()
    assert asked == {"of": "sure", "arm": "gross"}
    clean = np.stack([case.clean.columns[column] for column in ("x_m", "y_m", "z_m")], axis=1)
    off_m = np.linalg.norm(read_folder(tmp_path / "longer" / name).positions_m - clean, axis=1)
    assert np.sum(off_m > 5e-5) == 6
    assert off_m.max() < 1.1e-2
    assert set(json.loads((tmp_path / "longer" / "options.json").read_text())) == {name}


def test_final_runs_draw_their_seed_from_the_system():
    made = [Maker(None, final=True, slots=[]) for _ in range(2)]
    assert made[0].commitment != made[1].commitment
    assert len({maker(seed=4).commitment, maker(seed=4).commitment}) == 1


def test_a_final_run_looks_among_all_effects_for_those_that_resemble_the_true_one(tmp_path, capsys):
    with pytest.raises(ValueError, match="among all effects"):
        Maker(None, final=True, slots=[], resembling=RESEMBLING)
    assert set(Maker(None, final=True, slots=[])._libraries.effects) == set(CATALOGUE)
    log = tmp_path / "log.jsonl"
    with pytest.raises(SystemExit):
        run.main(["--final", "--resembling", RESEMBLING[0], "--out", str(tmp_path), "--log", str(log)])
    assert "--resembling is no final run" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        run.main(["--seed", "1", "--resembling", "slack", "--out", str(tmp_path), "--log", str(log)])
    assert "unknown effect 'slack'" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        run.main(["--seed", "1", "--n", "0", "--out", str(tmp_path), "--log", str(log)])
    assert "--n is 0; give the number of cases" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("function", ["asks_for_the_plant", "reads_a_truth", "diagnose"])
def test_a_diagnoser_that_asks_for_the_plant_fails(tmp_path, function):
    write_recording(case_of(NULL).recording, tmp_path / "in" / "recordings" / "x")
    (tmp_path / "in" / "recordings" / "options.json").write_text('{"x": {"without": [], "without_forms": []}}')
    arguments = (tmp_path / "in" / "recordings", tmp_path / "answers", f"stand_in:{function}")
    if function == "diagnose":
        lane.diagnose(*arguments)
        answer = json.loads((tmp_path / "answers" / "answers.json").read_text())["x"]
        assert set(answer["baselines"]) == {"nearest_residual", "greedy_bic", "form_free"}
        return
    with pytest.raises(lane.RunFailed, match=r"may (be )?read"):
        lane.diagnose(*arguments)
    assert not (tmp_path / "answers" / "answers.json").exists()
    assert "may be read" in (tmp_path / "in" / "diagnoser.log").read_text().replace("may read", "may be read")


def test_answers_cannot_be_changed_after_the_truth_is_known(tmp_path):
    m = maker(NULL)
    m.make(tmp_path / "recordings")
    lane.diagnose(tmp_path / "recordings", tmp_path / "answers", STAND_IN)
    m.seal(tmp_path / "truth.json", fixed_answers(tmp_path))
    assert [row["key"] for row in score_batch(tmp_path)] == ["null-a"]
    answers = tmp_path / "answers" / "answers.json"
    answers.write_text(answers.read_text().replace("rankin", "rankln"))
    with pytest.raises(Tampered, match="not those"):
        score_batch(tmp_path)


# --- statistics


def test_achieved_shrink_is_that_of_the_plant():
    case = case_of(EFFECT)
    rows = platform_rows(case.bench)[::3]
    rng = np.random.default_rng(3)
    turn = case.bench.view.rotation
    error = np.zeros((len(rows), 3))
    error[:, :2] = 1e-5 * rng.choice([-1.0, 1.0], (len(rows), 2))
    error[:, 2] = 1e-3  # along the machine's z, which does not count
    near = case.noise_free_m[rows]
    predictions = {"rows": rows, "before_m": near + error @ turn.T, "after_m": near + 0.2 * error @ turn.T}
    achieved_shrink = achieved(case.truth, predictions, case.noise_free_m, platform_rows(case.bench))
    assert achieved_shrink["achieved"] == pytest.approx(0.8)
    assert achieved_shrink["before_m"] == pytest.approx(1e-5)
    assert achieved_shrink["predicted_share"] == pytest.approx(1.0 / 3.0, abs=0.01)


# --- further poses


def test_a_longer_campaign_goes_on_where_the_first_one_ended():
    case = case_of(NEXT)
    asked = [
        {"target_m": [0.1, 0.2, 0, 0, 0, 0], "direction": [-1, 1], "payload": 2, "speed_m_per_s": 0.1, "dwell_s": 8.0},
        {"target_m": [5.0, 0.2, 0, 0, 0, 0], "direction": [-1, 1], "payload": 2, "speed_m_per_s": 0.1, "dwell_s": 8.0},
    ]
    arms = longer_recordings(case, asked, np.random.default_rng(1))
    n = len(case.recording)
    for made in arms.values():
        assert all(np.array_equal(made.columns[c][:n], v) for c, v in case.recording.columns.items())
        assert len(np.unique(made.columns["visit"])) == len(np.unique(case.recording.columns["visit"])) + MORE
        assert np.all(np.diff(made.columns["t_rig_s"]) > 0.0)
        assert len(set(made.columns["uid"].tolist())) == len(made)
    assert set(arms["chosen"].columns["payload"][n:].tolist()) >= {2.0}
    assert set(arms["random"].columns["payload"].tolist()) == {0.0}
    at_pose = arms["chosen"].columns["phase"][n:] == "calibration"
    assert set(arms["chosen"].columns["target_x_m"][n:][at_pose].tolist()) == {0.1}


# --- over the wire


def test_the_wire_and_the_maker_of_recordings_agree():
    effect = "servo_settling=2e-4,place=right,tau_s=10"
    assert effect in over_the_wire.EFFECTS
    assert len({text.partition("=")[0] for text in over_the_wire.EFFECTS}) == 10
    assert over_the_wire.difference_m(effect) < over_the_wire.LARGEST_M


# --- whole runs


def arguments(folder, *more, n=14, kinds="null,outside", batch=2):
    return [
        "--seed", "7", "--n", str(n), "--kinds", kinds, "--out", str(folder), "--lanes", "1",
        "--batch", str(batch), *more,
    ]  # fmt: skip


def rows_of(folder):
    lines = (folder / "results.jsonl").read_text().splitlines()[1:]
    rows = [r for line in lines for r in json.loads(line)["rows"]]
    return sorted(({k: v for k, v in r.items() if "seconds" not in k} for r in rows), key=lambda r: r["key"])


def test_a_stopped_run_goes_on_and_gives_the_same(tmp_path, capsys, monkeypatch):
    two = {"n": 4, "kinds": "null", "batch": 1}  # others wait for a library of what they resemble
    assert run.main(arguments(tmp_path / "whole", "--diagnose", STAND_IN, **two)) == 0
    kept = []
    whole = lane.run_lane

    def stopped(options, keep, begun):
        def once(batch):
            if kept:
                raise lane.RunFailed("stopped")
            kept.append(batch)
            keep(batch)

        whole(options, once, begun)

    monkeypatch.setattr(run, "run_lane", stopped)
    assert run.main(arguments(tmp_path / "parts", "--diagnose", STAND_IN, **two)) == 2
    assert len(rows_of(tmp_path / "parts")) == 1
    capsys.readouterr()
    held = {file: file.read_bytes() for file in (tmp_path / "parts").rglob("*") if file.is_file()}
    assert run.main(["--so-far", str(tmp_path / "parts")]) == 1
    assert capsys.readouterr().out.startswith("1 of 2 cases\n")
    assert held == {file: file.read_bytes() for file in (tmp_path / "parts").rglob("*") if file.is_file()}
    monkeypatch.setattr(run, "run_lane", whole)
    assert run.main(arguments(tmp_path / "parts", "--diagnose", STAND_IN, **two)) == 0
    assert len(rows_of(tmp_path / "parts")) == 2
    assert rows_of(tmp_path / "parts") == rows_of(tmp_path / "whole")
    assert "null cases called an effect" in capsys.readouterr().out
    assert not list((tmp_path / "parts").rglob("*.csv"))
    assert {"confusion.png", "reliability.png", "shrink.png", "results.json"} <= {
        file.name for file in (tmp_path / "parts").iterdir()
    }


def test_runs_of_different_kinds_have_one_table_and_those_of_the_same_kinds_none(tmp_path, capsys, monkeypatch):
    """By header and rows alone: what is scored is not looked at here."""
    monkeypatch.setattr(run, "summary", lambda rows: {"measures": [], "keys": [row["key"] for row in rows]})
    monkeypatch.setattr(run, "printed", lambda found: " ".join(found["keys"]))
    for kind in ("null", "effect"):
        (tmp_path / kind).mkdir()
        header = {"settings": {"n": 60, "kinds": [kind]}}
        rows = {"rows": [{"key": f"{kind}-1"}, {"key": f"{kind}-0"}]}
        (tmp_path / kind / "results.jsonl").write_text(f"{json.dumps(header)}\n{json.dumps(rows)}\n")
    folders = [str(tmp_path / kind) for kind in ("null", "effect")]
    planned = sum(len(run.plan(60, [kind])) for kind in ("null", "effect"))
    assert run.main(["--so-far", *folders]) == 1
    assert capsys.readouterr().out == f"4 of {planned} cases\neffect-0 effect-1 null-0 null-1\n"
    assert run.main(["--so-far", folders[0], folders[0]]) == 2
    assert "of different kinds" in capsys.readouterr().err


def test_figures_do_not_depend_on_the_order_in_which_batches_were_made():
    batches = [{"rows": [{"key": "null-3"}, {"key": "effect-1"}]}, {"rows": [{"key": "effect-0"}]}]
    in_order = [{"key": key} for key in ("effect-0", "effect-1", "null-3")]
    assert run.rows_of(batches) == run.rows_of(batches[::-1]) == in_order


def test_results_that_are_not_there_are_said_in_one_line(tmp_path, capsys):
    (tmp_path / "results.jsonl").write_text('{"rows": []}\n')
    for folder in (tmp_path / "nowhere", tmp_path):
        assert run.main(["--so-far", str(folder)]) == 2
        message = capsys.readouterr().err
        assert message.count("\n") == 1
        assert str(folder) in message


def test_a_final_run_is_logged_whatever_comes_out(tmp_path, capsys):
    options = [
        "--final", "--n", "2", "--kinds", "null", "--out", str(tmp_path / "out"), "--lanes", "1",
        "--diagnose", STAND_IN, "--log", str(tmp_path / "log.jsonl"),
    ]  # fmt: skip
    assert run.main(options) in (0, 1)
    begun, ended = (json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines())
    assert begun["run"] == ended["run"]
    truth = next((tmp_path / "out").rglob("truth.json"))
    assert ended["truths"][0] == hashlib.sha256(truth.read_bytes()).hexdigest()
    assert json.loads(truth.read_text())["commitment"] == begun["seed"]
    of_null = [ended["figures"][f"null cases called an effect, declared {declared}"][3] for declared in DECLARED]
    assert sum(of_null) == ended["n"]
    capsys.readouterr()


def test_the_catalogue_is_logged_before_new_final_forms_come(tmp_path):
    log = tmp_path / "log.jsonl"
    assert run.main(["--log-catalogue", "--log", str(log)]) == 0
    assert json.loads(log.read_text())["catalogue"] == run.catalogue_digest()


def test_a_small_run_of_the_real_diagnosis(tmp_path, capsys):
    among = ("--resembling", ",".join(RESEMBLING))
    assert run.main(arguments(tmp_path / "out", *among, n=3, kinds="effect,null", batch=1)) in (0, 1)
    rows = rows_of(tmp_path / "out")
    assert [set(r["mimics_sigma"]) for r in rows] == [set(RESEMBLING) - set(rows[0]["true"]), set()]
    assert Counter(r["kind"] for r in rows) == {"effect": 1, "null": 1}
    assert [r["error"] for r in rows] == ["", ""]
    assert sum(overall_right(r) for r in rows if answerable(r)) >= 1
    for r in rows:
        assert sum(p for _, p in r["ranked"]) <= 1.0 + 1e-9
        assert r["predicted_share"] > 0.99  # noise with tails: a reading or two in a thousand is left out
        assert r["achieved"] < 1.0
    document = json.loads((tmp_path / "out" / "results.json").read_text())
    assert document["cases"] == 2
    assert "one diagnosis, median" in capsys.readouterr().out
