"""Figures that no change of layout, names or craft may move: written once, compared after every such change.

Ten recordings straight from the mock plant are reduced, identified, turned into tables and diagnosed; three mock rigs
go through the main job. A figure that has an uncertainty may move by 1e-9 of it, a probability by 1e-9, any other
number by 1e-9 of itself; the bytes of tables may not change.

    python -m benchmarks.preserved_figures [--without-rigs]     compares; status 1 names what has moved
    python -m benchmarks.preserved_figures --write              once; refused where the file is there

On another processor the identification may end at another last digit: some figures then move by 1e-5 of their
uncertainty whatever the code. There, `--file FIGURES.npz --write` keeps those of an earlier commit, and
`--file FIGURES.npz` compares with them.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import pkm_rig  # noqa: F401  # one thread a process, before numpy's libraries start
from benchmarks.demo_check import run_seed
from calibration.compensation.tables import CompensationTable, table_for_payload
from calibration.diagnosis.diagnose import diagnose
from calibration.identification.calibration import Calibration, identified_summary, identify_recording, pose_u
from calibration.identification.prediction import predict_poses
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from drivers.drives.table_image import TableImage, encode_table, machine_id_of
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import make_recording
from mock_devices.settings import MockSettings
from pkm_rig.jobs.session import pin_to_one_core
from pkm_rig.report.diagnosis_json import diagnosis_json
from pkm_rig.store.store import open_store

FILE = Path(__file__).parent / "preserved" / "figures.npz"
RELATIVE = 1e-9
RIGS = (1, 2, 3)
KEPT_EVENTS = ("identified", "activated", "accepted", "refused", "diagnosed")
NOT_FIGURES = ("host_s", "polls", "campaign", "table_change")  # of this computer's speed, the time of day, or drawn
# Figures that were changed on purpose after they had been kept, each with its reason. They are no longer compared.
CHANGED = (
    # The uncertainty of an effect's further parameter comes from the fit; it was 120 of whatever unit, or a share.
    re.compile(r"effects/\d+/parameters/\w+/u$"),
    # A further key of results and verdicts: accepted, refused or not decided.
    re.compile(r"/decision$"),
    # Causes that version 0.1.0 did not know, none of which these recordings have: readings that do not fit the model,
    # visits that were measured anew.
    re.compile(r"dropped/(model gate|visit measured anew)$"),
)

# Sums of large terms that nearly cancel: version 0.1.0 itself gives them 1.5e-8 of their value apart with one thread of
# the linear algebra library or two. They may move by 1e-6 of it.
ROUNDED, ROUNDING = re.compile(r"/inside_geometry/"), 1e-6


@dataclass(frozen=True)
class Case:
    """One recording of the mock plant: its seed, its size and what acts on its machine."""

    seed: int
    visits: int
    effects: tuple[EffectChoice, ...] = ()


CASES = (
    Case(1, 90),
    Case(2, 120),
    Case(3, 90, (EffectChoice("backlash", 8.0e-6, "left"),)),
    Case(4, 90, (EffectChoice("column_compliance", 2.0e-8, "right"),)),
    Case(5, 90, (EffectChoice("screw_thermal_growth", 3.0, "left"),)),
    Case(6, 90, (EffectChoice("link_stiffness", 0.3),)),
    Case(7, 90, (EffectChoice("tracker_drift", 20.0e-6),)),
    Case(8, 120, (EffectChoice("guide_straightness", 10.0e-6, "right"),)),
    Case(9, 90, (EffectChoice("screw_cumulative_error", 10.0e-6, "left"),)),
    Case(10, 120, (EffectChoice("refraction", 1.0), EffectChoice("backlash", 8.0e-6, "right"))),
)

Value = float | str | bool | bytes | None
Figures = dict[str, tuple[Value, float]]  # a value and how far it may move


def of_recordings() -> Figures:
    """Figures of the ten recordings."""
    figures: Figures = {}
    for case in CASES:
        recording = recorded(case)
        identified = identify_recording(recording)
        figures |= {f"recording {case.seed}/{name}": value for name, value in of_calibration(identified).items()}
        diagnosis = diagnosis_json(diagnose(recording))
        figures |= {f"recording {case.seed}/diagnosis/{n}": v for n, v in leaves(diagnosis)}
        print(f"recording {case.seed}: {diagnosis['verdict']}", flush=True)
    return figures


def recorded(case: Case) -> Recording:
    """The recording of a case."""
    path = shipped_machine("planar4")
    options = DesignOptions(visits=case.visits, poses=2 * case.visits // 3)
    design = draw_design(read_machine_file(path), np.random.default_rng(case.seed), options)
    made = make_recording(path, MockSettings(seed=case.seed, effects=case.effects), design)
    columns = {n: c.astype(str) if c.dtype.kind in "US" else c.astype(np.float64) for n, c in made.columns.items()}
    return Recording(RecordingFile(**made.header), load_machine(path), columns)


def of_calibration(identified: Calibration) -> Figures:
    """Parameters, covariance, reduced and predicted poses, rigid models and tables."""
    fit, reduction = identified.fit, identified.reduction
    figures: Figures = dict(leaves(identified_summary(identified)))
    sd = np.sqrt(np.diag(fit.covariance))
    figures |= arrays("unknowns", fit.unknowns, sd)
    figures |= arrays("covariance", fit.covariance, np.outer(sd, sd))
    u = np.full(reduction.poses.coordinates.shape, 1.0e-9)  # of coordinates that the machine does not move
    u[:, reduction.recording.machine.dof] = np.sqrt(np.einsum("nii->ni", reduction.poses.covariance))
    figures |= arrays("measured pose", reduction.poses.coordinates, u)
    visits = reduction.observations.visits
    u_position_m, u_rotation_rad = pose_u(identified, visits)
    figures |= arrays("u position", u_position_m, u_position_m)
    figures |= arrays("u rotation", u_rotation_rad, u_rotation_rad)
    u = np.repeat(np.column_stack([u_position_m, u_rotation_rad]), 3, axis=1)
    figures |= arrays("predicted pose", predict_poses(fit, reduction.report, visits), u)
    for baseline in identified.baselines:
        figures |= arrays(baseline.name, baseline.predict(visits), u)
    temperatures = {n: float(t[-1]) for n, t in reduction.recording.temperatures_c().items()}
    for payload in range(len(reduction.recording.file.payloads)):
        for node, data in enumerate(
            images(table_for_payload(identified, payload, temperatures), fit.model.parameters.machine.name)
        ):
            figures[f"table/{payload}/{node}"] = (hashlib.sha256(data).hexdigest(), 0.0)
    return figures


def images(table: CompensationTable, machine_name: str) -> Iterator[bytes]:
    """The table's bytes as the two drives would store them."""
    for own, other in ((0, 1), (1, 0)):
        corrections = table.correction_m[own]
        yield encode_table(
            TableImage(
                node_id=own + 1,
                generation=1,
                payload_kg=table.conditions.payload_kg,
                temperature_c=table.temperature_c,
                machine_id=machine_id_of(machine_name),
                own_start_m=float(table.start_m[own]),
                own_step_m=float(table.step_m[own]),
                partner_start_m=float(table.start_m[other]),
                partner_step_m=float(table.step_m[other]),
                corrections_m=corrections if own == 0 else corrections.T,
                metres_per_increment=1.0e-8,
            )
        )


