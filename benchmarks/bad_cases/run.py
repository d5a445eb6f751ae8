"""A hundred seeded campaigns with a mistake and a hundred good ones: how each ends, what its tables are truly worth.

Readings come straight from the mock plant; identification, tables and decision are those of `pkm-rig calibrate`. The
plant is then asked, free of noise, how far the tool is off at the verification poses without and with the tables, in
the frame that the definitions ask for. No mistake may end with tables on that are worse than none. `--wire 5` runs so
many of each kind through the main job over the real protocols instead, each mistake planted where that can be: in the
machine file or the payloads that the host believes, or in the station that aims at another reflector once.

    python -m benchmarks.bad_cases.run [--each 25] [--good 100] [--wire 5] [--out runs/bad-cases]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bad_cases.campaign import Correct, PlantCampaign, nothing
from benchmarks.bad_cases.cases import GOOD, KINDS, Case, draw
from benchmarks.results_file import code_digest
from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.error_map import correction_at
from calibration.compensation.tables import table_for_payload
from calibration.identification.calibration import identify_recording
from drivers.errors import DeviceError
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.acceptance import evaluate_campaign
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import WrittenTable
from pkm_rig.rig.schedule import calibration_blocks, verification_block
from tests.kept_results import KeptResults, key_of, until_stopped

EACH, GOOD_CASES = 25, 100
LEAST_GOOD = 0.99
PROGRAMS = ("calibration", "mock_devices/plant", "pkm_rig/jobs", "pkm_rig/rig", "benchmarks/bad_cases")
REFUSED, SURVIVED, WORSE = "refused", "survived", "worse"


def run_case(
    case: Case, folder: Path, *, poses: int | None = None, verification_poses: int | None = None
) -> dict[str, Any]:
    """One campaign to its end: `outcome`, `why`, and where tables stay the true RMS errors (m) by payload."""
    campaign = PlantCampaign(case, folder, poses, verification_poses)
    try:
        outcome, tables = _calibrate(campaign)
    except (InputError, DeviceError, CampaignRefused) as error:
        return {"outcome": REFUSED, "why": f"{type(error).__name__}: {error}".split(";")[0][:160], "true_m": {}}
    true_m = true_errors(campaign, tables)
    if not outcome.accepted:
        why = "; ".join(v.decision.rule for v in outcome.verified if v.decision.verdict != "accepted")
        return {"outcome": REFUSED, "why": f"verdict: {why}"[:160], "true_m": true_m}
    worse = any(after >= before for before, after in true_m.values())
    return {"outcome": WORSE if worse else SURVIVED, "why": "tables on", "true_m": true_m}


def _calibrate(campaign: PlantCampaign) -> tuple[Any, dict[int, Correct]]:
    """Calibration, tables and verification at every payload of the rig file; the outcome and what the tables add."""
    file, machine = campaign.file, campaign.machine
    settings, station_m = file.campaign, file.station.position_m
    blocks = calibration_blocks(machine, settings, station_m)
    checks = [verification_block(machine, settings, n, station_m) for n in settings.verification_payloads]
    campaign.planned_visits = sum(len(b.visits) for b in blocks) + 2 * sum(len(b.visits) for b in checks)
    platform = [s.name for s in machine.smrs if s.on == "platform"]
    moving = [s.name for s in machine.smrs if s.on != "floor"]
    for block in blocks:
        campaign.measure(block, "calibration", moving)
    identification = identify_recording(campaign.recording(), baselines=False)
    written, tables = [], {}
    for block in checks:
        campaign.measure(block, "verification_before", platform)
        table = table_for_payload(identification, block.payload, campaign.temperatures_c())
        tables[block.payload] = lambda drives, table=table: correction_at(table, drives[None])[0]
        campaign.measure(block, "verification_after", platform, tables[block.payload])
        written.append(WrittenTable(table, block.payload, {}))
    outcome = evaluate_campaign(
        campaign.header.campaign,
        identification,
        campaign.recording(),
        tuple(written),
        DiagnosisAttempt(None, "not asked for"),
        previous_tables="none",
        limits_m=settings.accept_below_m,
    )
    return outcome, tables


def true_errors(campaign: PlantCampaign, tables: dict[int, Correct]) -> dict[int, tuple[float, float]]:
    """RMS position error (m) without and with each payload's table, of the plant, at the verification poses.

    In the frame fitted to the unloaded calibration visits.
    """
    file, machine = campaign.file, campaign.machine
    t_s = campaign._t_s
    block = calibration_blocks(machine, file.campaign, file.station.position_m)[0]
    frame = _planar_fit(*_tool_places(campaign, block.visits, nothing, t_s))
    out = {}
    for payload, correct in tables.items():
        visits = verification_block(machine, file.campaign, payload, file.station.position_m).visits
        errors = []
        for added in (nothing, correct):
            target, truly = _tool_places(campaign, visits, added, t_s)
            errors.append(float(np.sqrt(np.mean(np.sum((frame(truly) - target) ** 2, axis=1)))))
        out[payload] = (errors[0], errors[1])
    return out


def _tool_places(campaign: PlantCampaign, visits: Any, correct: Correct, t_s: float) -> tuple[Array, Array]:
    """Targets (n, 2) of the tool, and where it truly is (n, 2), in m."""
    target = np.array([visit.target_m[:2] for visit in visits])
    truly = [
        campaign.plant.truth.tool_pose(tuple(campaign.stands_at(v.drives_m, correct).tolist()), v.payload, t_s)[:2]
        for v in visits
    ]
    return target + campaign.machine.tool_point_m[:2], np.array(truly)


def _planar_fit(target: Array, truly: Array) -> Callable[[Array], Array]:
    """The rigid motion of the plane that brings true places closest to targets."""
    a, b = truly - truly.mean(axis=0), target - target.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return lambda places: np.asarray((places - truly.mean(axis=0)) @ turn.T + target.mean(axis=0))


def table_of(rows: list[dict[str, Any]]) -> tuple[list[str], bool]:
    """How many of each kind ended how, and whether the goals are reached."""
    lines = [f"{'kind':20}  {'cases':>5}  {'refused':>7}  {'survived':>8}  {'accepted, worse than none':>25}"]
    reached = True
    for kind in (*KINDS, GOOD):
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        count = {name: sum(row["outcome"] == name for row in own) for name in (REFUSED, SURVIVED, WORSE)}
        lines.append(f"{kind:20}  {len(own):5}  {count[REFUSED]:7}  {count[SURVIVED]:8}  {count[WORSE]:25}")
        reached = reached and count[WORSE] == 0
        if kind == GOOD:
            good = count[SURVIVED] >= np.floor(LEAST_GOOD * len(own))
            lines.append(
                f"{'ok  ' if good else 'MISS'}  good ones accepted: {count[SURVIVED]} of {len(own)}, at least 99 of 100"
            )
            reached = reached and bool(good)
    worse = sum(row["outcome"] == WORSE for row in rows)
    lines.append(f"{'MISS' if worse else 'ok  '}  ends with tables on that are worse than none: {worse} of {len(rows)}")
    lines += [
        f"      {row['kind']} {row['number']}: {row['what']}: {row['why']}" for row in rows if row["outcome"] == WORSE
    ]
    return lines, reached


def main() -> int:
    """Run what is missing; exit status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=EACH, help="cases of each kind of mistake")
    parser.add_argument("--good", type=int, default=GOOD_CASES)
    parser.add_argument("--wire", type=int, default=0, help="so many of each kind over the real protocols instead")
    parser.add_argument("--out", type=Path, default=Path("runs/bad-cases"))
    options = parser.parse_args()
    code = code_digest(*PROGRAMS)
    where = "wire" if options.wire else "plant"
    kept = KeptResults(options.out / f"{where}.jsonl")
    if options.wire:
        from benchmarks.bad_cases.wire import run_over_the_wire as run  # noqa: PLC0415  # what it loads takes long

        counts = dict.fromkeys((*KINDS, GOOD), options.wire)
    else:
        run, counts = run_case, {**dict.fromkeys(KINDS, options.each), GOOD: options.good}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for kind, count in counts.items():
            for number in range(count):
                key = key_of(code, where, kind, number)
                if key not in kept:
                    case, begun_s = draw(kind, number), time.monotonic()
                    found = {"key": key, "kind": kind, "number": number, "what": case.what} | run(case, Path(folder))
                    kept.add(found | {"host_s": time.monotonic() - begun_s})
                row = kept[key]
                rows.append(row)
                shown = ", ".join(f"{b * 1e6:.1f} -> {a * 1e6:.1f} um" for b, a in row["true_m"].values())
                print(
                    f"{kind} {number}: {row['what']}: {row['outcome']} ({row['why']}) {shown} {row['host_s']:.0f} s",
                    flush=True,
                )
    lines, reached = table_of(rows)
    print("\n".join(["", *lines]))
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(until_stopped(main))
