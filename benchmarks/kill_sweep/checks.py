"""What has to hold after a struck campaign: nothing changed, nothing missing, nothing twice, the same predictions."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_vector
from calibration.identification.calibration import identify_recording
from calibration.identification.fit import Fit
from calibration.identification.prediction import ToolDerivatives, _without_rigid_motions, predict_tool
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import TIES
from pkm_rig.jobs.acceptance import last_verification_attempt
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import Store

MOST_U = 0.5
TRIAL = 2  # mode of compensation (docs/reference/drive-objects.md)
Key = tuple[str, int, int, int, str]


@dataclass(frozen=True)
class Measured:
    """A finished campaign: how often each planned reading is there, and the fit."""

    readings: Counter[Key]
    fit: Fit


def measured(out: Path, campaign: str) -> Measured:
    """Read and identify a campaign of a store."""
    store = Store(out / STORE_NAME)
    try:
        recording = last_verification_attempt(store, campaign)
    finally:
        store.close()
    return Measured(planned_readings(recording), identify_recording(recording).fit)


def planned_readings(recording: Recording) -> Counter[Key]:
    """Readings by what the plan names them: phase, payload, pose, pass, reflector.

    Without those of nests and repeatability, which every session begins with.
    """
    names = ("phase", "payload", "pose", "pass", "smr")
    columns = [np.asarray(recording[name]) for name in names]
    return Counter(
        (str(phase), int(payload), int(pose), int(pass_), str(smr))
        for phase, payload, pose, pass_, smr in zip(*columns, strict=True)
        if phase not in TIES
    )


def problems(before: dict[str, str], after: dict[str, str], found: Measured, reference: Measured) -> list[str]:
    """What is wrong with a campaign, against the readings before its last kill and the untouched run."""
    out = changed_readings(before, after)
    missing, more = reference.readings - found.readings, found.readings - reference.readings
    if missing:
        out.append(f"{missing.total()} planned readings are missing: {next(iter(missing))}")
    if more:
        out.append(f"{more.total()} readings are there that the untouched run has not: {next(iter(more))}")
    worst = largest_difference_u(found.fit, reference.fit)
    if not worst <= MOST_U:
        out.append(f"a prediction differs by {worst:.2f} u from the untouched run's")
    return out


def changed_readings(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """Readings that were stored before a kill and are not byte for byte what they were."""
    changed = sum(after.get(uid) != text for uid, text in before.items())
    return [f"{changed} of {len(before)} readings from before a kill have changed"] if changed else []


def largest_difference_u(fit: Fit, reference: Fit) -> float:
    """Largest difference of two fits' tool positions at the reference's visits, in standard uncertainties.

    Without the rigid motions of machine and tool, which a station cannot tell.
    """
    visits = reference.visits
    ours, theirs = fit.predict(visits), reference.predict(visits)
    shift = (ours.tool_m() - theirs.tool_m())[:, :, None]
    r = theirs.equilibrium.rotation
    turn = rotation_vector(ours.equilibrium.rotation @ r.transpose(0, 2, 1))[:, :, None]
    difference: ToolDerivatives = _without_rigid_motions(shift, turn, theirs.tool_m(), r)
    free: Array = predict_tool(reference, visits).u
    moves = reference.machine.dof[reference.machine.dof < 3]
    return float(np.max(np.abs(difference.position[:, moves, 0]) / free[:, moves]))


def drive_problems(status: dict[str, Any]) -> list[str]:
    """One generation on all drives, compensation in the same mode on all, none on trial, nothing moves."""
    drives = status["drives"].values()
    out = []
    if len({(drive["generation"], drive["compensation"]) for drive in drives}) > 1:
        out.append(f"the drives differ: {status['drives']}")
    if any(drive["compensation"] == TRIAL for drive in drives):
        out.append(f"a drive is on trial: {status['drives']}")
    if any(drive["moving"] for drive in drives):
        out.append("a drive moves after the command has ended")
    return out
