"""What holds of every effect: nothing at size zero, the same from the same seed, variants that differ, wanted sizes."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mock_devices.effects import (
    CATALOGUE,
    GEOMETRY,
    OUTSIDE,
    OUTSIDE_FINAL,
    SPECS,
    EffectChoice,
    EffectError,
    draw,
    parse,
)
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.recordings.effect_size import SizeScale
from mock_devices.recordings.visible_size import VisibleScale
from tests.mock_devices.effects_bench import FILE, STATION_M, bench

NAMED = [
    "link_thermal_growth",
    "column_thermal_growth",
    "screw_thermal_growth",
    "backlash",
    "friction_windup",
    "column_compliance",
    "link_stiffness",
    "joint_clearance",
    "screw_cumulative_error",
    "screw_periodic_error",
    "encoder_interpolation",
    "guide_straightness",
    "guide_angular",
    "foundation_settling",
    "tracker_drift",
    "refraction",
    "smr_reseat",
    "axis_coupling",
    "latency",
    "servo_settling",
    "expansion_coefficient",
    "payload",
    "tables_left_on",
    "drive_scale",
]
EVERY = [(name, variant) for name, spec in SPECS.items() for variant in spec.variants]
PROGRAMME = ((0.0, 0.0), (3600.0, 0.0), (5400.0, 2.0), (7200.0, -1.0))


@lru_cache
def sizes(fly_share=0.0):
    return SizeScale(bench(visits=160, fly_share=fly_share, temperature_programme=PROGRAMME))


def scale_for(name):
    return sizes(0.3 if name == "latency" else 0.0)


def test_the_catalogue_is_complete():
    assert sorted(CATALOGUE) == sorted(NAMED)
    assert sorted(GEOMETRY) == ["joint_spacing", "link_self_weight", "smr_offset"]
    assert len(OUTSIDE) >= 10
    assert len(OUTSIDE_FINAL) >= 4
    assert not set(OUTSIDE) & set(OUTSIDE_FINAL)
    for spec in SPECS.values():
        if spec.kind != "nuisance":
            assert len(set(spec.variants)) >= 3
            assert spec.final in spec.variants
        for p in spec.parameters:
            assert 0.0 <= p.low <= p.typical <= p.high
            assert p.name.rsplit("_", 1)[-1] in {"m", "s", "k", "n", "rad", "kg", "nm", "ratio"}


@pytest.mark.parametrize(("name", "variant"), EVERY)
def test_size_zero_changes_nothing_and_the_typical_size_something(name, variant):
    scale = scale_for(name)
    choice = EffectChoice(name, SPECS[name].size.typical, variant=variant)
    assert np.abs(scale.change_m(replace(choice, size=0.0))).max() < 1e-13
    change = scale.change_m(choice)
    assert (np.abs(change).max() > 1e-8) == (name != "ordinary_friction")  # which loads the drives only
    assert np.array_equal(change, scale.change_m(choice))


@pytest.mark.parametrize("name", [*CATALOGUE, *GEOMETRY, *OUTSIDE, *OUTSIDE_FINAL])
def test_variants_are_not_multiples_of_one_another(name):
    scale = scale_for(name)
    size = 0.5 if name == "latency" else SPECS[name].size.middle
    changes = [scale.change_m(EffectChoice(name, size, variant=v)) for v in SPECS[name].variants]
    for i, one in enumerate(changes):
        for other in changes[:i]:
            cosine = abs(np.sum(one * other)) / np.linalg.norm(one) / np.linalg.norm(other)
            assert cosine < 0.99999 or not np.isclose(np.linalg.norm(one), np.linalg.norm(other), rtol=1e-3)


@pytest.mark.parametrize("wanted", [1.0, 5.0])
@pytest.mark.parametrize(
    "name", ["backlash", "column_compliance", "link_stiffness", "refraction", "screw_thermal_growth"]
)
def test_an_effect_gets_the_raw_size_that_is_wanted(name, wanted):
    scale = scale_for(name)
    choice = scale.scaled(EffectChoice(name, SPECS[name].size.typical), wanted)
    assert scale.raw_size(choice) == pytest.approx(wanted, rel=0.01)


def test_raw_size_is_in_units_of_the_stated_deviation():
    scale = scale_for("smr_offset")
    raw = scale.raw_size(EffectChoice("smr_offset", 1e-5, "P1"))
    distance = np.linalg.norm(scale.bench.points_m([]), axis=1)[scale.bench.timeline.smr < 3].mean()
    one_of_three, two_coordinates = 1.0 / np.sqrt(3.0), 1.0 / np.sqrt(2.0)
    assert raw == pytest.approx(1e-5 / (2.4e-6 * distance) * one_of_three * two_coordinates, rel=0.02)


def test_what_cannot_be_reached_is_said():
    with pytest.raises(EffectError, match="no size gives 3 sigma"):
        scale_for("x").scaled(EffectChoice("latency", 5e-4), 3.0)  # nothing is measured on the fly


def test_geometry_absorbs_offsets_of_reflectors_but_not_a_fine_period():
    visible = VisibleScale(scale_for("x").bench, scale_for("x"))
    absorbed = EffectChoice("smr_offset", 5e-5, "P1")
    fine = EffectChoice("screw_periodic_error", 5e-5, "left", parameters=(("period_m", 0.01),))
    assert visible.visible_size(absorbed) < 0.05 * visible.sizes.raw_size(absorbed)
    assert visible.visible_size(fine) > 0.6 * visible.sizes.raw_size(fine)
    assert visible.visible_size(fine) < visible.sizes.raw_size(fine)


def test_seeds_decide_what_is_drawn():
    site = Site(FILE, STATION_M)
    choice = EffectChoice("guide_straightness", 1e-5, variant="irregular", seed=3)
    curves = [make(c, site, 1).curve(np.linspace(-1, 1, 9)) for c in (choice, choice, replace(choice, seed=4))]
    assert np.array_equal(curves[0], curves[1])
    assert not np.array_equal(curves[0], curves[2])
    rng = np.random.default_rng(2)
    drawn = [draw("backlash", FILE, rng, final=True) for _ in range(20)]
    assert {c.variant for c in drawn} == {"grit_in_thread"}
    assert {c.place for c in drawn} == {"left", "right"}
    assert "grit_in_thread" not in {draw("backlash", FILE, rng, final=False).variant for _ in range(40)}
    onsets = [dict(draw("smr_reseat", FILE, rng, duration_s=2000.0).parameters)["onset_s"] for _ in range(20)]
    assert 300.0 <= min(onsets) < max(onsets) <= 1400.0
    for c in drawn:
        assert 1.0 <= dict(c.parameters)["tau_s"] <= 20.0


def test_a_variant_is_drawn_among_those_that_are_wanted():
    rng, wanted = np.random.default_rng(2), ("index_fixed", "warm_jet", "gas_lens")
    assert {draw("refraction", FILE, rng, among=wanted).variant for _ in range(60)} == set(wanted)
    assert {draw("refraction", FILE, rng, final=False, among=wanted).variant for _ in range(60)} == set(wanted[:2])
    with pytest.raises(EffectError, match="refraction: none of its variants is among plume"):
        draw("refraction", FILE, rng, final=True, among=("plume",))


def test_choices_are_read_from_one_line():
    choice = parse("backlash=2e-5,place=right,variant=closing,tau_s=3,seed=7", FILE)
    assert choice == EffectChoice("backlash", 2e-5, "right", "closing", (("tau_s", 3.0),), 7)
    assert parse("refraction=0", FILE).size == 0.0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("nope=1", "unknown effect 'nope'; docs/reference/mock-effects.md has all"),
        ("backlsh=1", "unknown effect 'backlsh'; is 'backlash' meant"),
        ("backlash", "give its width_m"),
        ("backlash=wide", "not a number"),
        ("backlash=1", "out of range"),
        ("backlash=-1e-5", "out of range"),
        ("refraction=nan", "out of range"),
        ("backlash=1e-5,place=top", "no drive 'top'; known: left, right"),
        ("backlash=1e-5,variant=odd", "no variant 'odd'"),
        ("backlash=1e-5,foo=1", "no parameter 'foo'"),
        ("backlash=1e-5,tau_s=900", "tau_s = 900 is out of range"),
        ("backlash=1e-5,seed=1e400", "not a whole number"),
        ("backlash=1e-5,closing", "not KEY=VALUE"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(text, complaint):
    with pytest.raises(EffectError, match=complaint) as caught:
        parse(text, FILE)
    assert "\n" not in str(caught.value)
