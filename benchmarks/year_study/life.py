"""One machine over a year: the truth goes on, the software measures, and a policy decides when to calibrate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.year_study.plant_machine import PARTS, PlantMachine
from benchmarks.year_study.truths import TOLERANCE_M, MachineYear
from benchmarks.year_study.workshop import (
    CALIBRATION_H,
    LOOKS,
    PARTIAL_H,
    READING_S,
    Knowledge,
    Tables,
    Workshop,
    nests_of,
    read_all,
    rough_station,
)
from calibration.intervals.check_estimate import CheckEstimate
from calibration.intervals.drift import WEEK_S
from calibration.intervals.envelope import Verification, judge, verify
from calibration.intervals.facts import (
    CalibrationFact,
    CheckFact,
    ErrorFigure,
    EventFact,
    Extent,
    InstrumentFact,
    MachineFact,
    MachineHistory,
    Tolerance,
)
from calibration.intervals.settings import IntervalSettings

START_S = 1.7e9
HOURS_A_WEEK = 60.0
SETTINGS = IntervalSettings(temperature_k=6.5)
POINT_SD_M = 4.5e-6  # of a coordinate of the tool from one reading of the three reflectors of the platform
GROWTH_M = 20.0e-6  # of the tool, for each parameter: what may have happened before a full calibration
FULL_POSES, PARTIAL_POSES = 30, 12


@dataclass
class Life:
    """The machine, what is known of it, its history of facts, and what is scored."""

    shop: Workshop
    year: MachineYear
    noise: int
    week: float = 0.0
    hours: float = 0.0
    scores: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([15, self.year.seed, self.noise])
        self.plant = PlantMachine(self.year.seed % 100_000)
        self._passed = 0.0
        self.eventful = False
        self.calibrations = 0
        self.activations: list[dict[str, float]] = []
        cold = dict.fromkeys(PARTS, 20.0)
        first, parts_c = self._measured(Tables(self.shop.nominal(), cold), self.shop.nominal())
        first, parts_c = self._measured(Tables(first, parts_c), first)
        self.known, self.tables = first, Tables(first, parts_c)
        self.frame = self._rigid_error()
        names = tuple(self.shop.model.parameters.names)
        machine = MachineFact("planar4", str(self.year.seed), names, (Tolerance(START_S, TOLERANCE_M),))
        station = InstrumentFact("T1", "certificate", START_S + 1000.0 * 86400.0)
        self.history = MachineHistory(machine, (station,)).with_calibration(
            self.fact("full", parts_c, None, ErrorFigure(2e-6, 1e-6))
        )

    @property
    def now_s(self) -> float:
        """UTC of the present week."""
        return START_S + self.week * WEEK_S

    def _measured(self, tables: Tables, prior: Knowledge) -> tuple[Knowledge, dict[str, float]]:
        return self.shop.calibrate(self.plant, tables, prior, self.year.mean_c(self.week), self.rng)

    def fact(
        self, extent: Extent, parts_c: dict[str, float], found: ErrorFigure | None, left: ErrorFigure
    ) -> CalibrationFact:
        """What is known now as the next calibration of the history."""
        count = self.shop.count
        self.calibrations += 1
        return CalibrationFact(
            id=f"c{self.calibrations}",
            t_utc_s=self.now_s,
            instrument="T1",
            parameter_names=tuple(self.shop.model.parameters.names),
            parameters=tuple(self.known.values[:count].tolist()),
            covariance=tuple(map(tuple, self.known.covariance[:count, :count].tolist())),
            temperature_c=float(np.mean(list(parts_c.values()))),
            operating_h=HOURS_A_WEEK * self.week,
            as_found=found,
            as_left=left,
            extent=extent,
        )

    # --- the truth

    def go_to(self, week: float) -> None:
        """Let the truth go on until a time; events that devices notice are stored."""
        for number in range(int(self._passed), min(int(week), len(self.year.walk))):
            for name, by in zip(self.shop.steppable, self.year.walk[number], strict=True):
                self.plant.move(name, float(by))
        for one in self.year.happenings:
            if one.kind == "ramp":
                worn = max(0.0, week - max(one.week, self._passed))
                if worn > 0.0:
                    self.eventful = True
                    for name, by in one.changes:
                        self.plant.move(name, by * worn)
            elif self._passed < one.week <= week:
                self.eventful = True
                for name, by in one.changes:
                    self.plant.move(name, by)
                if one.kind != "step":
                    kind = one.kind
                    assert kind in ("drive replaced", "collision")
                    self.history = self.history.with_event(EventFact(START_S + one.week * WEEK_S, kind, one.part))
        for number, at in enumerate(self.year.reseats, start=1):
            if self._passed < at <= week:
                self.plant.set_up(number)
        self._passed = self.week = week

    def _errors_m(self, tables: Tables, xy: np.ndarray) -> np.ndarray:
        parts_c = dict.fromkeys(PARTS, self.year.mean_c(self.week))
        return np.asarray(self.plant.tool_m(self.shop.drives(tables, xy), parts_c) - xy)

    def _rigid_error(self) -> np.ndarray:
        """The rigid motion (3,) in which machine and calibration differ at first: the frame, fixed from then on."""
        xy = self.shop.workspace_xy
        return np.asarray(np.linalg.lstsq(_rigid(xy), self._errors_m(self.tables, xy).reshape(-1), rcond=None)[0])

    def true_errors_m(self, tables: Tables, xy: np.ndarray) -> np.ndarray:
        """Errors (n, 2) of the tool in the fixed frame, free of noise."""
        return self._errors_m(tables, xy) - (_rigid(xy) @ self.frame).reshape(-1, 2)

    def true_error_m(self, tables: Tables | None = None) -> float:
        """RMS position error over the workspace, free of noise."""
        errors = self.true_errors_m(tables or self.tables, self.shop.workspace_xy)
        return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))

    # --- what is measured

    def read_check(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Residuals of a whole check, known error over the workspace, mean temperature."""
        shop = self.shop
        true_c, read_c = self.plant.parts_c(self.year.mean_c(self.week), self.rng)
        drives = shop.drives(self.tables, shop.check_xy)
        read = read_all(self.plant, shop.check_readings, drives, true_c, 1.0, self.rng)
        poses = shop.predict(self.known, drives, shop.check_xy, read_c)
        nests, station = nests_of(self.plant, shop.nests), rough_station(self.plant)
        residual = shop.residual(shop.check_readings, self.known, poses, read, nests, station)
        of_tables = Tables(self.known, self.tables.parts_c)
        known_m = shop.known_error_m(of_tables, shop.drives(self.tables, shop.workspace_xy), read_c)
        return residual, known_m, float(np.mean(list(read_c.values())))

    def check_fact(self, look: int, estimate: CheckEstimate, known_m: np.ndarray, mean_c: float) -> CheckFact:
        """A check that ended after a look."""
        shop, poses = self.shop, LOOKS[look]
        design = shop.looks[look]
        last = self.history.last_calibration
        assert last is not None
        return CheckFact(
            id=f"h{len(self.history.checks) + 1}",
            t_utc_s=self.now_s,
            calibration=last.id,
            instrument="T1",
            error=estimate.error,
            watched=shop.watched.names,
            change=tuple(estimate.change.tolist()),
            change_u=tuple(estimate.change_u.tolist()),
            reference_u=tuple(design.reference_u_of(self.known.covariance).tolist()),
            error_per_change=tuple(design.error_per_change.tolist()),
            independent=shop.independent,
            temperature_c=mean_c,
            poses=poses,
            operating_h=HOURS_A_WEEK * self.week,
            duration_s=(len(shop.moving) * poses + 4) * READING_S,
            known_error_m=float(np.sqrt(np.sum(known_m**2) / design.points)),
            known_alignment=tuple(design.alignment(known_m).tolist()),
        )

    # --- what is done

    def calibrate(self, extent: Extent) -> Verification:
        """Calibrate, verify with fresh poses, activate if the error falls."""
        shop = self.shop
        former = self.history.last_calibration
        assert former is not None
        if extent == "full":
            grown = Knowledge(self.known.values, self.known.covariance + np.diag(_growth(shop) ** 2))
            known, parts_c = self._measured(self.tables, grown)
            self.hours += CALIBRATION_H
        else:  # the same parameters, tables for the temperature of today
            known, parts_c = self.known, self.plant.parts_c(self.year.mean_c(self.week), self.rng)[1]
            self.hours += PARTIAL_H
        new = Tables(known, parts_c)
        poses, sd = (FULL_POSES, POINT_SD_M / np.sqrt(2.0)) if extent == "full" else (PARTIAL_POSES, POINT_SD_M)
        xy = self.rng.uniform(-1.0, 1.0, (poses, 2)) * np.array([0.35, 0.30])
        before, after = (
            self.true_errors_m(t, xy) + sd * self.rng.standard_normal((poses, 2)) for t in (self.tables, new)
        )
        result = verify(before, after, float(sd))
        found, left = error_figure(before, float(sd)), error_figure(after if result.accepted else before, float(sd))
        self.known = known
        fact = self.fact(extent, parts_c if result.accepted else self.tables.parts_c, found, left)
        change_m = float(np.abs(shop.drives(new, xy) - shop.drives(self.tables, xy)).max())
        allowed = judge(SETTINGS.envelope, former, fact, drift_sd(self, former), change_m, found)
        if result.accepted:
            self.activations.append(
                {
                    "before_m": self.true_error_m(),
                    "after_m": self.true_error_m(new),
                    "u_m": result.u_m,
                    "alone": float(allowed.allowed),
                }
            )
            self.tables = new
        if extent == "full":
            self.eventful = any(h.kind == "ramp" and h.week < self.week for h in self.year.happenings)
        self.history = self.history.with_calibration(fact)
        return result


