"""The study's table: each measure with its goal, its figure and an interval."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from benchmarks.withheld.statistics import wilson
from benchmarks.year_study.special import LEAST_CHECKS, SIZES
from benchmarks.year_study.tasks import MONTHLY, OTHER_RATES, RIVALS
from benchmarks.year_study.truths import WEEKS
from benchmarks.year_study.workshop import READING_S

Row = dict[str, Any]
AT = 5.5


@dataclass(frozen=True)
class Line:
    """One line of the table; ok: None if it has no goal or nothing was measured."""

    measure: str
    goal: str
    figure: str
    interval: str
    number: int
    ok: bool | None

    def __str__(self) -> str:
        mark = {True: "ok", False: "short", None: ""}[self.ok]
        return f"{self.measure:62s} {self.goal:>14s} {self.figure:>8s}   {self.interval:20s} {self.number:5d}  {mark}"


def of(rows: Iterable[Row], kind: str) -> list[Row]:
    """The rows of one kind, each number once."""
    return list({row["number"]: row for row in rows if row["kind"] == kind}.values())


def rate(count: float, years: float) -> tuple[float, float, float]:
    """Events a year with the exact 95 % interval of a Poisson rate."""
    low = 0.5 * chi2.ppf(0.025, 2 * count) if count else 0.0
    return count / years, float(low) / years, float(0.5 * chi2.ppf(0.975, 2 * count + 2)) / years


def _share(measure: str, goal: str, hits: int, trials: int, ok: bool | None) -> Line:
    if not trials:
        return Line(measure, goal, "-", "", 0, None)
    low, high = wilson(hits, trials)
    return Line(measure, goal, _percent(hits / trials), f"{_percent(low)} to {_percent(high)}", trials, ok)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def false_alarms(rows: Sequence[Row], name: str, goal: float | None = 1.0) -> Line:
    """False alarms in the weeks without an event since the last full calibration, as a rate a year."""
    years = sum(r["quiet_weeks"] for r in rows) / WEEKS
    if not years:
        return Line(f"false alarms a quiet year, {name}", "", "-", "", 0, None)
    now, low, high = rate(sum(r["false_alarms"] for r in rows), years)
    goal_text = "" if goal is None else f"at most {goal:g}"
    ok = None if goal is None else now <= goal
    return Line(
        f"false alarms a quiet year, {name}", goal_text, f"{now:.2f}", f"{low:.2f} to {high:.2f}", len(rows), ok
    )


def power(rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Sizes in sigma and share found at the next check; the first is without any step."""
    found = np.array([r["found"] for r in rows], dtype=np.float64).reshape(-1, len(SIZES) + 1)
    return np.array([0.0, *SIZES]), found.mean(axis=0) if len(found) else np.full(len(SIZES) + 1, np.nan)


def step_lines(rows: Sequence[Row]) -> list[Line]:
    """Power at the goal's size, and at 3 sigma."""
    out = []
    for size, goal in ((AT, "at least 95 %"), (3.0, "")):
        hits = sum(r["found"][1 + SIZES.index(size)] for r in rows)
        ok = hits >= 0.95 * len(rows) if goal and rows else None
        out.append(
            _share(f"step of {size:g} sigma in one parameter found at the next check", goal, hits, len(rows), ok)
        )
    return out


def ramp_lines(rows: Sequence[Row]) -> list[Line]:
    """Due dates at half the tolerance, of machines that had not left it by then."""
    used = [r for r in rows if "predicted" in r and r.get("left", np.inf) > r["predicted"] and "left" in r]
    near = sum(r["due"] is not None and abs(r["due"] - r["left"]) <= 0.2 * r["life_weeks"] for r in used)
    inside = sum(
        (r["early"] is not None and r["early"] <= r["left"]) and (r["late"] is None or r["left"] <= r["late"] + 1.0)
        for r in used
    )
    late = sum(r["act_by"] is not None and r["left"] < r["act_by"] for r in used)
    n = len(used)
    cover = inside / n if n else 0.0
    return [
        _share(f"due date within 20 % of the life, {LEAST_CHECKS} checks or more", "at least 75 %", near, n,
               near >= 0.75 * n if n else None),
        _share("interval of the due date covers", "90 to 98 %", inside, n, 0.90 <= cover <= 0.98 if n else None),
        _share('tolerance left before the "act by" date', "at most 3 %", late, n, late <= 0.03 * n if n else None),
    ]  # fmt: skip


def lost_lines(rows: Sequence[Row]) -> list[Line]:
    """Lost references of one drive: whether its offset alone was measured, what was left of the error, for how long."""
    if not rows:
        return []
    partly = [r for r in rows if "accepted" in r]
    kept = [r for r in partly if r["accepted"]]
    out = [_share("a lost reference answered by 10 visits whose tables stay", "", len(kept), len(rows), None)]
    for measure, values, least in (
        ("error left then / um, median and 90 % of machines", [1e6 * r["after_m"] for r in kept], 1),
        ("verification of these / poses, median and 90 %", [r["poses"] for r in partly], 0),
        ("hours of these, median and 90 %", [r["hours"] for r in partly], 2),
    ):
        if values:
            middle, most = np.quantile(np.array(values), [0.5, 0.9])
            out.append(Line(measure, "", f"{middle:.{least}f}", f"{most:.{least}f}", len(values), None))
    return out


