"""Joins truths and answers: one row a recording, in the form of the check on withheld cases."""

from __future__ import annotations

import hashlib
import io
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.independent.truths import Truth
from benchmarks.withheld.making import ELIGIBLE_RAW, ELIGIBLE_VISIBLE
from benchmarks.withheld.score_rows import Row, answerable
from benchmarks.withheld.scorer import Tampered, achieved, places_of, raw_sizes, score_case
from calibration.base.errors import InputError
from calibration.base.frame import station_frame
from calibration.base.plain_file import read_text
from calibration.base.toml_file import parse_toml
from calibration.diagnosis.diagnose import withheld_with
from calibration.recording.folder import read_folder
from calibration.recording.header import RecordingFile

KINDS = {"single": "effect", "null": "null", "pair": "pair", "outside": "outside"}
ONE_PLACE, SEVERAL_PLACES = "one place", "several places"
STEP_EFFECTS = ("foundation_settling", "smr_reseat")


def score(recordings: Path, name: str, answer: Mapping[str, Any], predictions: bytes | None, truth: Truth) -> Row:
    """The row of a recording; raises Tampered if the predictions are not those of the answer."""
    case = case_of(name, truth.entry)
    row = score_case(case, {"without": [], **answer})
    row.pop("true_kinds", None)  # those of the mock's forms; another simulator has its own
    if any("period_m" not in effect for effect in truth.entry["effects"]):
        row.pop("period_error", None)
    diagnosis = answer.get("diagnosis")
    row |= {"campaign": truth.entry["campaign"], "places": [list(e["places"]) for e in truth.entry["effects"]]}
    if diagnosis is None:
        return row
    if not answerable(row):
        row.pop("p_true", None)
    row["named_places"] = [places_of(found) for found in diagnosis["effects"]]
    if case["kind"] == "effect":
        row |= _of_single(truth.entry["effects"][0], diagnosis, _drive_of_strut(recordings / name / "machine.toml"))
    if predictions is not None:
        if hashlib.sha256(predictions).hexdigest() != answer["withheld_sha256"]:
            raise Tampered(f"{name}: its predictions were changed after they were made; run again with --fresh")
        turn = _turn(recordings / name / "recording.toml")
        with np.load(io.BytesIO(predictions), allow_pickle=False) as arrays:
            row |= achieved({"turn": turn}, arrays, truth.noise_free_m, truth.platform)
    return row


def reached_with_truth(recordings: Path, name: str, truth: Truth) -> float | None:
    """The shrink that the true effect reaches once it is in the model; None if the recording is unsuitable."""
    try:
        withheld = withheld_with(read_folder(recordings / name), {e["effect"] for e in truth.entry["effects"]})
    except InputError:
        return None
    turn = _turn(recordings / name / "recording.toml")
    reached = achieved({"turn": turn}, asdict(withheld), truth.noise_free_m, truth.platform)
    return reached.get("achieved")


def case_of(name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """A truth in the form that `score_case` takes. Sizes are those of the reflectors that the effect moves most."""
    facts = [_fact(effect) for effect in entry["effects"]]
    return {
        "key": name,
        "kind": KINDS[entry["kind"]],
        "effects": facts,
        "raw": _combined([f["raw"] for f in facts]),
        "visible": _combined([f["visible"] for f in facts]),
        "eligible": bool(facts) and all(f["raw"] >= ELIGIBLE_RAW and f["visible"] >= ELIGIBLE_VISIBLE for f in facts),
        "wanted_raw": [f["raw"] for f in facts],
        "profile": entry["disturbances"],
        "design": entry["campaign"],
    }


def _turn(header: Path) -> NDArray[np.float64]:
    """Rotation (3, 3) from the machine's to the station's axes; the rough heading does for an RMS in the plane."""
    station = parse_toml(read_text(header), RecordingFile, str(header)).station
    return station_frame(station.position_m, station.heading_rad).rotation


def _fact(effect: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "effect": effect["effect"],
        "variant": SEVERAL_PLACES if len(effect["places"]) > 1 else ONE_PLACE,
        "final": False,
        "place": "",  # compared below, where there may be several
        "raw": effect["raw_sigma"],
        "visible": effect["visible_sigma"],
        "plausible": False,  # no size of its own
        "period_m": effect.get("period_m", np.nan),
    }


def _combined(sizes: list[float]) -> float:
    return float(np.sqrt(np.sum(np.square(sizes))))


def _drive_of_strut(machine: Path) -> dict[str, str]:
    struts = tomllib.loads(machine.read_text(encoding="utf-8")).get("struts", [])
    return {strut["name"]: strut["drive"] for strut in struts}


def _of_single(
    effect: Mapping[str, Any], diagnosis: Mapping[str, Any], drive_of_strut: Mapping[str, str]
) -> dict[str, Any]:
    """Places, step and size of an effect that is found under its name, perhaps as several findings."""
    found = [f for f in diagnosis["effects"] if f["effect"] == effect["effect"]]
    if not found:
        return {}
    out: dict[str, Any] = {}
    named, true = {place for f in found for place in places_of(f)}, set(effect["places"])
    if named & drive_of_strut.keys() and not true & drive_of_strut.keys():
        # Where the truth says a drive, and the diagnosis struts, both struts of the drive are meant.
        true = {strut for strut, drive in drive_of_strut.items() if drive in true} or true
    if true:
        out |= {"place_right": bool(named) and named <= true, "places_right": named == true}
    quantities = {q["name"]: q["value"] for q in found[0]["others"]}
    if effect["effect"] in STEP_EFFECTS and "step_s" in effect:
        onset = quantities.get("onset_s")
        out["step_error_s"] = None if onset is None else onset - effect["step_s"]
    return out | raw_sizes(found, effect["raw_platform_sigma"])
