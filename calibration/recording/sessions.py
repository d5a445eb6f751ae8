"""The times of a recording's sessions: where rig time falls, and how it is made to rise again.

A session is one process' work on a campaign. Rig time that begins anew in a session is no time of the campaign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.recording.header import SessionEntry
from calibration.recording.recording import Recording

FALL_S = 1.0  # by which rig time may fall between two readings: time stamps have noise
UNKNOWN_GAP_S = 3600.0  # between two sessions of which nobody knows how far apart they were


def rows_by_sequence(recording: Recording) -> NDArray[np.intp]:
    """Rows (r,) in the order in which they were measured."""
    return np.argsort(recording["sequence"], kind="stable")


def falls_of_time(recording: Recording) -> NDArray[np.intp]:
    """Rows before which rig time falls, in the order of the sequence."""
    order = rows_by_sequence(recording)
    t = recording["t_rig_s"][order]
    return order[1:][np.diff(t) < -FALL_S]


def breaks_s(recording: Recording) -> tuple[float, ...]:
    """Rig times before which an unknown time passed: no effect of time may be used across them."""
    return tuple(s.begin_rig_s for s in recording.file.sessions if s.time == "unknown")


def sessions_from_sequence(recording: Recording) -> Recording:
    """The same readings, where each fall of rig time begins a session, an unknown time after the last one."""
    order = rows_by_sequence(recording)
    firsts = np.searchsorted(recording["sequence"][order], recording["sequence"][falls_of_time(recording)])
    return shift_sessions(recording, [(int(first), None) for first in firsts])


def shift_sessions(recording: Recording, begins: Sequence[tuple[int, float | None]]) -> Recording:
    """The same readings with rising rig time and their sessions in the header.

    begins: places in the order of the sequence at which a session begins, beside the first reading, and the rig time
    between it and the reading before; None if that is unknown.
    """
    if not begins:
        return recording
    order = rows_by_sequence(recording)
    t, shift_s = recording["t_rig_s"][order], np.zeros(len(order))
    entries = []
    bounds = [0, *(first for first, _ in begins), len(order)]
    for number, (first, end) in enumerate(pairwise(bounds), start=1):
        gap_s = begins[number - 2][1] if number > 1 else 0.0
        if number > 1:
            before_s = t[first - 1] + shift_s[first - 1]
            shift_s[first:] = before_s + (UNKNOWN_GAP_S if gap_s is None else gap_s) - t[first]
        rows = order[first:end]
        entries.append(
            SessionEntry(
                number=number,
                first_sequence=int(recording["sequence"][rows[0]]),
                begin_rig_s=float((t + shift_s)[first]),
                end_rig_s=float((t + shift_s)[end - 1]),
                time="measured" if number == 1 else "unknown" if gap_s is None else "repaired",
            )
        )
    shifted: Array = np.empty(len(order))
    shifted[order] = t + shift_s
    columns = {**recording.columns, "t_rig_s": shifted}
    file = recording.file.model_copy(update={"sessions": tuple(entries)})
    return replace(recording, file=file, columns=columns)


def repaired_text(recording: Recording) -> str | None:
    """What is to be said of a recording whose times were not as they are now; None if nothing."""
    repaired = [s for s in recording.file.sessions if s.time != "measured"]
    if not repaired:
        return None
    unknown = sum(s.time == "unknown" for s in repaired)
    known = len(repaired) - unknown
    parts = []
    if known:
        parts.append(f"{known} by the computer's clock")
    if unknown:
        parts.append(f"{unknown} after an unknown time, across which no effect of time is used")
    return (
        f"recording {recording.file.campaign}: rig time began anew in {len(repaired)} of its sessions; "
        f"repaired: {', '.join(parts)}"
    )
