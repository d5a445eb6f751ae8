"""Mock machines of one kind through the main job over the real protocols, each scored by its plant's own truth.

The calibration sees readings only. After each run the plant is asked where the reflectors truly were, drift-free and
without noise, in a frame fitted to those places as the definitions ask. Results are kept as they come: stopped, it goes
on.

    python -m benchmarks.machine_check gough8 [--seeds 1,2,3] [--workers 2] [--out runs/machine-check]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibrated_mock import calibrated_mock
from benchmarks.results_file import ResultsFile, code_digest
from benchmarks.side_by_side import end_with_parent
from calibration.base.errors import InputError
from calibration.identification.calibration import pose_u
from calibration.identification.prediction import predict_poses
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.machine.description import COORDINATES
from calibration.reduction.figures import figure_axes
from calibration.reduction.reduction import Reduction
from calibration.reduction.report_frame import ReportFrame, fit_report_frame
from mock_devices.rig import MockRig
from pkm_rig.jobs.session import pin_to_one_core
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.config import demo_rig_path, load_rig
from tests.kept_results import until_stopped

SEEDS = tuple(range(1, 11))
LEAST_FALL = {  # of position and rotation; None: what is not corrected, or not asked
    "gough8": (6.0, 6.0),
    "delta8": (8.0, None),
    "prs3": (3.0, 6.0),
    "rrr4": (4.0, 8.0),
}
MOST_OVER_BOUND = 1.3
SLACK = 0.1
ROUNDING_M, ROUNDING_RAD = 0.02e-6, 0.1e-6  # of drives' increments and of the stored floats
PROGRAMS = (
    "calibration",
    "drivers",
    "mock_devices",
    "pkm_rig",
    "benchmarks/machine_check.py",
    "benchmarks/calibrated_mock.py",
)


def run_seed(machine_name: str, seed: int, out: Path) -> dict[str, Any]:
    """One machine: calibrate it, then ask its plant. SI units."""
    folder = out / f"{machine_name}-{seed}-{int(time.time())}"
    with calibrated_mock(demo_rig_path(machine_name), seed, folder) as run:
        outcome, truth = run.outcome, score(run.outcome, run.mock)
    return {
        "seed": seed,
        "accepted": outcome.accepted,
        "host_s": run.host_s,
        "rig_h": run.rig_time_s / 3600.0,
        "readings": len(outcome.reduction.recording),
        "floor": outcome.floor.as_dict(),
        "payloads": [
            {"kg": v.payload_kg, "before": v.before.as_dict(), "after": v.after.as_dict(), **truth[v.payload]}
            for v in outcome.verified
        ],
    }


def score(outcome: CampaignOutcome, mock: MockRig) -> dict[int, dict[str, Any]]:
    """Noise-free errors before and after at the verification poses, by payload, and the posterior bound."""
    reduction, machine = outcome.reduction, outcome.reduction.recording.machine
    zero = reduction.rows("calibration", 0)
    report = fit_report_frame(machine, noise_free(reduction, zero, mock), reduction.report.frame)
    moves, turns = figure_axes(machine)
    out = {}
    for verified in outcome.verified:
        errors, predicted = {}, {}
        for phase in ("before", "after"):
            rows = reduction.rows(f"verification_{phase}", verified.payload)
            errors[phase] = np.concatenate(true_errors(report, reduction, rows, mock), axis=1)
            visited = reduction.observations.visits.take(rows)
            poses = predict_poses(outcome.calibration.fit, reduction.report, visited)
            predicted[phase] = np.concatenate(reduction.report.tool_error(poses, visited.target_m), axis=1)
        visits = reduction.observations.visits.take(reduction.rows("verification_before", verified.payload))
        bound = [float(np.sqrt(np.mean(u**2))) for u in pose_u(outcome.calibration, visits)]
        rms = {
            phase: [float(np.sqrt(np.mean(np.sum(error[:, axes] ** 2, axis=1)))) for axes in (moves, turns + 3)]
            for phase, error in errors.items()
        }
        by_coordinate, predicted_by_coordinate = (
            {
                COORDINATES[c]: [float(np.sqrt(np.mean(of[phase][:, c] ** 2))) for phase in ("before", "after")]
                for c in machine.dof.tolist()
            }
            for of in (errors, predicted)
        )
        out[verified.payload] = {
            "true": rms,
            "bound": bound,
            "true_by_coordinate": by_coordinate,
            "predicted_by_coordinate": predicted_by_coordinate,
        }
    return out


def noise_free(reduction: Reduction, rows: np.ndarray, mock: MockRig) -> ReflectorObservations:
    """Places of the platform's reflectors at some visits as the plant knows them, drift-free station frame."""
    visits, smrs = reduction.observations.visits.take(rows), reduction.report.smrs
    names = [reduction.recording.machine.smrs[i].name for i in smrs]
    points = []
    for drives, visit in zip(visits.drives, np.flatnonzero(rows), strict=True):
        places = mock.plant.truth.smr_positions(  # type: ignore[attr-defined]
            drives, int(reduction.info.payload[visit]), float(reduction.info.t_rig_s[visit]), in_station_frame=True
        )
        points += [places[name] for name in names]
    count = len(visits)
    return ReflectorObservations(
        visits,
        np.repeat(np.arange(count), len(smrs)),
        np.tile(np.array(smrs), count),
        np.array(points),
        np.tile(np.eye(3) * 1e-12, (count * len(smrs), 1, 1)),
    )


