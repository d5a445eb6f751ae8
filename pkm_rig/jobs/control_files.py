"""The correction of a recording as files for a control that leads the drives itself."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError, printable
from calibration.base.plain_file import read_text
from calibration.compensation.correction import Correction, ToolError, model_error
from calibration.compensation.decomposition import DriveTables, Loss, corrections_at
from calibration.compensation.error_map import predicted_errors
from calibration.compensation.formats.catalogue import FORMATS, table_format
from calibration.compensation.formats.control import ControlFiles, Order, TableFormat, axis_names
from calibration.compensation.free_part import find_free_part
from calibration.compensation.kinematics.catalogue import KINEMATICS
from calibration.compensation.limits import (
    FormerCorrection,
    check_change,
    micro_unit,
)
from calibration.compensation.measured_range import MeasuredRange
from calibration.compensation.remaining_error import RemainingError
from calibration.identification.calibration import Calibration, identify_recording, pose_u
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.measured_poses import measured_box
from calibration.model.operating_conditions import OperatingConditions
from calibration.recording.recording import Recording
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.file_correction import Build, FileCorrection
from pkm_rig.report.maps import error_fields, error_maps
from pkm_rig.report.pictures import save_png
from pkm_rig.results.callbacks import Notify
from pkm_rig.store.place import campaign_folder
from pkm_rig.version import __version__

LEAST_REMOVED = 0.5  # of the tool's predicted error, RMS
WRITTEN = "written.csv"  # what a control was given, for the comparison with the next one
WRITTEN_ROWS = 200
U_POSES = 100


@dataclass(frozen=True)
class Choice:
    """What a user asks for."""

    form: str
    control: str | None = None
    axes: str | None = None
    accept_loss: bool = False
    accept_change: bool = False


@dataclass(frozen=True)
class IdentifiedLoad:
    """An identified recording at one payload of its list and the campaign's last temperatures."""

    recording: Recording
    payload: int
    calibration: Calibration
    load: OperatingConditions

    @classmethod
    def of(cls, recording: Recording, payload: int) -> IdentifiedLoad:
        """InputError for a payload that is not listed or beyond those that were measured."""
        if not 0 <= payload < len(recording.file.payloads):
            raise InputError(f"payload {payload}: the recording lists 0 to {len(recording.file.payloads) - 1}")
        calibration = identify_recording(recording, baselines=False)
        temperatures = {n: float(t[-1]) for n, t in calibration.reduction.recording.temperatures_c().items()}
        load = calibration.operating_conditions(payload, temperatures)
        MeasuredRange.of(calibration).require(load)
        return cls(recording, payload, calibration, load)

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.recording.machine

    @property
    def box(self) -> Array:
        """Limits (k, 2) of the commanded coordinates that were measured."""
        return measured_box(self.machine, self.calibration.reduction.calibration().visits.target_m)

    def error(self) -> ToolError:
        """The predicted tool error."""
        return model_error(self.calibration.fit, self.calibration.report, self.load)

    def other_loads(self) -> list[IdentifiedLoad]:
        """The same at every payload of the list within those that were measured, its own among them."""
        measured_kg = self.calibration.reduction.calibration().visits.payload_kg
        return [
            replace(self, payload=n, load=self.calibration.operating_conditions(n, self.load.temperatures_c))
            for n, entry in enumerate(self.recording.file.payloads)
            if np.min(measured_kg) <= entry.mass_kg <= np.max(measured_kg)
        ]

    def notes(self) -> tuple[str, ...]:
        """Lines for the head of a file."""
        file = self.recording.file
        limits = ", ".join(
            f"{COORDINATES[c]} {low:g} to {high:g} {'rad' if c > 2 else 'm'}"
            for c, (low, high) in zip(self.machine.commanded, self.box, strict=True)
        )
        parts = ", ".join(f"{name} {t:.1f}" for name, t in sorted(self.load.temperatures_c.items()))
        lines = (
            *(("SIMULATED: by simulated devices, not on a machine",) if file.simulated else ()),
            f"Correction of machine {self.machine.name}, campaign {file.campaign}, pkm-rig {__version__}",
            f"For a payload of {self.load.payload_kg:g} kg and temperatures in degC: {parts}",
            f"Measured and corrected at {limits}; beyond, the last values are held",
        )
        return tuple(printable(line) for line in lines)


