"""`import printer.cfg` and `identify` as a user types them, on a printer of our own making and on published ones."""

from __future__ import annotations

import json
import sys
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from pkm_rig.cli import main
from tests.calibration.delta_reference import (
    DISTANCE_SD_MM,
    HEIGHT_SD_MM,
    TRUE,
    Rows,
    fit,
    from_json,
    left_out,
    misses,
    own_printer,
    printer_cfg,
)

CFG = Path(__file__).parents[2] / "data" / "printer.cfg"
REAL = sorted((Path(__file__).parents[4] / "shared" / "real-data").glob("*.json"))
Done = namedtuple("Done", ("returncode", "stdout", "stderr"))


@pytest.fixture
def run(monkeypatch, capsys):
    """One command, in this process."""

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["pkm-rig", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "140")
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return Done(int(ended.value.code or 0), printed.out, printed.err)

    return command


@pytest.fixture
def identified(run, tmp_path, request):
    """The result of importing and identifying the text of a printer.cfg."""
    schema = json.loads(
        (request.config.rootpath / "docs" / "reference" / "result.schema.json").read_text(encoding="utf-8")
    )

    def identify(text):
        (tmp_path / "p.cfg").write_text(text, encoding="utf-8")
        assert run("import", tmp_path / "p.cfg", tmp_path / "p").returncode == 0
        done = run("identify", tmp_path / "p", "--json")
        assert done.returncode == 0, done.stderr
        document = json.loads(done.stdout)
        jsonschema.validate(document, {**schema, "anyOf": [{"$ref": "#/$defs/identification"}]})
        return document

    return identify


def rms_mm(misses_mm):
    return float(np.sqrt(np.mean(np.square(misses_mm))))


def compare_with_the_classical_fit(found, delta, rows):
    """Residual, true leave-one-out refits and parameters of the owner's fit against the independent one, mm."""
    arms = bool(rows.distances)
    best = fit(delta, rows, arms)
    n = len(rows.heights)
    parts = {"z": slice(0, n)} | ({"distance": slice(n, None)} if arms else {})
    residual, left = misses(best, rows), left_out(best, rows, arms)
    former = found["former"]
    for name, part in parts.items():
        assert 1e3 * former["residual"][f"{name}_rms_m"] == pytest.approx(rms_mm(residual[part]), rel=1e-4), name
        assert 1e3 * former["leave_one_out"][f"{name}_rms_m"] == pytest.approx(rms_mm(left[part]), rel=5e-3), name
    fitted = {"delta_radius": best.radius / 1e3}
    for i, k in enumerate("abc"):
        fitted[f"stepper_{k} position_endstop"] = best.endstop[i] / 1e3
        fitted[f"stepper_{k} angle"] = np.radians(best.angle[i])
        fitted[f"stepper_{k} arm_length"] = best.arm[i] / 1e3
    for name, value in former["quantities"].items():
        # Linear in the joints' places, which moved by some 0.3 mm on 140 mm.
        assert value["value"] == pytest.approx(fitted[name], abs=0.02 * value["u"] + 2e-6), name
    return best


def test_own_printer_is_identified_as_the_classical_fit_does_and_holds_the_truth(identified):
    delta, rows = own_printer()
    identification = identified(CFG.read_text(encoding="utf-8"))
    compare_with_the_classical_fit(identification, delta, rows)
    assert identification["readings"] == {"heights": 13, "distances": 6}
    assert identification["former"]["bare_degrees_of_freedom"] == 10
    assert identification["former"]["degrees_of_freedom"] == pytest.approx(10.0, abs=0.01)
    assert 0.0 < identification["degrees_of_freedom"] < 10.0
    true = {"delta_radius": TRUE.radius / 1e3}
    for i, k in enumerate("abc"):
        true[f"stepper_{k} position_endstop"] = TRUE.endstop[i] / 1e3
        true[f"stepper_{k} angle"] = np.radians(TRUE.angle[i])
        true[f"stepper_{k} arm_length"] = TRUE.arm[i] / 1e3
    for fitted in (identification["former"]["quantities"], identification["quantities"]):
        assert len(fitted) == 9
        for name, value in fitted.items():
            assert abs(value["value"] - true[name]) < 3.0 * value["u"], name


def test_the_stated_uncertainty_covers_the_truth_as_often_as_it_says(tmp_path, identified):
    """Squared errors over squared uncertainty of the owner's parameters, over drawn noise."""
    _, rows = own_printer()
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        noisy = Rows(
            [(TRUE.tool(p)[2] + rng.normal(0.0, HEIGHT_SD_MM), p) for _, p in rows.heights],
            [
                (np.linalg.norm(TRUE.tool(p) - TRUE.tool(q)) + rng.normal(0.0, DISTANCE_SD_MM), p, q)
                for _, p, q in rows.distances
            ],
        )
        identification = identified(printer_cfg(replace(TRUE, radius=TRUE.radius + 0.1), noisy))
        radius = identification["former"]["quantities"]["delta_radius"]
        angle = identification["former"]["quantities"]["stepper_a angle"]
        ratios += [
            (radius["value"] - TRUE.radius / 1e3) / radius["u"],
            (angle["value"] - np.radians(TRUE.angle[0])) / angle["u"],
        ]
        for path in (tmp_path / "p").iterdir():
            path.unlink()
        (tmp_path / "p").rmdir()
    # Eight values of unit variance: chi-squared, 0.1 % to 99.9 %.
    assert 0.86 < np.sum(np.square(ratios)) < 26.1


