"""Facts of a machine's life as the store keeps them; every rule is a pure function of them.

Times are seconds since 1970 in UTC (`t_utc_s`), so that summer time moves nothing. Facts are checked when they are
made; `MachineHistory` also checks that they fit one another. Tuples instead of arrays: facts are compared and hashed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Self

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError

EventKind = Literal["drive replaced", "reference lost", "collision", "tolerance changed", "structure changed"]
EVENT_KINDS: tuple[EventKind, ...] = (
    "drive replaced",
    "reference lost",
    "collision",
    "tolerance changed",
    "structure changed",
)
Extent = Literal["full", "expansion", "drive offset"]
EXTENTS: tuple[Extent, ...] = ("full", "expansion", "drive offset")


@dataclass(frozen=True)
class Tolerance:
    """Largest position error of the tool point that is allowed (RMS over the workspace), from a date on.

    position_m: > 0. since_utc_s: from when it holds.
    """

    since_utc_s: float
    position_m: float

    def __post_init__(self) -> None:
        _finite("tolerance", since_utc_s=self.since_utc_s, position_m=self.position_m)
        if self.position_m <= 0.0:
            raise InputError(f"tolerance: {self.position_m} m is not above zero: state the largest error allowed")


@dataclass(frozen=True)
class MachineFact:
    """Which machine it is, what its parameters are called today, and which tolerances it has had, oldest first.

    identity: a hash or serial that distinguishes machines of the same name.
    """

    name: str
    identity: str
    parameter_names: tuple[str, ...]
    tolerances: tuple[Tolerance, ...]

    def __post_init__(self) -> None:
        where = f"machine {self.name}"
        if not self.tolerances:
            raise InputError(f"{where}: has no tolerance: state one in [recalibration]")
        _unique(where, self.parameter_names)
        _ascending(f"{where}: tolerances", [t.since_utc_s for t in self.tolerances])

    def tolerance_m(self, t_utc_s: float) -> float:
        """The tolerance at a time; before the first one that one."""
        valid = [t for t in self.tolerances if t.since_utc_s <= t_utc_s] or [self.tolerances[0]]
        return valid[-1].position_m


@dataclass(frozen=True)
class InstrumentFact:
    """A measuring instrument: serial, certificate, and until when the certificate is valid."""

    serial: str
    certificate: str
    due_utc_s: float

    def __post_init__(self) -> None:
        _finite(f"instrument {self.serial}", due_utc_s=self.due_utc_s)


@dataclass(frozen=True)
class ErrorFigure:
    """Position error of the tool point, RMS over the poses or the workspace, with its standard uncertainty."""

    position_m: float
    u_m: float

    def __post_init__(self) -> None:
        _finite("error figure", position_m=self.position_m, u_m=self.u_m)
        if self.position_m < 0.0 or self.u_m < 0.0:
            raise InputError(f"error figure: {self.position_m} m with u = {self.u_m} m: neither may be below zero")


@dataclass(frozen=True)
class CalibrationFact:
    """One calibration: what was found, under which conditions, and what it did to the error.

    extent: what was measured: everything, expansion alone, or one drive's offset. instrument: its serial.
    parameters (p,), covariance (p, p): SI units, in the order of `parameter_names`. temperature_c: mean temperature of
    the machine's parts. operating_h: hours of operation since the machine was new. as_found, as_left: the error with
    the tables before and after, if they were verified. tables: identity of the tables left active ("" for none).
    """

    id: str
    t_utc_s: float
    instrument: str
    parameter_names: tuple[str, ...]
    parameters: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    temperature_c: float
    operating_h: float
    as_found: ErrorFigure | None = None
    as_left: ErrorFigure | None = None
    extent: Extent = "full"
    tables: str = ""
    software: str = ""

    def __post_init__(self) -> None:
        where = f"calibration {self.id}"
        _finite(where, t_utc_s=self.t_utc_s, temperature_c=self.temperature_c, operating_h=self.operating_h)
        _unique(where, self.parameter_names)
        p = len(self.parameter_names)
        if len(self.parameters) != p or not np.all(np.isfinite(self.parameters)):
            raise InputError(f"{where}: needs {p} finite parameters, one for each name")
        _covariance(where, self.covariance, p)
        if self.extent not in EXTENTS:
            raise InputError(f"{where}: extent '{self.extent}' is none of {', '.join(EXTENTS)}")


@dataclass(frozen=True)
class CheckFact:
    """One short check with the tables on, against one calibration.

    calibration: id of the calibration whose tables were on. instrument: its serial. error: position error of the tool
    point over the workspace that the check infers, noise removed. watched: names of the watched changes of the machine,
    each a parameter or a structure of several ("drive_offset.left"), change (w,): how much each has changed since
    that calibration, if it alone has changed, change_u (w,): its standard uncertainty, station set up anew, both in
    the unit of the change. reference_u (w,): standard uncertainty that comes from the calibration itself and is common
    to all its checks. error_per_change (w,): position error of the tool point, RMS over the workspace, for a change of
    one unit (m per unit). independent: how many independent changes would exceed a limit as often as the watched ones
    together do (1 to w). `check_estimate.estimate_check` computes all of them. temperature_c: mean temperature of the
    machine's parts. poses: how many were used. duration_s: rig time. known_error_m: the part of the error that is
    known without measuring, since the tables were made for another temperature; known_alignment (w,), if it is stated:
    correlation over the workspace (-1 to 1) of that part with what each change does.
    """

    id: str
    t_utc_s: float
    calibration: str
    instrument: str
    error: ErrorFigure
    watched: tuple[str, ...]
    change: tuple[float, ...]
    change_u: tuple[float, ...]
    reference_u: tuple[float, ...]
    error_per_change: tuple[float, ...]
    independent: float
    temperature_c: float
    poses: int
    operating_h: float
    duration_s: float = 0.0
    known_error_m: float = 0.0
    known_alignment: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        where = f"check {self.id}"
        _finite(
            where,
            t_utc_s=self.t_utc_s,
            temperature_c=self.temperature_c,
            operating_h=self.operating_h,
            duration_s=self.duration_s,
            known_error_m=self.known_error_m,
        )
        _unique(where, self.watched)
        w = len(self.watched)
        columns = (self.change, self.change_u, self.reference_u, self.error_per_change)
        if any(len(column) != w for column in columns):
            raise InputError(f"{where}: needs {w} changes with their uncertainties, one for each that is watched")
        if not np.all(np.isfinite(self.change)) or not all(math.isfinite(u) and u > 0.0 for u in self.change_u):
            raise InputError(f"{where}: changes must be finite and their uncertainties above zero")
        if not all(math.isfinite(v) and v >= 0.0 for v in (*self.reference_u, *self.error_per_change)):
            raise InputError(f"{where}: reference_u and error_per_change must be finite and not below zero")
        if len(self.known_alignment) not in (0, w) or not all(abs(r) <= 1.0 + 1e-9 for r in self.known_alignment):
            raise InputError(f"{where}: known_alignment needs a correlation for each of the {w} watched changes")
        if not 1.0 <= self.independent <= max(w, 1):
            raise InputError(
                f"{where}: independent is {self.independent}: it lies between 1 and the {w} watched changes"
            )
        if self.poses < 1:
            raise InputError(f"{where}: used {self.poses} poses: a check needs at least one")

    def standardised(self) -> Array:
        """Each change divided by its standard uncertainty (w,)."""
        return np.asarray(self.change) / np.asarray(self.change_u)


@dataclass(frozen=True)
class EventFact:
    """Something that happened to the machine. part: the drive or column concerned ("" if it is not known)."""

    t_utc_s: float
    kind: EventKind
    part: str = ""
    detail: str = ""

    def __post_init__(self) -> None:
        _finite(f"event '{self.kind}'", t_utc_s=self.t_utc_s)
        if self.kind not in EVENT_KINDS:
            raise InputError(f"event '{self.kind}': none of {', '.join(EVENT_KINDS)}")


@dataclass(frozen=True)
class Postponement:
    """Somebody's decision to wait with a calibration that is due: who, why, and until when."""

    t_utc_s: float
    until_utc_s: float
    who: str
    why: str

    def __post_init__(self) -> None:
        _finite("postponement", t_utc_s=self.t_utc_s, until_utc_s=self.until_utc_s)
        if self.until_utc_s <= self.t_utc_s:
            raise InputError("postponement: ends before it begins: give an end that lies ahead")
        if not self.who.strip() or not self.why.strip():
            raise InputError("postponement: needs a name and a reason")


