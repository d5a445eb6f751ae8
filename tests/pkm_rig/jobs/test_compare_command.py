"""`pkm-rig compare` as a user types it, on recordings straight from the plant."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from rich.console import Console

import pkm_rig
from benchmarks.comparison.change import Change
from calibration.comparison.result import ChangedQuantity, Comparison, FoundChange, WorkspaceChange
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.folder import read_folder, write_folder
from pkm_rig.jobs.compare import run_comparison
from pkm_rig.report.comparison_json import comparison_json
from pkm_rig.report.comparison_pictures import draw_all
from pkm_rig.report.comparison_text import describe_comparison
from tests.calibration.comparison.pairs import first, recorded


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two campaigns; between them a strut has become 80 um longer."""
    root = tmp_path_factory.mktemp("recordings")
    write_folder(first(), root / "before")
    write_folder(recorded(Change(length_m={2: 8e-5})), root / "after")
    return root


def text_of(comparison: Comparison, pictures: dict[str, str] | None = None) -> str:
    console = Console(width=200)
    with console.capture() as printed:
        console.print(describe_comparison(comparison, {"pictures": pictures or {}}))
    return printed.get()


def test_json_follows_its_schema_and_pictures_are_written(run, folders, tmp_path, request):
    schema = json.loads((request.config.rootpath / "docs" / "reference" / "comparison.schema.json").read_text())
    done = run("compare", folders / "before", folders / "after", "--json", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    jsonschema.validate(document, schema)
    assert (document["verdict"], document["place"]) == ("strut", "right_upper")
    assert document["machine_changed"]
    length = document["changes"][0]["quantities"]["length"]
    assert abs(length["value"] - 8e-5) < 4.0 * length["u"]
    assert document["workspace"]["rms_m"] == pytest.approx(document["changes"][0]["workspace"]["rms_m"])
    assert set(document["pictures"]) == {"workspace", "probabilities"}
    for path in map(Path, document["pictures"].values()):
        assert path.stat().st_size > 5000
        assert path.parent == tmp_path / "after" / "compared-with" / "before"


def test_python_and_the_command_say_the_same(folders, tmp_path):
    recordings = [read_folder(folders / name) for name in ("before", "after")]
    comparison, result = run_comparison(*recordings, tmp_path)
    assert (
        comparison_json(pkm_rig.compare(*recordings)) | {"pictures": result["pictures"], "simulated": False} == result
    )
    assert comparison.readings == (result["readings"]["before"], result["readings"]["after"])


def test_words_name_what_changed_and_what_it_does():
    comparison = example()
    text = text_of(comparison, {"workspace": "map.png"})
    assert "verdict: strut right_upper" in text
    assert "strut right_upper has changed (probability 0.951, 0.954 with what is not told apart from it)" in text
    assert "76.2 +- 2.1 um RMS, at most 83.1 um (21.0 um after a new zero)" in text
    assert "length = 80.1 +- 3.0 um" in text
    assert "not told apart from it (within 0.12 sigma RMS): the column of drive right" in text
    assert "ranking: strut 0.951, unknown 0.044" in text
    assert "note: look closer" in text
    assert "map.png" in text


def test_words_for_nothing_unknown_and_a_nest():
    nothing = example("nothing", changes=(), workspace=None, equivalent=())
    assert "nothing has changed (probability 0.951); what is hidden is below 3.0 um RMS (95 %)" in text_of(nothing)
    unknown = example("unknown", changes=(), workspace=None, equivalent=())
    assert "none of the known structures" in text_of(unknown)
    moved = FoundChange("nest", "P2", False, 0.95, 0.99, example().changes[0].quantities, 4.0, 1.0, None)
    nest = example("nest", changes=(moved,), workspace=None, equivalent=())
    assert "reflector or nest P2 has moved, by which the machine is measured, not the machine" in text_of(nest)
    assert set(draw_all(nest, planar())) == {"probabilities"}


@pytest.mark.parametrize("field", ["rms_m", "u_rms_m", "max_m", "rest_rms_m"])
def test_a_figure_that_is_not_finite_is_null(field):
    comparison = example()
    broken = WorkspaceChange(**{**vars(comparison.workspace), field: float("nan")})
    result = comparison_json(example(workspace=broken))
    assert result["workspace"][field] is None
    assert json.dumps(result, allow_nan=False)


def test_what_cannot_be_compared_is_refused_in_one_line(run, folders, tmp_path):
    twice = run("compare", folders / "before", folders / "before", "--out", tmp_path)
    assert twice.returncode == 2
    assert "the same campaign twice" in twice.stderr.splitlines()[-1]
    text = (folders / "after" / "machine.toml").read_text().replace("right_upper", "strut_c")
    renamed = tmp_path / "renamed"
    renamed.mkdir()
    for file in (folders / "after").iterdir():
        (renamed / file.name).write_bytes(file.read_bytes())
    (renamed / "machine.toml").write_text(text)
    other = run("compare", folders / "before", renamed, "--out", tmp_path)
    assert other.returncode == 2
    assert "struts have other names (right_upper, strut_c)" in other.stderr.splitlines()[-1]


def test_a_place_where_nothing_can_be_written_is_said(run, folders, tmp_path):
    (tmp_path / "after").write_text("in the way")
    done = run("compare", folders / "before", folders / "after", "--out", tmp_path)
    assert done.returncode == 2
    assert "choose another --out" in done.stderr.splitlines()[-1]


def planar():
    return load_machine(shipped_machine("planar4"))


def example(verdict: str = "strut", **other) -> Comparison:
    rng = np.random.default_rng(1)
    tool = np.zeros((40, 3))
    tool[:, :2] = rng.uniform(-0.3, 0.3, (40, 2))
    shift = np.zeros((40, 3))
    shift[:, :2] = 5e-5 + 1e-4 * tool[:, :2]
    workspace = WorkspaceChange(tool, shift, np.ones(40, dtype=bool), 7.62e-5, 1.05e-6, 8.31e-5, 2.1e-5)
    length = ChangedQuantity("length", 8.01e-5, 1.5e-6, "m")
    change = FoundChange("strut", "right_upper", True, 0.951, 0.9995, (length,), 6.1, 1.2, workspace)
    ranking = {"strut": 0.0, "nest": 0.0, "column": 0.003, "nothing": 0.001, "unknown": 0.044} | {verdict: 0.951}
    values = {
        "before": "spring", "after": "autumn", "verdict": verdict, "place": "right_upper",
        "equivalent": (("column", "right"),), "matters_sigma": 0.12, "ranking": ranking, "changes": (change,),
        "workspace": workspace, "hidden_m": 3e-6, "scatter": (0.99, 1.02), "readings": (500, 480),
        "remarks": ("look closer",),
    }  # fmt: skip
    return Comparison(**(values | other))
