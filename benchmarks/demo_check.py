"""Twenty mock machines through the main job, each scored against its plant's own noise-free positions.

The calibration sees readings only. After each run the plant is asked where the reflectors truly were; the frame is
fitted to those positions as the definitions ask, so that an error of the identified frame counts.

    python -m benchmarks.demo_check [--seeds 1,2,3] [--workers 2] [--out runs/demo-check]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibrated_mock import calibrated_mock
from benchmarks.side_by_side import end_with_parent
from calibration.identification.prediction import predict_poses
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.reduction.reduction import Reduction
from calibration.reduction.report_frame import ReportFrame, fit_report_frame
from mock_devices.rig import MockRig
from pkm_rig.jobs.session import pin_to_one_core
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.config import embedded_rig_path

SEEDS = tuple(range(1, 21))


def run_seed(seed: int, out: Path) -> dict[str, Any]:
    """One machine: calibrate it, then ask its plant. All figures in um and urad."""
    with calibrated_mock(embedded_rig_path(), seed, out / f"seed-{seed}") as run:
        outcome, truth = run.outcome, score(run.outcome, run.mock)
    return {
        "seed": seed,
        "accepted": outcome.accepted,
        "host_s": run.host_s,
        "rig_h": run.rig_time_s / 3600.0,
        "polls": run.polls,
        "readings": len(outcome.reduction.recording),
        "floor": outcome.floor.position_rms_m * 1e6,
        "floor_urad": outcome.floor.orientation_rms_rad * 1e6,
        "chi2_per_dof": outcome.calibration.fit.chi2_per_dof,
        "payloads": [
            {
                "kg": v.payload_kg,
                "before": v.before.position_rms_m * 1e6,
                "after": v.after.position_rms_m * 1e6,
                "orientation_unpredicted": v.orientation_prediction_rad * 1e6,
                **truth[v.payload],
            }
            for v in outcome.verified
        ],
    }


def score(outcome: CampaignOutcome, mock: MockRig) -> dict[int, dict[str, Any]]:
    """Noise-free before, after and predictions at the verification poses, by payload."""
    reduction = outcome.reduction
    zero = reduction.rows("calibration", 0)
    report = fit_report_frame(
        reduction.recording.machine, _noise_free(reduction, zero, mock, corrected=False), reduction.report.frame
    )
    out = {}
    for verified in outcome.verified:
        before = reduction.rows("verification_before", verified.payload)
        after = reduction.rows("verification_after", verified.payload)
        results = {
            "true_before": _rms(report, reduction, before, mock, corrected=False)[0],
            "true_after": _rms(report, reduction, after, mock, corrected=True)[0],
        }
        visits = reduction.observations.visits.take(before)
        models = {"deformation_aware": predict_poses(outcome.calibration.fit, reduction.report, visits)}
        models |= {b.name: b.predict(visits) for b in outcome.calibration.baselines}
        results["models"] = {
            name: _rms(report, reduction, before, mock, corrected=False, against=predicted)
            for name, predicted in models.items()
        }
        out[verified.payload] = results
    return out


def _noise_free(reduction: Reduction, rows: np.ndarray, mock: MockRig, *, corrected: bool) -> ReflectorObservations:
    """Positions of the platform's reflectors at some visits as the plant knows them, drift-free station frame."""
    visits = reduction.observations.visits.take(rows)
    smrs = reduction.report.smrs
    names = [reduction.recording.machine.smrs[i].name for i in smrs]
    points = []
    for row, visit in enumerate(np.flatnonzero(rows)):
        drives = visits.drives[row]
        payload = int(reduction.info.payload[visit])
        if corrected:
            drives = drives + _corrections(mock, drives, visits.payload_kg[row], reduction.info.direction[visit])
        t_s = float(reduction.info.t_rig_s[visit])
        places = mock.plant.truth.smr_positions(drives, payload, t_s, in_station_frame=True)
        points += [places[name] for name in names]
    count = len(visits)
    return ReflectorObservations(
        visits,
        np.repeat(np.arange(count), len(smrs)),
        np.tile(np.array(smrs), count),
        np.array(points),
        np.tile(np.eye(3) * 1e-12, (count * len(smrs), 1, 1)),
    )


def _corrections(mock: MockRig, drives_m: np.ndarray, payload_kg: float, direction: np.ndarray) -> np.ndarray:
    """What the drives themselves add to a command, from the bank that holds the table for this payload."""
    out = []
    counts = [round(q * 1e8) for q in drives_m]
    for own, drive in enumerate(mock.drives):
        banks = drive.compensation.banks.values()
        table = next(b.table for b in banks if b.table is not None and b.table.payload_g == round(payload_kg * 1e3))
        out.append(table.correction_inc(counts[own], counts[1 - own], round(direction[own])) * 1e-8)
    return np.array(out)


