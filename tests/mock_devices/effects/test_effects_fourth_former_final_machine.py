"""Fourth former final forms of structure, parts' temperatures and stated values: equations solved here step by step."""

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
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures

ALPHA = 11.5e-6
LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def place_at(legs, t_s):
    """Where a drive stands at a time, if it moves at once."""
    return next((leg.to_m for leg in reversed(legs) if leg.start_s <= t_s), HOME_M)


def test_a_heat_pipe_works_while_its_drive_stands_high():
    tau = 700.0
    one = Alone("link_thermal_growth", 2.0, variant="heat_pipe", tau_s=tau, place="right_lower")
    starts_m = one.effect.starts_m
    assert abs(starts_m - MIDDLE_M) <= 0.3 * HALF_M
    assert Alone("link_thermal_growth", 2.0, variant="heat_pipe", seed=2).effect.starts_m != starts_m
    one.t_s = 100.0
    for to_m, rest_s in ((starts_m + 0.01, 300.0), (HIGH_M, 200.0), (starts_m - 0.01, 150.0), (LOW_M, 80.0)):
        one.move(1, to_m, speed=1e4, rest_s=rest_s)  # at once
        one.move(0, 2.2 - to_m, speed=1e4, rest_s=0.0)  # another strut's
    legs = one.history.legs(1)[1:]
    warm, step, now_s = 0.0, 0.02, 0.0
    ends = [leg.start_s for leg in legs[1:]] + [one.t_s, one.t_s + 900.0]
    for until_s in ends:
        while now_s < until_s:
            works = 1.0 if place_at(legs, now_s) > starts_m else 0.0
            warm, now_s = warm + step / tau * (works - warm), now_s + step
        d = one.deviation(t_s=until_s - 1e-6, q=[[HOME_M, place_at(legs, until_s - 1e-6)]])
        assert d.length_m[0, 3] == pytest.approx(ALPHA * 2.0 * 1.5 * warm, rel=2e-3)
        assert not np.any(d.length_m[0, :3])
    assert warm < 0.25


def test_oil_of_the_next_drive_warms_a_column():
    tau = 900.0
    one = Alone("column_thermal_growth", 2.0, variant="neighbours_oil", tau_s=tau)
    one.t_s = 300.0
    warm, at_s = 0.0, 0.0
    for drive, to_m, speed, rest_s in (
        (1, 1.5, 0.5, 100.0),
        (0, 0.7, 0.5, 10.0),
        (1, 0.6, 0.25, 50.0),
        (1, 0.8, 0.1, 0.0),
    ):
        way_m, middle_s = abs(to_m - one.q[drive]), one.t_s + 0.5 * abs(to_m - one.q[drive]) / speed
        if drive == 1:
            warm = warm * math.exp(-(middle_s - at_s) / tau) + way_m * (speed / 0.5) ** 2 / (0.01 * tau)
            at_s = middle_s
        one.move(drive, to_m, speed=speed, rest_s=rest_s)
        d = one.deviation()
        height = one.q[0] + 0.125 + 1.2
        expected = ALPHA * 2.0 * warm * math.exp(-(one.t_s - at_s) / tau) * height
        assert d.travel_m[0] == pytest.approx([expected, 0.0])
        assert not np.any(d.sideways_m)
    steady = Alone("column_thermal_growth", 2.0, variant="neighbours_oil", tau_s=300.0)
    for k in range(120):
        steady.move(1, HOME_M + 0.2 * (1 - k % 2), speed=0.5, rest_s=19.6)
    assert steady.travel_m() == pytest.approx(ALPHA * 2.0 * (HOME_M + 0.125 + 1.2), rel=0.04)


