"""Joins truth and answers of a batch: one row a case, plain data that outlives the recordings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld.channel_sizes import compared
from benchmarks.withheld.coordinates import first_kind, true_kinds
from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import withheld_with
from calibration.effects.catalogue import load_catalogue
from calibration.recording.folder import read_folder

Array = NDArray[np.float64]

MOST_RANKED = 6
STEPS = {"foundation_settling": ("step",), "smr_reseat": ("step", "put_back")}
PERIODIC = ("screw_periodic_error", "encoder_interpolation")
NONE, UNKNOWN = "none", "unknown"
WHOLE = "whole"  # the arm of a case that is diagnosed again with the whole catalogue
GROSS = "gross"  # that of a case whose verdict was sure, with gross readings
LEAST_P = 1.0e-6  # log score of an answer that was called impossible
WORTH_ADDING = 1.0  # sigma, visible: what the true effect in the model would have reached
AS_SCORED = ("verdict", "equivalent", "named", "ranked", "p")  # what is kept of that answer


class Tampered(RuntimeError):
    """Answers are not those for which the truth was given."""


def score_batch(folder: Path) -> list[dict[str, Any]]:
    """Rows of a sealed batch: answers/, longer/answers/ and truth.json with its arrays; raises Tampered."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    if fixed_answers(folder) != truth["answers_sha256"]:
        raise Tampered(f"{folder}: answers are not those that the maker was given the hash of")
    arrays = np.load(folder / "truth.npz")
    answers = json.loads((folder / "answers" / "answers.json").read_text(encoding="utf-8"))
    longer_file = folder / "longer_answers" / "answers.json"
    longer = json.loads(longer_file.read_text(encoding="utf-8")) if longer_file.exists() else {}
    rows = []
    for name, case in sorted(truth["cases"].items()):
        answer = answers[name]
        row = score_case(case, answer)
        if f"{name}_change" in arrays:
            row["at_channels"] = _at_channels(folder / "recordings" / name, row, answer, arrays[f"{name}_change"])
        predictions = folder / "answers" / f"{name}.npz"
        if predictions.exists():
            data = predictions.read_bytes()
            if hashlib.sha256(data).hexdigest() != answer["withheld_sha256"]:
                raise Tampered(f"{predictions}: was changed after the answers were fixed")
            true = (arrays[name], arrays[f"{name}_rows"])
            row |= achieved(case, np.load(predictions), *true)
            if case["kind"] == "effect" and case["visible"] >= WORTH_ADDING:
                row["reached_with_truth"] = reached_with_truth(folder / "recordings" / name, case, *true)
        for retry, of in truth["longer"].items():
            if of["of"] == name and of["arm"] == WHOLE:
                again = score_case(case, longer[retry])
                row[WHOLE] = {key: again[key] for key in AS_SCORED}
            elif of["of"] == name and of["arm"] == GROSS:
                row["held_against_gross"] = verdict(longer[retry]) == verdict(answer)
            elif of["of"] == name:
                row[f"after_{of['arm']}"] = in_class(case, longer[retry])
        rows.append(row)
    return rows


def fixed_answers(folder: Path) -> str:
    """SHA-256 of all answers of a batch, the second round's included."""
    digest = hashlib.sha256((folder / "answers" / "answers.json").read_bytes())
    longer = folder / "longer_answers" / "answers.json"
    if longer.exists():
        digest.update(longer.read_bytes())
    return digest.hexdigest()


