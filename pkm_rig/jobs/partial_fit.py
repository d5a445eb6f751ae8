"""The fit of a partial calibration: the former one is the prior, grown by what may have changed since.

Only what the reasons allow is let loose: the offset of a drive that has lost its reference, or thermal expansion. All
else has walked as drift does without any event, so that a few readings move it as little as they must.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.from_prior import Prior, identify_from_prior
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.intervals.check_estimate import CheckDesign
from calibration.intervals.drift import DriftSettings
from calibration.intervals.extent import Measurement
from calibration.intervals.partial import grown_covariance
from calibration.intervals.watched import watched_changes
from calibration.machine.description import PARTS
from calibration.recording.recording import Recording
from calibration.reduction.figures import free_axes
from calibration.reduction.pose_filter import filter_poses
from calibration.reduction.reduction import CALIBRATION
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.jobs.check_readings import machine_frame, observe
from pkm_rig.jobs.reference import MOUNTING, Reference

OFFSET_U_M = 1e-3  # by which a drive that has lost its reference may stand off


def growth_of(reference: Reference, measurement: Measurement) -> Array:
    """Covariance (k, k) of the reference's unknowns by which they may have changed, for what is to be measured.

    A drive's offset moves both base joints of its struts and its slider's reflector along its axis.
    """
    names, machine = reference.names, reference.machine
    growth = np.zeros((len(names), len(names)))
    if measurement.extent == "expansion":
        for part in PARTS:
            if f"expansion.{part}" in names:
                row = names.index(f"expansion.{part}")
                growth[row, row] = machine.u_expansion_per_k[part] ** 2
        return growth
    watched = watched_changes(reference.model.parameters)
    for drive in measurement.drives:
        column = np.zeros(len(names))
        name = f"drive_offset.{drive}"
        if name not in watched.names:
            raise InputError(f"drive {drive}: its offset is no change of this machine; calibrate in full")
        column[: len(reference.model.parameters)] = watched.combination[:, watched.names.index(name)]
        number = machine.drive_names.index(drive)
        for smr in machine.smrs:
            if smr.on == "slider" and smr.drive == number:
                for axis, share in zip("xyz", machine.nominal.axis[number], strict=True):
                    column[names.index(f"{MOUNTING}{smr.name}.{axis}")] = share
        growth += OFFSET_U_M**2 * np.outer(column, column)
    return growth


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

    growth (k, k): covariance of what its unknowns may have changed by since.
    """
    observed = observe(recording, reference, CALIBRATION).observations
    accuracy = recording.file.station.accuracy.to_station_accuracy()
    smrs = tuple(sorted(set(observed.smr.tolist())))
    station = StationModel.from_accuracy(machine_frame(reference, observed), smrs, accuracy)
    prior = Prior(reference.names, reference.values, reference.covariance + growth)
    return identify_from_prior(reference.model, observed.visits, [SmrPositions(observed, station)], prior)


def tool_errors(
    recording: Recording, reference: Reference, report: ReportFrame, phase: str
) -> tuple[Array, NDArray[np.intp]]:
    """Errors (n, m) of the tool's free coordinates at the verification poses, and the poses' numbers (n,)."""
    observed = observe(recording, reference, phase, drives_matter=False)
    poses = filter_poses(report, observed.observations)
    position, _ = report.tool_error(
        poses.coordinates[poses.measured], observed.observations.visits.target_m[poses.measured]
    )
    return position[:, free_axes(report.machine)[0]], observed.pose[poses.measured]


def pose_u_m(recording: Recording, reference: Reference, report: ReportFrame, phase: str) -> float:
    """Standard uncertainty of a measured coordinate of the platform: the root of the mean variance."""
    observed = observe(recording, reference, phase, drives_matter=False)
    covariance = filter_poses(report, observed.observations).covariance
    moves = np.flatnonzero(report.machine.dof < 3)
    variance = np.nanmean(np.diagonal(covariance, axis1=1, axis2=2)[:, moves])
    return float(np.sqrt(variance)) * reference.noise
