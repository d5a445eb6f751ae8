"""What the diagnosis makes of machines with nothing wrong in conditions that no other benchmark has.

    python -m benchmarks.quiet_machines [--n 3] [--seed S] [--out DIR]

Campaigns of a night or of four days on the mock plant, its drift or its warmth strong; and N machines of every shipped
kind that state too little: geometry within 2.5 times the tolerances of the machine file, readings that scatter 1.5 or 2
times as much as the station's accuracy says, and both; machines that do not repeat, their drives standing off anew at
each visit by 5 or 10 um (urad of a crank); measurement folders of four machines that do either; and the mock plant
read by sensors of temperature that scatter, round, or read 85 degC at two visits. Prints of each
condition how many were called an effect, and how many `unknown`; exit status 1 if any was. Progress goes to standard
error. Lines are kept in --out: stopped, the same command goes on after the last.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.results_file import code_digest
from benchmarks.timing import in_one_thread
from calibration.base.arrays import Array
from calibration.diagnosis.diagnose import diagnose, diagnose_measurements
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.machine.description import shipped_machines
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording
from mock_devices.recordings.design import DesignOptions
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded, sensed, simulated
from tests.calibration.diagnosis.measured import Wanted, made
from tests.kept_results import KeptResults, key_of, until_stopped

CODE = (
    "calibration", "mock_devices", "benchmarks/quiet_machines.py",
    "tests/calibration/diagnosis/campaigns.py", "tests/calibration/diagnosis/measured.py",
)  # fmt: skip
NIGHT = DesignOptions(dwells_s=(100.0, 200.0, 300.0, 600.0))
QUIET = DisturbanceLevels(drift_m=2e-6, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.01)
DRIFT, WARMTH = replace(QUIET, drift_m=2.5e-5), replace(QUIET, temperature_k=0.4)
VISITS_OF_A_NIGHT, VISITS, VISITS_OF_DAYS = 100, 60, 120
BETWEEN_DAYS_S = 14.0 * 3600.0
KINDS = len(shipped_machines())

PLACE, TURN = ("x_m", "y_m", "z_m"), ("rx_rad", "ry_rad", "rz_rad")
FOLDERS = (
    Wanted("delta6", pairs=240, sides=True),
    Wanted("delta6", PLACE, sides=True),
    Wanted("delta6", ("z_m",), visits=40),
    Wanted("planar4", ("x_m", "y_m", "rz_rad"), visits=60, sides=True),
    Wanted("stewart6", (*PLACE, *TURN), visits=80, sides=True),
    Wanted("rrr3", ball_m=(0.1, 0.2, 0.0), sides=True),
)

Make = Callable[[int], Recording | MeasuredMachine]


def conditions() -> dict[str, list[Make]]:
    """By name what makes a recording from a seed: one maker a machine, or one of the mock plant."""

    def night(levels: DisturbanceLevels) -> list[Make]:
        return [lambda seed: recorded(plant(VISITS_OF_A_NIGHT, seed=seed, design=NIGHT, nuisance=levels))]

    def four_days(levels: DisturbanceLevels) -> list[Make]:
        of_days = partial(plant, VISITS_OF_DAYS, exchange_s=BETWEEN_DAYS_S, nuisance=levels)
        return [lambda seed: recorded(of_days(seed=seed))]

    def states_too_little(times_tolerances: float, noise: float) -> list[Make]:
        return [partial(_of_kind, name, times_tolerances=times_tolerances, noise=noise) for name in shipped_machines()]

    def do_not_repeat(sd_m: float) -> list[Make]:
        return [partial(_of_kind, name, anew_m=sd_m) for name in shipped_machines()]

    def sensors(**bad: float) -> list[Make]:
        return [lambda seed: sensed(recorded(plant(VISITS, seed=seed)), seed, **bad)]

    def folders(noise: float = 1.0, anew_m: float = 0.0) -> list[Make]:
        return [partial(_folder, wanted, noise=noise, anew_m=anew_m) for wanted in FOLDERS]

    return {
        "nine hours, drift 25 um in one": night(DRIFT),
        "nine hours, waves of 0.4 K": night(WARMTH),
        "as stated": states_too_little(1.0, 1.0),
        "geometry 2.5 times as far off": states_too_little(2.5, 1.0),
        "readings scatter 1.5 times": states_too_little(1.0, 1.5),
        "readings scatter 2 times": states_too_little(1.0, 2.0),
        "geometry 2.5, scatter 1.5 times": states_too_little(2.5, 1.5),
        "four days, drift 25 um in an hour": four_days(DRIFT),
        "four days, waves of 0.4 K": four_days(WARMTH),
        "folders as stated": folders(1.0),
        "folders scatter 1.5 times": folders(1.5),
        "folders scatter 2 times": folders(2.0),
        "drives off by 5 um at each visit": do_not_repeat(5e-6),
        "drives off by 10 um at each visit": do_not_repeat(1e-5),
        "folders, drives off by 5 um": folders(anew_m=5e-6),
        "folders, drives off by 10 um": folders(anew_m=1e-5),
        "sensors scatter by 0.1 K": sensors(scatter_k=0.1),
        "sensors scatter by 0.3 K": sensors(scatter_k=0.3),
        "sensors round to 0.5 K": sensors(step_k=0.5),
        "a sensor reads 85 degC twice": sensors(elsewhere=2),
    }


def _of_kind(
    name: str, seed: int, *, times_tolerances: float = 1.0, noise: float = 1.0, anew_m: float = 0.0
) -> Recording:
    off = _anew(seed, anew_m)
    return simulated(
        name,
        VISITS,
        lambda arrivals: off(arrivals.drives),
        seed=seed,
        noise=noise,
        times_tolerances=times_tolerances,
    )


def _folder(wanted: Wanted, seed: int, *, noise: float, anew_m: float) -> MeasuredMachine:
    off = _anew(seed, anew_m)
    return made(replace(wanted, seed=seed, noise=noise, shift=lambda drives, _sides: off(drives)))


def _anew(seed: int, sd_m: float) -> Callable[[Array], Array]:
    """How far drives (v, d) stand off, drawn anew for each visit."""
    rng = np.random.default_rng([seed, 1])
    return lambda drives: sd_m * rng.standard_normal(drives.shape)


def _verdict(measured: Recording | MeasuredMachine) -> str:
    found = diagnose(measured) if isinstance(measured, Recording) else diagnose_measurements(measured)
    return found.verdict


def row(name: str, verdicts: Sequence[str]) -> str:
    """One line of the table."""
    unknown = verdicts.count(UNKNOWN)
    return f"{name:34s} {len(verdicts):4d} {len(verdicts) - unknown - verdicts.count(NONE):16d} {unknown:8d}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, a line after each condition."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--n", type=int, default=3, help="campaigns of each machine; of a night as many as of all together"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/quiet-machines"))
    options = parser.parse_args(arguments)
    if options.n < 1:
        parser.error(f"--n is {options.n}; give the number of campaigns of each machine, 1 or more")
    if options.seed < 0:
        parser.error(f"--seed is {options.seed}; give 0 or more")
    kept, code = KeptResults(options.out / "results.jsonl"), code_digest(*CODE)
    every, called = conditions(), 0
    print("quiet campaigns                       n  called an effect  unknown", flush=True)
    for number, (name, makers) in enumerate(every.items()):
        seeds = np.random.default_rng([options.seed, number]).integers(2**31, size=KINDS * options.n)
        verdicts = []
        for k, seed in enumerate(seeds.tolist()):
            key = key_of(code, name, options.seed, k)
            if key not in kept:
                print(f"{name}: {k + 1} of {len(seeds)}", file=sys.stderr)
                kept.add({"key": key, "verdict": _verdict(makers[k % len(makers)](seed))})
            verdicts.append(kept[key]["verdict"])
        called += len(verdicts) - verdicts.count(NONE)
        print(row(name, verdicts), flush=True)
    return int(called > 0)


if __name__ == "__main__":
    in_one_thread()
    sys.exit(until_stopped(main))
