"""Sessions of a stored campaign, from its events; where rig time began anew in each process, it is made to rise.

Campaigns of version 0.1 have no session events and times that overlap. Their processes show in their events and in the
readings: within one, rig time and the computer's monotonic clock go together.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from calibration.recording.header import SessionEntry
from calibration.recording.recording import Recording
from calibration.recording.sessions import FALL_S, rows_by_sequence, shift_sessions
from pkm_rig.store.stored_rows import StoredEvent

BEGUN, ENDED = "session_begun", "session_ended"
JUMP_S = 60.0  # of rig time against the computer's clock, between two readings: another process
JUMP_HOST_S = 2.0  # and beside it, for a computer that was busy


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


def last_moment(recording: Recording | None, events: Sequence[StoredEvent]) -> Moment | None:
    """Where a campaign ended: its last session's end, or after a kill what was stored last; None before it began."""
    moments = [Moment(e.data["t_rig_s"], e.data["t_utc_s"]) for e in events if e.kind in (BEGUN, ENDED)]
    if recording is not None:
        last = int(recording["t_rig_s"].argmax())
        t_rig_s = float(recording["t_rig_s"][last] + recording["t_u_s"][last])
        utc_s = recording.columns.get("t_utc_s")
        if utc_s is not None and np.isfinite(utc_s[last]):
            moments.append(Moment(t_rig_s, float(utc_s[last])))
        else:
            moments.append(Moment(t_rig_s, _utc_s(events[-1].created) if events else None))
    return max(moments, key=lambda moment: moment.t_rig_s, default=None)


def with_sessions(recording: Recording, events: Sequence[StoredEvent]) -> Recording:
    """The recording with its sessions in the header, and rising rig time."""
    begun = [e for e in events if e.kind == BEGUN]
    if not begun:
        return recording if recording.file.sessions else _of_former_version(recording, events)
    order = rows_by_sequence(recording)
    later = recording["t_rig_s"][order] >= begun[0].data["t_rig_s"]
    former = order[: int(np.argmax(later)) if later.any() else len(order)]
    entries: tuple[SessionEntry, ...] = ()
    if former.size:
        before = events[: next(i for i, e in enumerate(events) if e.kind == BEGUN)]
        risen = _of_former_version(recording.take(former), before)
        t_rig_s = recording["t_rig_s"].copy()
        t_rig_s[former] = risen["t_rig_s"]
        recording = Recording(recording.file, recording.machine, {**recording.columns, "t_rig_s": t_rig_s})
        entries = risen.file.sessions
    return _with_header(recording, (*entries, *_from_events(recording, events, len(entries))))


def _from_events(recording: Recording, events: Sequence[StoredEvent], former: int) -> list[SessionEntry]:
    ended = {e.data["session"]: e.data for e in events if e.kind == ENDED}
    order = rows_by_sequence(recording)
    times = recording["t_rig_s"][order].tolist()
    numbers = recording["sequence"][order].astype(int).tolist()
    begun = [e.data for e in events if e.kind == BEGUN]
    entries = []
    for index, begin in enumerate(begun):
        end = ended.get(begin["session"])
        first = bisect.bisect_left(times, begin["t_rig_s"])
        after = bisect.bisect_left(times, begun[index + 1]["t_rig_s"]) if index + 1 < len(begun) else len(times)
        last_s = times[after - 1] if after > first else begin["t_rig_s"]
        entries.append(
            SessionEntry(
                number=former + index + 1,
                command=begin["command"],
                why="killed" if end is None else end["why"],
                first_sequence=numbers[first] if first < len(numbers) else numbers[-1] + 1,
                begin_rig_s=begin["t_rig_s"],
                end_rig_s=last_s if end is None else end["t_rig_s"],
                begin_utc_s=begin["t_utc_s"],
                end_utc_s=None if end is None else end["t_utc_s"],
            )
        )
    return entries


def _of_former_version(recording: Recording, events: Sequence[StoredEvent]) -> Recording:
    """Rig time made to rise where processes of version 0.1 measured."""
    order = rows_by_sequence(recording)
    t, host = recording["t_rig_s"][order], recording["t_host_s"][order]
    scale = _time_scale(events)
    dt, dhost = np.diff(t), np.diff(host)
    begins = dt < -FALL_S
    if scale is not None:
        begins |= np.abs(dt - scale * dhost) > JUMP_S + JUMP_HOST_S * scale
    firsts = (np.flatnonzero(begins) + 1).tolist()
    processes = _processes(events)
    bounds = [0, *firsts]
    gaps: list[float | None] = []
    for number, first in enumerate(firsts, start=1):
        gap_s: float | None = None
        if scale is not None and dhost[first - 1] >= 0.0:
            gap_s = scale * float(dhost[first - 1])
        elif scale is not None and len(processes) == len(bounds):
            last_utc_s = processes[number - 1][0] + float(host[first - 1] - host[bounds[number - 1]])
            gap_s = scale * max(0.0, processes[number][0] - last_utc_s)
        gaps.append(gap_s)
    if firsts:
        recording = shift_sessions(recording, list(zip(firsts, gaps, strict=True)))
        if len(processes) != len(bounds):
            return recording
        entries = tuple(
            s.model_copy(update={"command": command, "begin_utc_s": utc_s})
            for s, (utc_s, command) in zip(recording.file.sessions, processes, strict=True)
        )
        return _with_header(recording, entries)
    if not processes:
        return recording
    entry = SessionEntry(
        number=1,
        command=processes[0][1],
        first_sequence=int(recording["sequence"][order[0]]),
        begin_rig_s=float(t[0]),
        end_rig_s=float(t[-1]),
        begin_utc_s=processes[0][0],
    )
    return _with_header(recording, (entry,))


def _with_header(recording: Recording, entries: tuple[SessionEntry, ...]) -> Recording:
    file = recording.file.model_copy(update={"sessions": entries})
    return Recording(file, recording.machine, recording.columns)


def _time_scale(events: Sequence[StoredEvent]) -> float | None:
    """Rig seconds a second of the campaign's rig; None where rig time is not the computer's, or that is unknown."""
    settings: Mapping[str, Any] | None = next((e.data for e in events if e.kind == "settings"), None)
    if settings is None or settings["rig_file"]["can"]["interface"] == "embedded":
        return None
    return float(settings["rig_file"].get("time_scale") or 1.0)


def _processes(events: Sequence[StoredEvent]) -> list[tuple[float, str]]:
    """(Unix time, command) of each process of version 0.1 that measured.

    Each begins with the calibration's plan, but for `verify`: `calibrate` has diagnosed just before it verifies.
    """
    out = []
    for event, before in zip(events, (None, *events), strict=False):
        if event.kind == "started" and event.data.get("plan") == "calibration":
            out.append((_utc_s(event.created), "measure"))
        elif event.kind == "verifying" and (before is None or before.kind != "diagnosed"):
            out.append((_utc_s(event.created), "verify"))
        elif event.kind == "verifying" and out:
            out[-1] = (out[-1][0], "calibrate")
    return out


def _utc_s(created: str) -> float:
    return datetime.fromisoformat(created).timestamp()
