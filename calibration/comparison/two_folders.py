"""The linear model of two measurement folders of one machine: coordinates of the tool, and distances.

As of two recordings (`two_campaigns`): common to both are the machine's parameters and a smooth curve of each drive;
each has its own instrument and disturbances. No unknown of the machine is left out, whatever a former fit varied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.comparison.candidates import Candidate, candidates
from calibration.comparison.two_campaigns import (
    CURVE_M,
    CURVE_TERMS,
    LEAST_SCATTER,
    TwoCampaigns,
    curve_of_drive,
    joint_columns,
    scatter_of,
)
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linear_folder import LinearFolder, linearise_measurements
from calibration.diagnosis.linearised_readings import inverse_covariance_factor
from calibration.diagnosis.positioning import most_likely_positioning_m
from calibration.recording.measurement_folder import MeasuredMachine


@dataclass(frozen=True)
class TwoFolders(TwoCampaigns):
    """The linear model of both folders, each at the point of its own fit."""

    before: LinearFolder
    after: LinearFolder

    def largest_rms(self, whitened: Array) -> float:
        """RMS in sigma over the numbers read after, of shifts (m,)."""
        return self.after.rms_sigma(whitened[self.of_after].reshape(self.after.residual.shape))


def linearise_folders(before: MeasuredMachine, after: MeasuredMachine) -> TwoFolders:
    """Both folders, wrong readings left out. Raises InputError."""
    models = [with_all_unknowns(linearise_measurements(measured)) for measured in (before, after)]
    positioning_sd_m = min(most_likely_positioning_m(linear) for linear in models)
    models = [linear.standing_off(positioning_sd_m) for linear in models]
    scatter = scatter_of(models[0]), scatter_of(models[1])
    weights = [1.0 / max(each, LEAST_SCATTER) for each in scatter]
    parameters = {p.name for p in models[0].poses.model.parameters.parameters}
    parts = [_columns_of(linear) for linear in models]
    common = [name for name in parts[0] if name in parts[1] and (name in parameters or name.startswith("curve."))]
    names, columns = joint_columns(parts, common, weights)
    residual = np.concatenate([w * linear.residual.ravel() for w, linear in zip(weights, models, strict=True)])
    q = np.concatenate([inverse_covariance_factor(columns[:, None, :])[:, 0], *_open_ends(models)], axis=1)
    anew = np.zeros((len(residual), 1))  # parts of a folder have no temperature that differs anew, and no reflectors
    return TwoFolders(models[0], models[1], residual, columns, names, q, anew, scatter, positioning_sd_m, frozenset())


def candidates_of_folders(pair: TwoFolders) -> list[Candidate]:
    """What may have changed, as far as both folders have it for an unknown: no reflector, no nest."""
    known, out = {*pair.before.names} & {*pair.after.names}, []
    for candidate in candidates(pair.after.machine, (), frozenset()):
        ways = tuple(
            way for way in candidate.ways if all(not move.unknown or move.unknown in known for move in way.moves)
        )
        if ways:
            out.append(replace(candidate, ways=ways))
    return out


def require_one_measured_machine(before: MeasuredMachine, after: MeasuredMachine) -> None:
    """Raise InputError, in one line, unless both folders are of one machine with the same nominal values."""
    names = f"{before.file.name} and {after.file.name}"
    if before.machine.name != after.machine.name:
        raise InputError(
            f"{names} are of different machines, {before.machine.name} and {after.machine.name}; compare folders of one"
        )
    ours, others = (measured.machine.file.model_copy(update={"smrs": []}) for measured in (before, after))
    if ours != others:
        raise InputError(
            f"{names}: their machine.toml differ; a difference of nominal values is no change of the machine: put the "
            "same machine.toml into both, with the drive coordinates as they were read"
        )
    same = before.visits.drives.shape == after.visits.drives.shape
    if same and all(
        np.array_equal(one, other, equal_nan=True)
        for one, other in (
            (before.visits.drives, after.visits.drives),
            (before.coordinates, after.coordinates),
            (before.distance_m, after.distance_m),
        )
    ):
        raise InputError(f"{before.file.name}: the same readings twice; give two folders")


def with_all_unknowns(linear: LinearFolder) -> LinearFolder:
    """The folder with the unknowns that a former fit left alone among those that are fitted."""
    if not linear.left_unknowns:
        return linear
    more = [linear.left_alone[unknown.name] * unknown.sigma for unknown in linear.left_unknowns]
    at, count = len(linear.sigma), len(more)
    columns = np.insert(linear.columns, [at] * count, np.stack(more, axis=2), axis=2)
    return replace(
        linear,
        columns=columns,
        names=(*linear.names[:at], *(unknown.name for unknown in linear.left_unknowns), *linear.names[at:]),
        sigma=np.concatenate([linear.sigma, [unknown.sigma for unknown in linear.left_unknowns]]),
        q=linear.factor_of(columns),
        of_calibration=linear.of_calibration + count,
        left_alone={},
        left_unknowns=(),
    )


def _columns_of(linear: LinearFolder) -> dict[str, Array]:
    """All columns (m,) of one folder by name: its own and each drive's curve."""
    out = {name: linear.columns[:, :, k].ravel() for k, name in enumerate(linear.names)}
    channels, machine = Channels(linear), linear.machine
    for a, drive in enumerate(machine.drive_names):
        response = linear.whiten_shift(channels.shift_m(f"travel.{drive}"))
        curve = curve_of_drive(machine.travel[a], linear.context.drives[:, a], CURVE_TERMS) * CURVE_M
        for k, shape in enumerate(curve.T):
            out[f"curve.{drive}.{k}"] = linear.joined(response * shape[:, None]).ravel()
    return out


def _open_ends(models: list[LinearFolder]) -> list[Array]:
    """Factors (m, r) by which the ends of each folder's distances are open to one another."""
    out, before = [], 0
    total = sum(linear.residual.size for linear in models)
    for linear in models:
        ends = linear.rows.open_ends()[:, 0]
        padded = np.zeros((total, ends.shape[1]))
        padded[before : before + len(ends)] = ends
        out.append(padded)
        before += len(ends)
    return out
