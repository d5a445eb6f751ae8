"""When the machine was looked at: where its drives stood, how they came there, and what acted on it.

One row a reading (n); d drives. Effects are functions of these and of nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.recording.recording import Recording


@dataclass(frozen=True)
class History:
    """All arrivals so far, in order of time: arrived_s (k,), drives (k, d)."""

    arrived_s: Array
    drives: Array

    @property
    def way_m(self) -> Array:
        """Way (k, d) of each drive from the arrival before; zero for the first."""
        return np.abs(np.diff(self.drives, axis=0, prepend=self.drives[:1]))


@dataclass(frozen=True)
class Moments:
    """What is known of n readings.

    t_s (n,) rig time; arrival (n,): row of the history that the machine had reached; drives, direction,
    velocity_m_per_s, torque (n, d): command coordinates, side of the last approach (+1 from below), torque over rated
    torque; speed_m_per_s (n,) of the approach; dwell_s (n,) since the target was reached; payload_kg (n,),
    payload_com_m (n, 3); exchanges (n,): how often the payload was exchanged before; temperatures_c by sensor (n,);
    start_s: when the campaign began.
    """

    history: History
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
    temperatures_c: Mapping[str, Array]
    start_s: float

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def elapsed_s(self) -> Array:
        """Time (n,) since the campaign began."""
        return np.maximum(self.t_s - self.start_s, 0.0)

    @property
    def former(self) -> Array:
        """Where the drives (n, d) stood at the arrival before."""
        return self.history.drives[np.maximum(self.arrival - 1, 0)]

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Readings (n,) taken on the fly."""
        return np.asarray(np.any(self.velocity_m_per_s != 0.0, axis=1))

    def warmth(self, drive: int, tau_s: float) -> Array:
        """How much heat of its own motion a drive holds (n,): its mean speed in m/s over the last tau_s."""
        arrived, way = self.history.arrived_s, self.history.way_m[:, drive]
        held = np.empty(len(arrived))
        value, before = 0.0, arrived[0]
        for i, (t, more) in enumerate(zip(arrived.tolist(), (way / tau_s).tolist(), strict=True)):
            value = value * np.exp(-(t - before) / tau_s) + more
            held[i], before = value, t
        return held[self.arrival] * np.exp(-np.maximum(self.t_s - arrived[self.arrival], 0.0) / tau_s)

    def lag_k(self, sensor: str, tau_s: float) -> Array:
        """A part of time constant tau_s that follows a sensor, minus the sensor (n,) in kelvin; zero at the start."""
        order = np.argsort(self.t_s, kind="stable")
        t, sensed = self.t_s[order], np.asarray(self.temperatures_c[sensor])[order]
        grid = np.linspace(t[0], t[-1], 400)
        on_grid = np.interp(grid, t, sensed)
        keep = float(np.exp(-(grid[1] - grid[0]) / tau_s))
        behind, out = 0.0, np.empty(len(grid))
        for i, change in enumerate(np.diff(on_grid, prepend=on_grid[0]).tolist()):
            behind = (behind - change) * keep
            out[i] = behind
        return np.asarray(np.interp(self.t_s, grid, out))


def moments_of(recording: Recording) -> Moments:
    """The moments of all readings of a recording."""
    visit = recording["visit"]
    t, dwell, drives = recording["t_rig_s"], recording["dwell_s"], recording.drives("actual_m")
    on_pose = np.asarray(recording["phase"]) != "nests"
    in_time = np.flatnonzero(on_pose)[np.argsort(t[on_pose], kind="stable")]
    head = in_time[np.unique(visit[in_time], return_index=True)[1]]
    head = head[np.argsort(t[head], kind="stable")]
    history = History(t[head] - dwell[head], drives[head])
    place = {number: row for row, number in enumerate(visit[head].tolist())}
    known = np.array([place.get(v, 0) for v in visit.tolist()], dtype=np.intp)
    payload, order = recording["payload"], np.argsort(t, kind="stable")
    exchanges = np.empty(len(t))
    exchanges[order] = np.cumsum(np.diff(payload[order], prepend=payload[order[0]]) != 0.0)
    return Moments(
        history=history,
        t_s=t,
        arrival=known,
        drives=drives,
        direction=recording.drives("direction"),
        velocity_m_per_s=np.where(on_pose[:, None], recording.drives("velocity_m_per_s"), 0.0),
        torque=recording.drives("torque_ratio"),
        speed_m_per_s=recording["speed_m_per_s"],
        dwell_s=dwell,
        payload_kg=recording["payload_mass_kg"],
        payload_com_m=recording.payload_com_m(),
        exchanges=exchanges,
        temperatures_c={"air": recording["air_temperature_c"], **recording.temperatures_c()},
        start_s=float(t.min()),
    )


ARRAYS = (
    "t_s", "arrival", "drives", "direction", "velocity_m_per_s", "torque", "speed_m_per_s", "dwell_s", "payload_kg",
    "payload_com_m", "exchanges",
)  # fmt: skip


