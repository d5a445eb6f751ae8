"""The check on another simulator's recordings: who may see which truth, how a run goes on, what is counted."""

from __future__ import annotations

import hashlib
import io
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.independent import final_runs, run
from benchmarks.independent.final_runs import MOST, NoFinalRun
from benchmarks.independent.pack import packed_arrays, write_archive
from benchmarks.independent.recordings import FILES, NoRecordings, copy_recordings, names_of
from benchmarks.independent.scorer import score
from benchmarks.independent.table import figures, misjudged
from benchmarks.independent.truths import ARRAYS, TABLE, OddTruth, Truth, read_truths
from benchmarks.scoring import goals
from benchmarks.withheld import sealing
from benchmarks.withheld.scorer import Tampered
from benchmarks.withheld.statistics import excess_calibration_error
from calibration.base.frame import station_frame

ROOT = Path(__file__).parents[2]
HEADER = """
format = 1
campaign = "c"
rig = "another"
created = "2026-11-01T08:00:00+00:00"
software = "another"
drives = ["left"]
sensors = []
nest_limit_m = 1e-3
station = {position_m = [1.0, 2.0, 3.0], heading_rad = 0.7, accuracy = {angle_sd_rad = 2e-6, range_sd_m = 4e-6, \
range_constant_u_m = 5e-6, range_scale_u = 1e-6}}
payloads = [{name = "none", mass_kg = 0.0, u_mass_kg = 0.0, com_m = [0.0, 0.0, 0.0], u_com_m = 0.002}]
"""
MACHINE = "".join(
    f'[[struts]]\nname = "{strut}"\ndrive = "{drive}"\n'
    for strut, drive in (("a", "left"), ("b", "left"), ("c", "right"))
)
TURN = station_frame((1.0, 2.0, 3.0), 0.7).rotation
SURE_OF = {"rec001": 0.95, "rec002": 0.95, "rec004": 0.85}
EVEN, ODD = ["rec002", "rec004"], ["rec001", "rec003"]


def effect(name="backlash", places=("left",), raw=5.0, visible=4.0, **more):
    return {
        "effect": name, "places": list(places), "raw_sigma": raw, "visible_sigma": visible,
        "raw_platform_sigma": raw, "visible_platform_sigma": visible, **more,
    }  # fmt: skip


def entry(kind="single", *effects):
    return {"kind": kind, "campaign": "oneway", "disturbances": "rough", "sigma_m": 6e-6, "effects": list(effects)}


def archive_in(folder, entries):
    """An archive with four recordings and their truths."""
    arrays = {"clean_m": np.zeros((6, 3)), "platform": np.array([True, True, True, True, False, False])}
    files = {TABLE: json.dumps(entries).encode()}
    for name in entries:
        files[f"{name}/notes.txt"] = b"what it is"
        files[f"{name}/truth.json"] = b"{}"
        files |= {f"{name}/{file}": HEADER.encode() for file in FILES}
        files[ARRAYS.format(name)] = b"spoiled" if entries[name] == "spoiled" else packed_arrays(arrays)
    return write_archive(folder, files)


@pytest.fixture
def spoiled(tmp_path):
    """An archive in which nobody can read the odd truths."""
    truths = dict.fromkeys(ODD, "spoiled") | {"rec002": entry("single", effect()), "rec004": entry("null")}
    return archive_in(tmp_path / "data", truths)


def answer(verdict, p=0.9, *found, shrink=0.5, **ranking):
    return {
        "seconds": 1.0,
        "clock_seconds": 2.0,
        "diagnosis": {
            "verdict": verdict, "equivalent": [], "ranking": {verdict: p, **ranking}, "effects": list(found),
            "not_tested": {}, "hidden_m": 1e-6, "where": [], "gap": {"shrink": shrink, "shrink_interval": [0.4, 0.6]},
        },
    }  # fmt: skip


def found(name="backlash", place="left", value=1e-5, u=1e-6, raw=5.0, **more):
    size = {"name": "size", "value": value, "u": u, "unit": "m"}
    return {"effect": name, "place": place, "size": size, "raw_sigma": raw, "others": [], **more}


# --- who may see what


def test_copies_hold_the_recording_and_nothing_else(tmp_path, spoiled):
    assert names_of(spoiled, even=True) == EVEN
    assert names_of(spoiled, even=False) == ODD
    copy_recordings(spoiled, EVEN, tmp_path / "copies")
    copied = sorted(str(f.relative_to(tmp_path / "copies")) for f in (tmp_path / "copies").rglob("*") if f.is_file())
    assert copied == [f"{name}/{file}" for name in EVEN for file in FILES]
    with pytest.raises(NoRecordings, match="rec006 lacks one of"):
        copy_recordings(spoiled, ["rec006"], tmp_path / "copies")