def _rms(
    report: ReportFrame,
    reduction: Reduction,
    rows: np.ndarray,
    mock: MockRig,
    *,
    corrected: bool,
    against: np.ndarray | None = None,
) -> tuple[float, float]:
    """Position (um) and orientation (urad) RMS of the true poses against their targets or a prediction."""
    noise_free = _noise_free(reduction, rows, mock, corrected=corrected)
    target = noise_free.visits.target_m
    pose = report.poses(noise_free.position_m.reshape(len(target), -1, 3), target)
    position, rotation = report.tool_error(pose, target if against is None else against)
    return (
        float(np.sqrt(np.mean(np.sum(position[:, :2] ** 2, axis=1)))) * 1e6,
        float(np.sqrt(np.mean(rotation[:, 2] ** 2))) * 1e6,
    )


def summarise(rows: list[dict[str, Any]]) -> tuple[list[str], bool]:
    """The goals of the demonstration, each with what was reached."""
    cases = [(row, p) for row in rows for p in row["payloads"]]
    fall = np.array([p["true_before"] / p["true_after"] for _, p in cases])
    worst = np.array([max(p["true_after"] for p in row["payloads"]) for row in rows])
    ratio = np.array([p["after"] / row["floor"] for row, p in cases])
    floor = np.array([row["floor"] for row in rows])
    turn = np.array([p["orientation_unpredicted"] / row["floor_urad"] for row, p in cases])
    share = np.ceil(0.9 * len(rows))
    goals = [
        ("true position error falls by (median)", f"{np.median(fall):.1f} times", np.median(fall) >= 10.0),
        ("rigs at most 3 um at both payloads", f"{np.sum(worst <= 3.0)} of {len(rows)}", np.sum(worst <= 3.0) >= share),
        ("measured after / noise floor (median)", f"{np.median(ratio):.2f}", np.median(ratio) <= 1.2),
        (
            "measured after at most 1.2 noise floors",
            f"{np.sum(ratio <= 1.2)} of {len(ratio)}",
            np.sum(ratio <= 1.2) >= 0.9 * len(ratio),
        ),
        ("largest noise floor", f"{floor.max():.1f} um", floor.max() <= 8.0),
        (
            "unpredicted orientation at most 1.5 floors",
            f"{np.sum(turn <= 1.5)} of {len(turn)}",
            np.sum(turn <= 1.5) >= 0.9 * len(turn),
        ),
        ("accepted", f"{sum(row['accepted'] for row in rows)} of {len(rows)}", all(row["accepted"] for row in rows)),
    ]
    lines = [f"{'ok  ' if good else 'MISS'}  {name}: {value}" for name, value, good in goals]
    names = list(rows[0]["payloads"][-1]["models"])
    lines.append("")
    lines.append("median true prediction error at the last payload (um, urad)")
    for name in names:
        errors = np.array([row["payloads"][-1]["models"][name] for row in rows])
        lines.append(f"      {name}: {np.median(errors[:, 0]):.2f}, {np.median(errors[:, 1]):.1f}")
    return lines, all(bool(good) for *_, good in goals)


def line_of(row: dict[str, Any]) -> str:
    """One run in one line."""
    parts = [
        f"{p['kg']:g} kg: true {p['true_before']:.1f} -> {p['true_after']:.2f}, "
        f"measured {p['before']:.1f} -> {p['after']:.1f} um"
        for p in row["payloads"]
    ]
    return (
        f"seed {row['seed']:2d}  {'; '.join(parts)}; floor {row['floor']:.1f} um; "
        f"chi2 {row['chi2_per_dof']:.2f}; {row['host_s']:.0f} s for {row['rig_h']:.2f} h"
    )


def _quiet_run(seed: int, out: Path) -> dict[str, Any]:
    worker = multiprocessing.current_process()._identity[0]  # type: ignore[attr-defined]
    with pin_to_one_core(worker), contextlib.redirect_stdout(io.StringIO()):
        return run_seed(seed, out)


def main() -> int:
    """Run all seeds; exit status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default=",".join(str(s) for s in SEEDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/demo-check"))
    options = parser.parse_args()
    seeds = [int(s) for s in options.seeds.split(",")]
    rows = []
    with ProcessPoolExecutor(options.workers, initializer=end_with_parent) as pool:
        for row in pool.map(_quiet_run, seeds, [options.out] * len(seeds)):
            rows.append(row)
            print(line_of(row), flush=True)
    lines, good = summarise(rows)
    print("\n".join(lines))
    (options.out / "demo-check.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
