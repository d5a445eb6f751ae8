"""Wrong readings planted into recordings of the mock plant: what they do to the identified machine, as one table.

    python -m benchmarks.outliers [--seeds 100] [--processes 2] [--out runs/outliers]

For every seed a recording is made; each case plants wrong readings into it. The prediction of the tool is compared with
that of a fit to the same recording without the planted rows; both are gated as always. Beside it: how many good
readings are lost where nothing is planted, with noise of a normal and of Student's distribution. A finished seed is on
disk before it counts: stop at any time, the same command goes on. Exit status 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.results_file import MixedSettingsError, ResultsFile
from benchmarks.side_by_side import side_by_side
from calibration.base.arrays import Array
from calibration.identification.calibration import Calibration, identify_recording
from calibration.identification.prediction import predict_poses
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import make_recording
from mock_devices.settings import MockSettings
from tests.kept_results import until_stopped

SETTINGS = {"machine": "planar4", "visits": 120, "poses": 80, "version": 1}
LIMIT_UM, SHARE = 0.15, 0.95
TAILS = 5.0  # degrees of freedom of Student's t
MOST_LOST = {"normal noise": 0.003, "Student t of 5 degrees of freedom": 0.01}
NOISE = {"normal noise": 0.0, "Student t of 5 degrees of freedom": TAILS}

Plant = Callable[[Recording, np.random.Generator], tuple[NDArray[np.intp], Array]]


def one_on(*parts: str) -> Plant:
    """One reading 10 mm off, on a reflector of some parts."""

    def plant(recording: Recording, rng: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
        on = {smr.name: smr.on for smr in recording.machine.smrs}
        rows = np.flatnonzero([on[name] in parts for name in recording["smr"].tolist()])
        return rng.choice(rows, 1), 1.0e-2 * _directions(rng, 1)

    return plant


def first_of_a_nest(recording: Recording, rng: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
    """The first reading of a nest 10 mm off: what all later checks are compared with."""
    names = sorted(smr.name for smr in recording.machine.smrs if smr.on == "floor")
    return np.flatnonzero(np.asarray(recording["smr"]) == rng.choice(names))[:1], 1.0e-2 * _directions(rng, 1)


def share_of(share: float) -> Plant:
    """A share of all readings 1 to 10 mm off, in any direction."""

    def plant(recording: Recording, rng: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
        count = max(1, round(share * len(recording)))
        rows = rng.choice(len(recording), count, replace=False)
        return rows, rng.uniform(1.0e-3, 1.0e-2, (count, 1)) * _directions(rng, count)

    return plant


def across(recording: Recording, rng: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
    """2 % of all readings 100 um off, across the line of sight."""
    count = round(0.02 * len(recording))
    rows = rng.choice(len(recording), count, replace=False)
    sight = recording.positions_m[rows] / np.linalg.norm(recording.positions_m[rows], axis=1)[:, None]
    shift = rng.standard_normal((count, 3))
    shift -= np.sum(shift * sight, axis=1)[:, None] * sight
    return rows, 1.0e-4 * shift / np.linalg.norm(shift, axis=1)[:, None]


CASES: dict[str, Plant] = {
    "one of 10 mm, on the platform": one_on("platform"),
    "one of 10 mm, on a slider": one_on("slider"),
    "one of 10 mm, on a nest": one_on("floor"),
    "one of 10 mm, a nest's first": first_of_a_nest,
    "0.2 % of 1 to 10 mm": share_of(0.002),
    "2 % of 1 to 10 mm": share_of(0.02),
    "2 % of 100 um across the line of sight": across,
}


def _directions(rng: np.random.Generator, count: int) -> Array:
    normal = rng.standard_normal((count, 3))
    return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def recorded(seed: int, noise_tails: float = 0.0) -> Recording:
    """The recording of a seed."""
    path = shipped_machine(str(SETTINGS["machine"]))
    options = DesignOptions(visits=int(SETTINGS["visits"]), poses=int(SETTINGS["poses"]))
    design = draw_design(read_machine_file(path), np.random.default_rng(seed), options)
    made = make_recording(path, MockSettings(seed=seed, noise_tails=noise_tails), design)
    columns = {n: c.astype(str) if c.dtype.kind in "US" else c.astype(np.float64) for n, c in made.columns.items()}
    return Recording(RecordingFile(**made.header), load_machine(path), columns)


def shifted(recording: Recording, rows: NDArray[np.intp], shift_m: Array) -> Recording:
    """The recording with some rows' positions off by (k, 3)."""
    columns = dict(recording.columns)
    for k, name in enumerate(("x_m", "y_m", "z_m")):
        columns[name] = columns[name].copy()
        columns[name][rows] += shift_m[:, k]
    return replace(recording, columns=columns)


