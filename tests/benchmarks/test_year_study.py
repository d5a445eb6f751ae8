"""The study of machine-years: its plant against the model, a short life under the rules, and its table."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from benchmarks.year_study.life import SETTINGS, Life
from benchmarks.year_study.lost_reference import calibrate_offset
from benchmarks.year_study.measures import false_alarms, lost_lines, of, policy_lines, ramp_lines, rate, step_lines
from benchmarks.year_study.plant_machine import PARTS
from benchmarks.year_study.policies import ChartRule, ours, sequential_check
from benchmarks.year_study.special import SIZES
from benchmarks.year_study.tasks import MONTHLY, RIVALS, tasks
from benchmarks.year_study.truths import TOLERANCE_M, Happening, MachineYear, draw_year, slope
from benchmarks.year_study.workshop import Knowledge, workshop
from calibration.intervals.charts import Shewhart
from calibration.intervals.facts import EventFact
from calibration.intervals.rules import judge_all

SEED = 910_777


@pytest.fixture(scope="module")
def shop():
    return workshop()


def quiet_year(shop, *happenings, weeks=12):
    return MachineYear(SEED, happenings, (2.5,), np.zeros((weeks, len(shop.steppable))), 0.0)


@pytest.fixture
def life(shop):
    return Life(shop, quiet_year(shop), 0)


def true_values(shop, plant):
    """The drawn machine in the calibration's terms: deviations from nominal."""
    values, drawn, nominal = {}, plant.drawn, shop.machine.file
    for true, entry in zip(drawn.file.struts, nominal.struts, strict=True):
        values[f"strut_length.{true.name}"] = true.length_m - entry.length_m
        for kind in ("platform_joint", "base_joint"):
            x, y, _ = getattr(entry, f"{kind}_m")
            at = getattr(true, kind)
            values[f"{kind}.{true.name}.x"], values[f"{kind}.{true.name}.y"] = at.real - x, at.imag - y
        values[f"ln_stiffness.{true.name}"] = np.log(true.stiffness_n_per_m / entry.stiffness_n_per_m)
    for slider, scale in zip(drawn.file.sliders, drawn.scales, strict=True):
        values[f"drive_scale.{slider.name}"] = scale - 1.0
        values[f"axis_tilt.{slider.name}.rz"] = cmath.phase(slider.axis / 1j)
    return np.array([values[name] for name in shop.model.parameters.names] + [0.0] * (shop.size - shop.count))


def test_changes_of_the_plant_are_those_of_the_model(shop, life):
    """The same names and signs on both sides, at 20 standard deviations, without any linearisation between them."""
    drives = shop.drives(life.tables, shop.check_xy)
    same, truth = dict.fromkeys(PARTS, 20.0), true_values(shop, life.plant)

    def predicted(values):
        return shop.predict(Knowledge(values, np.eye(1)), drives, shop.check_xy, same).tool_m()[:, :2]

    assert life.plant.tool_m(drives, same) == pytest.approx(predicted(truth), abs=1e-9)
    for name in shop.steppable:
        by = 20.0 * shop.sigma[name]
        life.plant.move(name, by)
        changed = truth.copy()
        changed[shop.model.parameters.names.index(name)] += by
        assert life.plant.tool_m(drives, same) == pytest.approx(predicted(changed), abs=1e-9)
        life.plant.move(name, -by)


def test_a_first_calibration_leaves_little(life):
    assert life.true_error_m() < 8e-6


def test_a_check_of_an_unchanged_machine_is_standard_normal(life):
    life.go_to(3.0)  # the station has been set up anew
    found = []
    for _ in range(300):
        residual, known_m, _ = life.read_check()
        found.append(life.shop.look(4, residual, known_m).standardised)
    assert np.std(found, axis=0) == pytest.approx(1.0, abs=0.3)
    # what is common to all of them comes from the calibration
    reference = life.shop.check_design.reference_u_of(life.known.covariance) / life.shop.check_design.change_u
    assert np.all(np.abs(np.mean(found, axis=0)) < 4.0 * np.sqrt(reference**2 + 1.0 / 300.0))


def test_a_step_is_found_calibrated_and_verified(shop):
    name = "strut_length.left_upper"
    step = Happening(4.5, "step", ((name, 15.0 * shop.sigma[name]),), name)
    life = Life(shop, quiet_year(shop, step), 0)
    for week in range(1, 7):
        life.go_to(float(week))
        before = life.true_error_m()
        ours(life)
        if week < 5:
            assert life.calibrations == 1
        elif week == 5:
            assert before > 15e-6
            assert life.true_error_m() < 0.5 * before
    assert life.calibrations == 2
    assert len(life.activations) == 1
    assert life.scores["false_alarms"] == 0
    assert life.hours == pytest.approx(2.0, abs=0.7)


def test_a_collision_is_an_event_that_every_policy_acts_on(shop):
    hit = Happening(0.5, "collision", (("axis_tilt.left.rz", 1e-5),), "left")
    life = Life(shop, quiet_year(shop, hit), 0)
    life.go_to(1.0)
    sequential_check(life)
    verdict = judge_all(life.history, SETTINGS, life.now_s)
    assert any(r.startswith("event: collision left") for r in verdict.reasons)
    rival = ChartRule(Shewhart(50.0))()
    assert rival(life) == "chart"


