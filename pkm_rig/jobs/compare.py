"""Comparison of two campaigns as a command does it: with pictures beside the store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.comparison.compare import compare, compare_measurements
from calibration.comparison.result import Comparison
from calibration.identification.calibration import calibration_part
from calibration.machine.description import Machine
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import drop_unclosed_readings
from pkm_rig.report import comparison_pictures
from pkm_rig.report.comparison_json import comparison_json
from pkm_rig.report.diagnosis_pictures import save
from pkm_rig.store.place import campaign_folder

PICTURES_FOLDER = "compared-with"


def run_comparison(before: Recording, after: Recording, out: Path) -> tuple[Comparison, dict[str, Any]]:
    """Compare two recordings; the object of docs/reference/comparison.schema.json, whose pictures are written.

    They are put into `out`, in the folder of the later campaign. Raises InputError.
    """
    readings = [drop_unclosed_readings(calibration_part(recording)) for recording in (before, after)]
    simulated = any(recording.file.simulated for recording in readings)
    return _written(compare(*readings), after.machine, out, simulated=simulated)


def run_folder_comparison(
    before: MeasuredMachine, after: MeasuredMachine, out: Path
) -> tuple[Comparison, dict[str, Any]]:
    """The same of two measurement folders, which say nothing of simulated devices. Raises InputError."""
    return _written(compare_measurements(before, after), after.machine, out, simulated=False)


def _written(
    comparison: Comparison, machine: Machine, out: Path, *, simulated: bool
) -> tuple[Comparison, dict[str, Any]]:
    result = comparison_json(comparison) | {"simulated": simulated}
    folder = campaign_folder(out, comparison.after) / PICTURES_FOLDER / comparison.before
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figures = comparison_pictures.draw_all(comparison, machine)
        result["pictures"] = save(figures, folder, simulated=simulated)
    except OSError as error:
        raise InputError(f"compare: {error}; choose another --out") from error
    return comparison, result