def activation_line(made: Sequence[Row]) -> Line:
    """Activations whose noise-free error exceeds the former tables' by more than two standard uncertainties."""
    worse = sum(a["after_m"] > a["before_m"] + 2.0 * a["u_m"] for a in made)
    ok = worse <= 0.002 * len(made) if made else None
    return _share("activations worse than the former tables by 2 u", "at most 0.2 %", worse, len(made), ok)


def hours_line(ours: Sequence[Row], monthly: Sequence[Row]) -> Line:
    """Hours against the monthly calendar on the same years, with a bootstrap interval."""
    theirs = {r["number"]: r for r in monthly}
    both = [(r["hours"], theirs[r["number"]]["hours"]) for r in ours if r["number"] in theirs]
    if not both:
        return Line("hours against a monthly calendar", "at most 50 %", "-", "", 0, None)
    pairs = np.array(both)
    draw = np.random.default_rng(1).integers(0, len(pairs), (2000, len(pairs)))
    ratios = pairs[draw, 0].sum(axis=1) / pairs[draw, 1].sum(axis=1)
    ratio = float(pairs[:, 0].sum() / pairs[:, 1].sum())
    low, high = np.quantile(ratios, [0.025, 0.975])
    interval = f"{_percent(float(low))} to {_percent(float(high))}"
    return Line("hours against a monthly calendar", "at most 50 %", _percent(ratio), interval, len(pairs), ratio <= 0.5)


def tolerance_line(ours: Sequence[Row], monthly: Sequence[Row]) -> Line:
    """Time out of tolerance less that under the monthly calendar on the same years, with a bootstrap interval."""
    theirs = {r["number"]: r["out_weeks"] for r in monthly}
    more = np.array([r["out_weeks"] - theirs[r["number"]] for r in ours if r["number"] in theirs]) / WEEKS
    measure = "time out of tolerance less the monthly calendar's"
    if not len(more):
        return Line(measure, "", "-", "", 0, None)
    draw = np.random.default_rng(1).integers(0, len(more), (2000, len(more)))
    low, high = np.quantile(more[draw].mean(axis=1), [0.025, 0.975])
    figures = [f"{100.0 * share:+.2f} %" for share in (float(more.mean()), float(low), float(high))]
    return Line(measure, "", figures[0], f"{figures[1]} to {figures[2]}", len(more), None)


def check_line(rows: Sequence[Row]) -> Line:
    """Minutes of rig time of a check: the median."""
    poses = [p for r in rows for p in r["poses"]]
    if not poses:
        return Line("minutes of a check, median", "at most 4", "-", "", 0, None)
    minutes = (5.0 * np.array(poses) + 4.0) * READING_S / 60.0
    middle = float(np.median(minutes))
    interval = f"most {minutes.max():.1f}"
    return Line("minutes of a check, median", "at most 4", f"{middle:.1f}", interval, len(poses), middle <= 4.0)


def policy_lines(rows: Sequence[Row]) -> list[str]:
    """Every policy on the same years, and ours at other rates: hours, out of tolerance, false alarms, calibrations."""
    out = [f"{'on the same years':20s} {'years':>5s} {'hours':>7s} {'out of tolerance':>17s} {'false alarms':>13s} "
           f"{'calibrations':>13s}"]  # fmt: skip
    least = min((len(of(rows, k)) for k in RIVALS if of(rows, k)), default=0)
    shared = {r["number"] for r in of(rows, "ours")}
    for kind in RIVALS:
        shared &= {r["number"] for r in of(rows, kind)} if of(rows, kind) else shared
    for kind in ("ours", *RIVALS):
        some = [r for r in of(rows, kind) if r["number"] in shared]
        if some and least:
            out.append(_policy_line(kind, some))
    return out + [_policy_line(f"ours, {kind}", of(rows, kind)) for kind in OTHER_RATES if of(rows, kind)]


def _policy_line(name: str, some: Sequence[Row]) -> str:
    n, quiet = len(some), sum(r["quiet_weeks"] for r in some) / WEEKS
    return (
        f"{name:20s} {n:5d} {sum(r['hours'] for r in some) / n:7.2f} "
        f"{100.0 * sum(r['out_weeks'] for r in some) / (WEEKS * n):15.2f} % "
        f"{sum(r['false_alarms'] for r in some) / max(quiet, 1e-9):13.2f} "
        f"{sum(r['calibrations'] for r in some) / n:13.2f}"
    )


def table(rows: Sequence[Row]) -> tuple[list[Line], list[str]]:
    """The measures with goals, and the comparison of policies."""
    ours = of(rows, "ours")
    lines = [
        false_alarms(ours, "all rules together"),
        *step_lines(of(rows, "step")),
        *ramp_lines(of(rows, "ramp")),
        activation_line(_activations(rows)),
        hours_line(ours, of(rows, MONTHLY)),
        tolerance_line(ours, of(rows, MONTHLY)),
        check_line(ours),
        *(false_alarms(of(rows, k), k, None) for k in OTHER_RATES if of(rows, k)),
        *lost_lines(of(rows, "lost")),
    ]
    return lines, policy_lines(rows)


def _activations(rows: Sequence[Row]) -> list[Row]:
    """All exchanges of tables under the project's own rules, full and partial."""
    full = [a for k in ("ours", *OTHER_RATES) for r in of(rows, k) for a in r["activations"]]
    return [*full, *(r for r in of(rows, "lost") if r.get("accepted"))]
