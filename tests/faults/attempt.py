"""One fault at one operation of the short campaign: what came of it, and what is wrong with that."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from calibration.recording.recording import Recording
from mock_devices.faults import Fault
from pkm_rig.errors import CampaignRefused
from tests.faults.short_campaign import (
    EXPECTED,
    GUARD_S,
    PATIENT_S,
    Bench,
    Key,
    bench,
    heal,
    recorded,
    rows_by_key,
    run,
    still,
)

ENDED_RIGHT, STOPPED, UNTOUCHED, WRONG = "ended right", "stopped safely", "untouched", "WRONG"

HANGS_S = 120
NO_FAULT = "stopped without a fault"

# Eight standard deviations of the difference of two readings; what is wrong is off by far more.
ANGLE_RAD = 8.0 * 2.4e-6 * 2.0**0.5 * 1.2
DISTANCE_M = 8.0 * 1.0e-4 * 2.0**0.5
LIMITS = {
    "hz_rad": ANGLE_RAD,
    "v_rad": ANGLE_RAD,
    "slope_distance_m": DISTANCE_M,
    "ppm": 0.5,
    "prism_constant_m": 0.0,
    "left_commanded_m": 2e-8,
    "right_commanded_m": 2e-8,
    "left_actual_m": 1e-6,
    "right_actual_m": 1e-6,
    "payload": 0.0,
    "air_temperature_c": 0.3,
    "struts_temperature_c": 0.3,
    "pressure_hpa": 3.0,
    "humidity_percent": 3.0,
    "flags": 0.0,
    "face": 0.0,
    "compensation": 0.0,
}
_DRIVES = ("left_commanded_m", "right_commanded_m", "left_actual_m", "right_actual_m")
Values = Mapping[str, float]


@dataclass(frozen=True)
class Result:
    """`outcome` is one of the four above; `detail` the error that ended the run, or what is wrong."""

    fault: str
    at: int
    outcome: str
    detail: str


def reference() -> dict[Key, Values]:
    """The readings of an untouched run, by key."""
    with bench(None) as made:
        run(made, PATIENT_S)
        recording = recorded(made)
        assert recording is not None
        return {key: _values(recording, rows[0]) for key, rows in rows_by_key(recording).items()}


def operations(names: list[str]) -> dict[str, int]:
    """How many operations of each kind an untouched run has."""
    counts = {}
    for name in names:
        with bench(Fault(name, 10**8)) as made:
            run(made, PATIENT_S)
            counts[name] = made.plan.counts[name]
    return counts


def attempt(fault: Fault, wanted: Mapping[Key, Values]) -> Result:
    """Run the campaign into the fault, look at what it left, then run it again without and look again."""
    result = _attempt(fault, wanted, GUARD_S)
    if result.outcome == WRONG and result.detail.startswith(NO_FAULT):
        return _attempt(fault, wanted, PATIENT_S)
    return result


def _attempt(fault: Fault, wanted: Mapping[Key, Values], guard_s: float) -> Result:
    with bench(fault) as made:
        error = _run(made, guard_s)
        struck = bool(made.plan.struck)
        problems = _look(made, error, wanted, fault)
        if error is None and not problems:
            return Result(fault.name, fault.at, ENDED_RIGHT if struck else UNTOUCHED, "")
        before = _stored(made)
        heal(made)
        made.mock.clock.sleep_s(1.0)
        second = _run(made, PATIENT_S)
        moved = isinstance(second, CampaignRefused) and fault.name == "tracker-drift"
        if second is not None and not moved:
            problems.append(f"the second run failed: {type(second).__name__}: {second}")
        problems += _look(made, second, wanted, fault)
        problems += _repeated(before, _stored(made))
        if not struck:
            return Result(fault.name, fault.at, WRONG, f"{NO_FAULT}: {error}")
        if problems:
            return Result(fault.name, fault.at, WRONG, "; ".join(problems))
        return Result(fault.name, fault.at, STOPPED, f"{type(error).__name__}: {error}")


def _run(made: Bench, guard_s: float) -> Exception | None:
    try:
        with _no_longer_than(HANGS_S):
            run(made, guard_s)
    except Exception as error:
        return error
    return None


@contextmanager
def _no_longer_than(limit_s: int) -> Iterator[None]:
    """A run that hangs is wrong as well; host time."""

    def hung(_number: int, _frame: object) -> None:
        raise TimeoutError(f"the run hung for {limit_s} s")

    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(limit_s)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _look(made: Bench, error: BaseException | None, wanted: Mapping[Key, Values], fault: Fault) -> list[str]:
    problems = []
    if error is not None and not isinstance(error, EXPECTED):
        problems.append(f"no typed error: {type(error).__name__}: {error}")
    if error is not None and "\n" in str(error):
        problems.append("the message has more than one line")
    if not still(made):
        problems.append("something moves")
    recording = recorded(made)
    if recording is None:
        return problems if error is not None else [*problems, "nothing was stored"]
    rows = rows_by_key(recording)
    missing = {key for key in wanted if key[0] == "calibration"} - set(rows)
    if error is None and missing:
        problems.append(f"readings missing: {sorted(missing)[:3]}")
    usable = _usable(recording) if fault.name == "tracker-drift" else np.ones(len(recording), dtype=bool)
    turned = _first_turn(recording, wanted) if fault.name == "tracker-drift" else 0.0
    for key, numbers in rows.items():
        if key[0] == "calibration" and len(numbers) > 1:
            problems.append(f"measured twice: {key}")
        for row in numbers:
            if usable[row]:
                problems += _wrong_values(key, _values(recording, row), _of(key, wanted), turned)
    return problems


def _of(key: Key, wanted: Mapping[Key, Values]) -> Values | None:
    """The reference of a reading; a nest is the same wherever the drives stand."""
    if key[0] != "nests":
        return wanted.get(key)
    return next(
        (
            {n: v for n, v in values.items() if n not in _DRIVES}
            for k, values in wanted.items()
            if k[0] == "nests" and k[3] == key[3]
        ),
        None,
    )


def _wrong_values(key: Key, found: Values, wanted: Values | None, turned: float) -> list[str]:
    if wanted is None:
        return [f"nobody asked for {key}"]
    return [
        f"{key}: {name} is {found[name]!r}, not {wanted[name]!r}"
        for name, limit in LIMITS.items()
        if name in wanted and not abs(found[name] - wanted[name] - (turned if name == "hz_rad" else 0.0)) <= limit
    ]


def _values(recording: Recording, row: int) -> Values:
    return {name: float(recording[name][row]) for name in LIMITS}


def _stored(made: Bench) -> dict[str, str]:
    recording = recorded(made)
    if recording is None:
        return {}
    columns = list(recording.columns)
    return {
        str(recording["uid"][row]): str([recording[name][row] for name in columns]) for row in range(len(recording))
    }


def _repeated(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    changed = [uid for uid, row in before.items() if after.get(uid) != row]
    return [f"{len(changed)} stored readings changed"] if changed else []


def _first_turn(recording: Recording, wanted: Mapping[Key, Values]) -> float:
    """How far the whole campaign is turned: a stand that was knocked before the first reading is no error."""
    nests = rows_by_key(recording)
    first = min((rows[0] for key, rows in nests.items() if key[0] == "nests"), default=None)
    if first is None:
        return 0.0
    key = next(key for key, rows in nests.items() if rows[0] == first)
    off = float(recording["hz_rad"][first]) - (_of(key, wanted) or {"hz_rad": 0.0})["hz_rad"]
    return 1e-4 if abs(off - 1e-4) < ANGLE_RAD else 0.0


def _usable(recording: Recording) -> np.ndarray:
    """Rows that lie before the last nest check that found both nests where they were at first."""
    checks = recording["nest_check"].astype(int)
    nests = np.asarray(recording["phase"]) == "nests"
    good = [0]
    for number in range(1, int(checks.max()) + 1):
        rows = np.flatnonzero(nests & (checks == number))
        firsts = np.flatnonzero(nests & (checks == 0))
        if len(rows) == len(firsts) and np.all(np.abs(recording["hz_rad"][rows] - recording["hz_rad"][firsts]) < 4e-5):
            good.append(number)
    usable: np.ndarray = checks < good[-1]
    return usable