def test_a_lost_reference_is_answered_by_ten_visits_with_the_former_calibration_as_the_prior(shop):
    life = Life(shop, quiet_year(shop), 0)
    life.go_to(1.0)
    knowledge = life.known
    life.plant.lost_m[0] += 3.0e-4
    life.history = life.history.with_event(EventFact(life.now_s, "reference lost", "left"))
    life.go_to(2.0)
    assert life.true_error_m() > 1.0e-4
    measurement = judge_all(life.history, SETTINGS, life.now_s).measurement
    assert (measurement.extent, measurement.visits) == ("drive offset", 10)
    done = calibrate_offset(life, measurement)
    assert (done["accepted"], done["poses"]) == (True, 12)
    assert done["after_m"] < 8.0e-6
    moved = life.known.values - knowledge.values
    names = shop.model.parameters.names
    for strut in ("left_upper", "left_lower"):
        assert moved[names.index(f"base_joint.{strut}.y")] == pytest.approx(3.0e-4, abs=2e-5)
        assert abs(moved[names.index(f"base_joint.{strut}.x")]) < 2e-5


def test_wear_alone_reaches_the_tolerance_when_it_says(shop):
    name = "drive_scale.right"
    per_week = slope(shop, name, 0.5)
    per_change = shop.check_design.error_per_change[shop.watched.names.index(name)]
    assert per_week * per_change * 0.5 * 52.18 == pytest.approx(TOLERANCE_M)


def test_years_are_drawn_with_the_stated_rates(shop):
    years = [draw_year(shop, seed) for seed in range(300)]
    kinds = [h.kind for y in years for h in y.happenings]
    for kind, expected in (("step", 0.5), ("ramp", 0.3), ("drive replaced", 0.2), ("collision", 0.1)):
        assert kinds.count(kind) / 300 == pytest.approx(expected, abs=4.0 * np.sqrt(expected / 300))
    assert np.mean([y.eventless for y in years]) == pytest.approx(np.exp(-1.1), abs=0.11)
    sizes = [abs(h.changes[0][1]) / shop.sigma[h.part] for y in years for h in y.happenings if h.kind == "step"]
    assert 1.0 <= min(sizes) < max(sizes) <= 20.0
    moved = np.concatenate([y.walk for y in years[:40]])
    rows = [shop.watched.names.index(n) for n in shop.steppable]
    statistic = moved @ (shop.check_design.correlation[:, rows] / shop.check_design.change_u[rows]).T
    assert np.sqrt(np.mean(statistic**2)) == pytest.approx(0.2, rel=0.1)


def test_a_stopped_study_has_some_of_all():
    queue = tasks(1000, 200, 200, 400, 400, 200)
    assert len(queue) == len(set(queue)) == 1000 + 200 * (len(RIVALS) + 2) + 1000
    assert {kind for kind, _ in queue[:600]} >= {"ours", "step", "ramp", "lost", *RIVALS}
    assert tasks(20, 20, 20, 0, 10, 0).count(("ours", 19)) == 1


def ramp(number, left, due, **dates):
    dates = {"early": due - 3.0, "late": due + 3.0, "act_by": due - 4.0} | dates
    return {"kind": "ramp", "number": number, "life_weeks": 40.0, "predicted": 30, "left": left, "due": due, **dates}


def test_the_table_counts_what_it_says():
    rows = [ramp(0, 50.0, 52.0), ramp(1, 50.0, 60.0), ramp(2, 45.0, 50.0), {"kind": "ramp", "number": 3, "left": 20.0}]
    near, covers, late = ramp_lines(rows)
    assert (near.figure, near.number, near.ok) == ("66.7 %", 3, False)
    assert covers.figure == "33.3 %"
    assert (late.figure, late.ok) == ("66.7 %", False)
    found = [{"found": [False] + [size >= 5.0 for size in SIZES]}] * 19 + [{"found": [False] * 10}]
    at, three = step_lines(found)
    assert (at.figure, at.ok, three.figure) == ("95.0 %", True, "0.0 %")
    years = [{"quiet_weeks": 26, "false_alarms": 1}, {"quiet_weeks": 52, "false_alarms": 0}]
    assert false_alarms(years, "x").figure == "0.67"
    assert rate(0, 2.0)[2] == pytest.approx(1.844, abs=1e-3)  # the rule of three, exactly


def test_lost_references_are_counted_over_all_machines():
    def row(number, **more):
        return {"kind": "lost", "number": number} | more

    kept = {"accepted": True, "after_m": 4e-6, "poses": 12, "hours": 0.25}
    refused = {"accepted": False, "after_m": 9e-6, "poses": 30, "hours": 0.5}
    rows = [row(0, **kept), row(1, **kept), row(2, **refused), row(3)]
    stay, left, poses, hours = lost_lines(rows)
    assert (stay.figure, stay.number) == ("50.0 %", 4)
    assert (left.figure, left.number) == ("4.0", 2)
    assert (poses.figure, hours.figure) == ("12", "0.25")
    assert lost_lines([]) == []


def test_policies_are_compared_on_the_same_years():
    def year(kind, number, hours):
        return {
            "kind": kind, "number": number, "hours": hours, "out_weeks": 0.0, "quiet_weeks": 52, "false_alarms": 0,
            "calibrations": 1, "activations": [], "poses": [],
        }  # fmt: skip

    rows = [year("ours", 0, 5.0), year("ours", 1, 100.0), year(MONTHLY, 0, 24.0), year(MONTHLY, 0, 24.0)]
    assert len(of(rows, MONTHLY)) == 1
    lines = policy_lines(rows)
    assert lines[1].split()[:3] == ["ours", "1", "5.00"]
