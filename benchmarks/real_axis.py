"""Checks the diagnosis of one drive alone on measured recordings of a robot (docs/explanation/axis.md).

    python -m benchmarks.real_axis [--data FOLDER] [--out FOLDER] [--shuffles 5]

Reads A-joint1 ... B-joint3 of FOLDER, else of ../shared/real-data/kuka-kr300 beside the checkout (columns in its
README). Each becomes a recording folder, which `pkm-rig diagnose` reads too. What A's coefficients will do to B is
written, with its hash printed, before any file of B is opened. Exit status 1 if a goal is missed, 2 without the data.
It takes one or two minutes and keeps nothing when it is stopped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.axis.diagnose import diagnose_axis, diagnose_signals
from calibration.axis.result import AxisDiagnosis
from calibration.axis.signals import Signals
from calibration.base.csv_table import read_table
from calibration.base.errors import InputError
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording, read_axis_folder, write_axis_folder
from tests.kept_results import until_stopped

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "real-data" / "kuka-kr300"
OUT = ROOT / "runs" / "real-axis"
JOINTS = (1, 2, 3)
NEEDED = ("time_s", "reference_position_deg", "motor_position_deg", "link_position_deg", "motor_torque_Nm")
OPTIONAL = ("motor_velocity_deg_per_s", "link_velocity_deg_per_s")
DELAY_S, SHRINK_WITHIN = (2.5e-3, 3.3e-3), 0.1
BLOCKS, K = 50, 2.0
MDEG = np.radians(1e-3)


@dataclass(frozen=True)
class Row:
    """What was found of one recording."""

    name: str
    diagnosis: AxisDiagnosis
    signals: Signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose A, state what it does to B, then diagnose B."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--shuffles", type=int, default=5)
    options = parser.parse_args(arguments)
    shutil.rmtree(options.out, ignore_errors=True)
    try:
        first = [_diagnosed(options, f"A-joint{joint}") for joint in JOINTS]
        stated = {row.name: _stated(row) for row in first}
        text = json.dumps(stated, indent=1, sort_keys=True) + "\n"
        (stated_at := options.out / "stated.json").write_text(text, encoding="utf-8")
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        print(f"stated before B is opened: {digest}, {os.path.relpath(stated_at)}")
        for row in first:
            low, high = row.diagnosis.gap.shrink_interval
            print(f"  {row.name}: shrink of B's gap {row.diagnosis.gap.shrink:.3f} [{low:.3f}, {high:.3f}]")
        second = [_diagnosed(options, f"B-joint{joint}") for joint in JOINTS]
    except InputError as error:
        print(f"real_axis: {error}", file=sys.stderr)
        return 2
    goals = [_print_row(row) for row in (*first, *second)]
    print("\nA's coefficients on B, its own offset taken off (mdeg RMS)")
    for row, held in zip(first, second, strict=True):
        before, after, shrink = row.diagnosis.model.shrink(held.signals)
        low, high = row.diagnosis.gap.shrink_interval
        met = abs(shrink - row.diagnosis.gap.shrink) <= SHRINK_WITHIN
        covered = "" if low <= shrink <= high else ", outside the interval"
        stated_shrink = row.diagnosis.gap.shrink
        print(
            f"{_mark(met)} {held.name}: {before / MDEG:.1f} to {after / MDEG:.1f}, shrink {shrink:.3f}, "
            f"stated {stated_shrink:.3f}{covered}"
        )
        goals.append(met)
    print(f"\nwhat is left, in {BLOCKS} blocks of time in random order")
    for row in (*first, *second):
        named = [_shuffled_verdict(row, seed) for seed in range(options.shuffles)]
        met = all(verdict in {NONE, UNKNOWN} for verdict in named)
        print(f"{_mark(met)} {row.name}: {', '.join(named)}")
        goals.append(met)
    print(f"\n{sum(goals)} of {len(goals)} goals met")
    return 0 if all(goals) else 1


def recording_folder(data: Path, name: str, out: Path) -> Path:
    """A recording of the robot as a folder that `pkm-rig diagnose` reads, in `out`."""
    table = read_table(data / f"{name}.csv", NEEDED, OPTIONAL)
    file = AxisFile(
        format=1,
        name=name,
        source="KUKA KR300, J. Weigand and others, github.com/JonasWeigand/Robot_Identification, MIT licence",
        kind="rotary",
        time_unit="s",
        position_unit="deg",
        torque_unit="Nm",
        torque_side="motor",
    )
    new = ("time", "command", "motor_position", "second_position", "torque")
    write_axis_folder(file, {key: table[column] for key, column in zip(new, NEEDED, strict=True)}, out / name)
    return out / name


def _diagnosed(options: argparse.Namespace, name: str) -> Row:
    recording: AxisRecording = read_axis_folder(recording_folder(options.data, name, options.out))
    return Row(name, diagnose_axis(recording), Signals.of(recording))


def _stated(row: Row) -> dict[str, object]:
    """All that predicts B: scale, coefficients of the laws in their order, and the shrink."""
    model = row.diagnosis.model
    return {
        "effects": [
            {"effect": e.effect, "size": e.size.value, "parameters": {q.name: q.value for q in e.others}}
            for e in row.diagnosis.effects
        ],
        "scale": model.scale,
        "coefficients": model.coefficients.tolist(),
        "shrink": row.diagnosis.gap.shrink,
        "shrink_interval": list(row.diagnosis.gap.shrink_interval),
    }


def _print_row(row: Row) -> bool:
    """Verdict, delay and ripple of a recording; whether the goal is met."""
    found = row.diagnosis
    delay = next((e.size for e in found.effects if e.effect == "delay"), None)
    first = found.verdict == "delay" and set(found.equivalent) <= {"viscous"}
    met = first and delay is not None and DELAY_S[0] <= delay.value <= DELAY_S[1]
    alike = f" = {', '.join(found.equivalent)}" if found.equivalent else ""
    size = "" if delay is None else f", {1e3 * delay.value:.2f} +- {1e3 * K * delay.u:.2f} ms"
    print(f"\n{_mark(met)} {row.name}: {found.verdict}{alike} (p {found.ranking[found.verdict]:.2f}){size}")
    gap = found.gap
    print(f"      gap {gap.before / MDEG:.1f} to {gap.after / MDEG:.1f} mdeg on withheld data, shrink {gap.shrink:.3f}")
    for effect in found.effects:
        if effect.effect == "ripple":
            period = np.degrees(effect.others[0].value)
            amplitude, u = effect.size.value / MDEG, K * effect.size.u / MDEG
            print(f"      ripple: {amplitude:.2f} +- {u:.2f} mdeg, period {period:.4f} deg")
        elif effect.effect != "delay":
            print(f"      {effect.effect}: {effect.size.value:.3g} +- {K * effect.size.u:.1g} {effect.size.unit}")
    if found.verdict == UNKNOWN:
        print(f"      clues: {', '.join(found.clues)}")
    return met


def _shuffled_verdict(row: Row, seed: int) -> str:
    blocks = np.array_split(row.diagnosis.remaining, BLOCKS)
    order = np.random.default_rng(seed).permutation(BLOCKS)
    gap = np.concatenate([blocks[i] for i in order])
    return diagnose_signals(row.signals.with_gap(gap), row.name).verdict


def _mark(met: bool) -> str:
    return "ok   " if met else "MISS "


if __name__ == "__main__":
    raise SystemExit(until_stopped(main, "begins anew"))