def test_a_carriage_floats_on_oil_after_a_fast_stop():
    one = Alone("column_compliance", 1e-8, variant="floating_carriage", place="right")
    film_s = one.effect.film_s
    assert 4.0 <= film_s <= 12.0
    assert Alone("column_compliance", 1e-8, variant="floating_carriage", seed=2).effect.film_s != film_s
    for to_m, speed in ((1.3, 0.5), (1.0, 0.1), (1.2, 0.25)):
        one.move(1, to_m, speed=speed, rest_s=0.0)
        begins = film = math.sqrt(speed / 0.5)
        step, now_s = 0.01, 0.0
        for rest_s in (0.0, 4.0, 20.0):
            while now_s < rest_s - 0.5 * step:  # a film that is squeezed: its rate goes with its cube
                film, now_s = film - step * film**3 / (2.0 * film_s * begins**2), now_s + step
            soft = one.deviation(t_s=one.t_s + rest_s).carriage_compliance[0]
            assert soft[1, 1] == pytest.approx(1e-8 * (0.25 + 0.75 * film), rel=2e-3)
            assert not np.any(soft[0])
            assert not np.any(soft[1, [0, 2]])


def test_rubber_gives_way_with_a_small_power_of_its_rest():
    one = Alone("link_stiffness", 0.7, variant="fractional_rubber", place="left_lower")
    order = one.effect.rubber
    assert 0.15 <= order <= 0.35
    assert Alone("link_stiffness", 0.7, variant="fractional_rubber", seed=2).effect.rubber != order
    one.move(0, 1.3, rest_s=0.0)
    ends_s = one.t_s
    one.move(1, 0.9, rest_s=0.0)  # another strut's
    rests_s = np.array([0.0, 1.0, 4.0, 16.0, 64.0])
    ln = np.array([one.deviation(t_s=ends_s + rest_s).ln_stiffness[0] for rest_s in rests_s])
    assert not np.any(np.delete(ln, 1, axis=1))
    added = np.expm1(-ln[:, 1]) / math.expm1(0.7)  # compliance over that of the size
    assert added[0] == 0.0
    assert added[3] == pytest.approx(1.0)
    assert np.diff(np.log(added[1:])) == pytest.approx(np.full(3, order * math.log(4.0)))


def test_play_goes_up_and_down_with_the_lobes_of_a_hole():
    one = Alone("joint_clearance", 2e-5, variant="lobed_hole", place="left_lower")
    lobes, strut = one.effect.lobes, FILE.struts[1]
    assert 15 <= lobes <= 30
    assert len({Alone("joint_clearance", 2e-5, variant="lobed_hole", seed=k).effect.lobes for k in range(12)}) > 4

    def along_strut(tool, q):
        return tool - FILE.tool_point + strut.platform_joint - strut.base_joint - 1j * q[0]

    low_m = MIDDLE_M - math.sqrt(1.5**2 - 1.0)  # height of the platform, both drives in the middle
    straight = along_strut(1j * low_m, (MIDDLE_M, MIDDLE_M))
    assert abs(straight) == pytest.approx(1.5)
    shares = []
    for tool in [complex(x, y) for x in np.linspace(-0.3, 0.3, 9) for y in (-0.2, 0.2)]:
        q = nominal_drives(FILE, tool)
        swing = cmath.phase(along_strut(tool, q) / straight)
        share = 0.5 + 0.5 * math.cos(lobes * swing + one.effect.phase)
        (law,) = one.deviation(q=[q]).laws[1]
        forces = [float(law(np.array([e]), np.array([1e8]))[0][0]) for e in (-6e-5, 6e-5)]
        play_m = 6e-5 - np.abs(forces) / 1e8
        assert play_m == pytest.approx(np.full(2, 2e-5 * share), abs=2e-8)
        shares.append(share)
    assert min(shares) < 0.2
    assert max(shares) > 0.8
    assert list(one.deviation().laws) == [1]


