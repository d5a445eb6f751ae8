"""`pkm-rig diagnose` as a user types it, on recordings straight from the plant."""

from __future__ import annotations

import json
import shutil
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from rich.console import Console

from calibration.base.errors import InputError
from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.settings import VERDICT
from calibration.machine.description import shipped_machine
from calibration.recording.folder import read_folder
from calibration.recording.header import DeclaredLevels
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.files import write_recording
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import DisturbanceLevels, MockSettings
from pkm_rig.jobs import diagnose, many_campaigns
from pkm_rig.report import diagnosis_text
from pkm_rig.report.diagnosis_json import diagnosis_attempt_json
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.rig.visits_file import with_visits
from pkm_rig.virtual.mock_rig import TwinFiles, embedded_mock_rig
from pkm_rig.virtual.twin_files import find_twin, read_twin
from tests.pkm_rig.diagnosis_example import example

MACHINE = shipped_machine("planar4")


@dataclass
class Added:
    """Where a diagnosis was written, and what was found."""

    out: Path
    found: Diagnosis
    result: dict


def record(folder, *effects, visits=100, platform_only=False):
    nominal = read_machine_file(MACHINE)
    options = DesignOptions(visits=visits, poses=60, platform_only=platform_only)
    settings = MockSettings(seed=4, effects=effects, nuisance=DisturbanceLevels(1e-5, 0.0, 0.0, 0.02))
    design = draw_design(nominal, np.random.default_rng(4), options)
    write_recording(SimulatedCampaign(MACHINE, settings, design).record(folder.name), folder)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording with 40 um of backlash at the right drive."""
    return record(tmp_path_factory.mktemp("recordings") / "backlash", EffectChoice("backlash", 4e-5, "right"))


@pytest.fixture(scope="module")
def added(folder, tmp_path_factory):
    """The same recording diagnosed, its twin written."""
    out = tmp_path_factory.mktemp("out")
    found, result = diagnose.run_diagnosis(read_folder(folder), out, add=True)
    return Added(out, found, result)


def test_disturbances_are_estimated_from_a_quiet_campaign_only(run, folder, tmp_path):
    refused = run("diagnose", folder, "--estimate-disturbances", "--out", tmp_path)
    assert refused.returncode == 2
    assert "not a quiet campaign, the diagnosis says 'backlash'" in refused.stderr
    quiet = record(tmp_path / "quiet", visits=40)
    done = run("diagnose", quiet, "--estimate-disturbances", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    levels = tomllib.loads(done.stdout)["nuisance"]
    printed = json.loads(run("diagnose", quiet, "--estimate-disturbances", "--json").stdout)
    found = printed["nuisance"]
    told = {key for key, level in found.items() if level["told_by_readings"]}
    assert set() < told < set(found)
    assert DeclaredLevels(**levels).model_dump() == {key: pytest.approx(found[key]["value"], rel=0.05) for key in told}
    assert f"# from campaign {printed['campaign']}" in done.stdout
    assert printed["verdict_at_declared_levels"] == "none"
    assert found["drift_m"]["low"] < 1e-5 < found["drift_m"]["high"]
    both = run("diagnose", quiet, "--estimate-disturbances", "--add")
    assert both.returncode == 2
    assert "leave out --add" in both.stderr


def test_levels_that_would_hide_an_effect_say_so(run, tmp_path):
    small = record(tmp_path / "small", EffectChoice("backlash", 1e-5, "right"), visits=60)
    header = small / "recording.toml"
    header.write_text("simulated = true\n" + header.read_text(encoding="utf-8"), encoding="utf-8")
    done = run("diagnose", small, "--estimate-disturbances", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "# from campaign small, SIMULATED" in done.stdout
    assert "at the levels that it declares the diagnosis says 'backlash'" in done.stdout
    assert set(tomllib.loads(done.stdout)) == {"nuisance"}
    printed = json.loads(run("diagnose", small, "--estimate-disturbances", "--json").stdout)
    assert (printed["simulated"], printed["verdict_at_declared_levels"]) == (True, "backlash")


def test_json_names_the_effect_its_place_and_its_size(run, folder, tmp_path, request):
    schema = json.loads((request.config.rootpath / "docs" / "reference" / "diagnosis.schema.json").read_text())
    done = run("diagnose", folder, "--json", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    jsonschema.validate(document, schema)
    assert document["verdict"] == "backlash"
    (effect,) = document["effects"]
    assert (effect["effect"], effect["place"], effect["unit"]) == ("backlash", "right", "m")
    assert abs(effect["value"] - 4e-5) < 4.0 * effect["u"] + 2e-6
    assert document["gap"]["after_m"] < 0.5 * document["gap"]["before_m"]
    assert sum(document["ranking"].values()) == pytest.approx(1.0)
    assert document["twin"] is None
    assert set(document["pictures"]) >= {"error-map", "coordinates", "time-line"}
    assert all(Path(path).stat().st_size > 5000 for path in document["pictures"].values())


def test_the_next_measurements_can_be_measured(added):
    result = added.result
    file, machine = load_rig(embedded_rig_path())
    files = [c["file"] for c in result["next_measurement"] if c["visits"]]
    assert files
    for path in files:
        blocks = calibration_blocks(machine, with_visits(file, Path(path), machine).campaign)
        assert sum(len(block.visits) for block in blocks) >= 2


def test_words_say_the_same(added):
    console = Console(width=200)
    with console.capture() as printed:
        console.print(diagnosis_text.describe_diagnosis(added.found, added.result))
    words = " ".join(printed.get().split())
    for part in (
        "verdict: backlash",
        "at right",
        "shrink",
        "noise floor",
        "campaign simulated on twins built without each region's readings",
        f"shrink {100.0 * added.result['twin']['shrink']:.0f} % (noise included",
        "pictures: ",
    ):
        assert part in words


def test_the_store_gives_the_same_as_the_folder(run, folder, added):
    out, by_folder = added.out, added.result
    run("import", folder, "--out", out)
    by_id = json.loads(run("diagnose", "backlash", "--json", "--add", "--out", out).stdout)
    assert by_id == json.loads(json.dumps(by_folder))


def test_a_diagnosis_within_a_calibration_is_the_same(added, folder):
    attempt = diagnose.try_diagnosis(read_folder(folder))
    assert attempt.failure == ""
    assert diagnosis_attempt_json(attempt)["ranking"] == added.result["ranking"]
    assert diagnosis_line(attempt).startswith("diagnosis: backlash at right")


def test_the_twin_comes_closer_to_the_withheld_readings(added):
    out, twin = added.out, added.result["twin"]
    assert twin["folder"] == str(out / "backlash" / "twin")
    assert twin["effects"] == ["backlash"]
    assert twin["after_m"] < 0.5 * twin["before_m"]
    assert twin["after_sigma"] < twin["before_sigma"]
    # Simulated, not the linear figures again: alike, but not the same.
    gap = added.result["gap"]
    assert twin["before_m"] == pytest.approx(gap["before_m"], rel=0.06)
    assert twin["shrink"] == pytest.approx(gap["shrink"], abs=0.06)
    assert twin["before_m"] != gap["before_m"]
    assert (twin["noise_floor_m"], twin["withheld"]) == (gap["noise_floor_m"], gap["withheld"])
    assert find_twin("backlash", out) == find_twin(twin["folder"], Path("nowhere")) == Path(twin["folder"])


def test_a_served_twin_has_the_backlash(added):
    out, result = added.out, added.result
    rig_path = embedded_rig_path()
    file, machine = load_rig(rig_path)
    at = np.array([1.15, 1.20])
    with (
        embedded_mock_rig(file, rig_path, twin=TwinFiles(find_twin("backlash", out))) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
    ):
        rig.enable()
        places = []
        for side in (-1.0, 1.0):
            rig.move(at - 0.01 * side * np.array([0.0, 1.0]), 0.2)
            rig.move(at, 0.2)
            rig.clock.sleep_s(4.0)
            plant = mock.mock.plant
            seen = plant.sightings(rig.clock.now_s())
            places.append({s.name: s.polar for s in seen})
    below, above = places[1]["SR"], places[0]["SR"]
    moved = np.hypot(below.v_rad - above.v_rad, below.hz_rad - above.hz_rad) * below.distance_m
    assert moved == pytest.approx(result["effects"][0]["value"], abs=8e-6)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "[]",
        lambda text: "{",
        lambda text: "[" * 100_000,
        lambda text: text.replace('"format": 1', '"format": 2'),
        lambda text: '{"format": 1, "twin": null}',
        lambda text: '{"format": 1, "twin": {}}',
        lambda text: '{"format": 1, "twin": [1, 2]}',
        lambda text: '{"format": 1, "twin": {"x": NaN}}',
        lambda text: text + " " * 100_000_001,
    ],
)
def test_a_twin_is_read_as_hostile_input(added, tmp_path, spoil):
    place = tmp_path / "twin"
    shutil.copytree(added.result["twin"]["folder"], place)
    read_twin(place)
    path = place / "twin.json"
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError) as caught:
        read_twin(place)
    assert "\n" not in str(caught.value)


def test_a_twin_of_another_machine_is_not_served(added, tmp_path):
    place = tmp_path / "twin"
    shutil.copytree(added.result["twin"]["folder"], place)
    text = (place / "machine.toml").read_text()
    (place / "machine.toml").write_text(text.replace('"SL"', '"SX"'))
    file, _ = load_rig(embedded_rig_path())
    with (
        pytest.raises(InputError, match="are not the rig file's"),
        embedded_mock_rig(file, embedded_rig_path(), twin=TwinFiles(place)),
    ):
        pass


def test_an_effect_of_ones_own(run, folder, tmp_path):
    own = tmp_path / "mine.py"
    text = (Path(__file__).parents[3] / "docs" / "explanation" / "diagnosis.md").read_text(encoding="utf-8")
    own.write_text(text.split("```python\n")[1].split("```")[0])
    done = run("diagnose", folder, "--json", "--effects", own, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert "stick" in {**document["ranking"], **document["not_tested"]}
    assert document["verdict"] == "backlash"


BROKEN = """
from calibration.effects.base import Effect, Parameter
def forms(setting, place):
    return setting.nothing_such
