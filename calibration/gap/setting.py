"""What effects may know of a campaign, from its baseline."""

from __future__ import annotations

import numpy as np

from calibration.effects.base import Setting
from calibration.gap.evidence import Readout
from calibration.gap.periods import Periodogram


def setting_of(readout: Readout) -> Setting:
    """The setting of a readout's readings; periods are searched in what it has left unexplained."""
    known, machine = readout.baseline, readout.baseline.machine
    visit = np.maximum(known.visit, 0)
    force = known.poses.rest.force_n[:, : len(machine.strut_names)]
    direction = known.poses.sensitivity.state.direction[:, : len(machine.strut_names)]
    if direction.shape[0] == 2:
        direction = np.concatenate([direction, np.zeros((1, *direction.shape[1:]))])
    drives = len(machine.drive_names)
    pull, moment = np.zeros((len(visit), drives, 3)), np.zeros((len(visit), drives))
    joints = known.poses.geometry.base_joint_m
    for a in range(drives):
        struts = np.flatnonzero(machine.strut_drive == a)
        middle = joints[struts].mean(axis=0) if struts.size else np.zeros(3)
        for i in struts:
            # A strut in tension pulls its slider towards the platform.
            on_slider = (force[:, i] * direction[:, i])[:, visit].T
            pull[:, a] += on_slider
            moment[:, a] += np.cross(np.broadcast_to(joints[i] - middle, on_slider.shape), on_slider)[:, 2]
    periodograms: dict[int, Periodogram] = {}

    def periods(drive: int, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        if drive not in periodograms:
            periodograms[drive] = periodogram(readout, drive)
        return periodograms[drive].strongest(shortest_m, longest_m)

    return Setting(
        machine=machine,
        moments=known.moments,
        tension_n=force[visit],
        pull_n=pull,
        moment_nm=moment,
        sight_m=known.position_m,
        channels=readout.channels.names,
        periods=periods,
    )


def periodogram(readout: Readout, drive: int) -> Periodogram:
    """Periodogram of what is left over a drive's coordinate."""
    response = readout.channels[f"travel.{readout.baseline.machine.drive_names[drive]}"]
    rows = np.flatnonzero(readout.baseline.visit >= 0)
    score = np.sum(response * readout.left, axis=1)[rows]
    information = float(np.sum(response[rows] ** 2))
    return Periodogram.of(readout.baseline.moments.drives[rows, drive], score, information)
