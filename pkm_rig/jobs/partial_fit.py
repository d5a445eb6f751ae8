"""The fit of a partial calibration: the former one is the prior, grown by what may have changed since.

Only what the reasons allow is let loose: the offset of a drive that has lost its reference, or thermal expansion. All
else has walked as drift does without any event, so that a few readings move it as little as they must.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.from_prior import Prior, identify_from_prior
from calibration.identification.positioning import with_positioning
from calibration.instruments.setups import RANGE_ERRORS
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.intervals.check_estimate import CheckDesign
from calibration.intervals.drift import DriftSettings
from calibration.intervals.extent import Measurement
from calibration.intervals.partial import grown_covariance
from calibration.intervals.watched import carried_shift, drive_offset
from calibration.machine.description import PARTS, Machine
from calibration.recording.recording import Recording
from calibration.reduction.figures import figure_axes
from calibration.reduction.pose_filter import filter_poses
from calibration.reduction.reduction import CALIBRATION
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.jobs.check_readings import machine_frame, observe
from pkm_rig.jobs.reference import MOUNTING, Reference

OFFSET_U_M = 1e-3  # by which a drive that has lost its reference may stand off


def growth_of(reference: Reference, measurement: Measurement) -> Array:
    """Covariance (k, k) of the reference's unknowns by which they may have changed, for what is to be measured.

    A drive's offset (`drive_offset`) takes the reflectors along that it carries.
    """
    names, machine = reference.names, reference.machine
    growth = np.zeros((len(names), len(names)))
    if measurement.extent == "expansion":
        for part in PARTS:
            if f"expansion.{part}" in names:
                row = names.index(f"expansion.{part}")
                growth[row, row] = machine.u_expansion_per_k[part] ** 2
        return growth
    parameters = reference.model.parameters
    for drive in measurement.drives:
        number = machine.drive_names.index(drive) if drive in machine.drive_names else None
        offset = np.zeros(len(parameters)) if number is None else drive_offset(parameters, number)
        if number is None or not np.any(offset):
            raise InputError(f"drive {drive}: its offset is no change of this machine; calibrate in full")
        column = np.zeros(len(names))
        column[: len(parameters)] = offset
        for smr in machine.smrs:
            if smr.on == "slider" and smr.drive == number:
                for axis, share in zip("xyz", carried_shift(machine, number, smr.position_m), strict=True):
                    column[names.index(f"{MOUNTING}{smr.name}.{axis}")] = share
        growth += offset_u(machine, number) ** 2 * np.outer(column, column)
    return growth


def offset_u(machine: Machine, drive: int) -> float:
    """By how much (m; rad of a crank) a drive that has lost its reference may stand off: OFFSET_U_M at its joint."""
    return OFFSET_U_M / float(machine.arms_m[drive])


def walk_of(reference: Reference, design: CheckDesign, age_s: float, drift: DriftSettings) -> Array:
    """Covariance (k, k) of the reference's unknowns by which they have walked since, without any event.

    design: of a check with all poses, whose standard uncertainties the walk is stated in.
    """
    count, size = len(reference.model.parameters), len(design.by_parameter[0])
    walked = grown_covariance(np.zeros((size, size)), design.watched, design.change_u, age_s, drift)
    mountings = [f"{MOUNTING}{reference.machine.smrs[i].name}.{axis}" for i in reference.moving for axis in "xyz"]
    rows = [*range(count), *(reference.names.index(name) for name in mountings)]
    growth = np.zeros((len(reference.names), len(reference.names)))
    growth[np.ix_(rows, rows)] = walked
    return growth


def fit_partly(reference: Reference, recording: Recording, growth: Array) -> Fit:
    """The former calibration, brought up to date by the few readings of a recording.

    growth (k, k): covariance of what its unknowns may have changed by since. What the ranges of this session have in
    common, which few readings of the nests leave open by some ten micrometres, is fitted and then left out: predictions
    are in the scale of the former calibration, which had many more. InputError if the search does not settle.
    """
    observed = observe(recording, reference, CALIBRATION).observations
    accuracy = recording.file.station.accuracy.to_station_accuracy()
    smrs = tuple(sorted(set(observed.smr.tolist())))
    station = StationModel.from_accuracy(machine_frame(reference, observed), smrs, accuracy)
    prior = Prior(reference.names, reference.values, reference.covariance + growth)
    fit = identify_from_prior(reference.model, observed.visits, [SmrPositions(observed, station)], prior)
    if not fit.converged:
        raise InputError(
            f"the few readings and calibration {reference.campaign} settle on no machine together: more has changed "
            "than was thought; calibrate anew"
        )
    of_session = np.array([name in RANGE_ERRORS for name in fit.layout.names])
    return replace(with_positioning(fit), unknowns=np.where(of_session, 0.0, fit.unknowns))


@dataclass(frozen=True)
class PoseErrors:
    """Errors of the tool at verification poses: in the coordinates that figures are of, and their uncertainty.

    moves_m (n, m); turns_rad (n, t), t = 0 where the drives command no rotation; pose (n,): numbers of the poses.
    move_u_m, turn_u_rad: standard uncertainty of one coordinate, the root of the mean variance.
    """

    moves_m: Array
    turns_rad: Array
    pose: NDArray[np.intp]
    move_u_m: float
    turn_u_rad: float

    def at(self, poses: NDArray[np.intp]) -> PoseErrors:
        """Those of some poses, in that order; the last measurement of each."""
        rows = [int(np.flatnonzero(self.pose == pose)[-1]) for pose in poses]
        return replace(self, moves_m=self.moves_m[rows], turns_rad=self.turns_rad[rows], pose=poses)


def tool_errors(recording: Recording, reference: Reference, report: ReportFrame, phase: str) -> PoseErrors:
    """Errors of the tool at the verification poses of a phase, in the frame of before and after."""
    machine = report.machine
    observed = observe(recording, reference, phase, drives_matter=False)
    poses = filter_poses(report, observed.observations)
    moves, turns = figure_axes(machine)
    if not np.any(machine.commanded > 2):
        turns = turns[:0]
    position, rotation = report.tool_error(
        poses.coordinates[poses.measured], observed.observations.visits.target_m[poses.measured]
    )
    variance = np.nanmean(np.diagonal(poses.covariance, axis1=1, axis2=2), axis=0) * reference.noise**2
    move_u, turn_u = (
        float(np.sqrt(np.mean(variance[np.isin(machine.dof, axes)]))) if len(axes) else 0.0
        for axes in (moves, turns + 3)
    )
    return PoseErrors(position[:, moves], rotation[:, turns], observed.pose[poses.measured], move_u, turn_u)
