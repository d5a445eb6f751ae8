"""From a recording to observations and measured poses: a pure function of the stored readings.

In this order: wrong readings of nests are left out; nest checks that failed take their readings out; the certified
length ties the range constant; the station's drift is followed through the nests; frame and mounting are fitted at zero
payload; the pose filter turns reflectors into poses and leaves wrong ones out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame, station_frame
from calibration.instruments import station_geometry
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.recording.recording import Recording
from calibration.reduction.data_checks import check_units
from calibration.reduction.drift_filter import estimate_drift
from calibration.reduction.grouped_readings import group_by_visit, replaced_readings
from calibration.reduction.left_out import MODEL, NEST, VISIT, LeftOutReading
from calibration.reduction.nest_gate import gate_nests
from calibration.reduction.pose_filter import FilteredPoses, filter_poses
from calibration.reduction.report_frame import ReportFrame, fit_report_frame

MAX_MISS_M = 0.01  # of a reflector from its nominal position: ten times the effect of the tolerances
CALIBRATION = "calibration"
VERIFICATIONS = ("verification_before", "verification_after")


@dataclass(frozen=True)
class VisitInfo:
    """Each visit apart from the model's input, one row per visit; direction (v, d)."""

    phase: NDArray[np.str_]
    pose: NDArray[np.intp]
    direction: Array
    payload: NDArray[np.intp]
    t_rig_s: Array
    samples: Array


@dataclass(frozen=True)
class Reduction:
    """A reduced recording: the input of every later analysis.

    observations: accepted readings of all visits (nests left out); offered: with those that the pose filter refused,
    uid (r,) their names. dropped: counts of readings left out, by cause; left_out: the wrong ones. range_constant_m,
    range_constant_u_m: subtracted from the ranges, with its standard uncertainty.
    """

    recording: Recording
    observations: ReflectorObservations
    info: VisitInfo
    report: ReportFrame
    poses: FilteredPoses
    range_constant_m: float
    range_constant_u_m: float
    offered: ReflectorObservations
    uid: NDArray[np.str_]
    dropped: dict[str, int]
    left_out: tuple[LeftOutReading, ...]

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
    return station_frame(entry.position_m, entry.heading_rad)


def reduce(recording: Recording, basis: Reduction | None = None, wrong: tuple[LeftOutReading, ...] = ()) -> Reduction:
    """Reduce a recording without the readings that do not fit the model (wrong). InputError if it is impossible.

    With a `basis` (the reduction that was identified) its range constant, its report frame and what it left out by the
    model are kept: figures before and after are stated in one frame.
    """
    check_units(recording.machine, _observations(recording, recording.positions_m, recording.covariances_m2)[0])
    if basis is not None:
        wrong = tuple(reading for reading in basis.left_out if reading.reason == MODEL)
    if wrong:
        recording = recording.take(~np.isin(np.asarray(recording["uid"]), [reading.name for reading in wrong]))
    recording, wrong_nests = gate_nests(recording)
    dropped = {}
    usable = usable_readings(recording)
    replaced = replaced_readings(recording)
    dropped["visit measured anew"] = int(np.count_nonzero(replaced))
    dropped["failed nest check"] = int(np.count_nonzero(~usable & ~replaced))
    flagged = usable & (recording["flags"] > 0.0)
    dropped["flagged by the station"] = int(np.count_nonzero(flagged))
    usable &= ~flagged
    recording = recording.take(usable)
    constant, constant_u = (
        _range_constant(recording) if basis is None else (basis.range_constant_m, basis.range_constant_u_m)
    )
    position, covariance = _remove_drift(recording, constant)
    observations, info = _observations(recording, position, covariance)
    uid = np.asarray(recording["uid"])[_of_poses(recording)].astype(str)
    zero = (info.phase == CALIBRATION) & (observations.visits.payload_kg == 0.0)
    if not np.any(zero):
        raise InputError(f"recording {recording.file.campaign}: no calibration readings without payload")
    report = basis.report if basis else _robust_frame(recording, observations.of_visits(zero))
    poses = filter_poses(report, observations)
    refused = tuple(
        LeftOutReading(
            str(uid[i]),
            recording.machine.smrs[observations.smr[i]].name,
            float(poses.size_m[i]),
            "m",
            float(poses.sigmas[i]),
            VISIT,
        )
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
        offered=observations,
        uid=uid,
        dropped=dropped,
        left_out=(*wrong, *wrong_nests, *refused),
    )


def nest_shift(recording: Recording) -> tuple[NDArray[np.intp], Array]:
    """Nest checks (c,) and the largest shift of a nest across the line of sight since the first check (c,), in m."""
    nests = gate_nests(recording.rows("nests"))[0]
    checks = np.unique(nests["nest_check"]).astype(int)
    first: dict[str, Array] = {}
    shifts = np.zeros(len(checks))
    for i, check in enumerate(checks):
        for name in np.unique(nests["smr"]):
            rows = (nests["nest_check"] == check) & (np.asarray(nests["smr"]) == name)
            if not np.any(rows):
                continue
            point = nests.positions_m[rows].mean(axis=0)
            start = first.setdefault(str(name), point)
            shift = station_geometry.across_line_of_sight(point - start, start)
            shifts[i] = max(shifts[i], float(np.linalg.norm(shift)))
    return checks, shifts


