"""Fifth former final forms of structure, parts' temperatures and stated values: equations solved here step by step."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from mock_devices.recordings.design import nominal_drives
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, drawn

ALPHA = 11.5e-6
LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def test_coolant_takes_more_heat_away_once_its_flow_is_turbulent():
    tau = 700.0
    one = Alone("link_thermal_growth", 2.0, variant="turbulent_coolant", tau_s=tau, place="right_lower")
    critical = drawn("link_thermal_growth", "turbulent_coolant", "critical_m_per_s", low=0.15, high=0.35)
    one.t_s = 500.0
    for speed, rest_s in ((0.99 * critical, 300.0), (1.01 * critical, 200.0), (0.5, 100.0), (0.05, 400.0)):
        one.move(1, HOME_M + 0.4 * speed, speed=speed, rest_s=rest_s)
        one.move(0, HOME_M + 0.1 * speed, speed=0.5, rest_s=0.0)  # another strut's
    legs = one.history.legs(1)
    warm, step, now_s = 0.0, 0.02, 0.0
    for leg in legs:
        until_s = min(leg.until_s, one.t_s)
        over = leg.speed_m_per_s / critical
        takes = 1.0 + 4.0 * over**0.8 if over > 1.0 else 1.0
        while now_s < until_s:
            warm, now_s = warm + step / tau * (1.0 - takes * warm), now_s + step
        d = one.deviation(t_s=until_s - 1e-6)
        assert d.length_m[0, 3] == pytest.approx(ALPHA * 2.0 * 1.5 * warm, rel=2e-3)
        assert not np.any(d.length_m[0, :3])
    assert 0.1 < warm < 0.9


def test_a_draught_rises_from_a_hatch_while_the_carriage_stands_above_it():
    tau = 800.0
    hatch_m = drawn("column_thermal_growth", "draughty_hatch", "hatch_m", low=MIDDLE_M - 0.7 * HALF_M, high=MIDDLE_M)
    one = Alone("column_thermal_growth", 2.0, variant="draughty_hatch", tau_s=tau)
    one.t_s = 50.0
    places = ((hatch_m - 0.01, 100.0), (hatch_m + 0.01, 300.0), (HIGH_M, 200.0), (LOW_M, 150.0), (1.3, 60.0))
    warm, step, open_now = 0.0, 0.02, False
    for to_m, rest_s in ((HOME_M, 50.0), *places):
        if to_m != HOME_M:
            one.move(0, to_m, speed=1e4, rest_s=rest_s)  # at once
            one.move(1, 2.2 - to_m, speed=1e4, rest_s=0.0)  # the other one's
        open_now = to_m > hatch_m
        for _ in range(round(rest_s / step)):
            warm += step / tau * (float(open_now) - warm)
        d = one.deviation()
        heights = np.linspace(0.0, max(to_m - hatch_m, 0.0), 2001)
        plume = ((heights + 1.2) / 1.2) ** (-5.0 / 3.0)
        expected = ALPHA * 2.0 * warm * float(np.sum(0.5 * (plume[1:] + plume[:-1]) * np.diff(heights)))
        assert d.travel_m[0] == pytest.approx([expected, 0.0], rel=2e-3, abs=1e-12)
        assert not np.any(d.sideways_m)
    assert expected > 1e-7


def test_a_bolted_joint_opens_beyond_a_payload():
    opens_kg = drawn("column_compliance", "opening_joint", "opens_kg", low=60.0, high=180.0)
    one = Alone("column_compliance", 1e-8, variant="opening_joint", place="right")
    for payload_kg, share in ((0.0, 0.15), (opens_kg, 0.15), (opens_kg + 125.0, 0.575), (opens_kg + 250.0, 1.0)):
        soft = one.deviation(payload_kg=payload_kg).carriage_compliance[0]
        assert soft[1, 1] == pytest.approx(1e-8 * share)
        assert not np.any(soft[0])
        assert not np.any(soft[1, [0, 2]])


def angle_of_strut(number, q, tool):
    """Direction of a strut's way to the platform, which does not turn."""
    strut = FILE.struts[number]
    return tool - FILE.tool_point + strut.platform_joint - strut.base_joint - 1j * q[strut.drive]


def test_needles_come_under_the_force_one_by_one():
    needles = drawn("link_stiffness", "needles_in_turn", "needles", low=40, high=70)
    one = Alone("link_stiffness", 0.7, variant="needles_in_turn", place="left_lower")
    low_m = MIDDLE_M - math.sqrt(1.5**2 - 1.0)  # height of the platform, both drives in the middle
    straight = angle_of_strut(1, (MIDDLE_M, MIDDLE_M), 1j * low_m)
    seen = []
    for tool in [complex(x, y) for x in np.linspace(-0.3, 0.3, 9) for y in (-0.2, 0.2)]:
        q = nominal_drives(FILE, tool)
        swing = cmath.phase(angle_of_strut(1, q, tool) / straight)
        passed = needles * 0.5 * swing / (2.0 * math.pi) + one.effect.phase / (2.0 * math.pi)  # by a cage
        soft = math.sin(math.pi * passed) ** 2
        ln = one.deviation(q=[q]).ln_stiffness[0]
        assert np.expm1(-ln[1]) == pytest.approx(math.expm1(0.7) * soft, abs=1e-9)
        assert not np.any(np.delete(ln, 1))
        seen.append(soft)
    assert min(seen) < 0.2
    assert max(seen) > 0.8


