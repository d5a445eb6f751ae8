"""The calibrated geometry of a recording as a file for a control that computes the drives from poses itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.compensation.correction import Correction
from calibration.compensation.kinematics.catalogue import KINEMATICS, require_kind
from calibration.compensation.kinematics.fit import KinematicsFiles, KinematicsFormat, KinematicsLoss, tool_poses
from calibration.compensation.remaining_error import RemainingError
from calibration.machine.description import Machine
from calibration.recording.recording import Recording
from pkm_rig.jobs.control_files import Choice, IdentifiedLoad, remaining_json, remaining_line, require_enough_removed
from pkm_rig.results.callbacks import Notify
from pkm_rig.store.place import campaign_folder


def write_kinematics_files(
    recording: Recording, payload: int, out: Path, choice: Choice, notify: Notify
) -> dict[str, Any]:
    """Write a payload's calibrated geometry; what it cannot carry is told first (docs/reference/json.md).

    Raises InputError for another kind of machine, CampaignRefused where too little would be removed.
    """
    form = KINEMATICS[choice.form]
    if choice.control is not None or choice.axes is not None:
        raise InputError(
            f"format {form.name}: it is for one control and numbers its joints; leave out --control, --axes"
        )
    require_kind(form, recording.machine)
    identified = IdentifiedLoad.of(recording, payload)
    machine = identified.machine
    correction = Correction.sampled(machine, identified.error(), identified.box)
    made = form.build(correction, identified.notes())
    loss = KinematicsLoss.of(made.kinematics, machine, correction.check)
    for name, before, left, most in zip(
        machine.drive_names, loss.rms_before, loss.rms_left, loss.max_left, strict=True
    ):
        notify(
            f"{name}: correction RMS {before * 1e6:.1f} um; rigid parameters leave max {most * 1e6:.2f}, "
            f"RMS {left * 1e6:.2f} um"
        )
    remaining = remaining_by_load(identified, made, correction)
    own = remaining[identified.payload]
    notify(remaining_line(own))
    require_enough_removed(form.name, machine, payload, own, accept=choice.accept_loss)
    folder = campaign_folder(out, recording.file.campaign) / f"{form.name}-payload-{payload}"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in made.files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return _result(identified, form, made, loss) | {
        **_remaining_json(identified, remaining),
        "folder": str(folder),
    }


def remaining_by_load(
    identified: IdentifiedLoad, made: KinematicsFiles, correction: Correction
) -> dict[int, RemainingError]:
    """The tool's predicted error by payload, without and with this geometry, made for one payload."""
    machine, check = identified.machine, correction.check
    calibrated = made.kinematics.drives(tool_poses(machine, check.target_m))
    return {
        load.payload: RemainingError.of(machine, load.error(), check, calibrated) for load in identified.other_loads()
    }


def _remaining_json(identified: IdentifiedLoad, remaining: dict[int, RemainingError]) -> dict[str, Any]:
    """By payload in kg."""
    masses = {n: f"{entry.mass_kg:g}" for n, entry in enumerate(identified.recording.file.payloads)}
    parts = {n: remaining_json(error) for n, error in remaining.items()}
    keys = next(iter(parts.values()))
    return {key: {masses[n]: part[key] for n, part in parts.items()} for key in keys}


def _result(
    identified: IdentifiedLoad, form: KinematicsFormat, made: KinematicsFiles, loss: KinematicsLoss
) -> dict[str, Any]:
    file, machine = identified.recording.file, identified.machine
    return {
        "campaign": file.campaign,
        "simulated": file.simulated,
        "payload_kg": identified.load.payload_kg,
        "temperatures_c": identified.load.temperatures_c,
        "format": form.name,
        "control": form.control,
        "parameters": form.parameters,
        "trial": form.trial,
        "files": sorted(made.files),
        "drives": _drives(machine, loss),
        "removed_share": 1.0 - loss.remaining_share,
    }


def _drives(machine: Machine, loss: KinematicsLoss) -> dict[str, dict[str, float]]:
    return {
        name: {
            "correction_max": float(loss.max_before[a]),
            "correction_rms": float(loss.rms_before[a]),
            "left_max": float(loss.max_left[a]),
            "left_rms": float(loss.rms_left[a]),
        }
        for a, name in enumerate(machine.drive_names)
    }
