"""From a recording to observations and measured poses: a pure function of the stored readings.

In this order: wrong readings of nests are left out; nest checks that failed take their readings out; the certified
length ties the range constant; the station's drift is followed through the nests; set-ups of the station are tied to
the first; frame and mounting are fitted at zero payload; the pose filter turns reflectors into poses and leaves wrong
ones out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame, station_frame
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.recording.recording import Recording
from calibration.reduction.common_points import NestEstimate
from calibration.reduction.data_checks import check_units
from calibration.reduction.grouped_readings import group_by_visit, replaced_readings
from calibration.reduction.left_out import MODEL, NEST, VISIT, LeftOutReading
from calibration.reduction.nest_checks import drop_unused_setups, usable_readings
from calibration.reduction.nest_gate import gate_nests
from calibration.reduction.part_temperatures import PartSensor, most_likely_temperatures
from calibration.reduction.pose_filter import FilteredPoses, filter_poses
from calibration.reduction.range_constant import range_constant_of
from calibration.reduction.recording_setups import tie_recording
from calibration.reduction.report_frame import ReportFrame, fit_report_frame
from calibration.reduction.station_drift import remove_drift

MAX_MISS_M = 0.01  # of a reflector from its nominal position: ten times the effect of the tolerances
CALIBRATION = "calibration"
VERIFICATIONS = ("verification_before", "verification_after")


@dataclass(frozen=True)
class VisitInfo:
    """Each visit apart from the model's input, one row per visit; number (v,): its own in the recording; direction
    (v, d); setup (v,): row of the set-ups."""

    number: NDArray[np.intp]
    phase: NDArray[np.str_]
    pose: NDArray[np.intp]
    direction: Array
    payload: NDArray[np.intp]
    t_rig_s: Array
    samples: Array
    setup: NDArray[np.intp]


@dataclass(frozen=True)
class Reduction:
    """A reduced recording: the input of every later analysis.

    observations: accepted readings of all visits (nests left out), in the frame of the first set-up; offered: with
    those that the pose filter refused, uid (r,) their names. nests: of each set-up, in its own frame. dropped: counts
    of readings left out, by cause; left_out: the wrong ones. sensors: of part temperatures, what is known of them.
    range_constant_m, range_constant_u_m: subtracted from the ranges, with its standard uncertainty.
    """

    recording: Recording
    observations: ReflectorObservations
    info: VisitInfo
    report: ReportFrame
    poses: FilteredPoses
    range_constant_m: float
    range_constant_u_m: float
    setups: Setups
    nests: Mapping[float, NestEstimate]
    offered: ReflectorObservations
    uid: NDArray[np.str_]
    dropped: dict[str, int]
    left_out: tuple[LeftOutReading, ...]
    sensors: Mapping[str, PartSensor]

    def rows(self, phase: str, payload: int | None = None) -> NDArray[np.bool_]:
        """Visits of a phase (and payload) that have a measured pose."""
        keep = (self.info.phase == phase) & self.poses.measured
        return keep if payload is None else keep & (self.info.payload == payload)

    def calibration(self) -> ReflectorObservations:
        """Accepted readings of the calibration."""
        return self.observations.of_visits(self.info.phase == CALIBRATION)

    def errors(self, rows: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Tool position error (n, 3) in m and rotation error (n, 3) in rad of some visits."""
        return self.report.tool_error(self.poses.coordinates[rows], self.observations.visits.target_m[rows])


def nominal_frame(recording: Recording) -> Frame:
    """The station's frame from its rough place and heading in the rig file (docs/reference/machine.md)."""
    entry = recording.file.station
    return station_frame(entry.position_m, entry.heading_rad, recording.machine.gravity_m_per_s2)