def of_rigs(out: Path) -> Figures:
    """Figures of three mock rigs that went through the main job, each scored against its plant."""
    figures: Figures = {}
    for seed in RIGS:
        row = run_seed(seed, out)
        figures |= {f"rig {seed}/{name}": value for name, value in leaves(row) if name not in NOT_FIGURES}
        with open_store(out / f"seed-{seed}") as store:
            ((campaign, *_),) = store.campaigns()
            for number, event in enumerate(e for kind in KEPT_EVENTS for e in store.events(campaign, kind)):
                figures |= {f"rig {seed}/event {number}/{name}": value for name, value in leaves(event.data)}
        print(f"rig {seed}", flush=True)
    return figures


def arrays(name: str, values: np.ndarray, u: np.ndarray) -> Figures:
    """The numbers of an array, each with its uncertainty, where that is not below the number's own rounding."""
    values, u = np.asarray(values, dtype=np.float64), np.broadcast_to(u, np.shape(values))
    return {
        f"{name}/{','.join(map(str, index))}": (float(values[index]), RELATIVE * float(u[index]))
        for index in np.ndindex(values.shape)
    }


def leaves(tree: Any, path: str = "") -> Iterator[tuple[str, tuple[Value, float]]]:
    """The values of an object for programs; `u` or `probability` beside a value says how far that may move."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            where = f"{path}/{key}" if path else str(key)
            if key == "value" and isinstance(tree.get("u"), float):
                yield where, (value, RELATIVE * tree["u"])
            elif isinstance(value, float) and ("probability" in key or "ranking" in path):
                yield where, (value, RELATIVE)
            else:
                yield from leaves(value, where)
    elif isinstance(tree, list | tuple):
        for i, value in enumerate(tree):
            yield from leaves(value, f"{path}/{i}")
    else:
        yield path, (tree, RELATIVE * abs(tree) if isinstance(tree, float) else 0.0)


def compared(name: str) -> bool:
    """Whether a figure has to be what it was."""
    return name.rsplit("/", maxsplit=1)[-1] not in NOT_FIGURES and not any(pattern.search(name) for pattern in CHANGED)


def moved(before: Figures, now: Figures) -> list[str]:
    """Figures that are not what they were, the farthest first."""
    before, now = ({name: value for name, value in figures.items() if compared(name)} for figures in (before, now))
    lines = [(np.inf, f"{name}: gone") for name in sorted(before.keys() - now.keys())]
    lines += [(np.inf, f"{name}: new") for name in sorted(now.keys() - before.keys())]
    for name in before.keys() & now.keys():
        (was, limit), (value, _) = before[name], now[name]
        if isinstance(was, float) and isinstance(value, float):
            if ROUNDED.search(name):
                limit = ROUNDING * abs(was)
            if not abs(value - was) <= limit and not (np.isnan(value) and np.isnan(was)):
                over = abs(value - was) / limit if limit > 0.0 else np.inf
                lines.append((over, f"{name}: {was!r} is now {value!r}, {over:.3g} times its limit"))
        elif was != value:
            lines.append((np.inf, f"{name}: {was!r} is now {value!r}"))
    return [line for _, line in sorted(lines, key=lambda entry: -entry[0])]


def write(figures: Figures, path: Path) -> None:
    """Numbers as an array, texts as JSON, in one file of plain data."""
    numbers = {name: entry for name, entry in figures.items() if isinstance(entry[0], float)}
    texts = {name: entry[0] for name, entry in figures.items() if not isinstance(entry[0], float)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as stream:  # never written again
        np.savez_compressed(
            stream,
            numbers=np.array(list(numbers.values())),
            names=np.array(json.dumps(list(numbers)).encode()),
            texts=np.array(json.dumps(texts).encode()),
        )


def read(path: Path) -> Figures:
    """The figures of before."""
    with np.load(path, allow_pickle=False) as data:
        names, texts = json.loads(data["names"].item()), json.loads(data["texts"].item())
        numbers = data["numbers"].tolist()
    return {n: (v, limit) for n, (v, limit) in zip(names, numbers, strict=True)} | {
        n: (t, 0.0) for n, t in texts.items()
    }


def main() -> int:
    """Compare, or write once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--without-rigs", action="store_true", help="leave the three mock rigs out: two minutes less")
    parser.add_argument("--file", type=Path, default=FILE, help="figures of this processor, in place of the kept ones")
    options = parser.parse_args()
    if options.write and options.file.exists():
        print(f"{options.file} is there and is never written again", file=sys.stderr)
        return 2
    now = of_recordings()
    if not options.without_rigs:
        with tempfile.TemporaryDirectory() as folder, pin_to_one_core(), contextlib.redirect_stderr(io.StringIO()):
            now |= of_rigs(Path(folder))
    if options.write:
        write(now, options.file)
        print(f"{len(now)} figures written")
        return 0
    before = read(options.file)
    if options.without_rigs:
        before = {name: value for name, value in before.items() if not name.startswith("rig ")}
    lines = moved(before, now)
    for line in lines[:20]:
        print(line)
    print(f"{len(lines)} of {len(before)} figures have moved")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