def test_play_comes_and_goes_as_an_oval_bush_creeps_round():
    bush_m = drawn("joint_clearance", "turning_bush", "bush_m", low=30.0, high=60.0)
    one = Alone("joint_clearance", 2e-5, variant="turning_bush", place="left_lower")
    way_m, shares = 0.0, []
    for k in range(120):
        to_m = HOME_M + 0.3 * (1 - 2 * (k % 2))
        way_m += abs(to_m - one.q[0])
        one.move(0, to_m)
        one.move(1, 2.2 - to_m, rest_s=0.0)  # another strut's
        share = math.cos(2.0 * math.pi * way_m / bush_m + 0.5 * one.effect.phase) ** 2
        (law,) = one.deviation().laws[1]
        forces = [float(law(np.array([e]), np.array([1e8]))[0][0]) for e in (-6e-5, 6e-5)]
        assert 6e-5 - np.abs(forces) / 1e8 == pytest.approx(np.full(2, 2e-5 * share), abs=2e-8)
        shares.append(share)
    assert min(shares) < 0.02
    assert max(shares) > 0.98
    assert list(one.deviation().laws) == [1]


def test_clay_swells_while_sprinklers_run_and_dries_in_between():
    tau = 1000.0
    cycle_s = drawn("foundation_settling", "watered_clay", "cycle_s", low=800.0, high=1600.0)
    one = Alone(
        "foundation_settling", 1e-4, variant="watered_clay", onset_s=200.0, tau_s=tau, tilt_per_m=0.2, start_s=30.0
    )
    swollen, step, now_s, seen = 0.0, 0.05, 0.0, []
    for after_s in np.arange(97.0, 6000.0, 241.0).tolist():
        while now_s < after_s - 0.5 * step:
            wet = now_s % cycle_s < 0.3 * cycle_s
            swollen += step * ((1.0 - swollen) / (0.1 * tau) if wet else -swollen / (0.3 * tau))
            now_s += step
        d = one.deviation(t_s=230.0 + after_s)
        assert d.travel_m[0] == pytest.approx([1e-4 * swollen, 0.0], rel=5e-3, abs=1e-9)
        assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
        seen.append(swollen)
    assert max(seen) > 0.8
    assert min(seen[5:]) < 0.4
    assert not np.any(one.deviation(t_s=229.0).travel_m)


def test_struts_under_load_have_another_coefficient():
    one = Alone("expansion_coefficient", 5e-6, variant="stressed_alloy")
    lengths_m = [strut.length_m for strut in FILE.struts]
    for celsius in (18.5, 20.0, 22.0):
        one.temperatures = Temperatures(lambda t, celsius=celsius: np.full_like(t, celsius))
        for payload_kg, share in ((0.0, 0.0), (100.0, 0.25), (400.0, 1.0)):
            d = one.deviation(payload_kg=payload_kg)
            assert d.length_m[0] == pytest.approx(5e-6 * share * (celsius - 20.0) * np.array(lengths_m), abs=1e-18)
            assert not np.any(d.travel_m)
            assert not np.any(d.base_joint_m)


def test_parts_come_onto_the_platform_and_leave_it_as_in_a_queue():
    one = Alone("payload", 12.0, variant="waiting_parts", start_s=100.0)
    t = 100.0 + np.arange(0.0, 20000.0, 1.0)
    d = one.deviation(t_s=t, q=np.full((len(t), 2), HOME_M))
    assert d.force_n == pytest.approx(np.tile(0.5 * 9.80665 * d.payload_mass_kg[:, None], (1, 2)))
    assert not np.any(d.payload_shift_m)
    count = d.payload_mass_kg / 3.0
    assert count == pytest.approx(np.round(count))
    assert count[0] == 0.0
    assert count.min() == 0.0
    assert np.array_equal(one.deviation(t_s=t[::500], q=np.full((40, 2), HOME_M), payload_kg=400.0).payload_mass_kg,
                          d.payload_mass_kg[::500])  # fmt: skip
    comes, goes, idle, busy_s = 0, 0, 0.0, 0.0
    for seed in range(40):
        other = Alone("payload", 12.0, variant="waiting_parts", seed=seed).effect
        assert np.all(np.abs(np.diff(other.waiting)) == 1.0)
        lasts_s = np.diff(np.concatenate([[0.0], other.changes_s]))
        comes += int(np.sum(np.diff(other.waiting) > 0.0))
        goes += int(np.sum(np.diff(other.waiting) < 0.0))
        busy_s += float(lasts_s[other.waiting[:-1] > 0.0].sum())
        idle += float(lasts_s.sum())
    assert comes / idle == pytest.approx(1.0 / 240.0, rel=0.05)
    assert goes / busy_s == pytest.approx(1.0 / 200.0, rel=0.05)


def test_each_drive_has_the_table_of_the_other_one():
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5, 3e-5), (4e-5, 0.0), (-2e-5, 2e-5))
    left = KnownTable(1, "left", nodes, rows, "right", (0.5, 1.5))
    right = KnownTable(1, "right", nodes, ((-3e-5,), (0.0,), (5e-5,)))
    one = Alone("tables_left_on", 0.5, variant="swapped_drives")
    one.effect = make(
        EffectChoice("tables_left_on", 0.5, variant="swapped_drives"), Site(FILE, STATION_M, 0.0, (left, right)), 1
    )
    d = one.deviation(t_s=np.zeros(3), q=[[0.5, 0.4], [1.5, 1.0], [1.0, 0.7]])
    on_right = np.array([1e-5, 0.0, 0.25 * (1e-5 + 3e-5 + 4e-5 + 0.0)])
    on_left = np.interp([0.5, 1.5, 1.0], nodes, [-3e-5, 0.0, 5e-5])
    assert d.travel_m == pytest.approx(0.5 * np.stack([on_left, on_right], axis=1), abs=1e-18)
