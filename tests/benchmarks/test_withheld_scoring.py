"""How withheld cases are scored: statistics against independent computations, rows against counting by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.withheld.coordinates import KINDS, first_kind, true_kinds
from benchmarks.withheld.methods import baseline_table
from benchmarks.withheld.report import printed, summary
from benchmarks.withheld.score_rows import in_class, overall_right
from benchmarks.withheld.scorer import score_case
from benchmarks.withheld.statistics import (
    calibration_error,
    excess_calibration_error,
    paired_difference,
    wilson,
)
from benchmarks.withheld.table import measures
from calibration.diagnosis.result import KINDS as KINDS_OF_SHARES
from mock_devices.effects import CATALOGUE, SPECS


@pytest.mark.parametrize(("hits", "trials"), [(0, 20), (3, 7), (95, 100), (40, 40), (996, 1000)])
def test_wilson_is_scipys(hits, trials):
    expected = binomtest(hits, trials).proportion_ci(0.95, method="wilson")
    assert wilson(hits, trials) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_calibration_error_by_hand():
    stated = np.array([0.95, 0.95, 0.91, 0.15, 1.0])
    right = np.array([1.0, 0.0, 1.0, 1.0, 1.0])
    in_last = abs(3.0 / 4.0 - np.mean([0.95, 0.95, 0.91, 1.0]))
    assert calibration_error(stated, right) == pytest.approx(0.8 * in_last + 0.2 * 0.85)


def test_a_calibrated_classifier_has_no_excess_and_an_overconfident_one_has():
    rng = np.random.default_rng(2)
    stated = rng.uniform(0.3, 1.0, 1500)
    excess, low, high = excess_calibration_error(stated, (rng.random(1500) < stated).astype(float))
    assert abs(excess) < 0.015
    assert low < excess < high
    excess, low, _ = excess_calibration_error(stated, (rng.random(1500) < stated - 0.1).astype(float))
    assert excess == pytest.approx(0.08, abs=0.025)
    assert low > 0.03


def test_paired_difference_is_that_of_differences():
    rng = np.random.default_rng(1)
    a, b = rng.random(200) < 0.7, rng.random(200) < 0.5
    found, low, high = paired_difference(a.tolist(), b.tolist())
    d = a.astype(float) - b.astype(float)
    assert found == pytest.approx(d.mean())
    assert (high - low) / 2.0 == pytest.approx(1.96 * d.std() / math.sqrt(200), rel=1e-4)


def row(kind, true, verdict, **more):
    base = {
        "key": f"{kind}-{true}-{verdict}", "kind": kind, "true": [true] if true else [], "variant": ["x"], "raw": 3.0,
        "final": False, "visible": 2.0, "eligible": bool(true), "wanted_raw": [3.0], "profile": "small", "p": 0.9,
        "verdict": verdict, "equivalent": [], "named": [verdict], "ranked": [[verdict, 0.9]], "mimics_sigma": {},
        "seconds": 0.5, "clock_seconds": 0.6, "baselines": {"form_free": "none"}, "error": "", "first_kind": "time",
        "shrink": 0.5, "shrink_interval": [0.4, 0.6], "achieved": 0.53, "places": [["left"]],
    }  # fmt: skip
    return {**base, **more}


def by_name(rows):
    return {m.name: m for m in measures(rows)}


def test_rows_are_counted_as_the_goals_say():
    pair = {**row("pair", "backlash", "backlash"), "true": ["backlash", "latency"]}
    rows = [
        row("effect", "backlash", "backlash", true_kinds=["direction"], place_right=True, step_error_s=-200.0),
        row("effect", "latency", "backlash", true_kinds=["time"], ranked=[["a", 0.5], ["b", 0.3], ["latency", 0.2]]),
        row("effect", "latency", "latency", eligible=False, visible=0.2, raw=1.0),
        row("null", "", "none"), row("null", "", "unknown"), row("null", "", "backlash"),
        row("outside", "cable_drag", "unknown"), row("outside", "cable_drag", "backlash"),
        row("outside", "cable_drag", "backlash", mimics_sigma={"backlash": 0.3, "latency": 0.1}),
        row("removed", "backlash", "friction_windup", mimics_sigma={"friction_windup": 0.4}),
        row("removed", "backlash", "latency", mimics_sigma={"friction_windup": 0.4}),
        row("platform_only", "backlash", "latency", equivalent=["backlash"], mimics_sigma={"latency": 0.2}),
        row("platform_only", "backlash", "backlash", equivalent=["latency"], mimics_sigma={"latency": 0.4}),
        {**pair, "named": ["latency", "backlash"]},
        {**pair, "named": ["backlash", "refraction"]},
        row("next", "backlash", "none", after_chosen=True, after_random=False),
    ]  # fmt: skip
    of_air = [
        row("effect", "refraction", verdict, variant=[variant])
        for verdict, variant in (("refraction", "index_fixed"), ("none", "index_late"), ("none", "plume"))
    ]
    assert (by_name(of_air)["index of air: named right"].value, by_name(of_air)["index of air: named right"].n) == (
        0.5,
        2,
    )
    measures = by_name(rows)
    for name, value, n in (
        ("visible single effects named right", 0.5, 2),
        ("  truth among the first three", 1.0, 2),
        ("null cases called an effect, declared right", 1.0 / 3.0, 3),
        ("  null cases called unknown", 1.0 / 3.0, 3),
        ("effect of no catalogue called unknown, or its mimic", 2.0 / 3.0, 3),
        ("  unknown itself", 1.0 / 3.0, 3),
        ("true class removed: unknown, or its mimic", 0.5, 2),
        ("platform only: class right and its members equivalent", 0.5, 2),
        ("platform only: mean class size", 2.0, 2),
        ("two effects: exact pair", 0.5, 2),
        ("two effects: at least one", 1.0, 2),
        ("predicted minus achieved shrink within 0.05, where named", 1.0, 2),
        ("95 % shrink interval covers, where named", 1.0, 2),
        ("true coordinate first by share", 0.5, 2),
        ("step time within 5 min", 1.0, 1),
        ("further poses: chosen better by", 1.0, 1),
    ):
        assert measures[name].value == pytest.approx(value), name
        assert measures[name].n == n, name
    assert measures["visible single effects named right"].ok is False
    assert [overall_right(r) for r in rows[3:6]] == [True, False, False]
    assert in_class(rows[11])
    methods = {line["method"]: line for line in baseline_table(rows)}
    assert methods["form_free"]["null"]["value"] == 1.0
    assert methods["diagnosis"]["effect"]["value"] == 0.5


def test_an_effect_at_several_places_is_right_by_name_and_by_its_places():
    def scored(*named):
        case = {
            "key": "x", "kind": "effect", "raw": 5.0, "visible": 4.0, "eligible": True, "wanted_raw": [5.0],
            "profile": "small", "design": "rich0", "effects": [{
                "effect": "backlash", "variant": "play", "final": False, "place": "", "places": ["left", "right"],
                "raw": 5.0, "visible": 4.0, "plausible": True, "size": 1e-5, "size_name": "width_m",
            }],
        }  # fmt: skip
        size, sigma = {"name": "width_m", "value": 1e-5, "u": 1e-6}, {"raw_sigma": 3.0}
        effects = [
            {"effect": "backlash", "place": place, "place_probability": 1.0, "size": size, "others": [], **sigma}
            for place in named
        ]  # fmt: skip
        diagnosis = {
            "ranking": {"backlash": 0.9}, "effects": effects, "verdict": "backlash", "equivalent": [],
            "not_tested": [], "hidden_m": 0.0, "gap": {"shrink": 0.5, "shrink_interval": [0.4, 0.6]}, "where": [],
        }  # fmt: skip
        answer = {"diagnosis": diagnosis, "without": [], "seconds": 1.0, "clock_seconds": 1.0}
        return {**score_case(case, answer), "mimics_sigma": {}}

    rows = [scored("left", "right"), scored("left"), scored("right", "gantry")]
    assert "size_error_u" not in rows[0]  # the truth states that of one place
    assert rows[0]["raw_named"] == pytest.approx(math.hypot(3.0, 3.0))
    one = row("effect", "latency", "backlash", place_right=False)
    found = by_name([*rows, one])
    for name, value, n in (
        ("named right: several places", 1.0, 3),
        ("named right: one place", 0.0, 1),
        ("named place is one of several", 2.0 / 3.0, 3),
        ("all of several places named", 1.0 / 3.0, 3),
        ("place right, where the effect is named", 0.0, 1),
        ("visible single effects named right", 0.75, 4),
    ):
        assert (found[name].value, found[name].n) == (pytest.approx(value), n), name


def test_a_run_without_cases_of_a_kind_and_one_that_failed_are_scored():
    assert by_name([])["visible single effects named right"].value is None
    failed = row("effect", "backlash", "", ranked=[], named=[], error="InputError: x", p=0.0)
    del failed["shrink"], failed["shrink_interval"], failed["achieved"]
    measures = by_name([failed])
    assert measures["diagnoses that failed"].value == 1.0
    assert measures["  within 0.05, any verdict"].value == 0.0


def test_every_effect_has_a_true_coordinate():
    for name in CATALOGUE:
        for variant in SPECS[name].variants:
            assert set(true_kinds(name, variant)) <= set(KINDS)
            assert true_kinds(name, variant)
    assert set(KINDS) < set(KINDS_OF_SHARES)
    shares = [{"kind": "smr", "share": 0.9}, {"kind": "load", "share": 0.2}, {"kind": "time", "share": 0.5}]
    assert first_kind(shares) == "time"
    assert first_kind(shares[:1]) == ""


# --- what could be taken for what


def test_null_cases_count_by_what_they_declare():
    rows = [
        row("null", "", "none"), row("null", "", "unknown", declared="not"), row("null", "", "latency", declared="not"),
        row("null", "", "latency", declared="too small", gross=True), row("null", "", "none", gross=True),
        row("misdeclared", "latency", "latency", declared="too large"),
        row("misdeclared", "latency", "none", declared="too large"),
    ]  # fmt: skip
    found = {name: (m.value, m.n) for name, m in by_name(rows).items()}
    assert found["null cases called an effect, declared right"] == (0.0, 2)
    assert found["null cases called an effect, declared not"] == (0.5, 2)
    assert found["null cases called an effect, declared too small"] == (1.0, 1)
    assert found["null cases called an effect, declared too large"] == (None, 0)
    assert found["disturbances declared too large: named right"] == (0.5, 2)
    assert found["gross readings: null cases called an effect"] == (0.0, 1)
    assert found["calibration error beyond chance"][1] == 2


def test_with_the_whole_catalogue_the_second_answer_counts():
    again = {"verdict": "backlash", "equivalent": [], "named": ["backlash"], "ranked": [["backlash", 0.9]], "p": 0.9}
    rows = [
        row("effect", "backlash", "unknown", left_out={"backlash/closing_at_rest": 0.99}, decoys=["x/y"], whole=again),
        row("effect", "latency", "latency", left_out={}, decoys=["x/y"]),
        row("null", "", "none", left_out={}, decoys=["x/y"]),
        {**row("pair", "backlash", "latency"), "true": ["backlash", "latency"], "left_out": {"latency/by_speed": 1.0}},
    ]
    data = summary(rows)
    first = "visible single effects named right"
    assert [next(m["value"] for m in data[of] if m["name"] == first) for of in ("measures", "whole_catalogue")] == [
        0.5, 1.0,
    ]  # fmt: skip
    of_effect = {entry["effect"]: entry for entry in data["left_out"]}
    assert of_effect["backlash"] == {
        "effect": "backlash", "cases": 2, "nothing": 1, "forms_a_case": 0.5, "forms": {"closing_at_rest": 1},
    }  # fmt: skip
    text = printed(data).splitlines()
    assert text[0].startswith("leave-form-out")
    assert text.index("with the whole catalogue") > 5
    assert printed(summary([row("effect", "latency", "latency")])).startswith("measure")
