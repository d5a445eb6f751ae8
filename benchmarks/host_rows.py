"""Rows a second that the host corrects: whole paths, every row for its own pose, on one core.

    python -m benchmarks.host_rows [--machines stewart6,gough8]

A machine is identified from a campaign of its plant (12 poses, noise as stated); then paths of 1 s, a row every 4 ms,
are corrected by the identified model. Times are processor time, one thread. Exit status 1 below the goal for a machine
with six drives.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from benchmarks.timing import in_one_thread
from calibration.compensation.host import host_correction
from calibration.identification.calibration import identify_recording
from calibration.machine.inverse import nominal_poses
from tests.pkm_rig.spatial_recording import TEMPERATURES_C, record

ROWS, PATHS, POSES, SEED = 250, 20, 12, 5
SIX, GOAL = 6, 2000.0  # rows a second are asked of machines with six drives


def rows_per_second(name: str) -> tuple[int, float, float, float]:
    """Number of drives; rows a second, median and slowest path; largest correction."""
    calibration = identify_recording(record(name, SEED, poses=POSES), baselines=False)
    correction = host_correction(calibration, 1, TEMPERATURES_C)
    machine, box = calibration.report.machine, correction.measured.box
    rng, rates, largest = np.random.default_rng(SEED), [], 0.0
    for _ in range(PATHS):
        a, b = (box[:, 0] + (box[:, 1] - box[:, 0]) * rng.uniform(0.2, 0.8, len(box)) for _ in range(2))
        path = nominal_poses(machine, a + np.linspace(0.0, 1.0, ROWS)[:, None] * (b - a))
        begun = time.process_time()
        corrections = correction.corrections(path)
        rates.append(ROWS / (time.process_time() - begun))
        largest = max(largest, float(np.abs(corrections).max()))
    return len(machine.drive_names), float(np.median(rates)), min(rates), largest


def main() -> int:
    """Print a line a machine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", default="stewart6,hexaglide,gough8")
    options = parser.parse_args()
    good = True
    in_one_thread()
    for name in options.machines.split(","):
        drives, median, slowest, largest = rows_per_second(name)
        missed = drives == SIX and median < GOAL
        good = good and not missed
        print(
            f"{name:10} {drives} drives: {median:7.0f} rows/s (slowest path {slowest:.0f}), corrections up to "
            f"{largest * 1e6:.0f} um{' MISSED' if missed else ''}",
            flush=True,
        )
    print(f"goal: {GOAL:.0f} rows/s with six drives, paths of {ROWS} rows, one core")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
