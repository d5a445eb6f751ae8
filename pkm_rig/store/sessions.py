"""Sessions of a campaign: one process' work on it each, from its events; their times follow one another."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from calibration.recording.recording import Recording
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredEvent

BEGUN, ENDED = "session_begun", "session_ended"


@dataclass(frozen=True)
class Moment:
    """A moment on both clocks: rig time, and Unix time where it is known."""

    t_rig_s: float
    t_utc_s: float | None

    def gap_s(self, now_utc_s: float) -> float:
        """Time that has passed since, at least 0: a clock that was set back counts as none."""
        return 0.0 if self.t_utc_s is None else max(0.0, now_utc_s - self.t_utc_s)

    def set_back_s(self, now_utc_s: float) -> float:
        """How far the clock was set back since, at least."""
        return 0.0 if self.t_utc_s is None else max(0.0, self.t_utc_s - now_utc_s)


def last_moment(store: Store, campaign: str) -> Moment | None:
    """Where a campaign ended: its last session's end, or after a kill what was stored last; None before it began."""
    begun_or_ended = [e for e in store.events(campaign) if e.kind in (BEGUN, ENDED)]
    moments = [Moment(e.data["t_rig_s"], e.data["t_utc_s"]) for e in begun_or_ended]
    if store.has_readings(campaign):
        moments.append(_last_reading(store.recording(campaign), store.events(campaign)))
    return max(moments, key=lambda moment: moment.t_rig_s, default=None)


def next_number(store: Store, campaign: str) -> int:
    """Number of the next session, from 1."""
    return 1 + max((int(e.data["session"]) for e in store.events(campaign, BEGUN)), default=0)


def _last_reading(recording: Recording, events: list[StoredEvent]) -> Moment:
    last = int(recording["t_rig_s"].argmax())
    t_rig_s = float(recording["t_rig_s"][last] + recording["t_u_s"][last])
    if "t_utc_s" in recording.columns and recording["t_utc_s"][last] == recording["t_utc_s"][last]:
        return Moment(t_rig_s, float(recording["t_utc_s"][last]))
    return Moment(t_rig_s, _utc_s(events[-1].created) if events else None)


def _utc_s(created: str) -> float:
    return datetime.fromisoformat(created).timestamp()
