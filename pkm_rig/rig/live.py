"""What is seen of a rig at work, as one value: for the terminal, for the page, for whoever else looks on.

It is filled from the campaign's threads and read from any other; reading it asks no device anything.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from calibration.base.arrays import Array
from drivers.drives.servo_drive import DriveSample, ServoDrive
from pkm_rig.rig.observer import Request
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.tool_place import platform_pose

LAST_READINGS, LAST_LINES = 12, 40
RATE_OVER = 400  # readings from which the time left is estimated
FEWEST_FOR_RATE = 10
FEWEST_FOR_MEAN = 4
Light = Literal["good", "bad", "unknown"]


@dataclass(frozen=True)
class Guard:
    """Something that must be good before or while the machine moves: its light and its value in words."""

    name: str
    light: Light
    value: str


@dataclass(frozen=True)
class LastReading:
    """A stored reading; `residual_m`: how far it is from where the nominal machine has it, the mean of that over the
    readings of its reflector taken off (its mounting is not known); NaN while there are too few.
    """

    sequence: int
    phase: str
    smr: str
    pose: int
    distance_m: float
    residual_m: float
    t_rig_s: float


@dataclass(frozen=True)
class Snapshot:
    """All of it at one time. `left_s` is host time; `pose` and `target` are platform poses (6,), `drives` (d,)."""

    campaign: str
    phase: str
    done: int
    total: int
    left_s: float | None
    t_rig_s: float
    request: Request | None
    guards: tuple[Guard, ...]
    readings: tuple[LastReading, ...]
    lines: tuple[str, ...]
    drives: Array | None
    pose: Array | None
    target: Array | None
    target_number: int
    aim: str


class Live:
    """Watches one rig at a time; safe to use from several threads."""

    def __init__(self, host_s: Callable[[], float] = time.monotonic) -> None:
        self._host_s = host_s
        self._lock = threading.Lock()
        self._rig: Rig | None = None
        self._pose: Array | None = None
        self._seen: tuple[Guard, ...] = ()
        self.version = 0
        self._clear()

    def _clear(self) -> None:
        self._campaign = self._phase = self._aim = ""
        self._done = self._total = 0
        self._request: Request | None = None
        self._checks: dict[str, tuple[float, float, str]] = {}
        self._means: dict[str, tuple[int, Array]] = {}
        self._readings: deque[LastReading] = deque(maxlen=LAST_READINGS)
        self._lines: deque[str] = deque(maxlen=LAST_LINES)
        self._times: deque[tuple[float, int]] = deque(maxlen=RATE_OVER)
        self._target: Array | None = None
        self._target_number = -1

    def watch(self, rig: Rig) -> None:
        """Watch a rig from its connection on; what was seen of another is forgotten."""
        with self._lock:
            self._rig = rig
            rig.observer = self
            self.version += 1

    def begin(self) -> None:
        """Forget what was seen: another job begins."""
        with self._lock:
            self._clear()
            self.version += 1

    def leave(self) -> None:
        """The rig is being left; the guards stay as they were seen last."""
        rig = self._rig
        seen = () if rig is None else _guards(rig)
        with self._lock:
            self._rig, self._request, self._seen = None, None, seen
            self.version += 1

    # --- told by jobs

    def notify(self, line: str) -> None:
        """A line of text."""
        with self._lock:
            self._lines.append(line)
            self.version += 1

    def progress(self, count: int, total: int, phase: str) -> None:
        """Readings since the last call, those of the campaign and what is being done."""
        with self._lock:
            self._done = self._done + count
            self._total = max(total, self._done)  # what is measured anew is not planned
            if phase != "nests":  # they come between all others
                self._phase = phase.replace("_", " ")
            if phase == "stored":
                self._times.clear()
            elif count:
                self._times.append((self._host_s(), self._done))
            self.version += 1

    # --- told by the rig

    def campaign(self, campaign: str) -> None:
        """A session of this campaign begins."""
        with self._lock:
            self._campaign = campaign
            self.version += 1

    def going_to(self, target_m: Array, pose: int) -> None:
        """The drives begin to move to a platform pose."""
        with self._lock:
            self._target, self._target_number = np.array(target_m, dtype=float), pose
            self.version += 1

    def aiming_at(self, smr: str) -> None:
        """The station turns to a reflector."""
        with self._lock:
            self._aim = smr
            self.version += 1

    def reading(self, row: Mapping[str, Any], deviation_m: Array) -> None:
        """A reading is stored."""
        with self._lock:
            residual_m = self._residual_m(str(row["smr"]), np.asarray(deviation_m, dtype=float))
            self._readings.append(
                LastReading(
                    int(row["sequence"]), str(row["phase"]), str(row["smr"]), int(row["pose"]),
                    float(row["slope_distance_m"]), residual_m, float(row["t_rig_s"]),
                )
            )  # fmt: skip
            self.version += 1

    def _residual_m(self, smr: str, deviation_m: Array) -> float:
        if not np.all(np.isfinite(deviation_m)):
            return math.nan
        count, mean_m = self._means.get(smr, (0, np.zeros(3)))
        mean_m = mean_m + (deviation_m - mean_m) / (count + 1)
        self._means[smr] = (count + 1, mean_m)
        return float(np.linalg.norm(deviation_m - mean_m)) if count + 1 >= FEWEST_FOR_MEAN else math.nan

    def checked(self, what: str, value: float, limit: float, unit: str) -> None:
        """A check of the campaign was made."""
        with self._lock:
            self._checks[what] = (value, limit, unit)
            self.version += 1

    def asks(self, request: Request | None) -> None:
        """The campaign waits for somebody, or no more."""
        with self._lock:
            self._request = request
            self.version += 1

    # --- seen

    def snapshot(self) -> Snapshot:
        """What there is to see now."""
        with self._lock:
            rig = self._rig
            seen: dict[str, Any] = {
                "campaign": self._campaign,
                "phase": self._phase,
                "done": self._done,
                "total": self._total,
                "left_s": self._left_s(),
                "request": self._request,
                "readings": tuple(self._readings),
                "lines": tuple(self._lines),
                "target": self._target,
                "target_number": self._target_number,
                "aim": self._aim,
            }
            checks = dict(self._checks)
        drives = None if rig is None else _drives(rig)
        if rig is not None and drives is not None:
            self._pose = platform_pose(rig.machine, drives, self._pose)
        guards = self._seen if rig is None else _guards(rig)
        return Snapshot(
            **seen,
            guards=(*guards, *(_check_guard(name, *check) for name, check in checks.items())),
            t_rig_s=math.nan if rig is None else rig.clock.now_s(),
            drives=drives,
            pose=self._pose,
        )

    def _left_s(self) -> float | None:
        if len(self._times) < FEWEST_FOR_RATE:
            return None
        (first_s, first), (last_s, last) = self._times[0], self._times[-1]
        return (self._total - self._done) * (last_s - first_s) / max(last - first, 1)


def _drives(rig: Rig) -> Array | None:
    """Drive positions (d,) as they were sent last, without a frame on the bus; None before the first."""
    samples = [_sample(drive) for drive in rig.drives.drives]
    return None if None in samples else np.array([sample.position_m for sample in samples if sample is not None])


def _sample(drive: ServoDrive) -> DriveSample | None:
    return drive.latest(0.0, 0.0) if all(drive.messages.tpdo_counts) else None


def _guards(rig: Rig) -> tuple[Guard, ...]:
    return (*_plc_guards(rig), *_drive_guards(rig))


def _plc_guards(rig: Rig) -> list[Guard]:
    supervisor = rig.supervisor
    state, trip = supervisor.last_state, supervisor.trip
    stopped = Guard("supervision", "bad" if trip else "good", "nothing is amiss" if trip is None else str(trip))
    if state is None:
        return [stopped]
    age_s = max(0.0, rig.clock.now_s() - state.t_rig_s)
    out = [stopped]
    out += [
        Guard(name, "good" if good else "bad", "good" if good else "open") for name, good in state.interlocks.items()
    ]
    if state.local_release is not None:
        on = state.local_release
        needed: Light = "bad" if rig.needs_release else "unknown"
        out.append(Guard("local release", "good" if on else needed, "on" if on else "off"))
    out.append(
        Guard("PLC", "good" if state.heartbeat_fresh else "bad", f"heartbeat {state.heartbeat}, read {age_s:.1f} s ago")
    )
    payload = "being changed" if state.payload is None else rig.file.payloads[state.payload].name
    out.append(Guard("payload", "unknown" if state.payload is None else "good", payload))
    return out


def _drive_guards(rig: Rig) -> list[Guard]:
    out = []
    for drive in rig.drives.drives:
        sample, beat = _sample(drive), drive.heartbeat().value
        if sample is None:
            out.append(Guard(f"drive {drive.name}", "unknown", "nothing received yet"))
            continue
        state = drive.messages.last_state() or sample.state  # without power there is no SYNC, and samples are old
        fault = state.name in ("FAULT", "FAULT_REACTION") or beat == "lost"
        value = (
            f"{state.name.lower().replace('_', ' ')}, heartbeat {beat}, "
            f"following error {sample.following_error_m * 1e6:.1f} um"
        )
        out.append(Guard(f"drive {drive.name}", "bad" if fault else "good", value))
    return out


def _check_guard(name: str, value: float, limit: float, unit: str) -> Guard:
    factor, shown = (1e6, "um") if unit == "m" else (1.0, unit)
    above: Light = "unknown" if name == "warm-up" else "bad"  # which is waited for
    light: Light = "good" if value <= limit else above
    return Guard(name, light, f"{value * factor:.3g} of {limit * factor:.3g} {shown}")