@pytest.mark.skipif(not REAL, reason="published sets are not beside the repository")
@pytest.mark.parametrize("path", REAL, ids=lambda p: p.stem)
def test_published_printers(identified, path):
    delta, rows = from_json(json.loads(path.read_text(encoding="utf-8")))
    identification = identified(printer_cfg(delta, rows))
    compare_with_the_classical_fit(identification, delta, rows)
    former = identification["former"]
    parameters = 9 if rows.distances else 6
    assert former["parameters"] == parameters
    assert former["bare_degrees_of_freedom"] == len(rows.heights) + len(rows.distances) - parameters
    for fitted in (former, identification):
        for kind, residual in fitted["residual"].items():
            assert fitted["leave_one_out"][kind] > residual
    assert any("residual is no accuracy" in remark for remark in identification["remarks"])
    assert any("drive scale" in remark and "aliased" in remark for remark in identification["remarks"])
    assert identification["aliased"]
    if not rows.distances:
        assert former["leave_one_out"]["z_rms_m"] > 5.0 * former["residual"]["z_rms_m"]
        assert sorted(identification["alike"][0]) == ["axis_tilt", "bed.bowl", "drive_scale", "strut_length"]
        assert any("sag and play" in remark for remark in identification["remarks"])


@pytest.mark.skipif(not REAL, reason="published sets are not beside the repository")
@pytest.mark.parametrize("path", REAL, ids=lambda p: p.stem)
def test_published_printers_with_other_microsteps_are_refused(run, tmp_path, path):
    delta, rows = from_json(json.loads(path.read_text(encoding="utf-8")))
    refused_with_the_factor(run, tmp_path, replace(delta, step=delta.step / 4.0), rows, "4 times")


@pytest.mark.parametrize(("factor", "named"), [(2.0, "1/2 times"), (8.0, "1/8 times"), (0.5, "2 times")])
def test_own_printer_with_other_microsteps_is_refused(run, tmp_path, factor, named):
    delta, rows = own_printer()
    refused_with_the_factor(run, tmp_path, replace(delta, step=delta.step * factor), rows, named)


def refused_with_the_factor(run, tmp_path, delta, rows, named):
    (tmp_path / "p.cfg").write_text(printer_cfg(delta, rows), encoding="utf-8")
    assert run("import", tmp_path / "p.cfg", tmp_path / "p").returncode == 0
    done = run("identify", tmp_path / "p", "--json")
    assert done.returncode == 2
    assert done.stdout == ""
    assert f"; {named} the step distance would close them" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_import_says_where_and_identify_says_it_in_words(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    imported = json.loads(run("import", CFG, "--json").stdout)
    assert imported == {
        "campaign": "printer", "readings": 19, "heights": 13, "distances": 6, "folder": str(Path("runs/printer")),
    }  # fmt: skip
    assert sorted(p.name for p in Path("runs/printer").iterdir()) == [
        "coordinates.csv", "distances.csv", "machine.toml", "measurements.toml",
    ]  # fmt: skip
    done = run("identify", "printer")
    assert done.returncode == 0
    for words in (
        "delta_radius",
        "leave-one-out",
        "degrees of freedom left: 10 after the owner's 9 parameters",
        "directions of the machine decided by the data",
        "what else would make the owner's residual",
        "not told apart by these readings",
        "the readings leave open",
    ):
        assert words in done.stdout, words
    assert run("identify", "runs/printer", "--estimator", "least_squares").returncode == 0


@pytest.mark.parametrize(
    ("prepare", "arguments", "complaint"),
    [
        (None, ("import", "{cfg}", "{tmp}"), "exists already"),
        (None, ("import", "{tmp}", "{tmp}/new"), "only for what a printer.cfg holds"),
        (None, ("import", "{tmp}/none.cfg", "{tmp}/new"), "no such file or folder; check the path"),
        ("[printer]\nkinematics: corexy\n", ("import", "{tmp}/p.cfg", "{tmp}/new"), "only a linear delta"),
        ("no settings at all", ("import", "{tmp}/p.cfg", "{tmp}/new"), "[printer] delta_radius is missing"),
        ("good", ("identify", "{tmp}/p", "--estimator", "magic"), "estimator 'magic'"),
        ("good", ("identify", "{tmp}/p", "--estimator", "truncated_svd"), "use map"),
        ("few", ("identify", "{tmp}/p"), "6 readings leave no degrees of freedom for 6 parameters"),
        ("good", ("compensate", "{tmp}/p"), "recording.toml"),
    ],
)
def test_bad_input_is_one_line_and_status_2(run, tmp_path, prepare, arguments, complaint):
    if prepare is not None:
        delta, rows = own_printer()
        texts = {"good": printer_cfg(delta, rows), "few": printer_cfg(delta, Rows(rows.heights[:6], []))}
        (tmp_path / "p.cfg").write_text(texts.get(prepare, prepare), encoding="utf-8")
        if prepare in texts:
            assert run("import", tmp_path / "p.cfg", tmp_path / "p").returncode == 0
    done = run(*(a.format(cfg=CFG, tmp=tmp_path) for a in arguments))
    assert done.returncode == 2, done.stderr
    assert complaint in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
