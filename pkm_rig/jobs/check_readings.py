"""Readings of a check, tables on, against the calibration in force: what a check's statistics take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame, station_frame
from calibration.identification.pose_selection import candidate_poses, workspace_poses
from calibration.instruments import station_geometry
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.intervals.check_design import CheckReadings, check_design, choose_poses
from calibration.intervals.check_effects import with_effects
from calibration.intervals.check_estimate import CheckDesign
from calibration.intervals.watched import watched_changes
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_poses
from calibration.model.model import Poses
from calibration.model.payload import PayloadEntry
from calibration.model.visits import Visits
from calibration.recording.recording import Recording
from calibration.reduction.grouped_readings import group_by_visit, replaced_readings
from calibration.reduction.nest_checks import drop_unused_setups, usable_readings
from calibration.reduction.nest_gate import gate_nests
from calibration.reduction.part_temperatures import most_likely_temperatures
from calibration.reduction.pose_filter import filter_poses
from calibration.reduction.range_constant import range_constant_of
from calibration.reduction.report_frame import ReportFrame
from calibration.reduction.station_drift import remove_drift
from pkm_rig.jobs.reference import Reference
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.devices import rigid_fit
from pkm_rig.rig.schedule import PlannedVisit, commanded_drives, sides, usable_targets

CANDIDATES, WORKSPACE_POSES, SEED = 48, 100, 14


@dataclass(frozen=True)
class CheckObservations:
    """Observations of a check's poses (the drives where they truly stood), and when each visit began (v,)."""

    observations: ReflectorObservations
    pose: NDArray[np.intp]


def plan_check(file: RigFile, reference: Reference, payload: int, count: int) -> tuple[list[PlannedVisit], CheckDesign]:
    """`count` visits, the most informative first, and the design of a check that makes them all.

    By their power against what a check watches and against the catalogue's effects that it can show.
    """
    machine = reference.machine
    tool = candidate_poses(machine, CANDIDATES, SEED)
    targets = nominal_poses(machine, np.unique(tool[:, machine.commanded], axis=0))
    targets = usable_targets(machine, targets, file.campaign.approach_m, file.station.position_m)
    if len(targets) < count:
        raise InputError(
            f"machine {machine.name}: its drives reach {len(targets)} poses of a check, {count} are needed"
        )
    drives = commanded_drives(machine, targets)
    entry = file.payloads[payload]
    visited = _visits_at(reference, drives, targets, entry)
    poses = reference.predict(visited)
    frame = station_frame(file.station.position_m, file.station.heading_rad, machine.gravity_m_per_s2)
    smrs = reference.moving
    mounting = reference.mounting_m()
    place = np.stack([poses.reflector_m(smr, mounting[smr]) for smr in smrs], axis=1).reshape(-1, 3)
    accuracy = file.station.accuracy.to_station_accuracy()
    polar = station_geometry.points_to_polar(frame.to_station(place))
    covariance = station_geometry.point_covariances(*polar, accuracy) / file.campaign.readings_per_smr
    visit, smr = np.repeat(np.arange(len(targets)), len(smrs)), np.tile(smrs, len(targets))
    readings = CheckReadings(visit, smr, place, _whiten(covariance, frame, reference.noise))
    design = _design(file, reference, readings, poses, entry)
    of_visit = np.repeat(visit, 3)
    workspace = _visits_at(reference, *_workspace(machine), entry)
    chosen = choose_poses(
        with_effects(design, readings, reference.predict, visited, workspace, mounting), of_visit, count
    )
    return _planned(file, machine, targets, drives, payload, chosen), design.rows(np.isin(of_visit, chosen))


def _planned(
    file: RigFile, machine: Machine, targets: Array, drives: Array, payload: int, chosen: Sequence[int]
) -> list[PlannedVisit]:
    settings = file.campaign
    return [
        PlannedVisit(
            pose=number,
            pass_=0,
            target_m=targets[row],
            drives_m=drives[row],
            payload=payload,
            direction=sides(machine, settings, targets[row], 1),
            speed_m_per_s=settings.speeds_m_per_s[0],
            dwell_s=settings.dwells_s[0],
        )
        for number, row in enumerate(chosen)
    ]


def known_error_m(file: RigFile, reference: Reference, payload: int, temperatures_c: Mapping[str, float]) -> Array:
    """Error (3 g,) of the tool over the workspace that temperatures other than the tables' are known to cause."""
    drives, targets = _workspace(reference.machine)
    visits = _visits_at(reference, drives, targets, file.payloads[payload])

    def tool_m(at_c: Mapping[str, float]) -> Array:
        parts = {name: np.full(len(targets), at_c[name]) for name in visits.temperatures_c}
        return reference.predict(replace(visits, temperatures_c=parts)).tool_m()

    shift = tool_m(temperatures_c) - tool_m(reference.temperatures_c)
    return np.asarray(shift.ravel())


def _workspace(machine: Machine) -> tuple[Array, Array]:
    """Commanded drives (g, d) and targets (g, 6) of poses over the workspace."""
    tool = workspace_poses(machine, WORKSPACE_POSES, SEED)
    targets = usable_targets(machine, nominal_poses(machine, tool[:, machine.commanded]), 0.0)
    return commanded_drives(machine, targets), targets


def _visits_at(reference: Reference, drives: Array, targets: Array, payload: PayloadEntry) -> Visits:
    return Visits.at_reference_temperature(
        reference.machine,
        drives,
        targets,
        np.full(len(targets), payload.mass_kg),
        np.tile(payload.com_m, (len(targets), 1)),
    )