def usable_readings(recording: Recording, next_check: int | None = None) -> NDArray[np.bool_]:
    """Readings (r,) that lie between two good nest checks, of visits that were not measured anew.

    Those next to a failed closing check are not used. `nest_check` of a reading is the number of the last check before
    it; `next_check` is a future one that is assumed to succeed. Without nests in the recording all are used.
    """
    checks, shifts = nest_shift(recording)
    if checks.size == 0:
        return ~replaced_readings(recording)
    good = {int(c) for c, s in zip(checks, shifts, strict=True) if s <= recording.file.nest_limit_m}
    if next_check is not None:
        good.add(next_check)
    number = recording["nest_check"].astype(int)
    is_nest = np.asarray(recording["phase"]) == "nests"
    opened = np.isin(number, list(good))
    closed = np.isin(number + 1, list(good))
    return np.where(is_nest, opened, opened & closed) & ~replaced_readings(recording)


def drop_unclosed_readings(recording: Recording) -> Recording:
    """A recording without the readings whose closing nest check was left out, though later ones were made.

    The station may have had other settings than it was given (`Runner.resume`): unlike those next to a failed check,
    they carry no information about the machine.
    """
    checks, _ = nest_shift(recording)
    is_nest = np.asarray(recording["phase"]) == "nests"
    closing = recording["nest_check"].astype(int) + 1
    keep = is_nest | np.isin(closing, checks) | (closing > checks.max(initial=-1))
    return recording.take(keep)


def last_calibration_check(recording: Recording) -> float:
    """Number of the nest check that closes the calibration; infinity without a calibration."""
    rows = np.asarray(recording["phase"]) == CALIBRATION
    return float(recording["nest_check"][rows].max()) + 1.0 if np.any(rows) else float("inf")


def _range_constant(recording: Recording) -> tuple[float, float]:
    accuracy = recording.file.station.accuracy
    scale_u = accuracy.range_scale_u * float(np.mean(np.linalg.norm(recording.positions_m, axis=1)))
    length = recording.file.nest_length
    nests = recording.rows("nests")
    names = np.asarray(nests["smr"])
    prior = float(np.hypot(accuracy.range_constant_u_m, scale_u))
    if length is None or not all(np.any(names == n) for n in length.nests):
        return 0.0, prior
    common = np.intersect1d(
        nests["nest_check"][names == length.nests[0]], nests["nest_check"][names == length.nests[1]]
    )
    mean, cov = [], []
    for nest in length.nests:
        rows = [np.flatnonzero((names == nest) & (nests["nest_check"] == c)) for c in common]
        mean.append(np.array([nests.positions_m[r].mean(axis=0) for r in rows]))
        cov.append(np.array([nests.covariances_m2[r].mean(axis=0) / len(r) for r in rows]))
    return station_geometry.range_constant(mean[0], mean[1], cov[0], cov[1], length.to_certified_length(), prior)


def _remove_drift(recording: Recording, constant: float) -> tuple[Array, Array]:
    raw = recording.positions_m
    position = raw - constant * raw / np.linalg.norm(raw, axis=1)[:, None]
    covariance = recording.covariances_m2
    is_nest = np.asarray(recording["phase"]) == "nests"
    if not np.any(is_nest):
        return position, covariance
    t = recording["t_rig_s"]
    rows = np.flatnonzero(is_nest)
    rows = rows[np.argsort(t[rows], kind="stable")]
    _, nest = np.unique(np.asarray(recording["smr"])[rows], return_inverse=True)
    accuracy = recording.file.station.accuracy
    drift = estimate_drift(t[rows], nest, position[rows], covariance[rows], accuracy, t)
    return drift.remove(position, covariance)


def _of_poses(recording: Recording) -> NDArray[np.intp]:
    """Rows of the readings that were made at a pose."""
    return np.flatnonzero(np.isin(np.asarray(recording["phase"]), (CALIBRATION, "repeatability", *VERIFICATIONS)))


def _observations(recording: Recording, position: Array, covariance: Array) -> tuple[ReflectorObservations, VisitInfo]:
    """Readings of poses, grouped by visit."""
    phase, rows = np.asarray(recording["phase"]), _of_poses(recording)
    if rows.size == 0:
        raise InputError(f"recording {recording.file.campaign}: no poses in it")
    grouped = group_by_visit(recording, rows, position, covariance)
    heads = grouped.heads
    info = VisitInfo(
        phase=phase[heads].astype(str),
        pose=recording["pose"][heads].astype(np.intp),
        direction=recording.drives("direction")[heads],
        payload=recording["payload"][heads].astype(np.intp),
        t_rig_s=grouped.mean(recording["t_rig_s"][rows]),
        samples=recording["samples"][heads],
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