def write_control_files(
    recording: Recording, payload: int, out: Path, choice: Choice, notify: Notify
) -> dict[str, Any]:
    """Write a payload's correction in a format of tables; its losses are told first (docs/reference/json.md).

    Raises CampaignRefused for a format that removes too little of the tool's error, InputError for what the control
    cannot take and for corrections beyond their limits. Nothing is written then.
    """
    if choice.form not in FORMATS:
        raise InputError(f"format '{choice.form}' is unknown; known: {', '.join((*FORMATS, *KINEMATICS))}")
    form = table_format(choice.form)
    control = form.control(choice.control)
    axes = axis_names(form, control, choice.axes, recording.machine)
    identified = IdentifiedLoad.of(recording, payload)
    machine = identified.machine
    written, forces_n = _carried(identified, lambda c: form.build(Order(c, control, axes, identified.notes())))
    correction, made, loss = written.correction, written.made, written.loss
    for line in (*loss_lines(machine, loss), remaining_line(written.remaining), *_force_lines(written, forces_n)):
        notify(line)
    folder = campaign_folder(out, recording.file.campaign) / f"{form.name}-payload-{payload}"
    former = find_former(folder, machine, identified.load.payload_kg)
    change = check_change(machine, made.tables, former, accept=choice.accept_change)
    require_enough_removed(form.name, machine, payload, written.remaining, accept=choice.accept_loss)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in made.files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    _draw_map(identified, made.tables, folder, choice)
    (folder / WRITTEN).write_text(_written(machine, identified, made.tables, correction), encoding="utf-8")
    return _result(identified, form, control.title, axes, made, loss, change) | {
        **remaining_json(written.remaining),
        "strut_force_rms_n": forces_n,
        "uncertain_share": uncertain_share(identified, correction),
        "folder": str(folder),
    }


def remaining_line(remaining: RemainingError) -> str:
    """The tool's predicted error without and with a correction."""
    return f"predicted error of the tool, RMS: {remaining.in_words}"


def require_enough_removed(
    form: str, machine: Machine, payload: int, remaining: RemainingError, *, accept: bool
) -> None:
    """Raise CampaignRefused where the tool would be worse, or less than half removed and that is not accepted."""
    name, (change, unit) = min(remaining.changes.items(), key=lambda entry: entry[1][0].removed_share)
    at = f"format {form}: on {machine.name} at payload {payload}"
    before, after = (f"{rms * 1e6:.1f} {unit}" for rms in (change.before, change.after))
    if change.removed_share < 0.0:
        raise CampaignRefused(
            f"{at} the tool's predicted {name} error would grow from {before} to {after} RMS; nothing is written, with "
            "--accept-loss neither; choose another format"
        )
    if change.removed_share < LEAST_REMOVED and not accept:
        raise CampaignRefused(
            f"{at} it would remove {change.removed_share:.0%} of the tool's predicted {name} error ({before} to "
            f"{after} RMS), less than {LEAST_REMOVED:.0%}; choose another format or give --accept-loss"
        )


def remaining_json(remaining: RemainingError) -> dict[str, dict[str, float] | None]:
    """The tool's predicted error as keys of a result."""
    parts = {"tool_position_rms_m": remaining.position_m, "tool_rotation_rms_rad": remaining.rotation_rad}
    return {key: None if change is None else change.as_json for key, change in parts.items()}


def _carried(identified: IdentifiedLoad, build: Build) -> tuple[FileCorrection, dict[str, float] | None]:
    """What is written, and forces where drives can strain the machine."""
    machine, error, box = identified.machine, identified.error(), identified.box
    smallest = FileCorrection.of(machine, error, box, build, None)
    if not machine.redundantly_actuated:
        return smallest, None
    fit = identified.calibration.fit
    free = find_free_part(fit, identified.calibration.report, identified.load, box)
    written = smallest.or_with(machine, error, build, free)
    return written, written.forces_n(fit, identified.load)


def _force_lines(written: FileCorrection, forces_n: dict[str, float] | None) -> tuple[str, ...]:
    """Predicted strut forces in words, where there are more drives than commanded coordinates."""
    if forces_n is None:
        return ()
    how = (
        "the format's tables do not hold what would take it away"
        if written.free is None
        else "internal force taken away"
    )
    return (f"predicted strut forces: {forces_n['before']:.0f} N RMS; corrected {forces_n['after']:.0f} N ({how})",)