def held(campaign: Moments, moments: Moments) -> Moments:
    """Moments held within what the campaign saw; their time counts from its beginning."""
    later = campaign.start_s - moments.start_s
    since = replace(moments, t_s=moments.t_s + later)

    def within(name: str) -> Array:
        known, values = getattr(campaign, name), getattr(since, name)
        return np.clip(values, known.min(axis=0), known.max(axis=0))

    changed: dict[str, Any] = {
        n: within(n) for n in ARRAYS if n not in ("arrival", "payload_com_m", "direction", "velocity_m_per_s")
    }
    air = campaign.temperatures_c["air"]
    temperatures = {
        name: np.clip(moments.temperatures_c.get(name, np.full(len(moments), air.mean())), t.min(), t.max())
        for name, t in campaign.temperatures_c.items()
    }
    history = History(moments.history.arrived_s + later, moments.history.drives)
    return replace(moments, history=history, start_s=campaign.start_s, temperatures_c=temperatures, **changed)


def joined(campaign: Moments, moments: Moments) -> Moments:
    """The campaign's moments, then others that continue it: its arrivals are their past."""
    h, g = campaign.history, moments.history
    history = History(np.concatenate([h.arrived_s, g.arrived_s]), np.concatenate([h.drives, g.drives]))
    changed: dict[str, Any] = {
        n: np.concatenate([getattr(campaign, n), getattr(moments, n)]) for n in ARRAYS if n != "arrival"
    }
    temperatures = {n: np.concatenate([t, moments.temperatures_c[n]]) for n, t in campaign.temperatures_c.items()}
    arrival = np.concatenate([campaign.arrival, moments.arrival + len(h.arrived_s)])
    return replace(campaign, history=history, arrival=arrival, temperatures_c=temperatures, **changed)


class Remembered:
    """Moments whose memory of what was before is worked out once."""

    def __init__(self, moments: Moments) -> None:
        self.moments = moments
        self._known: dict[tuple[str, int | str, float], Array] = {}

    def warmth(self, drive: int, tau_s: float) -> Array:
        """As of the moments."""
        return self._asked("warmth", drive, tau_s)

    def lag_k(self, sensor: str, tau_s: float) -> Array:
        """As of the moments."""
        return self._asked("lag_k", sensor, tau_s)

    def _asked(self, what: str, of: int | str, tau_s: float) -> Array:
        key = (what, of, tau_s)
        if key not in self._known:
            self._known[key] = np.asarray(getattr(self.moments, what)(of, tau_s))
        return self._known[key]


@dataclass(frozen=True)
class Joined(Moments):
    """The campaign's moments, then some of others; each remembers its own past, and no more than the campaign saw."""

    campaign: Remembered
    others: Remembered
    rows: NDArray[np.intp]

    @property
    def former(self) -> Array:
        """Where the drives (n, d) stood at the arrival before."""
        known = self.campaign.moments
        stood = known.drives
        own = self.others.moments.former[self.rows]
        return np.concatenate([known.former, np.clip(own, stood.min(axis=0), stood.max(axis=0))])

    def warmth(self, drive: int, tau_s: float) -> Array:
        """How much heat of its own motion a drive holds (n,)."""
        return self._both(self.campaign.warmth(drive, tau_s), self.others.warmth(drive, tau_s))

    def lag_k(self, sensor: str, tau_s: float) -> Array:
        """What a part of time constant tau_s lags behind a sensor (n,)."""
        return self._both(self.campaign.lag_k(sensor, tau_s), self.others.lag_k(sensor, tau_s))

    def _both(self, known: Array, own: Array) -> Array:
        return np.concatenate([known, np.clip(own[self.rows], known.min(), known.max())])


def remembered(own: Moments, moments: Moments) -> Remembered:
    """The memory of moments of which `own` is what is `held`: their own time, but temperatures that are held."""
    return Remembered(replace(moments, temperatures_c=own.temperatures_c))


def beside(campaign: Remembered, own: Moments, others: Remembered, rows: NDArray[np.intp]) -> Joined:
    """The campaign's moments, then rows (m,) of others, `own` as they are held; neither is the past of the other."""
    known = campaign.moments
    h, g = known.history, own.history
    changed: dict[str, Any] = {n: np.concatenate([getattr(known, n), getattr(own, n)[rows]]) for n in ARRAYS}
    changed["arrival"][len(known) :] += len(h.arrived_s)
    return Joined(
        history=History(np.concatenate([h.arrived_s, g.arrived_s]), np.concatenate([h.drives, g.drives])),
        temperatures_c={n: np.concatenate([t, own.temperatures_c[n][rows]]) for n, t in known.temperatures_c.items()},
        start_s=known.start_s,
        campaign=campaign,
        others=others,
        rows=rows,
        **changed,
    )
