"""What effects may know of a campaign, from its baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import Seen
from calibration.diagnosis.periodogram import Periodogram
from calibration.effects.api import Setting
from calibration.machine.sensitivity import Sensitivity


def setting_of(readout: Readout, found: tuple[Periodogram, ...]) -> Setting:
    """The setting of a readout's readings; `found`: periodograms of its drives."""

    def periods(drive: int, shortest_m: float, longest_m: float) -> list[tuple[float, float]]:
        return found[drive].strongest(shortest_m, longest_m)

    def onsets(channels: Sequence[str]) -> list[tuple[float, float]]:
        return strongest_onsets(readout, channels)

    return setting_from(readout.baseline, readout.channels, periods, onsets)


APART_S = 40.0
FEW_ONSETS = 6
Periods = Callable[[int, float, float], list[tuple[float, float]]]
Onsets = Callable[[Sequence[str]], list[tuple[float, float]]]


def setting_from(seen: Seen, channels: Channels, periods: Periods, onsets: Onsets) -> Setting:
    """The setting of readings, with the forces of the modelled machine."""
    machine, visit = seen.machine, np.maximum(seen.visit, 0)
    force = seen.poses.equilibrium.force_n[:, : len(machine.strut_names)]
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
        answer_n_per_m=_answers(seen.poses.sensitivity)[visit],
        pull_n=pull,
        moment_nm=moment,
        sight_m=seen.position_m,
        channels=channels.names,
        periods=periods,
        onsets=onsets,
    )


def _answers(known: Sensitivity) -> Array:
    """Change (v, s, s) of the tension of each strut with the length of each: dt_i = k_i (J_i dx - dl_i)."""
    struts = len(known.geometry.length_m)
    yielding = known.pose_derivatives([known.length(j) for j in range(struts)])
    turned = np.einsum("fin,nfj->nij", known.state.wrench[:, :struts], yielding)
    return np.asarray(known.geometry.stiffness_n_per_m[:struts, None] * (turned - np.eye(struts)))


def periodograms(readout: Readout) -> tuple[Periodogram, ...]:
    """Periodogram of what is left over each drive's coordinate."""
    out = []
    rows = np.flatnonzero(readout.baseline.visit >= 0)
    for a, drive in enumerate(readout.baseline.machine.drive_names):
        response = readout.response(f"travel.{drive}")
        score = np.sum(response * readout.left, axis=1)[rows]
        information = float(np.sum(response[rows] ** 2))
        out.append(Periodogram.of(readout.baseline.moments.drives[rows, a], score, information))
    return tuple(out)


def strongest_onsets(readout: Readout, channels: Sequence[str]) -> list[tuple[float, float]]:
    """Moments, in s since the beginning, at which channels may have changed for good; each with its prior probability.

    The likelihood ratio of a step at every arrival, a constant taken out; peaks apart by APART_S.
    """
    m = readout.baseline.moments
    order = np.argsort(m.t_s, kind="stable")
    t = m.elapsed_s[order]
    gain = np.zeros(len(t))
    for channel in channels:
        response = readout.response(channel)[order]
        information = np.cumsum(np.sum(response**2, axis=1)[::-1])[::-1]
        score = np.cumsum(np.sum(response * readout.left[order], axis=1)[::-1])[::-1]
        share = information / max(float(information[0]), 1e-300)
        left = information * (1.0 - share)
        gain += np.where(left > 0.0, (score - score[0] * share) ** 2, 0.0) / np.maximum(left, 1e-300)
    starts = np.flatnonzero(np.diff(m.arrival[order], prepend=-1) != 0)
    starts = starts[t[starts] > 0.0]
    found: list[float] = []
    for k in starts[np.argsort(gain[starts])[::-1]]:
        at = 0.5 * float(t[k] + t[k - 1])  # between the last reading before and the first one after
        if all(abs(at - other) > APART_S for other in found):
            found.append(at)
        if len(found) == FEW_ONSETS:
            break
    return [(at, 1.0 / max(len(starts), 1)) for at in found]
