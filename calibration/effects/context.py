"""The context of each reading: time, drive coordinates, how the drives arrived there, payload and temperatures.

One row per reading (n), d drives. Effects are functions of this context and of nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

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
TIME_UNKNOWN = "an unknown time passed between two sessions of the recording"
# Fields with one row per reading; they are also keys of a twin's file.
ARRAYS = (
    "t_s", "arrival", "drives", "direction", "velocity_m_per_s", "torque", "speed_m_per_s", "dwell_s", "payload_kg",
    "payload_com_m", "exchanges", "air_refractivity",
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
    by the recorded air, uncorrected; temperatures_c: by sensor,
    (n,) each; start_s: rig time at the campaign's start; breaks_s: rig times before which an unknown time passed;
    known_tables: compensation tables that are kept for the machine; missing: why the readings do not say some of these
    fields, by their names, whose values are then without meaning.
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
    breaks_s: tuple[float, ...] = field(default=(), kw_only=True)
    known_tables: tuple[KnownTable, ...] = field(default=(), kw_only=True)
    missing: Mapping[str, str] = field(default_factory=dict, kw_only=True)

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
        for table in self.known_tables:
            if table.generation == generation:
                own = drive_names.index(table.drive)
                partner = own if table.partner is None else drive_names.index(table.partner)
                out[:, own] = table.correction_m(drives[:, own], drives[:, partner])
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
        temperatures_c={"air": recording["air_temperature_c"], **recording.temperatures_c()},
        start_s=float(t.min()),
        breaks_s=breaks_s(recording),
        known_tables=recording.file.known_tables,
    )


def clip_to_campaign(campaign: ReadingContext, context: ReadingContext) -> ReadingContext:
    """Another context clipped to the range that the campaign covers; its time counts from the campaign's start."""
    offset_s = campaign.start_s - context.start_s
    shifted = replace(context, t_s=context.t_s + offset_s)

    def clip(name: str) -> Array:
        campaign_values = getattr(campaign, name)
        return np.clip(getattr(shifted, name), campaign_values.min(axis=0), campaign_values.max(axis=0))

    clipped: dict[str, Any] = {name: clip(name) for name in ARRAYS if name not in NOT_CLIPPED}
    air = campaign.temperatures_c["air"]
    temperatures = {
        name: np.clip(context.temperatures_c.get(name, np.full(len(context), air.mean())), t.min(), t.max())
        for name, t in campaign.temperatures_c.items()
    }
    history = ArrivalHistory(context.history.arrived_s + offset_s, context.history.drives)
    return replace(
        context,
        history=history,
        start_s=campaign.start_s,
        temperatures_c=temperatures,
        known_tables=campaign.known_tables,
        **clipped,
    )