def moved_um(one: Calibration, other: Calibration) -> float:
    """RMS distance of two predictions of the tool, each in its report frame, over the visits of the other."""
    visits = other.reduction.observations.visits
    poses = [predict_poses(identified.fit, identified.report, visits) for identified in (one, other)]
    position, _ = other.report.tool_error(*poses)
    moves = other.report.machine.commanded
    return float(np.sqrt(np.mean(np.sum(position[:, moves[moves < 3]] ** 2, axis=1)))) * 1e6


def run_case(recording: Recording, plant: Plant, rng: np.random.Generator) -> dict[str, float]:
    """How far the planted readings move the prediction; planted rows that were not found, good ones that were lost."""
    rows, shift_m = plant(recording, rng)
    gated = identify_recording(shifted(recording, rows, shift_m), baselines=False)
    reference = identify_recording(recording.take(np.delete(np.arange(len(recording)), rows)), baselines=False)
    planted = set(np.asarray(recording["uid"])[rows].tolist())
    named = {reading.name for reading in gated.reduction.left_out}
    return {
        "moved_um": moved_um(gated, reference),
        "planted": len(planted),
        "missed": len(planted - named),
        "lost": len(named - planted),
    }


def run_seed(seed: int) -> dict[str, Any]:
    """All cases of one seed."""
    recording = recorded(seed)
    rng = np.random.default_rng([seed, 2026])
    out: dict[str, Any] = {"seed": seed, "readings": len(recording)}
    out["cases"] = {name: run_case(recording, plant, rng) for name, plant in CASES.items()}
    out["lost"] = {
        name: len(identify_recording(recorded(seed, tails), baselines=False).reduction.left_out)
        for name, tails in NOISE.items()
    }
    return out


def summarise(rows: list[dict[str, Any]]) -> tuple[list[str], bool]:
    """The table, and whether every limit is kept."""
    lines = [f"| planted | within {LIMIT_UM} um | median, um | largest, um | not found | good ones lost |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    good = True
    for name in CASES:
        cases = [row["cases"][name] for row in rows]
        moved = np.array([case["moved_um"] for case in cases])
        within = int(np.sum(moved <= LIMIT_UM))
        good = good and within >= SHARE * len(rows)
        planted, missed, lost = (sum(case[key] for case in cases) for key in ("planted", "missed", "lost"))
        lines.append(
            f"| {name} | {within} of {len(rows)} | {np.median(moved):.3f} | {moved.max():.2f} | "
            f"{missed} of {planted} | {lost} |"
        )
    lines += ["", "| nothing planted | good readings lost | at most |", "| --- | --- | --- |"]
    total = sum(row["readings"] for row in rows)
    for name, most in MOST_LOST.items():
        lost = sum(row["lost"][name] for row in rows)
        good = good and lost <= most * total
        lines.append(f"| {name} | {lost} of {total} ({100.0 * lost / total:.3f} %) | {100.0 * most:g} % |")
    return lines, good


def main() -> int:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100, help="seeds 1 to this")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/outliers"))
    options = parser.parse_args()
    file = ResultsFile(options.out / "outliers.jsonl", SETTINGS)
    try:
        done = {row["seed"] for row in file.rows()}
    except MixedSettingsError as error:
        print(f"outliers: {error}", file=sys.stderr)
        return 2
    _run([seed for seed in range(1, options.seeds + 1) if seed not in done], file, options.processes)
    lines, good = summarise([row for row in file.rows() if row["seed"] <= options.seeds])
    print("\n".join(lines))
    return 0 if good else 1


def _run(seeds: list[int], file: ResultsFile, processes: int) -> None:
    """Run seeds side by side; each result is stored as soon as it is there."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # taken up by the spawned processes, which load numpy anew
    started = time.monotonic()
    with side_by_side(run_seed, [(seed,) for seed in seeds], processes) as running:
        for count, future in enumerate(as_completed(running), start=1):
            file.append(future.result())
            passed = (time.monotonic() - started) / 60.0
            left = passed / count * (len(seeds) - count)
            print(f"{count} of {len(seeds)}; {passed:.1f} min, {left:.1f} left", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(until_stopped(main))
