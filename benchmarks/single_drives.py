"""What the diagnosis of one drive alone makes of integrated drives (docs/explanation/axis.md): noise only, and causes.

    python -m benchmarks.single_drives [--n 30] [--seed S] [--out DIR]

Makes N drives with coloured noise alone, its correlation time anywhere from 10 ms to 10 s, and N with each cause, its
size within a factor of 1.5 of what stands in CAUSES; each moves for ten seconds in its own way. Prints of each cause
how many were named right, how many got any name of an effect, how many `unknown`; of those named right how many had a
size within U (k = 2) and how far these were off. Progress goes to standard error. Lines are kept in --out: stopped, the
same command goes on after the last.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.results_file import code_digest
from benchmarks.timing import in_one_thread
from calibration.axis.diagnose import diagnose_axis
from calibration.axis.result import AxisDiagnosis
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording
from mock_devices.axis import DriveFlaws, DriveRecording, record_drives
from tests.kept_results import KeptResults, key_of, until_stopped

DURATION_S, SAMPLING_S = 10.0, 0.005  # a longer one is more reversals
FACTOR, K = 1.5, 2.0
FASTEST, SLOWEST = 0.01, 10.0  # correlation times of noise alone, in s
QUIET = DriveFlaws(rigid=True, noise_rad=1e-5, torque_side="load")
COARSE = DriveFlaws(noise_rad=1e-5, white_rad=2e-6)


@dataclass(frozen=True)
class Cause:
    """A cause: flaws, which of them is varied, names that are right, and the size over that flaw's value.

    power: of the flaw in the size: a compliance is one over a stiffness.
    """

    flaws: DriveFlaws
    varied: str
    names: frozenset[str]
    size_over_flaw: float = 1.0
    power: int = 1

    def with_factor(self, factor: float) -> DriveFlaws:
        """The flaws with the varied one times a factor."""
        return replace(self.flaws, **{self.varied: factor * getattr(self.flaws, self.varied)})

    def size(self, flaws: DriveFlaws) -> float:
        """What the diagnosis should state of such flaws."""
        return float(self.size_over_flaw * getattr(flaws, self.varied) ** self.power)


def _cause(varied: str, names: str, size_over_flaw: float = 1.0, power: int = 1, **flaws: object) -> Cause:
    return Cause(replace(COARSE, **flaws), varied, frozenset(names.split()), size_over_flaw, power)  # type: ignore[arg-type]


CAUSES = {
    "delay": _cause("delay_s", "delay", rigid=True, delay_s=5e-4, coulomb_nm=300.0),
    "viscous, no torque": _cause("viscous_nms", "delay viscous", 1 / 2e7, viscous_nms=8000.0, torque_side=""),
    "Coulomb, no torque": _cause("coulomb_nm", "coulomb backlash", 1 / 2e7, coulomb_nm=1500.0, torque_side=""),
    "uneven Coulomb, no torque": _cause(
        "coulomb_nm", "coulomb backlash", 1 / 2e7, coulomb_nm=1500.0, coulomb_asymmetry=0.5, torque_side=""
    ),
    "play, motor's torque": _cause(
        "play_rad", "backlash", 0.5, play_rad=1e-3, coulomb_nm=300.0, stiffness_nm_per_rad=1e8
    ),
    "compliance, load's torque": _cause(
        "stiffness_nm_per_rad",
        "compliance",
        1.0,
        -1,
        stiffness_nm_per_rad=1e6,
        weight_nm=300.0,
        coulomb_nm=20.0,
        torque_side="load",
    ),
    "compliance, motor's torque": _cause(
        "stiffness_nm_per_rad", "compliance", 1.0, -1, stiffness_nm_per_rad=1e6, weight_nm=300.0, coulomb_nm=20.0
    ),
    "inertia, no torque": _cause("stiffness_nm_per_rad", "inertia", 40.0, -1, stiffness_nm_per_rad=1e6, torque_side=""),
    "ripple": _cause("ripple_rad", "ripple", rigid=True, ripple_rad=1e-5, ripple_period_rad=0.02),
}


def recording_of(seen: DriveRecording) -> AxisRecording:
    """What a recorder saw, as the diagnosis reads it."""
    torque = {"torque_unit": "Nm", "torque_side": seen.torque_side} if seen.torque_side else {}
    header = {"format": 1, "name": "mock", "kind": "rotary", "time_unit": "s", "position_unit": "rad"}
    file = AxisFile.model_validate({**header, "simulated": True, **torque})
    return AxisRecording(file, seen.time_s, seen.motor, seen.second, seen.command, seen.torque)


def diagnosed(flaws: Sequence[DriveFlaws], seed: int) -> list[AxisDiagnosis]:
    """The diagnosis of one recording of each drive."""
    seen = record_drives(flaws, seed, duration_s=DURATION_S, sampling_s=SAMPLING_S)
    return [diagnose_axis(recording_of(one)) for one in seen]


def row(name: str, found: Sequence[AxisDiagnosis], flaws: Sequence[DriveFlaws]) -> str:
    """One line of the table."""
    cause = CAUSES.get(name)
    names = cause.names if cause else {NONE}
    right = [(d, f) for d, f in zip(found, flaws, strict=True) if d.verdict in names]
    unknown = sum(d.verdict == UNKNOWN for d in found)
    named = len(found) - unknown - sum(d.verdict == NONE for d in found)
    line = f"{name:28s} {len(found):3d} {len(right):6d} {named:16d} {unknown:8d}"
    if not cause or not right:
        return line
    off = [abs(d.effects[0].size.value - cause.size(f)) for d, f in right]
    within = sum(o <= K * d.effects[0].size.u for o, (d, _) in zip(off, right, strict=True))
    shares = [o / cause.size(f) for o, (_, f) in zip(off, right, strict=True)]
    return f"{line} {within:9d} {np.median(shares):14.1%} {max(shares):8.1%}"


def row_of_drives(name: str, n: int, rng: np.random.Generator) -> str:
    """The line of so many drives with a cause, or with noise only."""
    if name in CAUSES:
        flaws = [CAUSES[name].with_factor(float(FACTOR**u)) for u in rng.uniform(-1.0, 1.0, n)]
    else:
        times = np.exp(rng.uniform(np.log(FASTEST), np.log(SLOWEST), n))
        flaws = [replace(QUIET, noise_s=float(time)) for time in times]
    return row(name, diagnosed(flaws, int(rng.integers(2**31))), flaws)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, a line after each cause."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=30, help="drives with noise only, and with each cause")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/single-drives"))
    options = parser.parse_args(arguments)
    if options.n < 1:
        parser.error(f"--n is {options.n}; give the number of drives of each cause, 1 or more")
    if options.seed < 0:
        parser.error(f"--seed is {options.seed}; give 0 or more")
    kept = KeptResults(options.out / "results.jsonl")
    code = code_digest("calibration", "mock_devices/axis.py", "benchmarks/single_drives.py")
    print(
        "drives with                    n  right  named an effect  unknown  within U  off: median  largest", flush=True
    )
    for number, name in enumerate(("noise only", *CAUSES)):
        key = key_of(code, name, options.n, options.seed)
        if key not in kept:
            print(name, file=sys.stderr)
            kept.add({"key": key, "row": row_of_drives(name, options.n, np.random.default_rng([options.seed, number]))})
        print(kept[key]["row"], flush=True)
    return 0


if __name__ == "__main__":
    in_one_thread()
    sys.exit(until_stopped(main))