def _rigid(xy: np.ndarray) -> np.ndarray:
    """Shift (2 n, 3) of points with a translation and a rotation."""
    out = np.zeros((len(xy), 2, 3))
    out[:, 0, 0] = out[:, 1, 1] = 1.0
    out[:, 0, 2], out[:, 1, 2] = -xy[:, 1], xy[:, 0]
    return out.reshape(-1, 3)


def _growth(shop: Workshop) -> np.ndarray:
    """Standard deviation (p,) of what may have happened to each parameter; mountings of reflectors stay."""
    out = np.zeros(shop.size)
    for row, name in enumerate(shop.model.parameters.names):
        if name in shop.steppable:
            out[row] = GROWTH_M / shop.check_design.error_per_change[shop.watched.names.index(name)]
    return out


def drift_sd(life: Life, former: CalibrationFact) -> np.ndarray:
    """Standard deviation (p,) of each parameter's ordinary drift since a calibration."""
    weeks = max((life.now_s - former.t_utc_s) / WEEK_S, 0.0)
    walk = SETTINGS.drift.walk_per_sqrt_week * np.sqrt(weeks)
    return np.array([walk * life.shop.sigma.get(name, 0.0) for name in life.shop.model.parameters.names])


def error_figure(errors_m: np.ndarray, sd_m: float) -> ErrorFigure:
    """RMS of errors (n, 2) that were measured with a standard uncertainty, its noise taken out."""
    square = max(float(np.mean(np.sum(errors_m**2, axis=1))) - 2.0 * sd_m**2, 0.0)
    u = np.sqrt((4.0 * sd_m**2 * square + 4.0 * sd_m**4) / len(errors_m)) / (2.0 * max(np.sqrt(square), sd_m))
    return ErrorFigure(float(np.sqrt(square)), float(u))
