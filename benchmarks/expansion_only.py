"""What a calibration of expansion alone leaves: warmer machines, and their true errors, free of noise.

    python -m benchmarks.expansion_only [--seeds 1,2,3] [--warmer 7] [--noise 1] [--out runs/expansion-only]

Each seed's planar machine is calibrated over the protocols of the embedded mock, made warmer, and calibrated anew from
twelve visits, with the former calibration as the prior. The plant then tells where the reflectors truly were at the
verification poses, with the former tables and with the new ones. A rigid motion of all poses is taken off: the
machine's frame is known up to one, and so is the place of a station that drifts. --noise: the station's noise and
drift as a share of what the rig file states. Lines are kept as they come: stopped, it goes on.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.results_file import code_digest
from calibration.base.frame import Frame
from calibration.compensation.tables import CompensationTable, correction_at
from calibration.intervals.extent import EXPANSION_VISITS, Measurement
from calibration.recording.recording import Recording
from calibration.reduction.report_frame import ReportFrame
from mock_devices.rig import MockRig
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.check_readings import true_drives
from pkm_rig.jobs.life_record import key_of
from pkm_rig.jobs.partial import recalibrate_partly
from pkm_rig.jobs.partial_verification import AFTER, BEFORE
from pkm_rig.jobs.reference import load_reference
from pkm_rig.rig.config import RigFile, embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.rig import Rig
from pkm_rig.store.life_facts import machine_history
from pkm_rig.store.store import Store, open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.kept_results import KeptResults, until_stopped
from tests.kept_results import key_of as result_key

SHORT = {
    "calibration_poses": 12,
    "repeatability_visits": 3,
    "readings_per_nest": 1,
    "warm_up_rate_k_per_h": 20.0,
    "nest_every_visits": 8,
}
PROGRAMS = ("calibration", "drivers", "mock_devices", "pkm_rig", "benchmarks/expansion_only.py")
NOISY = ("angle_sd_rad", "range_sd_m", "drift_rad_per_sqrt_h", "drift_of_level_rad_per_sqrt_h", "drift_m_per_sqrt_h")


def main() -> int:
    """One line a seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1,2,3,4")
    parser.add_argument("--warmer", type=float, default=7.0, help="kelvin, all parts")
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--out", type=Path, default=Path("runs/expansion-only"))
    options = parser.parse_args()
    results, code = KeptResults(options.out / "results.jsonl"), code_digest(*PROGRAMS)
    print("error of the tool, um RMS    former tables      new tables")
    print("seed  warmer  noise       measured    true   measured    true")
    for seed in options.seeds.split(","):
        key = result_key(code, seed, options.warmer, options.noise)
        if key not in results:
            with tempfile.TemporaryDirectory() as folder, machine_of(int(seed), options.noise, Path(folder)) as parts:
                results.add({"key": key, "line": line_of(*parts, options.warmer)})
        line = results[key]["line"]
        print(f"{seed:>4s} {options.warmer:5.1f} K {options.noise:6.2f}  {line}", flush=True)
    return 0


@contextmanager
def machine_of(seed: int, noise: float, folder: Path) -> Iterator[tuple[Rig, Store, MockRig]]:
    """A machine of a seed, connected, whose mock station scatters and drifts by a share of what the host is told."""
    path = embedded_rig_path()
    file, machine = load_rig(path)
    mocked = file.mock.model_copy(update={"seed": seed}) if file.mock else None
    recalibration = file.recalibration.model_copy(update={"tolerance_m": 6e-5})
    campaign = file.campaign.model_copy(update=SHORT)
    file = file.model_copy(update={"mock": mocked, "campaign": campaign, "recalibration": recalibration})
    with (
        open_store(folder, hold=True) as store,
        embedded_mock_rig(_with_noise(file, noise), path) as mock,
        mock.clock.activity(),
        connect_rig(
            mock.file.model_copy(update={"station": file.station.model_copy(update={"port": mock.file.station.port})}),
            machine, mock.clock, mock.bus_factory,
        ) as rig,
    ):  # fmt: skip
        yield rig, store, mock.mock


def _with_noise(file: RigFile, share: float) -> RigFile:
    accuracy = file.station.accuracy
    quieter = accuracy.model_copy(update={key: share * getattr(accuracy, key) for key in NOISY})
    return file.model_copy(update={"station": file.station.model_copy(update={"accuracy": quieter})})


def line_of(rig: Rig, store: Store, mock: MockRig, warmer_k: float) -> str:
    """Calibrate, warm, calibrate expansion alone; what was measured, and what is true."""
    outcome = calibrate(rig, store, lambda _line: None, lambda _n, _total, _what: None)
    if not outcome.accepted:
        return f"the first calibration was {outcome.decision}"
    for part in ("struts", "columns", "base", "platform"):
        mock.plant.thermal.heat(part, warmer_k)
    last = machine_history(store, rig.file.rig, key_of(rig)).last_calibration
    assert last is not None
    partly = recalibrate_partly(
        rig, store, last, Measurement("expansion", (), EXPANSION_VISITS, "the temperature"), lambda _line: None,
        lambda _n, _total, _what: None, lambda *_: (),
    )  # fmt: skip
    reference = load_reference(store, rig.file.rig, last.id, rig.machine, rig.file.payloads)
    report = reference.report_frame(Frame(np.eye(3), np.zeros(3)))
    table, recording = partly.correction, store.recording(partly.campaign)
    assert isinstance(table, CompensationTable)
    words = []
    for phase, figure, new in ((BEFORE, partly.fact.as_found, None), (AFTER, partly.fact.as_left, table)):
        assert figure is not None
        true_m = true_error_m(recording.take(np.asarray(recording["phase"]) == phase), mock, report, new)
        words.append(f"{figure.position_m * 1e6:11.1f} {true_m * 1e6:7.1f}")
    return "".join(words) + ("" if partly.accepted else f"  {partly.verification.reason}")


def true_error_m(rows: Recording, mock: MockRig, report: ReportFrame, table: CompensationTable | None) -> float:
    """True error of the tool at the poses of some rows; table: in use then, where the recording does not hold it."""
    _, first = np.unique(rows["visit"], return_index=True)
    one_each = rows.take(first)
    drives = one_each.drives("actual_m") if table else true_drives(one_each).drives("actual_m")
    drives = drives + correction_at(table, drives) if table else drives
    names, points = [report.machine.smrs[i].name for i in report.smrs], []
    for at, payload, t_s in zip(drives.tolist(), one_each["payload"], one_each["t_rig_s"], strict=True):
        places = mock.plant.truth.smr_positions(at, int(payload), float(t_s))  # type: ignore[attr-defined]
        points.append([places[name] for name in names])
    target_m = one_each.targets_m()
    error_m, _ = report.tool_error(report.poses(np.array(points), target_m.copy()), target_m)
    x, y = target_m[:, 0], target_m[:, 1]
    rigid = np.zeros((len(x), 2, 3))
    rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
    rigid[:, 0, 2], rigid[:, 1, 2] = -y, x
    rigid, flat = rigid.reshape(-1, 3), error_m[:, :2].ravel()
    left = flat - rigid @ np.linalg.lstsq(rigid, flat, rcond=None)[0]
    return float(np.sqrt(np.sum(left**2) / len(x)))


if __name__ == "__main__":
    sys.exit(until_stopped(main))