def test_a_foot_sinks_in_the_bowl_under_the_next_one():
    tau = 1000.0
    one = Alone("foundation_settling", 1e-4, variant="neighbours_bowl", onset_s=200.0, tau_s=tau, tilt_per_m=0.2)
    one.t_s = 500.0
    for to_m, rest_s in ((LOW_M, 60.0), (HIGH_M, 30.0), (1.2, 200.0)):
        one.move(1, to_m, speed=1e4, rest_s=rest_s)  # at once
        one.move(0, 2.0 - to_m, rest_s=0.0)  # its own carriage does nothing
    legs = one.history.legs(1)[1:]
    late, step, now_s = 0.0, 0.05, 0.0
    for until_s in (150.0, 480.0, legs[0].end_s + 50.0, legs[1].start_s, legs[2].start_s, one.t_s):
        while now_s < until_s:
            late += step / (0.05 * tau) * ((HIGH_M - place_at(legs, now_s)) / (HIGH_M - LOW_M) - late)
            now_s += step
        q = place_at(legs, until_s - 1e-6)
        softened = 1.0 - math.exp(-max(until_s - 200.0, 0.0) / tau)
        sunk = 0.5 * (HIGH_M - q) / (HIGH_M - LOW_M) + 0.5 * late
        d = one.deviation(t_s=until_s - 1e-6, q=[[0.9, q]])
        assert -d.travel_m[0, 0] == pytest.approx(1e-4 * softened * sunk, rel=2e-3, abs=1e-9)
        assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
        assert not np.any(d.travel_m[:, 1])
    assert not np.any(one.deviation(t_s=199.0).travel_m)


def test_struts_grow_more_above_the_temperature_of_a_kink():
    swing = Temperatures(lambda t: 21.0 + 0.6 * np.sin(np.maximum(t - 60.0, 0.0) / 900.0))
    one = Alone("expansion_coefficient", 5e-6, variant="curie_kink", temperatures=swing, start_s=60.0)
    kink_k = one.effect.kink_k
    assert -0.1 <= kink_k <= 0.3
    assert Alone("expansion_coefficient", 5e-6, variant="curie_kink", seed=2).effect.kink_k != kink_k
    t = np.arange(60.0, 9000.0, 97.0)
    d = one.deviation(t_s=t, q=np.full((len(t), 2), HOME_M))
    beyond_k = [max(0.6 * math.sin((s - 60.0) / 900.0) - kink_k, 0.0) for s in t.tolist()]
    assert d.length_m == pytest.approx(5e-6 * np.outer(beyond_k, [strut.length_m for strut in FILE.struts]), abs=1e-18)
    assert max(beyond_k) > 0.25
    assert min(beyond_k) == 0.0
    assert not np.any(d.travel_m)
    assert not np.any(d.base_joint_m)


def test_the_rope_of_a_counterweight_makes_the_load_heavier_on_the_way_up():
    one = Alone("payload", 12.0, variant="rope_of_counterweight")
    for drive, to_m, sense in ((0, 1.3, 0.5), (1, 1.4, 1.0), (0, 1.0, 0.0), (1, 0.8, -1.0)):
        one.move(drive, to_m, speed=0.1 + 0.2 * to_m, rest_s=60.0)
        for payload_kg in (0.0, 300.0):
            d = one.deviation(payload_kg=payload_kg)
            expected_kg = 12.0 * sense * (150.0 + payload_kg) / 150.0
            assert d.payload_mass_kg[0] == pytest.approx(expected_kg)
            assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * expected_kg))
            assert not np.any(d.payload_shift_m)


def test_tables_act_in_proportion_to_the_payload():
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5, 3e-5), (4e-5, 0.0), (-2e-5, 2e-5))
    left = KnownTable(1, "left", nodes, rows, "right", (0.5, 1.5))
    right = KnownTable(1, "right", nodes, ((-3e-5,), (0.0,), (5e-5,)))
    one = Alone("tables_left_on", 0.5, variant="by_payload")
    one.effect = make(
        EffectChoice("tables_left_on", 0.5, variant="by_payload"), Site(FILE, STATION_M, 0.0, (left, right)), 1
    )
    for payload_kg, share in ((0.0, 0.0), (100.0, 0.25), (400.0, 1.0)):
        d = one.deviation(t_s=np.zeros(3), q=[[0.4, 0.5], [1.0, 1.5], [0.7, 1.0]], payload_kg=payload_kg)
        on_left = np.array([1e-5, 0.0, 0.25 * (1e-5 + 3e-5 + 4e-5 + 0.0)])
        on_right = np.interp([0.5, 1.5, 1.0], nodes, [-3e-5, 0.0, 5e-5])
        assert d.travel_m == pytest.approx(0.5 * share * np.stack([on_left, on_right], axis=1), abs=1e-18)
