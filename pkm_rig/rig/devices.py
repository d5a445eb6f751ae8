"""Bluesky's view of the rig: a few thin adapters around plain drivers.

Work is done by one worker thread, so that no `read` or `set` ever blocks the run engine's loop; the worker
lends the campaign's turn on the rig clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import rotation_matrix
from calibration.instruments import station_geometry
from calibration.machine.equilibrium import carried_point
from calibration.machine.inverse import nominal_drives
from calibration.machine.led_path import approach_point, tool_coordinates
from calibration.recording.columns import columns_of
from drivers.errors import UNSEEN, DrivesMoved
from drivers.station.laser_tracker import MeanReading, SettleCriterion, average
from pkm_rig.rig.led_motion import side_of
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import PlannedVisit
from pkm_rig.rig.standstill import Standstill
from pkm_rig.rig.state_row import rig_state_row
from pkm_rig.rig.worker import Worker, WorkStatus

TARGET_TOLERANCE_M = 0.02
INITIAL_TARGET_TOLERANCE_M = 0.06
SEARCH_WINDOW_RAD = 0.01
INITIAL_SEARCH_WINDOW_RAD = 0.04
SETTLED_ACROSS_M = 40e-6
SETTLE_READINGS = 3
SETTLE_LIMIT_S = 60.0
POINTS_TO_FIT = 5


@dataclass
class PointingFrame:
    """Where reflectors are expected: the rough frame, replaced by a fit once some points were measured."""

    frame: Frame | None = None
    expected_m: list[Array] = field(default_factory=list)
    measured_m: list[Array] = field(default_factory=list)

    @property
    def is_fitted(self) -> bool:
        """Whether the frame rests on measured points."""
        return len(self.measured_m) >= POINTS_TO_FIT

    @property
    def is_final(self) -> bool:
        """Whether further points change it no more."""
        return len(self.measured_m) > 3 * POINTS_TO_FIT

    def add_point(self, expected_m: Array, measured_m: Array) -> None:
        """Take one more point; from the fifth on, the frame is the rigid motion that fits them best."""
        self.expected_m.append(expected_m)
        self.measured_m.append(measured_m)
        if POINTS_TO_FIT <= len(self.measured_m) <= 3 * POINTS_TO_FIT:
            self.frame = rigid_fit(np.array(self.expected_m), np.array(self.measured_m))


@dataclass
class ReadingTags:
    """Labels of the next reading; set by the plan's devices and stored with each reading.

    `replaces_visit`: the visit that the present one is made in place of, -1 without one. `setup`: number of the
    station's set-up. `smr`: the reflector that was aimed at last.
    """

    phase: str = "repeatability"
    smr: str = ""
    setup: int = 1
    visit: PlannedVisit | None = None
    visit_number: int = -1
    replaces_visit: int = -1
    nest_check: int = -1
    sequence: int = 0
    arrived_s: float = 0.0
    fresh_arrival: bool = False
    aim: PointingFrame = field(default_factory=PointingFrame)


def rigid_fit(machine_m: Array, station_m: Array) -> Frame:
    """Frame that maps points (n, 3) of the machine onto those of the station best (Kabsch's method)."""
    centre, other = machine_m.mean(axis=0), station_m.mean(axis=0)
    u, _, vt = np.linalg.svd((machine_m - centre).T @ (station_m - other))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn = vt.T @ flip @ u.T
    return Frame(turn, other - turn @ centre)


class MachineDevice:
    """`set(visit)`: both drives together to the approach point, then to the target, then settled."""

    name = "machine"
    parent = None

    def __init__(self, rig: Rig, worker: Worker, tags: ReadingTags) -> None:
        self._rig, self._worker, self._tags = rig, worker, tags

    def set(self, visit: PlannedVisit) -> WorkStatus:
        """Go to a visit's pose."""
        return self._worker.submit(f"machine to pose {visit.pose}", lambda: self._move_to_visit(visit))

    def stop(self, *, success: bool = False) -> None:
        """Stop all drives together; called by the run engine at the end of a failed plan."""
        if not success:
            self._rig.stop("the campaign ended")

    def _move_to_visit(self, visit: PlannedVisit) -> None:
        self._rig.observer.going_to(visit.target_m, visit.pose)
        if self._rig.led:
            self._lead_to_visit(visit)
        else:
            offset = -np.array(visit.direction) * self._rig.file.campaign.approach_m
            self._rig.move(visit.drives_m + offset, visit.speed_m_per_s)
            self._rig.move(visit.drives_m, visit.speed_m_per_s)
        self._tags.visit = visit
        self._tags.visit_number += 1
        self._tags.arrived_s = self._rig.clock.now_s()
        self._tags.fresh_arrival = True
        self._rig.clock.sleep_s(visit.dwell_s)

    def _lead_to_visit(self, visit: PlannedVisit) -> None:
        machine, approach_m = self._rig.machine, self._rig.file.campaign.approach_m
        commanded = tool_coordinates(machine, visit.target_m[None])[0]
        correction = visit.drives_m - nominal_drives(machine, visit.target_m[None])[0]
        side = side_of(machine, visit.target_m, visit.direction, approach_m)
        before = approach_point(machine, commanded, side, approach_m)
        self._rig.lead(before, visit.speed_m_per_s, correction if self._rig.host is None else None)
        self._rig.lead(commanded, visit.speed_m_per_s, correction)


class WaitDevice:
    """`set(seconds)`: let rig time pass; then `temperatures_c` are those that the PLC has read."""

    name = "wait"
    parent = None

    def __init__(self, rig: Rig, worker: Worker) -> None:
        self._rig, self._worker = rig, worker
        self.temperatures_c: dict[str, float] = {}

    def set(self, duration_s: float) -> WorkStatus:
        """Wait, stopping early if supervision has stopped the drives."""
        return self._worker.submit(f"wait {duration_s:g} s", lambda: self._wait(duration_s))

    def _wait(self, duration_s: float) -> None:
        self._rig.wait(duration_s)
        self.temperatures_c = dict(self._rig.supervisor.state().temperatures_c)


class StationDevice:
    """`set(smr)`, `trigger`, `read`: aim at a reflector by its predicted place, measure it, give the whole row.

    `last_deviation_m` (3,): from where the nominal machine has the last point to where it is; NaN before that is known.
    `moved` is set where a measurement found that the drives have moved since their visit began: there is no row then.
    """

    name = "station"
    parent = None

    def __init__(self, rig: Rig, worker: Worker, tags: ReadingTags) -> None:
        self._rig, self._worker, self._tags = rig, worker, tags
        self._row: dict[str, float | str] = {}
        self._stamp_s = 0.0
        self.moved: DrivesMoved | None = None
        self.last_deviation_m = np.full(3, np.nan)
        self._standstill = Standstill(rig.drives.drives, rig.file.limits.moved_m, rig.drives.rest.following_error_m)

    def set(self, smr: str) -> WorkStatus:
        """Choose the reflector and aim at it."""
        self._tags.smr = smr
        self._rig.observer.aiming_at(smr)
        return self._worker.submit(f"station to {smr}", lambda: self._at_reflector(self._aim))

    def trigger(self) -> WorkStatus:
        """Measure."""
        return self._worker.submit(f"station measures {self._tags.smr}", lambda: self._at_reflector(self._measure))

    def read(self) -> dict[str, dict[str, Any]]:
        """The row of the last measurement."""
        return {key: {"value": value, "timestamp": self._stamp_s} for key, value in self._row.items()}

    def describe(self) -> dict[str, dict[str, Any]]:
        """Columns of a recording."""
        rig = self._rig
        names = [d.name for d in rig.file.drives]
        columns = columns_of(names, rig.sensors, rig.extra_columns, rig.machine.rotary_drives)
        return {
            c.name: {"source": "rig", "dtype": "string" if c.kind == "text" else "number", "shape": []}
            for c in columns
            if c.name != "uid"
        }

    def _at_reflector(self, work: Callable[[], None]) -> None:
        """Aim or measure; what is wrong with the beam names the reflector, which only the campaign knows."""
        try:
            work()
        except UNSEEN as error:
            error.where = f"{error.where}, reflector {self._tags.smr}"
            raise

    @property
    def last_position_m(self) -> Array:
        """The last measured point, station's frame."""
        return np.array([float(self._row[c]) for c in ("x_m", "y_m", "z_m")])

    def _expected_position_m(self) -> Array:
        """Predicted position (3,) of the reflector in the machine frame, from the drives' commanded position."""
        machine, visit = self._rig.machine, self._tags.visit
        smr = machine.smr(self._tags.smr)
        if smr.on == "floor":
            return smr.position_m
        if smr.on == "slider":
            return carried_point(machine, smr.drive, smr.position_m, self._rig.positions_m())
        if visit is None:
            raise RuntimeError(f"reflector {self._tags.smr} on the platform is measured before any visit")
        turn = rotation_matrix(visit.target_m[None, 3:])[0]
        return np.asarray(visit.target_m[:3] + turn @ smr.position_m)

    def _frame(self) -> Frame:
        """The frame to aim in: the rough one of the rig file until points were measured."""
        aim = self._tags.aim
        if aim.frame is None:
            aim.frame = self._rig.rough_frame()
        return aim.frame

    def _aim(self) -> None:
        self._rig.refresh_atmosphere_if_stale()  # here, where no measurement is under way
        point = self._frame().to_station(self._expected_position_m()[None])
        hz, v, _ = station_geometry.points_to_polar(point)
        window = SEARCH_WINDOW_RAD if self._tags.aim.is_fitted else INITIAL_SEARCH_WINDOW_RAD
        self._rig.station.point_and_aim(float(hz[0]), float(v[0]), window)

    def _measure(self) -> None:
        rig, tags = self._rig, self._tags
        settings = rig.file.campaign
        settle = None
        if tags.fresh_arrival:
            settle = SettleCriterion(window=SETTLE_READINGS, across_m=SETTLED_ACROSS_M, limit_s=SETTLE_LIMIT_S)
        on_floor = rig.machine.smr(self._tags.smr).on == "floor"
        count = settings.readings_per_nest if on_floor else settings.readings_per_smr
        readings = rig.station.measure(count, two_face=settings.two_face, settle=settle)
        if on_floor:  # a stored nest reading certifies the station's settings for all readings since the previous one
            rig.station.require_settings()
        tags.fresh_arrival = False
        state = rig.supervisor.state()
        drives = rig.drives.sample()
        self.moved = (
            None
            if on_floor or tags.visit is None or rig.moved_by_control
            else self._standstill.check(tags.visit_number, tags.visit.drives_m, drives)
        )
        if self.moved is not None:
            return
        mean = average(readings)
        hz, v, distance = (np.array([x]) for x in (mean.hz_rad, mean.v_rad, mean.slope_distance_m))
        position = station_geometry.polar_to_points(hz, v, distance)[0]
        self._require_target(mean)
        stated = rig.file.station.accuracy.to_station_accuracy()
        covariance = station_geometry.point_covariances(hz, v, distance, stated)[0] / mean.n
        first = readings[0]
        row = rig_state_row(rig, state, drives)
        row |= self._visit_columns()
        row |= {
            "sequence": float(tags.sequence),
            "phase": tags.phase,
            "nest_check": float(tags.nest_check),
            "smr": self._tags.smr,
            "t_rig_s": mean.t_rig_s,
            "t_host_s": first.t_host_s,
            "t_utc_s": first.t_host_s + (time.time() - time.monotonic()),  # anew each time: UTC may be set
            "t_u_s": first.u_t_s,
            "hz_rad": mean.hz_rad,
            "v_rad": mean.v_rad,
            "slope_distance_m": mean.slope_distance_m,
            "station": float(tags.setup),
            "face": 0.0 if settings.two_face else float(first.face),
            "prism_constant_m": first.prism_constant_m,
            "ppm": first.ppm,
            "edm_mode": float(first.edm_mode),
            "prism_type": float(first.prism_type),
            "samples": float(mean.n),
            "flags": float(len({flag for r in readings for flag in r.flags})),
            **{axis: float(value) for axis, value in zip(("x_m", "y_m", "z_m"), position, strict=True)},
            **{
                f"cov_{'xyz'[i]}{'xyz'[j]}_m2": float(covariance[i, j])
                for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
            },
        }
        tags.sequence += 1
        self._row, self._stamp_s = row, first.t_host_s
        expected_m = self._expected_position_m()
        away_m = position - self._frame().to_station(expected_m[None])[0]
        self.last_deviation_m = away_m if tags.aim.is_final else np.full(3, np.nan)
        tags.aim.add_point(expected_m, position)

    def _visit_columns(self) -> dict[str, float | str]:
        tags, rig = self._tags, self._rig
        visit = tags.visit
        target = np.zeros(6) if visit is None else visit.target_m
        names = ("target_x_m", "target_y_m", "target_z_m", "target_rx_rad", "target_ry_rad", "target_rz_rad")
        columns: dict[str, float | str] = {n: float(t) for n, t in zip(names, target, strict=True)}
        columns |= {
            "visit": float(tags.visit_number),
            "replaces_visit": float(tags.replaces_visit),
            "pose": -1.0 if visit is None else float(visit.pose),
            "pass": 0.0 if visit is None else float(visit.pass_),
            "speed_m_per_s": 0.0 if visit is None else visit.speed_m_per_s,
            "dwell_s": 0.0 if visit is None else rig.clock.now_s() - tags.arrived_s,
        }
        for index, drive in enumerate(rig.file.drives):
            side = 0.0 if visit is None else float(visit.direction[index])
            columns[f"{drive.name}_direction"] = side
        return columns

    def _require_target(self, mean: MeanReading) -> None:
        """A reflector far from its predicted position is another one, or the beam is obstructed."""
        e, n, h = (float(x) for x in self._frame().to_station(self._expected_position_m()[None])[0])
        tolerance_m = TARGET_TOLERANCE_M if self._tags.aim.is_fitted else INITIAL_TARGET_TOLERANCE_M
        self._rig.station.require_target(mean, (e, n, h), tolerance_m, self._tags.smr)
