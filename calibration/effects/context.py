"""The context of each reading: time, drive coordinates, how the drives arrived there, payload and temperatures.

One row per reading (n), d drives. Effects are functions of this context and of nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.former_names import former_name
from calibration.effects.memory import fading, following, lag_behind
from calibration.instruments.air import refractivity
from calibration.recording.header import KnownTable
from calibration.recording.recording import Recording
from calibration.recording.sessions import breaks_s

STANDS_M_PER_S = 1.0e-3  # or rad/s
LEAST_SPEED_M_PER_S = 1.0e-3  # of a motion
LEAST_CHANGE_K = 0.3  # a temperature that varies less is not followed
TIME_UNKNOWN = "an unknown time passed between two sessions of the recording"
# Fields with one row per reading; they are also keys of a twin's file.
ARRAYS = (
    "t_s", "arrival", "drives", "direction", "velocity_m_per_s", "torque", "speed_m_per_s", "dwell_s", "payload_kg",
    "payload_com_m", "exchanges", "air_refractivity", "following_error_m",
)  # fmt: skip
NOT_CLIPPED = ("arrival", "payload_com_m", "direction", "velocity_m_per_s")


def of_sensor(name: str) -> str:
    """The temperature of a sensor as `ReadingContext.missing` names it."""
    return f"temperatures_c.{name}"


@dataclass(frozen=True)
class ArrivalHistory:
    """All arrivals (k) at a target so far, in order of time: arrived_s (k,), drive coordinates (k, d)."""

    arrived_s: Array
    drives: Array

    @property
    def travelled_m(self) -> Array:
        """Distance (k, d) of each drive from the previous arrival; zero for the first."""
        return np.abs(np.diff(self.drives, axis=0, prepend=self.drives[:1]))

    way_m = former_name("travelled_m")


@dataclass(frozen=True)
class ReadingContext:
    """Context of n readings.

    t_s (n,): rig time; arrival (n,): row of the history, the last arrival before the reading; drives, direction,
    velocity_m_per_s, torque (n, d): drive coordinates, side of the last approach (+1 from below), torque over rated
    torque; speed_m_per_s (n,): of the approach; dwell_s (n,): since the target was reached; payload_kg (n,),
    payload_com_m (n, 3); exchanges (n,): number of payload exchanges before the reading; air_refractivity (n,):
    by the recorded air, uncorrected; following_error_m (n, d): what a drive reports itself to be short of its command,
    zero where none was recorded; temperatures_c: by sensor, (n,) each; start_s: rig time at the campaign's start;
    breaks_s: rig times before which an unknown time passed; known_tables: compensation tables that are kept for the
    machine; missing: why the readings do not say some of these fields, by their names, whose values are then without
    meaning.
    """

    history: ArrivalHistory
    t_s: Array
    arrival: NDArray[np.intp]
    drives: Array
    direction: Array
    velocity_m_per_s: Array
    torque: Array
    speed_m_per_s: Array
    dwell_s: Array
    payload_kg: Array
    payload_com_m: Array
    exchanges: Array
    air_refractivity: Array
    temperatures_c: Mapping[str, Array]
    start_s: float
    following_error_m: Array = field(default_factory=lambda: np.zeros((0, 0)), kw_only=True)
    breaks_s: tuple[float, ...] = field(default=(), kw_only=True)
    known_tables: tuple[KnownTable, ...] = field(default=(), kw_only=True)
    missing: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        if self.following_error_m.shape != self.drives.shape:
            object.__setattr__(self, "following_error_m", np.zeros_like(self.drives))

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def not_said(self) -> Mapping[str, str]:
        """Why the readings do not say some fields, by their names: rig time where an unknown time has passed."""
        return {"t_s": TIME_UNKNOWN, **self.missing} if self.breaks_s else self.missing

    @property
    def elapsed_s(self) -> Array:
        """Time (n,) since the campaign's start."""
        return np.maximum(self.t_s - self.start_s, 0.0)

    @property
    def previous_drives(self) -> Array:
        """Drive coordinates (n, d) at the previous arrival."""
        return self.history.drives[np.maximum(self.arrival - 1, 0)]

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Readings (n,) taken on the fly: what a drive at rest reports as its velocity is its encoder's noise."""
        return np.asarray(np.any(np.abs(self.velocity_m_per_s) > STANDS_M_PER_S, axis=1))

    def motion_heat(self, drive: int, tau_s: float) -> Array:
        """Heat of a drive's own motion (n,): its mean speed in m/s, exponentially weighted with time constant tau_s."""
        return self.left_by_motions(self.history.travelled_m[:, drive], tau_s) / tau_s

    def way_m(self, drive: int) -> Array:
        """Distance (n,) that a drive has moved since the campaign's first arrival."""
        return np.asarray(np.cumsum(self.history.travelled_m[:, drive])[self.arrival])

    def dragged(self, drive: int, width_m: float) -> Array:
        """Where (n,) a part lies that a drive drags along in its play, up to a width to either side (Krasnosel'skii,
        Pokrovskii, Systems with Hysteresis, 1989); it begins where the drive does."""
        follows, lies = [], float(self.history.drives[0, drive])
        for now in self.history.drives[:, drive].tolist():
            lies = min(max(lies, now - width_m), now + width_m)
            follows.append(lies)
        return np.array(follows)[self.arrival]

    def worn_beyond(self, load: Array, share: float) -> Array:
        """What (n,) the visits so far have had of a load (n,) beyond that of a share of all visits; over all of it, or
        zero if no visit has more."""
        of_visit = np.zeros(len(self.history.arrived_s))
        of_visit[self.arrival] = load
        measured = np.unique(self.arrival)
        worn = np.cumsum(np.maximum(of_visit - np.quantile(of_visit[measured], share), 0.0))
        return np.asarray(worn[self.arrival] / max(float(worn[-1]), 1e-300))

    def pause_s(self) -> Array:
        """How long (n,) the drives stood before their last motion, as far as its way and speed say."""
        since_s = np.diff(self.history.arrived_s, prepend=self.history.arrived_s[:1])
        speed = np.maximum(self.approach_speed_m_per_s, LEAST_SPEED_M_PER_S)
        return np.asarray(np.maximum(since_s - self.history.travelled_m.max(axis=1) / speed, 0.0)[self.arrival])

    def relative_changes(self, sensors: Iterable[str], times_s: Sequence[float]) -> list[tuple[Array, float]]:
        """What parts follow (n,) that some sensors are on, over the sensor's range, with time constants, 0: at once.

        Of sensors that hardly vary none: they would be followed to their resolution. The range is that of the sensor,
        not of the part, so that it is the campaign's also where readings of another context follow.
        """
        out = []
        for sensor in sensors:
            span_k = float(np.ptp(self.temperatures_c[sensor])) if sensor in self.temperatures_c else 0.0
            if span_k > LEAST_CHANGE_K:
                out += [(self.part_temperature_k(sensor, tau) / span_k, tau) for tau in times_s]
        return out

    def mean_temperature_c(self) -> Array:
        """Mean (n,) of all recorded temperatures."""
        return np.asarray(np.mean([np.asarray(values) for values in self.temperatures_c.values()], axis=0))

    def left_by_motions(self, left: Array, tau_s: float) -> Array:
        """Sum (n,) of what the motions to each arrival (k,) have left, which dies away with a time constant."""
        at_arrival = fading(self.history.arrived_s, left, tau_s)[self.arrival]
        since_arrival_s = np.maximum(self.t_s - self.history.arrived_s[self.arrival], 0.0)
        return np.asarray(at_arrival * np.exp(-since_arrival_s / tau_s))

    @property
    def approach_speed_m_per_s(self) -> Array:
        """Speed (k,) of the motion to each arrival; zero where nothing was read after it."""
        out = np.zeros(len(self.history.arrived_s))
        out[self.arrival] = self.speed_m_per_s
        return out

    def thermal_lag_k(self, sensor: str, tau_s: float) -> Array:
        """Temperature of a part of time constant tau_s minus its sensor (n,) in kelvin; zero at the start."""
        if (sensor, tau_s) not in self._lags_k:
            self._lags_k[sensor, tau_s] = lag_behind(self.t_s, np.asarray(self.temperatures_c[sensor]), tau_s)
        return self._lags_k[sensor, tau_s]

    @cached_property
    def _lags_k(self) -> dict[tuple[str, float], Array]:
        return {}

    def part_temperature_k(self, sensor: str, tau_s: float) -> Array:
        """Change (n,) in kelvin since the start, of a part that follows a sensor with a time constant, 0: at once."""
        change = np.asarray(self.temperatures_c[sensor]) - self.temperatures_c[sensor][int(np.argmin(self.t_s))]
        return change + self.thermal_lag_k(sensor, tau_s) if tau_s > 0.0 else np.asarray(change)

    def lagging(self, values: Array, tau_s: float) -> Array:
        """What follows values (n,) of the readings with a time constant; it begins where they do."""
        return following(self.t_s, values, tau_s)

    def refractivity_change(self, delay_s: float) -> Array:
        """Refractivity (n,) of the recorded air less that of delay_s before; the first one's, where that is earlier."""
        order = np.argsort(self.t_s, kind="stable")
        return self.air_refractivity - np.interp(self.t_s - delay_s, self.t_s[order], self.air_refractivity[order])

    @property
    def table_generations(self) -> tuple[int, ...]:
        """Generations of the known tables, ascending."""
        return tuple(sorted({table.generation for table in self.known_tables}))

    def table_corrections_m(self, generation: int, drive_names: Sequence[str], drives: Array) -> Array:
        """What the tables of a generation add to commands (n, d) of the drives; zero for a drive without a table."""
        out = np.zeros_like(drives)
        for own, table, own_m, partner_m in self.tables_at(generation, drive_names, drives):
            out[:, own] = table.correction_m(own_m, partner_m)
        return out

    def tables_at(
        self, generation: int, drive_names: Sequence[str], drives: Array
    ) -> list[tuple[int, KnownTable, Array, Array]]:
        """Drives with a table of a generation, the table, and coordinates (n,) of the drive and of its partner."""
        out = []
        for table in self.known_tables:
            if table.generation == generation:
                own = drive_names.index(table.drive)
                partner = own if table.partner is None else drive_names.index(table.partner)
                out.append((own, table, drives[:, own], drives[:, partner]))
        return out

    former = former_name("previous_drives")
    warmth = former_name("motion_heat")
    lag_k = former_name("thermal_lag_k")