def reduce(
    recording: Recording,
    basis: Reduction | None = None,
    wrong: tuple[LeftOutReading, ...] = (),
    known: Setups | None = None,
) -> Reduction:
    """Reduce a recording without the readings that do not fit the model (wrong). InputError if it is impossible.

    With a `basis` (the reduction that was identified) its range constant, its set-ups, its report frame and what it
    left out by the model are kept: figures before and after are stated in one frame. known: set-ups whose motions are
    kept.
    """
    none = np.zeros(len(recording), dtype=np.intp)
    check_units(recording.machine, _observations(recording, recording.positions_m, recording.covariances_m2, none)[0])
    if basis is not None:
        wrong = tuple(reading for reading in basis.left_out if reading.reason == MODEL)
    if wrong:
        recording = recording.take(~np.isin(np.asarray(recording["uid"]), [reading.name for reading in wrong]))
    recording, wrong_nests = gate_nests(drop_unused_setups(recording))
    dropped = {}
    usable = usable_readings(recording)
    replaced = replaced_readings(recording)
    dropped["visit measured anew"] = int(np.count_nonzero(replaced))
    dropped["failed nest check"] = int(np.count_nonzero(~usable & ~replaced))
    flagged = usable & (recording["flags"] > 0.0)
    dropped["flagged by the station"] = int(np.count_nonzero(flagged))
    usable &= ~flagged
    recording, sensors = most_likely_temperatures(recording.take(usable))
    constant, constant_u = (
        range_constant_of(recording) if basis is None else (basis.range_constant_m, basis.range_constant_u_m)
    )
    drift_free = remove_drift(recording, constant)
    setups = tie_recording(recording, drift_free, constant_u, basis.setups if basis else known)
    setup = setups.rows(recording["station"])
    position = setups.to_first(drift_free.position_m, setup)
    covariance = setups.covariances_in_first(drift_free.covariance_m2, setup)
    observations, info = _observations(recording, position, covariance, setup)
    of_poses = _of_poses(recording)
    zero = (info.phase == CALIBRATION) & (observations.visits.payload_kg == 0.0)
    if not np.any(zero):
        raise InputError(f"recording {recording.file.campaign}: no calibration readings without payload")
    report = basis.report if basis else _robust_frame(recording, observations.of_visits(zero))
    poses = filter_poses(report, observations)
    refused = tuple(
        LeftOutReading.of_recording(recording, int(of_poses[i]), poses.size_m[i], poses.sigmas[i], VISIT)
        for i in np.flatnonzero(~poses.accepted)
    )
    dropped |= {NEST: len(wrong_nests), VISIT: len(refused), MODEL: len(wrong)}
    return Reduction(
        recording=recording,
        observations=observations.take(poses.accepted),
        info=info,
        report=report,
        poses=poses,
        range_constant_m=constant,
        range_constant_u_m=constant_u,
        setups=setups,
        nests=drift_free.nests,
        offered=observations,
        uid=np.asarray(recording["uid"])[of_poses].astype(str),
        dropped=dropped,
        left_out=(*wrong, *wrong_nests, *refused),
        sensors=sensors,
    )


def last_calibration_check(recording: Recording) -> float:
    """Number of the nest check that closes the calibration; infinity without a calibration."""
    rows = np.asarray(recording["phase"]) == CALIBRATION
    return float(recording["nest_check"][rows].max()) + 1.0 if np.any(rows) else float("inf")


def _of_poses(recording: Recording) -> NDArray[np.intp]:
    """Rows of the readings that were made at a pose."""
    return np.flatnonzero(np.isin(np.asarray(recording["phase"]), (CALIBRATION, "repeatability", *VERIFICATIONS)))


def _observations(
    recording: Recording, position: Array, covariance: Array, setup: NDArray[np.intp]
) -> tuple[ReflectorObservations, VisitInfo]:
    """Readings of poses, grouped by visit."""
    phase, rows = np.asarray(recording["phase"]), _of_poses(recording)
    if rows.size == 0:
        raise InputError(f"recording {recording.file.campaign}: no poses in it")
    grouped = group_by_visit(recording, rows, position, covariance, setup)
    heads = grouped.heads
    info = VisitInfo(
        number=recording["visit"][heads].astype(np.intp),
        phase=phase[heads].astype(str),
        pose=recording["pose"][heads].astype(np.intp),
        direction=recording.drives("direction")[heads],
        payload=recording["payload"][heads].astype(np.intp),
        t_rig_s=grouped.mean(recording["t_rig_s"][rows]),
        samples=recording["samples"][heads],
        setup=setup[heads],
    )
    return grouped.observations, info


def _robust_frame(recording: Recording, zero: ReflectorObservations) -> ReportFrame:
    """Fit the frame, drop outlying readings, fit again."""
    report = fit_report_frame(recording.machine, zero, nominal_frame(recording))
    expected = report.points(zero.visits.target_m)
    on_platform = np.isin(zero.smr, report.smrs)
    column = np.searchsorted(report.smrs, zero.smr[on_platform])
    off = np.linalg.norm(zero.position_m[on_platform] - expected[zero.visit[on_platform], column], axis=1)
    if np.median(off) > MAX_MISS_M:
        raise InputError(
            f"frame: reflectors lie {np.median(off) * 1e3:.0f} mm from where the commanded poses put them; check which "
            "reflector is which, and signs and offsets of the drives"
        )
    limit = 6.0 * np.median(off)
    if np.all(off <= limit):
        return report
    keep = np.zeros(len(zero), dtype=bool)
    keep[np.flatnonzero(on_platform)[off <= limit]] = True
    fewer = zero.take(keep)
    return fit_report_frame(recording.machine, fewer, report.frame)