def score_case(case: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    """What a case's answer is worth, without its predictions."""
    facts = case["effects"]
    row: dict[str, Any] = {
        "key": case["key"],
        "kind": case["kind"],
        "true": [f["effect"] for f in facts],
        "variant": [f["variant"] for f in facts],
        "places": [f.get("places", []) for f in facts],
        "final": any(f["final"] for f in facts),
        "raw": case["raw"],
        "visible": case["visible"],
        "eligible": case["eligible"],
        "wanted_raw": case["wanted_raw"],
        "profile": case["profile"],
        "design": case["design"],
        "declared": case.get("declared", "right"),
        "gross": case.get("gross", False),
        "without": answer["without"],
        "left_out": case.get("left_out", {}),
        "decoys": case.get("decoys", []),
        "mimics_sigma": case.get("mimics_sigma", {}),
        "seconds": answer["seconds"],
        "clock_seconds": answer["clock_seconds"],
        "baselines": answer.get("baselines", {}),
        "error": answer.get("error", ""),
    }
    diagnosis = answer.get("diagnosis")
    if diagnosis is None:
        return {**row, "verdict": "", "equivalent": [], "named": [], "ranked": [], "p": 0.0, "first_kind": ""}
    ranked = sorted(diagnosis["ranking"].items(), key=lambda pair: -pair[1])
    if len(facts) < 2:
        row["p_true"] = max(float(diagnosis["ranking"].get(only_answer(case), 0.0)), LEAST_P)
    named = [effect["effect"] for effect in diagnosis["effects"]]
    row |= {
        "verdict": diagnosis["verdict"],
        "equivalent": diagnosis["equivalent"],
        "named": named,
        "ranked": [[name, p] for name, p in ranked[:MOST_RANKED]],
        "p": min(max(diagnosis["ranking"].get(diagnosis["verdict"], 0.0), 0.0), 1.0),
        "not_tested": sorted(set(diagnosis["not_tested"]) & set(row["true"])),
        "hidden_m": diagnosis["hidden_m"],
        "shrink": diagnosis["gap"]["shrink"],
        "shrink_interval": diagnosis["gap"]["shrink_interval"],
        "gap": diagnosis["gap"],
        "first_kind": first_kind(diagnosis["where"]),
        "evidence": diagnosis.get("evidence"),
    }
    if len(facts) == 1:
        row |= _details(facts[0], diagnosis)
    return row


def _details(fact: dict[str, Any], diagnosis: dict[str, Any]) -> dict[str, Any]:
    """Place, step time, period and coordinate of one true effect."""
    out: dict[str, Any] = {}
    kinds = true_kinds(fact["effect"], fact["variant"])
    if kinds:
        out["true_kinds"] = list(kinds)
    same = [effect for effect in diagnosis["effects"] if effect["effect"] == fact["effect"]]
    if not same:
        return out
    effect = same[0]
    several = len(fact.get("places", [])) > 1
    if several:
        named, true = {place for found in same for place in places_of(found)}, set(fact["places"])
        out |= {"place_right": bool(named) and named <= true, "places_right": named == true}
    elif fact["place"]:
        out["place_right"] = effect["place"] == fact["place"]
        out["place_p"] = effect["place_probability"]
    if fact["plausible"]:
        out |= raw_sizes(same, fact["raw"])
        if not several and effect["size"]["name"] == fact["size_name"] and effect["size"]["u"] > 0.0:
            off = abs(effect["size"]["value"]) - abs(fact["size"])
            out["size_error_u"] = off / effect["size"]["u"]
    quantities = {q["name"]: q["value"] for q in (effect["size"], *effect["others"])}
    if fact["variant"] in STEPS.get(fact["effect"], ()) and "onset_s" in fact:
        out["step_error_s"] = _difference(quantities.get("onset_s"), fact["onset_s"])
    if fact["effect"] in PERIODIC and "period_m" in fact:
        error = _difference(quantities.get("period_m"), fact["period_m"])
        out["period_error"] = None if error is None else error / fact["period_m"]
    return out


def _at_channels(recording: Path, row: dict[str, Any], answer: dict[str, Any], change_m: Array) -> list[dict[str, Any]]:
    """Where the verdict names the true effect of one place: what it does at its channels, as stated and in truth."""
    if row["verdict"] != row["true"][0] or len(row["places"][0]) > 1:
        return []
    found: dict[str, Any] = next((e for e in answer["diagnosis"]["effects"] if e["effect"] == row["verdict"]), {})
    return compared(recording, found, change_m)


def places_of(found: Mapping[str, Any]) -> list[str]:
    """Where a diagnosis says that an effect is."""
    if found.get("places"):
        return [place["place"] for place in found["places"]]
    return [found["place"]] if found["place"] else []


def only_answer(case: dict[str, Any]) -> str:
    """The right verdict of a case with one effect or none."""
    return {"null": NONE, "outside": UNKNOWN}.get(case["kind"]) or str(case["effects"][0]["effect"])


def verdict(answer: dict[str, Any]) -> str:
    """The verdict of an answer; empty if the diagnosis failed."""
    return str(answer["diagnosis"]["verdict"]) if "diagnosis" in answer else ""


def raw_sizes(found: Sequence[Mapping[str, Any]], true: float) -> dict[str, float]:
    """Raw size of an effect, as one or several findings, with its standard uncertainty, beside the true one."""
    sizes = np.array([f["size"]["value"] for f in found], dtype=np.float64)
    u = np.array([f["size"]["u"] for f in found], dtype=np.float64)
    raw = np.array([f["raw_sigma"] for f in found], dtype=np.float64)
    if not (np.all(sizes != 0.0) and np.all(np.isfinite(u)) and np.any(raw > 0.0)):
        return {}
    # At different places their shifts hardly correlate: squares add up.
    together = float(np.linalg.norm(raw))
    return {"raw_named": together, "raw_true": true, "raw_u": float(np.linalg.norm(raw**2 * u / sizes)) / together}


def _difference(diagnosis: float | None, true: float) -> float | None:
    return None if diagnosis is None or not np.isfinite(diagnosis) else diagnosis - true


def achieved(case: dict[str, Any], predictions: Any, noise_free_m: Array, platform: NDArray[np.intp]) -> dict[str, Any]:
    """Achieved shrink: predictions against the plant's noise-free readings, in the plane, platform reflectors."""
    rows = np.asarray(predictions["rows"], dtype=np.intp)
    keep = np.isin(rows, platform)
    turn = np.array(case["turn"])
    out: dict[str, Any] = {"predicted_share": float(np.mean(np.isin(platform, rows)))}
    sizes = []
    for name in ("before_m", "after_m"):
        error = (np.asarray(predictions[name])[keep] - noise_free_m[rows[keep]]) @ turn
        sizes.append(float(np.sqrt(np.mean(error[:, :2] ** 2))) if np.any(keep) else float("nan"))
    if np.all(np.isfinite(sizes)) and sizes[0] > 0.0:
        out |= {"before_m": sizes[0], "after_m": sizes[1], "achieved": 1.0 - sizes[1] / sizes[0]}
    return out


def reached_with_truth(
    recording: Path, case: dict[str, Any], noise_free_m: Array, platform: NDArray[np.intp]
) -> float | None:
    """The shrink that the true effect reaches once it is in the model, with the forms that the case may use; None if
    the recording is unsuitable."""
    catalogue = load_catalogue().without_forms([*case.get("left_out", {}), *case.get("decoys", [])])
    try:
        withheld = withheld_with(read_folder(recording), {f["effect"] for f in case["effects"]}, catalogue)
    except InputError:
        return None
    reached = achieved(case, asdict(withheld), noise_free_m, platform).get("achieved")
    return None if reached is None else float(reached)


def in_class(case: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Whether verdict or class holds the truth."""
    diagnosis = answer.get("diagnosis")
    return diagnosis is not None and case["effects"][0]["effect"] in (diagnosis["verdict"], *diagnosis["equivalent"])