def test_odd_truths_are_read_in_a_final_run_only(tmp_path, spoiled):
    with pytest.raises(OddTruth, match="rec003 is of the odd half"):
        read_truths(spoiled, ["rec002", "rec003"])
    assert set(read_truths(spoiled, EVEN)) == set(EVEN)
    whole = archive_in(tmp_path / "whole", dict.fromkeys(ODD + EVEN, entry("null")))
    assert set(read_truths(whole, ODD, final_runs.begin("code", tmp_path / "log"))) == set(ODD)


def test_only_the_scorer_of_a_run_reads_truths():
    readers = set()
    for package in ("benchmarks", "calibration", "drivers", "mock_devices", "pkm_rig", "tests"):
        for file in (ROOT / package).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            if "independent.truths" in text or "read_truths" in text or "truth/" + "truth" in text:
                readers.add(str(file.relative_to(ROOT)))
    here = {f"benchmarks/independent/{name}.py" for name in ("pack", "run", "scorer", "truths")}
    fit = "benchmarks/fit_verdict/sources.py"  # even ones: without a final run the others are refused
    assert "final_run" not in (ROOT / fit).read_text(encoding="utf-8")
    assert "even=True" in (ROOT / fit).read_text(encoding="utf-8")
    here.add(fit)
    assert readers == here | {f"tests/benchmarks/test_{name}.py" for name in ("emergent", "independent")}
    for name in ("pack", "scorer"):
        assert "read_truths" not in (ROOT / f"benchmarks/independent/{name}.py").read_text(encoding="utf-8")
    assert (ROOT / "benchmarks/independent/run.py").read_text(encoding="utf-8").count("read_truths(") == 1


@pytest.mark.parametrize("name", ["recordings.tar.xz", "truth.json", "results.json"])
def test_a_diagnoser_may_open_no_file_with_truths(monkeypatch, name):
    monkeypatch.setattr(sealing, "_refusal", sealing._Refusal())
    sealing._on_event("open", ("/data/readings.csv",))
    with pytest.raises(sealing.SealBroken):
        sealing._on_event("open", (f"/data/{name}",))


def test_the_committed_log_has_at_most_five_runs():
    runs = final_runs.logged()
    assert [entry["run"] for entry in runs] == list(range(1, len(runs) + 1))
    assert len(runs) <= MOST
    assert all(entry["figures"] for entry in runs)


def test_there_is_no_sixth_final_run_and_none_of_the_same_code(tmp_path):
    log = tmp_path / "log.jsonl"
    for number in range(MOST):
        final_runs.append(final_runs.begin(f"code {number}", log), "answers", {})
        with pytest.raises(NoFinalRun, match="scored this very code" if number < MOST - 1 else "the most there may be"):
            final_runs.begin(f"code {number}", log)
    with pytest.raises(NoFinalRun, match="has 5 final runs"):
        final_runs.begin("other code", log)


# --- a run


@pytest.fixture
def asked(monkeypatch):
    """What is diagnosed; every answer is backlash on the left."""
    names = []

    def batch(out, of, function, prepare, sealed):
        names.extend(of)
        if prepare is not None:  # with gross readings backlash is no longer found
            return {name: answer("unknown", 0.8) for name in of}
        assert all((out / "recordings" / name / "recording.toml").is_file() for name in of)
        return {name: answer("backlash", SURE_OF[name], found(), none=0.02) for name in of}

    monkeypatch.setattr(run, "diagnose_batch", batch)
    monkeypatch.setattr(goals, "excess_calibration_error", partial(excess_calibration_error, simulations=10))
    return names


def arguments(tmp_path, *more, data="data"):
    return ["--data", str(tmp_path / data), "--out", str(tmp_path / "out"), "--log", str(tmp_path / "log"), *more]


def test_a_run_reads_the_even_half_goes_on_and_begins_anew_with_other_code(
    tmp_path, spoiled, asked, capsys, monkeypatch
):
    code = ["one"]
    monkeypatch.setattr(run, "code_digest", lambda _: code[0])
    assert run.main(arguments(tmp_path, "--n", "1")) == 1
    assert asked == EVEN[:1]
    assert run.main(arguments(tmp_path)) == 1
    assert asked == EVEN
    assert run.main(arguments(tmp_path)) == 1
    assert asked == EVEN
    shown = capsys.readouterr().out
    assert "visible single effects named right" in shown
    assert "rec004 oneway, rough: nothing" in shown
    assert not list((tmp_path / "out").glob("*/odd"))
    assert run.main(arguments(tmp_path, "--fresh")) == 1
    assert asked == EVEN + EVEN
    code[0] = "other"
    assert run.main(arguments(tmp_path)) == 1
    assert asked == EVEN * 3
    capsys.readouterr()
    assert run.main(arguments(tmp_path, "--gross")) == 1
    assert asked == EVEN * 3 + ["rec002"]
    (line,) = (line for line in capsys.readouterr().out.splitlines() if "six gross readings change" in line)
    assert "20.7 % to 100.0 %      1  short" in line
    assert run.main(arguments(tmp_path, "--far")) == 1
    assert asked == EVEN * 3 + ["rec002"] * 2
    (line,) = (line for line in capsys.readouterr().out.splitlines() if "one far reading in twenty changes" in line)
    assert "100.0 %" in line
    assert not (tmp_path / "log").exists()