@dataclass(frozen=True)
class MachineHistory:
    """All facts of one machine, each kind in the order in which it was stored.

    Raises InputError if a row is older than the one stored before it (the clock was set back), was stored twice, or
    refers to a calibration that is not there.
    """

    machine: MachineFact
    instruments: tuple[InstrumentFact, ...] = ()
    calibrations: tuple[CalibrationFact, ...] = ()
    checks: tuple[CheckFact, ...] = ()
    events: tuple[EventFact, ...] = ()
    postponements: tuple[Postponement, ...] = ()

    def __post_init__(self) -> None:
        where = f"machine {self.machine.name}"
        _unique(f"{where}: instruments", [i.serial for i in self.instruments])
        _unique(f"{where}: calibrations", [c.id for c in self.calibrations])
        _unique(f"{where}: checks", [c.id for c in self.checks])
        for name, rows in (("calibrations", self.calibrations), ("checks", self.checks), ("events", self.events)):
            _ascending(f"{where}: {name}", [row.t_utc_s for row in rows])
        known = {c.id: c.t_utc_s for c in self.calibrations}
        for check in self.checks:
            if check.calibration not in known:
                raise InputError(f"{where}: check {check.id} is of calibration {check.calibration}, which is not there")
            if check.t_utc_s < known[check.calibration]:
                raise InputError(f"{where}: check {check.id} is older than its calibration: the clock was set back")

    def with_calibration(self, calibration: CalibrationFact) -> Self:
        """The history with one more calibration; InputError if it does not follow from what is there."""
        return replace(self, calibrations=(*self.calibrations, calibration))

    def with_check(self, check: CheckFact) -> Self:
        """The history with one more check; InputError if it does not follow from what is there."""
        return replace(self, checks=(*self.checks, check))

    def with_event(self, event: EventFact) -> Self:
        """The history with one more event; InputError if it does not follow from what is there."""
        return replace(self, events=(*self.events, event))

    @property
    def last_calibration(self) -> CalibrationFact | None:
        """The calibration in force, full or partial."""
        return self.calibrations[-1] if self.calibrations else None

    @property
    def last_time_utc_s(self) -> float:
        """Time of the newest calibration, check or event; minus infinity if there is none."""
        last = [rows[-1].t_utc_s for rows in (self.calibrations, self.checks, self.events) if rows]
        return max(last, default=-math.inf)

    def checks_since_calibration(self) -> tuple[CheckFact, ...]:
        """Checks of the calibration in force, oldest first."""
        last = self.last_calibration
        return () if last is None else tuple(c for c in self.checks if c.calibration == last.id)

    def events_since_calibration(self) -> tuple[EventFact, ...]:
        """Events after the calibration in force, oldest first; all of them if there is none."""
        last = self.last_calibration
        return self.events if last is None else tuple(e for e in self.events if e.t_utc_s > last.t_utc_s)

    def happened_since_calibration(self) -> tuple[EventFact, ...]:
        """Of these what has happened to the machine: another tolerance is none of it."""
        return tuple(e for e in self.events_since_calibration() if e.kind != "tolerance changed")

    def instrument(self, serial: str) -> InstrumentFact | None:
        """The instrument of a serial number, None if it is not known."""
        return next((i for i in self.instruments if i.serial == serial), None)


