"""The inputs of effects, from the readings of a recording and the forces of the fitted machine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.observed_model import ObservedModel
from calibration.diagnosis.periodogram import COMMON_M, SHORTEST_M, Periodogram
from calibration.effects.api import EffectInputs, Periods
from calibration.effects.basis_functions import cosine_basis
from calibration.effects.columns import Contributions
from calibration.machine.sensitivity import Sensitivity

ONSETS_APART_S = 40.0
MAX_ONSETS, MAX_FURTHER_ONSETS, MAX_ONSETS_OF_STRENGTH = 6, 2, 3
CHANGING_BY_CHANCE, MOST_CHANGING_PERIODS = 1.0e-9, 3  # of a wave that changes, at each of millions of frequencies
CHANGING_S = 900.0  # in which what motions have warmed cools again
Onsets = Callable[[Sequence[str]], list[tuple[float, float]]]


def inputs_of_recording(likelihood: MarginalLikelihood, periodograms: tuple[Periodogram, ...]) -> EffectInputs:
    """The inputs of effects on a recording's readings, with a periodogram for each drive."""

    @cache
    def changing(drive: int) -> Periodogram:
        return _periodogram_of_changing_waves(likelihood, drive)

    @cache
    def periods(
        drive: int, shortest_m: float, longest_m: float, over: tuple[float, ...] = ()
    ) -> list[tuple[float, float]]:
        if over:
            return _periodogram(likelihood, drive, over, shortest_m).strongest_periods(shortest_m, longest_m)
        lasting = periodograms[drive].strongest_periods(shortest_m, longest_m)
        resolution = periodograms[drive].resolution
        further = [
            (period_m, prior)
            for period_m, prior in changing(drive).strongest_periods(
                shortest_m, longest_m, by_chance=CHANGING_BY_CHANCE
            )
            if all(abs(1.0 / period_m - 1.0 / other_m) > resolution for other_m, _ in lasting)
        ]
        return lasting + further[:MOST_CHANGING_PERIODS]

    def onsets(channels: Sequence[str]) -> list[tuple[float, float]]:
        return strongest_onsets(likelihood, channels)

    def strength_onsets(_: str, column: Contributions) -> list[tuple[float, float]]:
        return strongest_onsets_of_strength(likelihood, column)

    inputs = inputs_of_readings(likelihood.linear, likelihood.channels, periods, onsets)
    return replace(inputs, strength_onsets=strength_onsets)


def inputs_of_readings(observed: ObservedModel, channels: Channels, periods: Periods, onsets: Onsets) -> EffectInputs:
    """The inputs of effects on any readings of a modelled machine."""
    machine, visit = observed.machine, np.maximum(observed.visit, 0)
    force = observed.poses.equilibrium.force_n[:, : len(machine.strut_names)]
    direction = observed.poses.sensitivity.state.direction[:, : len(machine.strut_names)]
    if direction.shape[0] == 2:
        direction = np.concatenate([direction, np.zeros((1, *direction.shape[1:]))])
    drives = len(machine.drive_names)
    pull, moment = np.zeros((len(visit), drives, 3)), np.zeros((len(visit), drives))
    joints = observed.poses.geometry.base_joint_m
    for a in range(drives):
        struts = np.flatnonzero(machine.strut_drive == a)
        middle = joints[struts].mean(axis=0) if struts.size else np.zeros(3)
        for i in struts:
            # A strut in tension pulls its slider towards the platform.
            on_slider = (force[:, i] * direction[:, i])[:, visit].T
            pull[:, a] += on_slider
            moment[:, a] += np.cross(np.broadcast_to(joints[i] - middle, on_slider.shape), on_slider)[:, 2]
    return EffectInputs(
        machine=machine,
        context=observed.context,
        tension_n=force[visit],
        tension_response_n_per_m=_tension_response(observed.poses.sensitivity)[visit],
        pull_n=pull,
        moment_nm=moment,
        sight_m=observed.sight_m,
        channels=channels.names,
        periods=periods,
        onsets=onsets,
        payload_elongation_m={
            name: _payload_elongation(observed.poses.sensitivity, channels.payload_column(name))[visit]
            for name in channels.names
            if name.startswith("payload.")
        },
    )


def _tension_response(sensitivity: Sensitivity) -> Array:
    """Change (v, s, s) of the tension of each strut with the length of each: dt_i = k_i (J_i dx - dl_i)."""
    struts = len(sensitivity.geometry.length_m)
    pose_response = sensitivity.pose_derivatives([sensitivity.length(j) for j in range(struts)])
    elongation = np.einsum("fin,nfj->nij", sensitivity.state.wrench[:, :struts], pose_response)
    return np.asarray(sensitivity.geometry.stiffness_n_per_m[:struts, None] * (elongation - np.eye(struts)))


def _payload_elongation(sensitivity: Sensitivity, column: Array) -> Array:
    """Elongation (v, s) of each strut by a payload that changes by a column (f, v): J_i dx."""
    struts = len(sensitivity.geometry.length_m)
    pose_response = sensitivity.pose_derivatives([column])[:, :, 0]
    return np.asarray(np.einsum("fin,nf->ni", sensitivity.state.wrench[:, :struts], pose_response))


def periodograms(likelihood: MarginalLikelihood) -> tuple[Periodogram, ...]:
    """Periodogram of the weighted residual along each drive's coordinate."""
    drives = len(likelihood.linear.machine.drive_names)
    return tuple(_periodogram(likelihood, a, np.eye(drives)[a], SHORTEST_M) for a in range(drives))