def true_errors(
    report: ReportFrame, reduction: Reduction, rows: np.ndarray, mock: MockRig
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 3) and (n, 3) of the tool against its targets, free of noise."""
    seen = noise_free(reduction, rows, mock)
    target = seen.visits.target_m
    return report.tool_error(report.poses(seen.position_m.reshape(len(target), -1, 3), target), target)


def summarise(machine_name: str, rows: list[dict[str, Any]]) -> tuple[list[str], bool]:
    """The goals, each with what was reached."""
    cases = [p for row in rows for p in row["payloads"]]
    machine = load_rig(demo_rig_path(machine_name))[1]
    turns = bool(np.any(machine.commanded > 2))
    lines, good = [], True

    def goal(name: str, value: str, reached: bool) -> None:
        nonlocal good
        good = good and reached
        lines.append(f"{'ok  ' if reached else 'MISS'}  {name}: {value}")

    least = LEAST_FALL.get(machine_name, (None, None))
    for place, (kind, rounding, unit) in enumerate(
        (("position", ROUNDING_M, "um"), ("rotation", ROUNDING_RAD, "urad"))
    ):
        if kind == "rotation" and not turns:
            before, after = (np.median([p["true"][phase][1] for p in cases]) * 1e6 for phase in ("before", "after"))
            lines.append(f"      rotation, not commanded: {before:.1f} -> {after:.1f} urad (median)")
            continue
        words = ", ".join(COORDINATES[c] for c in machine.commanded.tolist() if (c > 2) == (kind == "rotation"))
        fall = np.median([p["true"]["before"][place] / p["true"]["after"][place] for p in cases])
        over = np.median([p["true"]["after"][place] / (p["bound"][place] + rounding) for p in cases])
        wanted = least[place]
        goal(
            f"true {kind} error ({words}) falls by (median)" + ("" if wanted is None else f", at least {wanted:g}"),
            f"{fall:.1f} times",
            wanted is None or bool(fall >= wanted),
        )
        after = np.median([p["true"]["after"][place] for p in cases]) * 1e6
        goal(
            f"true {kind} error after / (posterior bound + rounding) (median), at most {MOST_OVER_BOUND:g}",
            f"{over:.2f} ({after:.2f} {unit})",
            bool(over <= MOST_OVER_BOUND),
        )
        figure = ("position_rms_m", "orientation_rms_rad")[place]
        ratio = min(p["before"][figure] / row["floor"][figure] for row in rows for p in row["payloads"])
        goal(f"measured {kind} before / noise floor, at least 2 (least)", f"{ratio:.1f}", bool(ratio >= 2.0))
    goal("accepted", f"{sum(row['accepted'] for row in rows)} of {len(rows)}", all(row["accepted"] for row in rows))
    for c in machine.dof[~np.isin(machine.dof, machine.commanded)].tolist():
        line, grows = growth_line(COORDINATES[c], cases)
        goal(line, grows[0], grows[1])
    names = list(cases[0]["true_by_coordinate"])
    for phase, index in (("before", 0), ("after", 1)):
        medians = [np.median([p["true_by_coordinate"][name][index] for p in cases]) * 1e6 for name in names]
        lines.append(f"      true {phase} by coordinate (um, urad; median): " + ", ".join(
            f"{name} {value:.2f}" for name, value in zip(names, medians, strict=True)))  # fmt: skip
    return lines, good


def growth_line(name: str, cases: list[dict[str, Any]]) -> tuple[str, tuple[str, bool]]:
    """What the drives cannot correct of one coordinate: before, after, and whether it grew by more than predicted.

    Medians over the runs; more counts beyond a tenth of what is there after.
    """
    true, model = (
        np.median([case[of][name] for case in cases], axis=0) * 1e6
        for of in ("true_by_coordinate", "predicted_by_coordinate")
    )
    reached = bool(true[1] - true[0] <= max(0.0, model[1] - model[0]) + SLACK * true[1])
    value = f"{true[0]:.2f} -> {true[1]:.2f}, predicted {model[0]:.2f} -> {model[1]:.2f}"
    return f"{name} is not commanded, grows by no more than predicted (um, urad; median)", (value, reached)


def line_of(row: dict[str, Any]) -> str:
    """One run in one line."""
    parts = [
        f"{p['kg']:g} kg: true {p['true']['before'][0] * 1e6:.1f} -> {p['true']['after'][0] * 1e6:.2f} um, "
        f"{p['true']['before'][1] * 1e6:.1f} -> {p['true']['after'][1] * 1e6:.2f} urad"
        for p in row["payloads"]
    ]
    return (
        f"seed {row['seed']:2d}  {'; '.join(parts)}; {'accepted' if row['accepted'] else 'REFUSED'}; "
        f"{row['readings']} readings, {row['host_s']:.0f} s for {row['rig_h']:.2f} h"
    )


def _quiet_run(machine_name: str, seed: int, out: Path) -> dict[str, Any]:
    worker = multiprocessing.current_process()._identity[0]  # type: ignore[attr-defined]
    with pin_to_one_core(worker), contextlib.redirect_stdout(io.StringIO()):
        return run_seed(machine_name, seed, out)


def main() -> int:
    """Run what is missing of all seeds; exit status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machine")
    parser.add_argument("--seeds", default=",".join(str(s) for s in SEEDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/machine-check"))
    options = parser.parse_args()
    try:
        demo_rig_path(options.machine)
    except InputError as unknown:
        parser.error(str(unknown))
    seeds = [int(s) for s in options.seeds.split(",")]
    code = code_digest(*PROGRAMS)
    kept = ResultsFile(options.out / f"{options.machine}-{code}.jsonl", {"machine": options.machine, "code": code})
    rows = [row for row in kept.rows() if row["seed"] in seeds]
    for row in rows:
        print(line_of(row), flush=True)
    missing = [seed for seed in seeds if seed not in {row["seed"] for row in rows}]
    ended = []
    with ProcessPoolExecutor(options.workers, initializer=end_with_parent) as pool:
        running = {pool.submit(_quiet_run, options.machine, seed, options.out): seed for seed in missing}
        for future in as_completed(running):
            if (error := future.exception()) is not None:
                ended.append(running[future])
                print(f"seed {running[future]:2d}  ENDED: {error}", flush=True)
                continue
            rows.append(future.result())
            kept.append(rows[-1])
            print(line_of(rows[-1]), flush=True)
    lines, good = summarise(options.machine, rows) if rows else ([], False)
    if ended:
        lines.append(f"MISS  campaigns that ended before a verdict, none: seeds {sorted(ended)}")
    print("\n".join(lines))
    return 0 if good and not ended else 1


if __name__ == "__main__":
    sys.exit(until_stopped(main))
