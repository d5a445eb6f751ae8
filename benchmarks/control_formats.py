"""What formats of controls lose of a machine's correction: format times machine, and CEC on twenty default machines.

Machines are drawn from their tolerances; the correction is the true machine's, without frame and tool offset and free
of noise, so that nothing but the format is lost. Losses are those of the tables as the control reads them, rounded, at
other poses than the tables were fitted to: of the drives' corrections, and of the tool's error, by which a format is
refused. A finished machine is kept as long as the code is the same: stop at any time, the same command goes on.

    python -m benchmarks.control_formats [--seeds 20] [--workers 2] [--out runs/control-formats]
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import numpy as np

import pkm_rig  # noqa: F401  # one thread a process, before numpy's libraries start
from benchmarks.results_file import code_digest
from benchmarks.side_by_side import side_by_side
from calibration.base.arrays import Array
from calibration.compensation.correction import Correction
from calibration.compensation.decomposition import Loss, corrections_at
from calibration.compensation.formats.catalogue import FORMATS
from calibration.compensation.formats.control import Order
from calibration.compensation.remaining_error import Change, RemainingError
from calibration.machine.description import shipped_machines
from pkm_rig.jobs.control_files import LEAST_REMOVED
from tests.calibration.compensation.drawn_machine import DrawnMachine
from tests.kept_results import KeptResults, key_of, until_stopped

CODE = ("calibration", "tests/calibration/compensation/drawn_machine.py", "benchmarks/control_formats.py")
DEFAULT, PAYLOADS_KG = "planar4", (0.0, 200.0)
MACHINE_SEEDS = (1, 2, 3, 4, 5)  # of each of the nine; the table of what is left shows the first
ONE, TWO = ("siemens-cec", "sinumerik-828d"), ("siemens-cec", "sinumerik-840d-sl")
ONE_MEDIAN_M, TWO_MOST_M, TWO_SHARE = 1.5e-6, 0.5e-6, 0.95


def run_machine(name: str, seed: int, payload_kg: float, formats: tuple[tuple[str, str], ...]) -> list[dict[str, Any]]:
    """Losses of a drawn machine in some formats for some controls."""
    drawn = DrawnMachine.of(name, seed)
    load = drawn.load(payload_kg)

    def error(drives: Array, target_m: Array) -> Array:
        return drawn.tool_error(drives, target_m, load)

    correction = Correction.sampled(drawn.machine, error)
    check, out = correction.check, []
    for form_name, control in formats:
        form = FORMATS[form_name]
        axes = tuple("XYZABCUV"[: len(drawn.machine.drive_names)])
        made = form.build(Order(correction, form.control(control), axes))
        loss = Loss.of(made.tables, check.drives, check.correction)
        corrected = check.drives + corrections_at(made.tables, check.drives)
        remaining = RemainingError.of(drawn.machine, error, check, corrected)
        out.append(
            {
                "format": form_name,
                "control": control,
                "max": float(np.max(loss.max_left)),
                "rms": float(np.sqrt(np.mean(loss.rms_left**2))),
                "before_max": float(np.max(loss.max_before)),
                "before_rms": float(np.sqrt(np.mean(loss.rms_before**2))),
                "tables": made.needed,
                "tool": {name: change.as_json for name, (change, _) in remaining.changes.items()},
            }
        )
    return out


def every_format() -> tuple[tuple[str, str], ...]:
    """Every format for every control, without the second type of the same file."""
    return tuple((f.name, c.name) for f in FORMATS.values() if f.name != "linuxcnc-comp-0" for c in f.controls)


def jobs(seeds: int) -> list[tuple[str, int, float, tuple[tuple[str, str], ...]]]:
    """The nine machines, several drawn of each, then the default one with other seeds and loads."""
    machines = (DEFAULT, *(name for name in shipped_machines() if name != DEFAULT))
    out = [(name, seed, 0.0, every_format()) for name in machines for seed in MACHINE_SEEDS]
    return out + [(DEFAULT, seed, load, (ONE, TWO)) for seed in range(1, seeds + 1) for load in PAYLOADS_KG]


def column_names() -> list[str]:
    """What a table's columns are: no table, then a format or its control."""
    return ["no table", *(control if control != "none" else form for form, control in every_format())]


