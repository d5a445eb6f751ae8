"""Machines of which one drive loses its reference: its offset is measured from ten visits, and verified in steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.year_study.life import POINT_SD_M, SETTINGS, Life, drift_sd, error_figure
from benchmarks.year_study.policies import sequential_check
from benchmarks.year_study.truths import draw_year, log_uniform
from benchmarks.year_study.workshop import LOOKS, READING_S, Knowledge, Tables, Workshop, read_all
from calibration.intervals.check_design import CheckReadings
from calibration.intervals.envelope import Verification, VerificationPlan, judge, verify_further
from calibration.intervals.extent import DRIVE_OFFSET_VISITS, Measurement
from calibration.intervals.facts import ErrorFigure, EventFact
from calibration.intervals.partial import grown_covariance, released_covariance
from calibration.intervals.rules import judge_all

LOST_M = (2.0e-5, 1.0e-3)  # by which the drive stands elsewhere then, log-uniform
FREE_M = 1.0e-3  # of the tool: what is allowed for
QUIET_WEEKS = (10, 40)
PLAN = VerificationPlan()


def run_lost(shop: Workshop, seed: int) -> dict[str, Any]:
    """One machine, watched for some quiet weeks; then a reference is lost, and what the rules ask for is done."""
    rng = np.random.default_rng([19, seed])
    drive, sign = int(rng.integers(len(shop.machine.drive_names))), float(rng.choice([-1.0, 1.0]))
    lost_m, quiet = log_uniform(rng, *LOST_M), int(rng.integers(*QUIET_WEEKS))
    life = Life(shop, replace(draw_year(shop, seed, 0.0), happenings=()), 0)
    for week in range(1, quiet + 1):
        life.go_to(float(week))
        sequential_check(life)
    life.go_to(quiet + 0.5)
    former_m = life.true_error_m()
    life.plant.lost_m[drive] += sign * lost_m
    life.history = life.history.with_event(EventFact(life.now_s, "reference lost", shop.machine.drive_names[drive]))
    life.go_to(quiet + 1.0)
    measurement = judge_all(life.history, SETTINGS, life.now_s).measurement
    assert measurement is not None
    row = {"seed": seed, "lost_m": lost_m, "quiet": quiet, "extent": measurement.extent, "former_m": former_m}
    return row | (calibrate_offset(life, measurement) if measurement.extent == "drive offset" else {})


def calibrate_offset(life: Life, measurement: Measurement) -> dict[str, Any]:
    """Measure what is asked for, with the former calibration as the prior, and verify it; what that was worth."""
    shop, former = life.shop, life.history.last_calibration
    assert former is not None
    walked, freed = _priors(life, measurement, life.now_s - former.t_utc_s)
    known, parts_c = _measured(life, Knowledge(life.known.values, freed))
    new = Tables(known, parts_c)
    poses, accepted, result, found, left = _verified(life, new)
    expected = np.hypot(drift_sd(life, former), np.sqrt(np.diag(freed - walked))[: shop.count])
    before_m, life.known = life.true_error_m(), known
    fact = life.fact("drive offset", parts_c, found, left)
    moved_m = float(np.abs(shop.drives(new, shop.workspace_xy) - shop.drives(life.tables, shop.workspace_xy)).max())
    return {
        "accepted": accepted,
        "alone": judge(SETTINGS.envelope, former, fact, expected, moved_m, found).allowed,
        "poses": poses,
        "hours": (len(shop.moving) * (DRIVE_OFFSET_VISITS + 2 * poses) + 4) * READING_S / 3600.0,
        "before_m": before_m,
        "after_m": life.true_error_m(new),
        "u_m": result.u_m,
    }


def _priors(life: Life, measurement: Measurement, age_s: float) -> tuple[np.ndarray, np.ndarray]:
    """The former calibration's covariance (p, p) as it has grown, and with what is measured let loose."""
    design = life.shop.check_design
    walked = grown_covariance(life.known.covariance, design.watched, design.change_u, age_s, SETTINGS.drift)
    return walked, released_covariance(walked, design.watched, design.error_per_change, measurement, FREE_M)


def _measured(life: Life, prior: Knowledge) -> tuple[Knowledge, dict[str, float]]:
    """A calibration from the first ten poses of the check."""
    shop, look = life.shop, LOOKS.index(DRIVE_OFFSET_VISITS)
    xy, of_check = shop.check_xy[:DRIVE_OFFSET_VISITS], shop.check_readings
    rows = of_check.visit < DRIVE_OFFSET_VISITS
    readings = CheckReadings(of_check.visit[rows], of_check.smr[rows], of_check.place_m[rows], of_check.whiten[rows])
    true_c, read_c = life.plant.parts_c(life.year.mean_c(life.week), life.rng)
    drives = shop.drives(life.tables, xy)
    read_m = read_all(life.plant, readings, drives, true_c, 1.0, life.rng)
    return shop.fit(life.plant, shop.looks[look], readings, xy, drives, read_m, prior, read_c), read_c


def _verified(life: Life, new: Tables) -> tuple[int, bool, Verification, ErrorFigure, ErrorFigure]:
    """Fresh poses, more of them until it is decided: how many, whether the new tables stay, errors before and after."""
    xy = life.rng.uniform(-1.0, 1.0, (PLAN.looks[-1], 2)) * np.array([0.35, 0.30])
    noise = POINT_SD_M * life.rng.standard_normal((2, len(xy), 2))
    before, after = (life.true_errors_m(t, xy) + n for t, n in zip((life.tables, new), noise, strict=True))
    for poses in PLAN.looks:
        answer, result = verify_further(before[:poses], after[:poses], POINT_SD_M, PLAN)
        if answer != "go on":
            break
    found, left = (error_figure(errors[:poses], POINT_SD_M) for errors in (before, after))
    return poses, answer == "accepted", result, found, left