def _periodogram(
    likelihood: MarginalLikelihood, drive: int, over: Sequence[float] | Array, finest_m: float
) -> Periodogram:
    """Periodogram of the weighted residual of a drive along the drives' coordinates, each times its weight (d,)."""
    linear = likelihood.linear
    rows = np.flatnonzero(linear.visit >= 0)
    response = likelihood.response(f"travel.{linear.machine.drive_names[drive]}")
    score = np.sum(response * likelihood.weighted_residual, axis=1)[rows]
    information = float(np.sum(response[rows] ** 2))
    return Periodogram.from_scores(linear.context.drives[rows] @ np.asarray(over), score, information, finest_m)


def _periodogram_of_changing_waves(likelihood: MarginalLikelihood, drive: int) -> Periodogram:
    """Periodogram along a drive of waves whose size changes its sign, and which one of the same size would not show:
    with time, side of the approach, or what its motions have warmed."""
    linear = likelihood.linear
    rows, context = np.flatnonzero(linear.visit >= 0), linear.context
    changes = [context.direction[:, drive : drive + 1]]
    if "t_s" not in context.not_said:
        changes.append(cosine_basis(context.elapsed_s, 2, roughness=0.0))
    if not {"t_s", "history"} & context.not_said.keys():
        changes.append(cosine_basis(context.motion_heat(drive, CHANGING_S), 1))
    by = np.column_stack(changes)[rows]
    by = by - by.mean(axis=0)
    response = likelihood.response(f"travel.{linear.machine.drive_names[drive]}")
    score = np.sum(response * likelihood.weighted_residual, axis=1)[rows]
    information = np.sum(response[rows] ** 2, axis=1)
    return Periodogram.from_scores(
        context.drives[rows, drive], score[:, None] * by, np.sum(information[:, None] * by**2, axis=0), COMMON_M
    )


def strongest_onsets(likelihood: MarginalLikelihood, channels: Sequence[str]) -> list[tuple[float, float]]:
    """Times, in s since the campaign's start, of the most likely lasting changes of some channels, with their prior.

    The likelihood ratio of a step at every arrival, a constant projected out; peaks at least ONSETS_APART_S apart. The
    last of them are the most likely ones beside a step at the first: what comes back hides in a single step.
    """
    order = np.argsort(likelihood.linear.context.t_s, kind="stable")
    sums = [_sums_from_each(likelihood, likelihood.response(channel), order) for channel in channels]
    return _likeliest_steps(likelihood, sums, order, MAX_ONSETS, MAX_FURTHER_ONSETS)


def strongest_onsets_of_strength(likelihood: MarginalLikelihood, column: Contributions) -> list[tuple[float, float]]:
    """The same of a column, which is projected out as the constant is there: times when its strength changes."""
    order = np.argsort(likelihood.linear.context.t_s, kind="stable")
    shifts = np.sum([likelihood.response(channel) * shape[:, None] for channel, shape in column], axis=0)
    return _likeliest_steps(likelihood, [_sums_from_each(likelihood, shifts, order)], order, MAX_ONSETS_OF_STRENGTH, 0)


def _likeliest_steps(
    likelihood: MarginalLikelihood,
    sums: Sequence[tuple[Array, Array]],
    order: NDArray[np.intp],
    most: int,
    further: int,
) -> list[tuple[float, float]]:
    """The most likely steps, and further ones beside the first, with their prior."""
    context = likelihood.linear.context
    t = context.elapsed_s[order]
    arrivals = np.flatnonzero(np.diff(context.arrival[order], prepend=-1) != 0)
    arrivals = arrivals[t[arrivals] > 0.0]
    rows: list[int] = []
    for beside, end in ((0, most), (1, most + further)):
        gain = _gain_of_step(sums, sorted(rows[:beside]), len(t))
        for row in arrivals[np.argsort(gain[arrivals])[::-1]]:
            if len(rows) == end:
                break
            if all(abs(_between(t, row) - _between(t, other)) > ONSETS_APART_S for other in rows):
                rows.append(int(row))
    return [(_between(t, row), 1.0 / max(len(arrivals), 1)) for row in rows]


def _between(t_s: Array, row: int) -> float:
    """The middle between a reading and the last before it, in time."""
    return 0.5 * float(t_s[row] + t_s[row - 1])


def _sums_from_each(likelihood: MarginalLikelihood, shifts: Array, order: NDArray[np.intp]) -> tuple[Array, Array]:
    """Information and score (n + 1,) of shifts (n, w) over all readings from each one on, in an order."""
    information = np.sum(shifts[order] ** 2, axis=1)
    score = np.sum(shifts[order] * likelihood.weighted_residual[order], axis=1)
    information_from, score_from = (np.append(np.cumsum(x[::-1])[::-1], 0.0) for x in (information, score))
    return information_from, score_from


def _gain_of_step(sums: Sequence[tuple[Array, Array]], steps: Sequence[int], n: int) -> Array:
    """Twice the log likelihood ratio (n,) of a step at each reading beside some steps, a constant projected out."""
    gain = np.zeros(n)
    for begin, end in itertools.pairwise((0, *steps, n)):
        rows = slice(begin, end)
        for information_from, score_from in sums:
            information, score = information_from[rows] - information_from[end], score_from[rows] - score_from[end]
            share = information / max(float(information[0]), 1e-300)
            remaining = information * (1.0 - share)
            squares = (score - score[0] * share) ** 2 / np.maximum(remaining, 1e-300)
            gain[rows] += np.where(remaining > 0.0, squares, 0.0)
    return gain
