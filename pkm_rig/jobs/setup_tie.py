"""Tie the set-up of the station in which a campaign goes on to those before, by nests and by poses visited again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.errors import InputError
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import drop_unused_setups, usable_readings
from calibration.reduction.recording_setups import require_common_points, require_equal_nest_distances
from calibration.reduction.reduction import CALIBRATION
from pkm_rig.results.callbacks import Progress
from pkm_rig.rig.plans import nest_check, tie_setup
from pkm_rig.rig.runner import Runner
from pkm_rig.rig.schedule import Block, PlannedVisit, commanded_drives

POSES = 3  # far apart, the further ones for the angles of the tie; one would do
PLAN = "set-up"


@dataclass
class PlannedReadings:
    """How many readings a campaign will have; those of verification among them."""

    total: int
    verification: int = 0

    def show_by(self, progress: Progress) -> Callable[[int, str], None]:
        """Progress of a runner, which knows no total."""
        return lambda count, what: progress(count, self.total, what)


def tie_to_earlier_setups(runner: Runner, total: PlannedReadings) -> None:
    """Measure what ties the present set-up to those before; nothing in the first, or where it is tied.

    Raises InputError if a nest has moved since then, or if there are too few common points.
    """
    devices, rig = runner.devices, runner.rig
    if devices.tags.setup == 1:
        return
    nests = len(devices.smrs("floor"))
    total.total += nests
    rig.enable()
    rig.compensate(None)
    rig.refresh_atmosphere()
    runner.run(nest_check(devices), PLAN)
    require_equal_nest_distances(_recording(runner))
    if _is_tied(runner):
        return
    block = _poses_to_visit_again(runner)
    total.total += len(block.visits) * len(devices.smrs("platform", "slider")) + 2 * nests
    runner.run(tie_setup(devices, block), PLAN)
    require_equal_nest_distances(_recording(runner))
    require_common_points(_recording(runner))


def _recording(runner: Runner) -> Recording:
    """What is stored, without set-ups that were given up before the present one."""
    return drop_unused_setups(runner.store.recording(runner.campaign), keep=runner.devices.tags.setup)


def _is_tied(runner: Runner) -> bool:
    try:
        require_common_points(_recording(runner))
    except InputError:
        return False
    return True


def _poses_to_visit_again(runner: Runner) -> Block:
    """Visits of earlier set-ups, far apart, with the payload that is on if it can be.

    InputError, which says what to measure, if there are none with all reflectors.
    """
    recording = _recording(runner)
    smrs = runner.devices.smrs("platform", "slider")
    recording = recording.take(
        usable_readings(recording)
        & (np.asarray(recording["phase"]) == CALIBRATION)
        & (recording["station"] < runner.devices.tags.setup)
        & (recording["compensation"] == 0.0)
    )
    visits, first, count = np.unique(recording["visit"], return_index=True, return_counts=True)
    first = first[count >= len(smrs)]
    if not visits.size or not first.size:
        require_common_points(_recording(runner))  # says what is missing
    recording = recording.take(first)
    payloads = recording["payload"]
    on = runner.rig.supervisor.state().payload
    payload = on if on is not None and on in payloads else int(payloads.min())
    recording = recording.take(payloads == payload)
    recording = recording.take(_far_apart(recording))
    return Block(payload, tuple(_visit_again(runner, recording, row) for row in range(len(recording))))


def _far_apart(recording: Recording) -> NDArray[np.intp]:
    """Rows of a few poses: each the farthest from those before it."""
    target_m = recording.targets_m()[:, :3]
    away = np.linalg.norm(target_m - target_m.mean(axis=0), axis=1)
    rows: list[int] = []
    while len(rows) < POSES and away.max() > 0.0:
        rows.append(int(np.argmax(away)))
        distances = np.linalg.norm(target_m - target_m[rows[-1]], axis=1)
        away = distances if len(rows) == 1 else np.minimum(away, distances)
    return np.array(rows or [0], dtype=np.intp)


def _visit_again(runner: Runner, recording: Recording, row: int) -> PlannedVisit:
    target_m = recording.targets_m()[row]
    return PlannedVisit(
        pose=int(recording["pose"][row]),
        pass_=int(recording["pass"][row]),
        target_m=target_m,
        drives_m=commanded_drives(runner.rig.machine, target_m[None])[0],
        payload=int(recording["payload"][row]),
        direction=tuple(int(side) for side in recording.drives("direction")[row]),
        speed_m_per_s=float(recording["speed_m_per_s"][row]),
        dwell_s=runner.rig.file.campaign.dwells_s[0],
    )