def context_of_recording(recording: Recording) -> ReadingContext:
    """The context of all readings of a recording."""
    visit = recording["visit"]
    t, dwell, drives = recording["t_rig_s"], recording["dwell_s"], recording.drives("actual_m")
    on_pose = np.asarray(recording["phase"]) != "nests"
    in_time = np.flatnonzero(on_pose)[np.argsort(t[on_pose], kind="stable")]
    first_rows = in_time[np.unique(visit[in_time], return_index=True)[1]]
    first_rows = first_rows[np.argsort(t[first_rows], kind="stable")]
    history = ArrivalHistory(t[first_rows] - dwell[first_rows], drives[first_rows])
    row_of_visit = {number: row for row, number in enumerate(visit[first_rows].tolist())}
    arrival = np.array([row_of_visit.get(number, 0) for number in visit.tolist()], dtype=np.intp)
    payload, order = recording["payload"], np.argsort(t, kind="stable")
    exchanges = np.empty(len(t))
    exchanges[order] = np.cumsum(np.diff(payload[order], prepend=payload[order[0]]) != 0.0)
    return ReadingContext(
        history=history,
        t_s=t,
        arrival=arrival,
        drives=drives,
        direction=recording.drives("direction"),
        velocity_m_per_s=np.where(on_pose[:, None], recording.drives("velocity_m_per_s"), 0.0),
        torque=recording.drives("torque_ratio"),
        speed_m_per_s=recording["speed_m_per_s"],
        dwell_s=dwell,
        payload_kg=recording["payload_mass_kg"],
        payload_com_m=recording.payload_com_m(),
        exchanges=exchanges,
        air_refractivity=refractivity(recording["air_temperature_c"], recording["pressure_hpa"]),
        following_error_m=recording.drives("following_error_m"),
        temperatures_c={"air": recording["air_temperature_c"], **recording.temperatures_c()},
        start_s=float(t.min()),
        breaks_s=breaks_s(recording),
        known_tables=recording.file.known_tables,
    )