def _finite(where: str, **values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise InputError(f"{where}: {name} is {value}: it must be a finite number")


def _unique(where: str, names: tuple[str, ...] | list[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if not name:
            raise InputError(f"{where}: a name is empty")
        if name in seen:
            raise InputError(f"{where}: '{name}' is there twice: keep one")
        seen.add(name)


def _ascending(where: str, times: list[float]) -> None:
    for i, (before, after) in enumerate(pairwise(times), start=2):
        if after < before:
            raise InputError(
                f"{where}: number {i} is {before - after:.0f} s older than the one stored before it: "
                "the clock was set back; set it right and store no row until then"
            )


def _covariance(where: str, covariance: tuple[tuple[float, ...], ...], p: int) -> None:
    if len(covariance) != p or any(len(row) != p for row in covariance):
        raise InputError(f"{where}: the covariance must be {p} by {p}")
    c = np.array(covariance, dtype=np.float64).reshape(p, p)
    if not np.all(np.isfinite(c)):
        raise InputError(f"{where}: the covariance must be finite")
    scale = np.sqrt(np.abs(np.diag(c)))
    unit = c / np.where(scale > 0.0, np.outer(scale, scale), 1.0)
    if np.any(np.diag(c) < 0.0) or np.max(np.abs(unit - unit.T), initial=0.0) > 1e-9:
        raise InputError(f"{where}: the covariance must be symmetric with no negative variance")
    if p and np.linalg.eigvalsh(unit)[0] < -1e-9 * p:
        raise InputError(f"{where}: the covariance has a negative variance in some direction")