def append_context(campaign: ReadingContext, later: ReadingContext) -> ReadingContext:
    """The campaign's readings followed by later ones, whose history includes the campaign's arrivals."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(campaign, name), getattr(later, name)]) for name in ARRAYS if name != "arrival"
    }
    return replace(
        campaign,
        history=_concatenate(campaign.history, later.history),
        arrival=np.concatenate([campaign.arrival, later.arrival + len(campaign.history.arrived_s)]),
        temperatures_c={n: np.concatenate([t, later.temperatures_c[n]]) for n, t in campaign.temperatures_c.items()},
        **arrays,
    )


def _concatenate(first: ArrivalHistory, second: ArrivalHistory) -> ArrivalHistory:
    return ArrivalHistory(
        np.concatenate([first.arrived_s, second.arrived_s]), np.concatenate([first.drives, second.drives])
    )


class CachedContext:
    """A context whose history-dependent quantities are computed once."""

    def __init__(self, context: ReadingContext) -> None:
        self.context = context
        self._motion_heat: dict[tuple[int, float], Array] = {}
        self._thermal_lag_k: dict[tuple[str, float], Array] = {}

    def motion_heat(self, drive: int, tau_s: float) -> Array:
        """As `ReadingContext.motion_heat`."""
        key = (drive, tau_s)
        if key not in self._motion_heat:
            self._motion_heat[key] = self.context.motion_heat(drive, tau_s)
        return self._motion_heat[key]

    def thermal_lag_k(self, sensor: str, tau_s: float) -> Array:
        """As `ReadingContext.thermal_lag_k`."""
        key = (sensor, tau_s)
        if key not in self._thermal_lag_k:
            self._thermal_lag_k[key] = self.context.thermal_lag_k(sensor, tau_s)
        return self._thermal_lag_k[key]


def cached_context(clipped: ReadingContext, context: ReadingContext) -> CachedContext:
    """The cache of a context in its own time, but with temperatures and air of its clipped version."""
    return CachedContext(
        replace(context, temperatures_c=clipped.temperatures_c, air_refractivity=clipped.air_refractivity)
    )


@dataclass(frozen=True)
class CombinedContext(ReadingContext):
    """The campaign's readings followed by rows of another context.

    Each part keeps its own history; history-dependent quantities are clipped to the range that the campaign covers.
    """

    campaign: CachedContext
    other: CachedContext
    rows: NDArray[np.intp]

    @property
    def previous_drives(self) -> Array:
        """Drive coordinates (n, d) at the previous arrival."""
        campaign = self.campaign.context
        requested = self.other.context.previous_drives[self.rows]
        clipped = np.clip(requested, campaign.drives.min(axis=0), campaign.drives.max(axis=0))
        return np.concatenate([campaign.previous_drives, clipped])

    def motion_heat(self, drive: int, tau_s: float) -> Array:
        """Heat of a drive's own motion (n,)."""
        return self._concatenate_clipped(self.campaign.motion_heat(drive, tau_s), self.other.motion_heat(drive, tau_s))

    def way_m(self, drive: int) -> Array:
        """Distance (n,) that a drive has moved."""
        return self._concatenate_clipped(self.campaign.context.way_m(drive), self.other.context.way_m(drive))

    def mean_temperature_c(self) -> Array:
        """Mean (n,) of all recorded temperatures."""
        mean_c = super().mean_temperature_c()
        of_campaign = mean_c[: len(self.campaign.context)]
        return np.clip(mean_c, of_campaign.min(), of_campaign.max())

    def thermal_lag_k(self, sensor: str, tau_s: float) -> Array:
        """Temperature of a part of time constant tau_s minus its sensor (n,)."""
        return self._concatenate_clipped(
            self.campaign.thermal_lag_k(sensor, tau_s), self.other.thermal_lag_k(sensor, tau_s)
        )

    def part_temperature_k(self, sensor: str, tau_s: float) -> Array:
        """Change (n,) since the campaign's start, of a part that follows a sensor with a time constant."""
        change = super().part_temperature_k(sensor, tau_s)
        of_campaign = change[: len(self.campaign.context)]
        return np.clip(change, of_campaign.min(), of_campaign.max())

    def refractivity_change(self, delay_s: float) -> Array:
        """Refractivity (n,) of the recorded air less that of delay_s before."""
        campaign, other = self.campaign.context, self.other.context
        return self._concatenate_clipped(campaign.refractivity_change(delay_s), other.refractivity_change(delay_s))

    def _concatenate_clipped(self, of_campaign: Array, of_other: Array) -> Array:
        return np.concatenate([of_campaign, np.clip(of_other[self.rows], of_campaign.min(), of_campaign.max())])


def combine_contexts(
    campaign: CachedContext, clipped: ReadingContext, other: CachedContext, rows: NDArray[np.intp]
) -> CombinedContext:
    """The campaign's readings followed by rows (m,) of another context; neither is part of the other's history.

    clipped: the other context as `clip_to_campaign` returns it; other: its cache, in its own time.
    """
    first = campaign.context
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(clipped, name)[rows]]) for name in ARRAYS
    }
    arrays["arrival"][len(first) :] += len(first.history.arrived_s)
    return CombinedContext(
        history=_concatenate(first.history, clipped.history),
        temperatures_c={
            n: np.concatenate([t, clipped.temperatures_c[n][rows]]) for n, t in first.temperatures_c.items()
        },
        start_s=first.start_s,
        known_tables=first.known_tables,
        campaign=campaign,
        other=other,
        rows=rows,
        **arrays,
    )