def _whiten(covariance_m2: Array, frame: Frame, noise: float) -> Array:
    """Inverse Cholesky factors (r, 3, 3), in the machine's axes, of covariances in the station's."""
    turned = frame.rotation.T @ covariance_m2 @ frame.rotation
    return np.asarray(np.linalg.inv(np.linalg.cholesky(turned)) / noise)


def _design(
    file: RigFile, reference: Reference, readings: CheckReadings, poses: Poses, payload: PayloadEntry
) -> CheckDesign:
    workspace = reference.predict(_visits_at(reference, *_workspace(reference.machine), payload))
    accuracy = file.station.accuracy
    return check_design(
        readings,
        poses,
        workspace,
        reference.mounting_m(),
        watched_changes(reference.model.parameters),
        station_m=np.array(file.station.position_m),
        range_u=(accuracy.range_constant_u_m, accuracy.range_scale_u),
        prior=reference.drift_covariance(file.nuisance.reseat_m),
        reference=reference.watched_covariance(),
    )


def observe(recording: Recording, reference: Reference, phase: str, *, drives_matter: bool = True) -> CheckObservations:
    """Observations of a check: nest checks that failed and what is wrong left out, drift removed, tables added.

    Drives report in command coordinates: where they truly stood is that plus the correction of the table in use, which
    the recording's header has. InputError without it, unless drives do not matter: where poses are measured only.
    """
    if drives_matter:
        recording = true_drives(recording)
    recording, _ = gate_nests(drop_unused_setups(recording))
    usable = usable_readings(recording) & ~replaced_readings(recording) & (recording["flags"] == 0.0)
    recording, _ = most_likely_temperatures(recording.take(usable))
    constant, _ = range_constant_of(recording)
    drift_free = remove_drift(recording, constant)
    rows = np.flatnonzero(np.asarray(recording["phase"]) == phase)
    if not rows.size:
        raise InputError(f"check {recording.file.campaign}: no reading can be used; a nest check has failed")
    grouped = group_by_visit(recording, rows, drift_free.position_m, drift_free.covariance_m2)
    observations = replace(grouped.observations, setup=None)
    frame = machine_frame(reference, observations)
    platform = tuple(i for i in reference.moving if reference.machine.smrs[i].on == "platform")
    report = ReportFrame(reference.machine, frame, platform, reference.mounting_m()[list(platform)])
    kept = observations.take(filter_poses(report, observations).accepted)
    return CheckObservations(kept, recording["pose"][grouped.heads].astype(np.intp))


def true_drives(recording: Recording) -> Recording:
    """The recording with the drives' true coordinates in place of those in command coordinates."""
    generation = recording["compensation"].astype(int)
    if not np.any(generation):  # none was on, or the host corrects: commands are where drives stand
        return recording
    names = recording.file.drives
    actual = {name: recording[f"{name}_actual_m"].copy() for name in names}
    for one in sorted(set(generation.tolist()) - {0}):
        rows = generation == one
        tables = {table.drive: table for table in recording.file.known_tables if table.generation == one}
        missing = [name for name in names if name not in tables]
        if missing:
            raise InputError(
                f"recording {recording.file.campaign}: it does not hold table {one} of drive {missing[0]}, with which "
                "it was measured"
            )
        for name, table in tables.items():
            own = recording[f"{name}_actual_m"][rows]
            partner = own if table.partner is None else recording[f"{table.partner}_actual_m"][rows]
            actual[name][rows] += table.correction_m(own, partner)
    columns = {f"{name}_actual_m": values for name, values in actual.items()}
    return Recording(recording.file, recording.machine, {**recording.columns, **columns})


def _places(reference: Reference, poses: Poses, observations: ReflectorObservations) -> Array:
    """Where each reading's reflector is predicted (r, 3), in the machine's frame."""
    mounting = reference.mounting_m()
    place = np.empty((len(observations), 3))
    for smr in reference.moving:
        rows = np.flatnonzero(observations.smr == smr)
        place[rows] = poses.reflector_m(smr, mounting[smr])[observations.visit[rows]]
    return place


def machine_frame(reference: Reference, observations: ReflectorObservations) -> Frame:
    """The machine's frame as the station sees it, by where reflectors are predicted; InputError where none is."""
    place = _places(reference, reference.predict(observations.visits), observations)
    if not np.all(np.isfinite(place)):
        raise InputError("check: the calibration in force predicts no pose there; calibrate anew")
    return rigid_fit(place, observations.position_m)


def design_and_residual(
    file: RigFile, reference: Reference, observed: CheckObservations, payload: int
) -> tuple[CheckDesign, Array]:
    """The design of the readings that were made, and their whitened residuals (3 r,), measured minus predicted."""
    observations = observed.observations
    poses = reference.predict(observations.visits)
    place, frame = _places(reference, poses, observations), machine_frame(reference, observations)
    readings = CheckReadings(
        observations.visit,
        observations.smr,
        place,
        _whiten(observations.covariance_m2, frame, reference.noise),
    )
    measured = (observations.position_m - frame.translation_m) @ frame.rotation
    design = _design(file, reference, readings, poses, file.payloads[payload])
    return design, readings.whitened(measured - place)


def mean_temperatures_c(observations: ReflectorObservations) -> dict[str, float]:
    """Means of the parts' temperatures over a check."""
    return {name: float(np.mean(values)) for name, values in observations.visits.temperatures_c.items()}


def groups_of(visits: Sequence[PlannedVisit], looks: Sequence[int]) -> list[tuple[PlannedVisit, ...]]:
    """The visits between one look and the next."""
    return [tuple(visits[first:last]) for first, last in zip((0, *looks), looks, strict=False)]
