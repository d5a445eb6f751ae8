"""What effects may know of a campaign, from its baseline."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.effects.base import Setting
from calibration.gap.baseline import Seen
from calibration.gap.channels import Channels
from calibration.gap.evidence import Readout
from calibration.gap.periods import Periodogram


def setting_of(readout: Readout) -> Setting:
    """The setting of a readout's readings; periods are searched in what it has left unexplained."""
    periodograms: dict[int, Periodogram] = {}

    def periods(drive: int, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        if drive not in periodograms:
            periodograms[drive] = periodogram(readout, drive)
        return periodograms[drive].strongest(shortest_m, longest_m)

    return setting_from(readout.baseline, readout.channels, periods)


Periods = Callable[[int, float, float], list[tuple[float, float]]]


def setting_from(seen: Seen, channels: Channels, periods: Periods) -> Setting:
    """The setting of readings, with the forces of the modelled machine."""
    machine, visit = seen.machine, np.maximum(seen.visit, 0)
    force = seen.poses.rest.force_n[:, : len(machine.strut_names)]
    direction = seen.poses.sensitivity.state.direction[:, : len(machine.strut_names)]
    if direction.shape[0] == 2:
        direction = np.concatenate([direction, np.zeros((1, *direction.shape[1:]))])
    drives = len(machine.drive_names)
    pull, moment = np.zeros((len(visit), drives, 3)), np.zeros((len(visit), drives))
    joints = seen.poses.geometry.base_joint_m
    for a in range(drives):
        struts = np.flatnonzero(machine.strut_drive == a)
        middle = joints[struts].mean(axis=0) if struts.size else np.zeros(3)
        for i in struts:
            # A strut in tension pulls its slider towards the platform.
            on_slider = (force[:, i] * direction[:, i])[:, visit].T
            pull[:, a] += on_slider
            moment[:, a] += np.cross(np.broadcast_to(joints[i] - middle, on_slider.shape), on_slider)[:, 2]
    return Setting(
        machine=machine,
        moments=seen.moments,
        tension_n=force[visit],
        pull_n=pull,
        moment_nm=moment,
        sight_m=seen.position_m,
        channels=channels.names,
        periods=periods,
    )


def periodogram(readout: Readout, drive: int) -> Periodogram:
    """Periodogram of what is left over a drive's coordinate."""
    response = readout.response(f"travel.{readout.baseline.machine.drive_names[drive]}")
    rows = np.flatnonzero(readout.baseline.visit >= 0)
    score = np.sum(response * readout.left, axis=1)[rows]
    information = float(np.sum(response[rows] ** 2))
    return Periodogram.of(readout.baseline.moments.drives[rows, drive], score, information)