def test_totals_tell_of_no_single_recording(tmp_path, spoiled, asked, capsys):
    assert run.main(arguments(tmp_path, "--totals")) == 1
    shown = capsys.readouterr()
    assert "visible single effects named right" in shown.out
    assert "rec00" not in shown.out + shown.err
    assert not list((tmp_path / "out").rglob("results.json"))


def test_a_final_run_scores_the_odd_half_and_tells_of_no_single_recording(tmp_path, asked, capsys):
    archive_in(tmp_path / "data", {"rec001": entry("single", effect("latency")), "rec002": "spoiled"})
    assert run.main(arguments(tmp_path, "--final")) == 1
    assert asked == ["rec001", "rec001"]  # once more with gross readings
    shown = capsys.readouterr().out
    assert "latency                      0 of 1\n" in shown
    assert "rec001" not in shown
    (line,) = (tmp_path / "log").read_text().splitlines()
    assert json.loads(line)["figures"]["visible single effects named right"] == [0.0, 0.0, 0.7935, 1, False]
    kept = [file for file in (tmp_path / "out").rglob("*") if file.is_file() and "latency" in file.read_text()]
    assert kept == []
    assert run.main(arguments(tmp_path, "--final")) == 2
    assert "scored this very code" in capsys.readouterr().err


def test_the_code_of_an_answer_is_the_diagnosis(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "ROOT", tmp_path)
    monkeypatch.setattr(run, "CODE", ("package", "one.py"))
    (tmp_path / "package" / "below").mkdir(parents=True)
    digests = set()
    for name in ("one.py", "package/below/module.py", "other.py"):
        (tmp_path / "one.py").touch()
        (tmp_path / name).write_text("changed")
        digests.add(run.code_digest())
    assert len(digests) == 2  # other.py is not part of it