EFFECTS = (Effect("mine", "rig", Parameter("size_m", 1e-6, 1e-4, "m", ""), "", (), forms),)
"""


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (None, "mine.py"),
        ("x = 1", "EFFECTS"),
        ("import nothing_of_that_name", "nothing_of_that_name"),
        (BROKEN, "nothing_such"),
    ],
)
def test_an_unfit_effect_of_ones_own_is_one_line(run, folder, tmp_path, text, complaint):
    own = tmp_path / "mine.py"
    if text is not None:
        own.write_text(text)
    done = run("diagnose", folder, "--effects", own, "--out", tmp_path)
    assert done.returncode == 2, done.stderr
    assert complaint in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr


def change(column, row, value):
    def spoil(place):
        lines = (place / "readings.csv").read_text().splitlines()
        cells = lines[row].split(",")
        cells[lines[0].split(",").index(column)] = value
        lines[row] = ",".join(cells)
        (place / "readings.csv").write_text("\n".join(lines) + "\n")

    return spoil


def keep_rows(wanted):
    def spoil(place):
        head, *rows = (place / "readings.csv").read_text().splitlines()
        names = head.split(",")
        kept = [row for i, row in enumerate(rows) if wanted(i, dict(zip(names, row.split(","), strict=True)))]
        (place / "readings.csv").write_text("\n".join([head, *kept]) + "\n")

    return spoil


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (change("x_m", 7, "nan"), "not finite"),
        (change("left_torque_ratio", 7, "inf"), "not finite"),
        (change("smr", 7, "P9"), "P9"),
        (keep_rows(lambda i, row: False), "no readings"),
        (keep_rows(lambda i, row: row["phase"] == "nests"), ""),
        (keep_rows(lambda i, row: i < 22), "measure 6 or more"),
        (keep_rows(lambda i, row: 0 <= int(float(row["visit"])) < 12), "measure 20 or more"),
        (lambda place: (place / "machine.toml").unlink(), "machine.toml"),
        (shutil.rmtree, "is no folder of a recording"),
    ],
)
def test_a_recording_that_is_not_fit_is_one_line_with_what_to_do(run, folder, tmp_path, spoil, complaint):
    place = tmp_path / "spoilt"
    shutil.copytree(folder, place)
    spoil(place)
    done = run("diagnose", place, "--out", tmp_path / "out")
    assert done.returncode == 2, done.stderr
    assert complaint in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    "spoil",
    [
        keep_rows(lambda i, row: row["smr"] not in ("SL", "SR") and int(float(row["visit"])) < 60),
        keep_rows(lambda i, row: row["phase"] != "nests" and int(float(row["visit"])) < 60),
        keep_rows(lambda i, row: row["payload"] in ("0", "0.0")),
        keep_rows(lambda i, row: row["left_direction"] in ("1", "1.0", "0.0")),
    ],
    ids=["no reflectors on the sliders", "no nests", "one payload", "one side"],
)
def test_a_poorer_campaign_is_diagnosed_or_says_what_is_missing(folder, tmp_path, spoil, request):
    place = tmp_path / "poor"
    shutil.copytree(folder, place)
    spoil(place)
    attempt = diagnose.try_diagnosis(read_folder(place))
    assert "internal error" not in attempt.failure
    if attempt.diagnosis is not None:
        document = diagnosis_attempt_json(attempt)
        assert document["verdict"] in document["ranking"]
        if "one side" in request.node.name:
            assert "backlash" in document["not_tested"]


def test_where_nothing_can_be_written_is_one_line(run, folder, tmp_path):
    (tmp_path / "file").write_text("")
    done = run("diagnose", folder, "--out", tmp_path / "file" / "runs")
    assert done.returncode == 2
    assert "choose another --out" in done.stderr


def test_an_imported_printer_is_diagnosed_in_words(run, tmp_path):
    done = run("import", Path(__file__).parents[2] / "data" / "printer.cfg", tmp_path / "delta", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    done = run("diagnose", tmp_path / "delta", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "verdict: none" in done.stdout
    assert "backlash: coordinates.csv has no column a_direction" in done.stdout


def test_a_twin_that_is_not_there_is_one_line(run, tmp_path):
    done = run("mock", "--rig", embedded_rig_path(), "--twin", "nothing", "--out", tmp_path)
    assert done.returncode == 2
    assert "pkm-rig diagnose nothing --add" in done.stderr


def test_a_candidate_that_cannot_be_written_does_not_lose_the_diagnosis(monkeypatch, folder, tmp_path):
    first, *others = example().next_measurement
    too_long = replace(first, visits=tuple(replace(visit, dwell_s=1000.0) for visit in first.visits))
    found = replace(example(), next_measurement=(too_long, *others))
    monkeypatch.setattr(diagnose, "diagnose", lambda *_, work: found)
    diagnosis, result = diagnose.run_diagnosis(read_folder(folder), tmp_path)
    assert [entry["file"] for entry in result["next_measurement"]] == [None, None]
    assert diagnosis.remarks[:-1] == found.remarks
    assert diagnosis.remarks[-1].startswith("no campaign file for 'other dwell': dwell_s = 1000")
    assert result["remarks"] == list(diagnosis.remarks)


@pytest.mark.parametrize("options", [{}, {"add": True}])
def test_a_thorough_one_leaves_out_no_search(monkeypatch, folder, tmp_path, options):
    """Whether the twin is written or not, of one campaign or of all."""
    asked = []

    def asked_for(*_, work):
        asked.append(work)
        raise InputError("enough")

    for name in ("diagnose", "diagnose_and_score"):
        monkeypatch.setattr(diagnose, name, asked_for)
    for thorough in (False, True):
        with pytest.raises(InputError, match="enough"):
            diagnose.run_diagnosis(read_folder(folder), tmp_path, thorough=thorough, **options)
        with pytest.raises(InputError, match="enough"):
            many_campaigns._diagnose(read_folder(folder), [], bool(options), thorough)
    assert asked == [VERDICT.search_work] * 2 + [np.inf] * 2
