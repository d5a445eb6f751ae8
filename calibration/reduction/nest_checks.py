"""Checks of the floor nests: whether the station stands where it stood, and which readings may therefore be used.

Each set-up of the station has its own first check, and only its own checks open and close its readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.instruments.station_geometry import across_line_of_sight
from calibration.recording.recording import Recording
from calibration.reduction.grouped_readings import replaced_readings
from calibration.reduction.nest_gate import gate_nests

TIES = ("nests", "repeatability")  # phases that place a set-up and tell nothing of the machine's accuracy


def nest_shift(recording: Recording) -> tuple[NDArray[np.intp], Array]:
    """Nest checks (c,) and the largest shift of a nest across the line of sight since its set-up's first check (c,)."""
    nests = gate_nests(recording.rows("nests"))[0]
    checks = np.unique(nests["nest_check"]).astype(int)
    first: dict[tuple[float, str], Array] = {}
    shifts = np.zeros(len(checks))
    for i, check in enumerate(checks):
        for name in np.unique(nests["smr"]):
            rows = np.flatnonzero((nests["nest_check"] == check) & (np.asarray(nests["smr"]) == name))
            if not rows.size:
                continue
            point = nests.positions_m[rows].mean(axis=0)
            start = first.setdefault((float(nests["station"][rows[0]]), str(name)), point)
            shift = across_line_of_sight(point - start, start)
            shifts[i] = max(shifts[i], float(np.linalg.norm(shift)))
    return checks, shifts


def usable_readings(recording: Recording, next_check: int | None = None) -> NDArray[np.bool_]:
    """Readings (r,) that lie between two good nest checks of their set-up, of visits that were not measured anew.

    Those next to a failed closing check are not used. `nest_check` of a reading is the number of the last check before
    it; `next_check` is a future one, of the last set-up, that is assumed to succeed: none where the next one begins a
    new set-up. Without nests in the recording all are used.
    """
    checks, shifts = nest_shift(recording)
    if checks.size == 0:
        return ~replaced_readings(recording)
    setup = setups_of_checks(recording)
    good = {(int(c), setup[int(c)]) for c, s in zip(checks, shifts, strict=True) if s <= recording.file.nest_limit_m}
    if next_check is not None:
        good.add((next_check, max(setup.values())))
    own = recording["station"].tolist()
    numbers = recording["nest_check"].astype(int).tolist()
    opened = np.array([(n, k) in good for n, k in zip(numbers, own, strict=True)])
    closed = np.array([(n + 1, k) in good for n, k in zip(numbers, own, strict=True)])
    is_nest = np.asarray(recording["phase"]) == "nests"
    return np.where(is_nest, opened, opened & closed) & ~replaced_readings(recording)


def drop_unused_setups(recording: Recording, keep: float | None = None) -> Recording:
    """A recording without the later set-ups in which nothing usable was measured but nests and what ties them.

    They were given up, some because a nest had moved, and must not spoil the others. keep: one that stays.
    """
    phase, setup = np.asarray(recording["phase"]), recording["station"]
    numbers = np.unique(setup)
    if len(numbers) == 1:
        return recording
    measured = usable_readings(recording) & ~np.isin(phase, TIES)
    return recording.take(np.isin(setup, [numbers[0], keep or numbers[0], *np.unique(setup[measured])]))


def drop_unclosed_readings(recording: Recording) -> Recording:
    """A recording without set-ups that were given up, and without the readings whose closing nest check was left out,
    though later ones were made.

    The station may have had other settings than it was given (`Runner.resume`), or it was taken away: unlike those next
    to a failed check, they carry no information about the machine.
    """
    recording = drop_unused_setups(recording)
    setup = setups_of_checks(recording)
    last = max(setup, default=-1)
    numbers = recording["nest_check"].astype(int).tolist()
    closed = [
        n + 1 > last or setup.get(n + 1) == own for n, own in zip(numbers, recording["station"].tolist(), strict=True)
    ]
    is_nest = np.asarray(recording["phase"]) == "nests"
    return recording.take(is_nest | np.array(closed))


def setups_of_checks(recording: Recording) -> dict[int, float]:
    """The set-up in which each nest check was made."""
    nests = recording.rows("nests")
    return dict(zip(nests["nest_check"].astype(int).tolist(), nests["station"].tolist(), strict=True))