def test_without_recordings_it_says_so_in_one_line(tmp_path, capsys):
    assert run.main(arguments(tmp_path, data="nowhere")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("independent: no recordings.tar.xz in ")


# --- scores


def truth(*effects, kind="single"):
    return Truth(entry(kind, *effects), np.zeros((6, 3)), np.arange(4))


def row_of(tmp_path, given, of, predictions=None):
    (tmp_path / "rec002").mkdir(exist_ok=True)
    (tmp_path / "rec002" / "recording.toml").write_text(HEADER)
    (tmp_path / "rec002" / "machine.toml").write_text(MACHINE)
    return score(tmp_path, "rec002", given, predictions, of)


def test_places_step_and_size_of_a_single_effect(tmp_path):
    step = effect("foundation_settling", ("left", "right"), raw=4.0, step_s=100.0)
    onset = [{"name": "onset_s", "value": 150.0, "u": 1.0, "unit": "s"}]
    one = row_of(tmp_path, answer("foundation_settling", 0.9, found("foundation_settling", others=onset)), truth(step))
    assert (one["place_right"], one["places_right"], one["step_error_s"]) == (True, False, 50.0)
    assert (one["raw_named"], one["raw_true"], one["raw_u"]) == (5.0, 4.0, pytest.approx(0.5))
    assert one["eligible"]
    several = found("foundation_settling", places=[{"place": "left"}, {"place": "right"}])
    both = row_of(tmp_path, answer("foundation_settling", 0.9, several), truth(step))
    assert (both["place_right"], both["places_right"], both["step_error_s"]) == (True, True, None)
    two = [found("foundation_settling", place, raw=raw) for place, raw in (("left", 3.0), ("right", 4.0))]
    apart = row_of(tmp_path, answer("foundation_settling", 0.9, *two), truth(step))
    assert (apart["places_right"], apart["raw_named"]) == (True, pytest.approx(5.0))
    assert apart["raw_u"] == pytest.approx(0.1 * np.hypot(9.0, 16.0) / 5.0)
    grown = effect("link_thermal_growth")  # at the left drive: both of its struts
    struts = [found("link_thermal_growth", place) for place in ("b", "a", "c")]
    ranges = [row_of(tmp_path, answer("link_thermal_growth", 0.9, *struts[:k]), truth(grown)) for k in (1, 2, 3)]
    assert [r["place_right"] for r in ranges] == [True, True, False]
    assert [r["places_right"] for r in ranges] == [False, True, False]
    wrong = row_of(tmp_path, answer("backlash", 0.9, found()), truth(step))
    assert "place_right" not in wrong
    assert wrong["p_true"] == pytest.approx(1e-6)
    small = row_of(tmp_path, answer("backlash", 0.9, found()), truth(effect(raw=2.9)))
    assert not small["eligible"]
    assert "p_true" not in small


def test_the_achieved_shrink_is_in_the_machines_plane(tmp_path):
    off = np.tile([1e-5, -1e-5, 1e-3], (4, 1)) @ TURN.T  # along the machine's z it does not count
    across = np.tile([0.0, 0.0, 1e-3], (4, 1)) @ TURN.T
    with io.BytesIO() as stream:
        np.savez(stream, rows=np.arange(4), before_m=off, after_m=across + 0.3 * (off - across))
        data = stream.getvalue()
    given = {**answer("backlash", 0.9, found()), "withheld_sha256": hashlib.sha256(data).hexdigest()}
    assert row_of(tmp_path, given, truth(effect()), data)["achieved"] == pytest.approx(0.7)
    with pytest.raises(Tampered, match="rec002: its predictions were changed"):
        row_of(tmp_path, given, truth(effect()), data + b" ")


def test_measures_are_counted_by_hand(tmp_path):
    pair = (effect("backlash"), effect("latency", visible=0.6))
    cases = [
        (answer("backlash", 0.995, found(), found("latency", "")), truth(effect())),
        (answer("unknown", 0.999, backlash=0.001), truth(effect(places=("left", "right")))),
        (answer("latency", 0.6, found("latency"), backlash=0.4), truth(effect())),
        (answer("latency", 0.6, found("latency")), truth(effect(visible=0.4))),
        (answer("none", 0.9), truth(kind="null")),
        (answer("backlash", 0.9, found()), truth(kind="null")),
        (answer("unknown", 0.9), truth(effect("vibration_alias", ()), kind="outside")),
        (answer("backlash", 0.9, found()), truth(effect("vibration_alias", (), raw=1.0), kind="outside")),
        (answer("backlash", 0.9, found(), found("latency")), truth(*pair, kind="pair")),
        (answer("backlash", 0.9, found(), found("refraction", "")), truth(*pair, kind="pair")),
        ({"seconds": 1.0, "clock_seconds": 1.0, "error": "InputError: x"}, truth(effect("latency", ("right",)))),
    ]
    rows = [{**row_of(tmp_path, *case), "achieved": 0.53, "reached_with_truth": 0.6} for case in cases]
    by_name = {m["name"].strip(): m for m in figures(rows)["measures"]}
    for name, value, n in (
        ("visible single effects named right", 0.25, 4),
        ("another effect named", 0.25, 4),
        ("named right, with another effect beside it", 0.25, 4),
        ("called unknown", 0.25, 4),
        ("truth among the first three", 0.75, 4),
        ("null cases called an effect, declared right", 0.5, 2),
        ("effect of no catalogue called unknown, or its mimic", 1.0, 1),
        ("of any size, unknown", 0.5, 2),
        ("smaller single effects called another one", 1.0, 1),
        ("two effects: exact pair", 0.5, 2),
        ("two effects: at least one", 1.0, 2),
        ("right when p > 0.99", 0.5, 2),
        ("right when called unknown with p > 0.99", 0.0, 1),
        ("predicted minus achieved shrink within 0.05, where named", 1.0, 2),
        ("place right, where there is one", 1.0, 1),
        ("raw size within its U (k = 2), where named right", 1.0, 1),
        ("named right: one place", 1.0 / 3.0, 3),
        ("named right: several places", 0.0, 1),
        ("median shrink reached with what was found", 0.265, 4),
        ("with the true effect added", 0.6, 4),
        ("left on the table (median shrink with the truth, less)", 0.335, 4),
        ("diagnoses that failed", 1.0 / 11.0, 11),
    ):
        assert (by_name[name]["value"], by_name[name]["n"]) == (pytest.approx(value), n), name
    stated = [0.995, 0.001, 0.4, 0.9, 1e-6, 0.9]
    assert by_name["log score (mean -ln p of the truth)"]["value"] == pytest.approx(-np.mean(np.log(stated)))
    listed = misjudged(rows)
    assert len(listed) == 7
    assert "backlash at left,right (raw 5.0, visible 4.0): unknown (unknown 0.999, backlash 0.001)" in listed[0]
    assert any("below the sizes that count" in line for line in listed)
    assert any("latency at right (raw 5.0, visible 4.0): InputError: x" in line for line in listed)