def print_tool_table(rows: dict[str, list[list[dict[str, Any]]]]) -> None:
    """Format times machine, %: what is removed of the tool's error, by which formats are refused."""
    count = len(next(iter(rows.values())))
    print(
        f"\nremoved of the tool's error (RMS), of position and rotation the smaller, in %: median and least of {count}"
    )
    print(f"machines; below {LEAST_REMOVED:.0%} only with --accept-loss, below 0 the tool is worse: not written\n")
    print("machine    " + "".join(f"{name:>20}" for name in column_names()[1:]))
    for machine, of_seeds in rows.items():
        shares = 100.0 * np.array([[_removed(r["tool"]) for r in losses] for losses in of_seeds])
        cells = [f"{np.median(share):.1f}, {np.min(share):.1f}" for share in shares.T]
        print(f"{machine:11}" + "".join(f"{cell:>20}" for cell in cells))


def _removed(tool: dict[str, dict[str, float]]) -> float:
    return min(Change(**change).removed_share for change in tool.values())


def print_table(rows: dict[str, list[dict[str, Any]]]) -> None:
    """Format times machine, um (urad for cranks): max / RMS of what is left, and the tables needed."""
    names = column_names()
    print("left of the corrections, max / RMS in um (urad for rrr3 and rrr4), and the tables needed\n")
    print("machine    " + "".join(f"{name:>20}" for name in names))
    for machine, losses in rows.items():
        cells = [f"{losses[0]['before_max'] * 1e6:.1f} / {losses[0]['before_rms'] * 1e6:.1f}     "]
        cells += [f"{r['max'] * 1e6:.2f} / {r['rms'] * 1e6:.2f} ({r['tables']})" for r in losses]
        print(f"{machine:11}" + "".join(f"{cell:>20}" for cell in cells))


def judge(losses: dict[int, list[list[dict[str, Any]]]]) -> bool:
    """Print how one and two products do on the default machines; whether both goals are met."""
    one = [entry[0]["max"] for loads in losses.values() for entry in loads]
    two = [max(entry[1]["max"] for entry in loads) for loads in losses.values()]
    good = sum(most <= TWO_MOST_M for most in two)
    verdicts = (float(np.median(one)) <= ONE_MEDIAN_M, good >= TWO_SHARE * len(two))
    print(f"\nCEC on {len(two)} machines drawn from {DEFAULT} at 0 and 200 kg, largest value left on either drive")
    print(
        f"{'ok  ' if verdicts[0] else 'MISS'}  one product, 8 tables (828D): median {np.median(one) * 1e6:.2f} um, "
        f"worst {max(one) * 1e6:.2f} um"
    )
    print(
        f"{'ok  ' if verdicts[1] else 'MISS'}  two products, 12 tables (840D sl): at most 0.5 um on {good} of "
        f"{len(two)} machines at both loads, worst {max(two) * 1e6:.2f} um"
    )
    return all(verdicts)


def main() -> int:
    """Run what is missing; exit status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/control-formats"))
    options = parser.parse_args()
    results, code = KeptResults(options.out / "losses.jsonl"), code_digest(*CODE)
    keys = {job: key_of(code, *map(str, job)) for job in jobs(options.seeds)}
    missing = [job for job, key in keys.items() if key not in results]
    with side_by_side(run_machine, missing, options.workers) as running:
        job_of = dict(zip(running, missing, strict=True))
        for done, future in enumerate(as_completed(running), start=1):
            job = job_of[future]
            results.add({"key": keys[job], "losses": future.result()})
            print(f"{done} of {len(missing)}: {job[0]}, seed {job[1]}, {job[2]:g} kg", file=sys.stderr, flush=True)
    found = {job: results[key]["losses"] for job, key in keys.items()}
    by_machine: dict[str, list[list[dict[str, Any]]]] = {}
    for job, losses in found.items():
        if job[3] == every_format():
            by_machine.setdefault(job[0], []).append(losses)
    print_table({machine: of_seeds[0] for machine, of_seeds in by_machine.items()})
    print_tool_table(by_machine)
    by_seed: dict[int, list[list[dict[str, Any]]]] = {}
    for job, losses in found.items():
        if job[3] == (ONE, TWO):
            by_seed.setdefault(job[1], []).append(losses)
    return 0 if judge(by_seed) else 1


if __name__ == "__main__":
    sys.exit(until_stopped(main))