def _draw_map(identified: IdentifiedLoad, tables: tuple[DriveTables, ...], folder: Path, choice: Choice) -> None:
    """Predicted errors without and with the tables, where two translations are commanded."""
    if identified.machine.commanded.tolist() != [0, 1]:
        return
    maps = predicted_errors(identified.calibration, identified.load, lambda drives: corrections_at(tables, drives))
    title = f"{identified.recording.file.campaign}, {identified.load.payload_kg:g} kg, {choice.form}"
    save_png(
        error_maps(error_fields(maps, None, identified.payload), title),
        folder / "map.png",
        simulated=identified.recording.file.simulated,
    )


def loss_lines(machine: Machine, loss: Loss) -> list[str]:
    """What tables leave of each drive's correction, in words."""
    return [
        f"{name}: correction max {loss.max_before[a] * 1e6:.1f}, RMS {loss.rms_before[a] * 1e6:.1f} {unit}; the format "
        f"leaves max {loss.max_left[a] * 1e6:.2f}, RMS {loss.rms_left[a] * 1e6:.2f} {unit}"
        for a, (name, unit) in enumerate(zip(machine.drive_names, map(micro_unit, machine.drive_kinds), strict=True))
    ]


def _result(
    identified: IdentifiedLoad,
    form: TableFormat,
    control: str,
    axes: tuple[str, ...],
    made: ControlFiles,
    loss: Loss,
    change: float | None,
) -> dict[str, Any]:
    file = identified.recording.file
    return {
        "campaign": file.campaign,
        "simulated": file.simulated,
        "payload_kg": identified.load.payload_kg,
        "temperatures_c": identified.load.temperatures_c,
        "format": form.name,
        "control": control,
        "sign": form.sign,
        "interpolation": form.interpolation,
        "trial": form.trial,
        "tables": made.needed,
        "files": sorted(made.files),
        "drives": {
            name: {
                "axis": axes[a],
                "unit": "rad" if identified.machine.drive_kinds[a] == "crank" else "m",
                "correction_max": float(loss.max_before[a]),
                "correction_rms": float(loss.rms_before[a]),
                "left_max": float(loss.max_left[a]),
                "left_rms": float(loss.rms_left[a]),
            }
            for a, name in enumerate(identified.machine.drive_names)
        },
        "removed_share": 1.0 - loss.remaining_share,
        "largest_change": change,
    }


def uncertain_share(identified: IdentifiedLoad, correction: Correction) -> float:
    """Share of the poses at which U (k = 2) of the predicted position exceeds the error that is corrected."""
    check, moves = correction.check, identified.machine.commanded[identified.machine.commanded < 3]
    rows = np.linspace(0, len(check) - 1, min(U_POSES, len(check))).astype(np.intp)
    u = pose_u(identified.calibration, identified.load.at_poses(check.drives[rows], check.target_m[rows]))[0]
    error = identified.error()(check.drives[rows], check.target_m[rows])[:, moves]
    return float(np.mean(COVERAGE_FACTOR * u > np.linalg.norm(error, axis=1)))


def _written(
    machine: Machine, identified: IdentifiedLoad, tables: tuple[DriveTables, ...], correction: Correction
) -> str:
    drives = correction.check.drives[:WRITTEN_ROWS]
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow([identified.recording.file.rig, machine.name, repr(identified.load.payload_kg)])
    rows.writerows([[repr(float(v)) for v in row] for row in np.hstack([drives, corrections_at(tables, drives)])])
    return stream.getvalue()


def find_former(folder: Path, machine: Machine, payload_kg: float) -> FormerCorrection | None:
    """The correction of another campaign that was written last for the same machine and load; None without one."""
    written = folder.parent.parent.glob(f"*/*-payload-*/{WRITTEN}")
    found = [path for path in written if path.parent.parent != folder.parent]
    for path in sorted(found, key=lambda path: path.stat().st_mtime, reverse=True):
        former = _read_written(path, machine, payload_kg)
        if former is not None:
            return former
    return None


def _read_written(path: Path, machine: Machine, payload_kg: float) -> FormerCorrection | None:
    rows = list(csv.reader(io.StringIO(read_text(path))))
    count = len(machine.drive_names)
    try:
        is_same = rows[0][1] == machine.name and float(rows[0][2]) == payload_kg
        values = np.array([[float(v) for v in row] for row in rows[1 : WRITTEN_ROWS + 1]])
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: damaged, so the change cannot be told; delete it to go on without") from error
    if not is_same or values.ndim != 2 or values.shape[1] != 2 * count:
        return None
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path}: damaged, so the change cannot be told; delete it to go on without")
    return FormerCorrection(values[:, :count], values[:, count:], path.parent.parent.name)
