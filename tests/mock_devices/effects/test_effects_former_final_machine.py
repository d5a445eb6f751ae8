"""Former final forms of structure, parts' temperatures and stated values: equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M = 0.5 * (LOW_M + HIGH_M)
ALPHA = 11.5e-6


def test_a_dry_joint_is_warmed_by_the_way_and_not_by_the_speed():
    tau, grown = 1000.0, []
    for speed in (0.1, 0.5):
        one = Alone("link_thermal_growth", 3.0, variant="rubbing_joint", tau_s=tau, place="right_lower")
        one.t_s = 100.0 - 0.5 * 0.4 / speed
        one.move(1, HOME_M + 0.4, speed=speed, rest_s=0.0)
        one.move(0, HOME_M - 0.5, speed=0.5, rest_s=0.0)  # another strut's
        d = one.deviation(t_s=100.0 + np.array([250.0, 2000.0]), q=np.full((2, 2), HOME_M + 0.4))
        assert not np.any(d.length_m[:, :3])
        grown.append(d.length_m[:, 3])
    assert grown[0] == pytest.approx(grown[1], rel=1e-6)
    joint, strut, step = 0.4 / (0.01 * tau), 0.0, 0.01
    for k in range(1, 200001):
        given = joint / (0.2 * tau) * step
        joint, strut = joint - given, strut + given - strut / tau * step
        if k == 25000:
            assert grown[0][0] == pytest.approx(ALPHA * 1.5 * 3.0 * strut, rel=1e-3)
    assert grown[0][1] == pytest.approx(ALPHA * 1.5 * 3.0 * strut, rel=1e-3)


def test_a_column_bends_while_the_sun_is_on_its_face():
    tau = 2000.0
    one = Alone("column_thermal_growth", 2.0, variant="sun_on_face", tau_s=tau)
    begins_s, lasts_s = one.effect.sun_begins_s, one.effect.sun_lasts_s
    assert 300.0 <= begins_s <= 1200.0
    assert 1500.0 <= lasts_s <= 3600.0
    t = begins_s + np.array([-100.0, 0.3 * lasts_s, lasts_s, lasts_s + tau, lasts_s + 20.0 * tau])
    d = one.deviation(t_s=t, q=np.full((5, 2), 1.1))
    rate = math.pi / lasts_s
    full = math.hypot(1.0, rate * tau)  # over what a steady swing would leave of it
    warm, step, at_s, seen = 0.0, 0.1, begins_s, {}
    while at_s < t[3] + step:
        shines = max(math.sin(rate * (at_s - begins_s)), 0.0) if at_s < begins_s + lasts_s else 0.0
        for k in (1, 2, 3):
            seen.setdefault(k, warm) if at_s >= t[k] else None
        warm, at_s = warm + step / tau * (full * shines - warm), at_s + step
    expected = 2.0 * np.array([0.0, seen[1], seen[2], seen[3], 0.0])
    height = 1.1 + 0.125 + 1.2
    assert d.yaw_rad[:, 0] == pytest.approx(ALPHA * expected / 0.4 * height, rel=2e-3, abs=1e-12)
    assert d.sideways_m[:, 0] == pytest.approx(0.5 * d.yaw_rad[:, 0] * height)
    assert d.travel_m[:, 0] == pytest.approx(0.5 * 0.4 * d.yaw_rad[:, 0])  # its middle is half as warm as its face
    assert not np.any(d.yaw_rad[:, 1])


def test_a_foot_that_rocks_gives_way_with_the_square_of_the_height():
    one = Alone("column_compliance", 1e-8, variant="rocking_foot")
    at = np.array([LOW_M, MIDDLE_M, HIGH_M])
    soft = one.deviation(t_s=np.zeros(3), q=along(at)).carriage_compliance
    height = at + 0.125 + 1.2
    turns = 1e-8 / height[1] ** 2  # radians a newton metre at the foot
    assert soft[:, 0, 1] == pytest.approx(turns * height**2)
    assert soft[:, 0, 2] == pytest.approx(np.full(3, turns))
    assert not np.any(soft[:, 0, 0])
    assert not np.any(soft[:, 1])


def test_a_bonded_end_creeps_after_every_motion():
    one = Alone("link_stiffness", 0.7, variant="creeping_bond", place="right_upper")
    creeps_s = one.effect.creeps_s
    assert 4.0 <= creeps_s <= 12.0
    for to_m in (1.3, 0.9):
        one.move(1, to_m, rest_s=0.0)
        more = []
        for wait_s in (0.0, creeps_s, 1e4):
            ln = one.deviation(t_s=one.t_s + wait_s).ln_stiffness[0]
            assert not np.any(np.delete(ln, 2))
            more.append(math.exp(-ln[2]) - 1.0)  # compliance beyond the strut's own, over that
        assert more[2] == pytest.approx(math.exp(0.7) - 1.0)
        assert more[0] == pytest.approx(0.3 * more[2])
        assert (more[2] - more[1]) / (more[2] - more[0]) == pytest.approx(1.0 / math.e)
        one.t_s += 50.0


def test_friction_holds_a_pin_where_it_was_pushed_until_weight_seats_it():
    one = Alone("joint_clearance", 2e-5, variant="friction_held", place="left_lower")
    assert not np.any(one.deviation(payload_kg=400.0).length_m)
    for to_m, side in ((1.3, 1.0), (1.2, -1.0)):
        one.move(0, to_m)
        one.move(1, 1.3 if one.q[1] == HOME_M else HOME_M)  # another drive's joint
        for payload_kg, share in ((0.0, 0.0), (150.0, 0.5), (300.0, 1.0), (400.0, 1.0)):
            d = one.deviation(payload_kg=payload_kg)
            assert d.length_m[0] == pytest.approx([0.0, 2e-5 * (side + (1.0 - side) * share), 0.0, 0.0], abs=1e-18)
            assert not d.laws


def test_a_slab_curls_while_its_top_is_warmer_than_its_bottom():
    tau = 1500.0
    gate = Temperatures(lambda t: np.where(t < 600.0, 20.0, 23.0))
    one = Alone(
        "foundation_settling", 1e-5, variant="curling_slab", onset_s=400.0, tau_s=tau, tilt_per_m=0.2, temperatures=gate
    )
    t = np.array([0.0, 300.0, 500.0, 800.0, 1500.0, 60000.0])
    d = one.deviation(t_s=t, q=np.full((6, 2), HOME_M))
    after = np.maximum(t - 600.0, 0.0)
    warmer = 3.0 * (np.exp(-after / tau) - np.exp(-after / (0.1 * tau)))
    assert d.travel_m[:, 0] == pytest.approx(-1e-5 * warmer, rel=0.08, abs=1e-9)
    assert d.travel_m[3, 0] < -5e-6
    assert d.yaw_rad[:, 0] == pytest.approx(-0.2 * d.travel_m[:, 0])
    assert not np.any(d.travel_m[:, 1])
    early = Temperatures(lambda t: np.where(t < 200.0, 20.0, 23.0))  # all before the gate is opened
    one.temperatures = early
    assert np.abs(one.deviation(t_s=t, q=np.full((6, 2), HOME_M)).travel_m).max() < 1e-12


def test_a_platform_of_light_metal_grows_with_its_joints_and_reflectors():
    one = Alone("expansion_coefficient", 2e-6, variant="platform_metal", temperatures=Temperatures(lambda t: 20.0 + t))
    d = one.deviation(t_s=[0.0, 3.0], q=np.full((2, 2), HOME_M))
    strain = 4.0 * 2e-6 * 3.0
    assert not np.any(d.platform_joint_m[0])
    assert d.platform_joint_m[1] == pytest.approx(strain * np.array([s.platform_joint for s in FILE.struts]))
    for i, smr in enumerate(FILE.smrs):
        grown = strain * np.array(smr.position_m) if smr.on == "platform" else np.zeros(3)
        assert d.smr_m[1, i] == pytest.approx(grown)
    assert not np.any(d.length_m)
    assert not np.any(d.travel_m)


def test_chips_gather_on_the_platform_with_any_payload():
    one = Alone("payload", 30.0, variant="gathering_chips", start_s=500.0)
    t = 500.0 + np.array([0.0, 900.0, 3600.0])
    for payload_kg in (0.0, 400.0):
        d = one.deviation(t_s=t, q=np.full((3, 2), HOME_M), payload_kg=payload_kg)
        assert d.payload_mass_kg == pytest.approx([0.0, 7.5, 30.0])
        assert d.force_n[:, 1] == pytest.approx(d.payload_mass_kg * 9.80665 / 2.0)
        assert not np.any(d.payload_shift_m)


def test_old_tables_are_added_to_the_new_ones():
    nodes, rows = (0.4, 1.0, 1.6), (((1e-5,), (4e-5,), (-2e-5,)), ((-3e-5,), (0.0,), (5e-5,)))
    tables = tuple(KnownTable(k + 1, drive, nodes, rows[k]) for k in range(2) for drive in ("left", "right"))
    one = Alone("tables_left_on", 0.5, variant="both_generations")
    choice = EffectChoice("tables_left_on", 0.5, variant="both_generations")
    at = np.linspace(0.5, 1.5, 15)
    for seed in range(4):  # whichever of them counts as the new one
        one.effect = make(choice, Site(FILE, STATION_M, 0.0, tables), seed)
        off = one.deviation(t_s=np.zeros(15), q=along(at)).travel_m
        assert off[:, 0] == pytest.approx(0.5 * np.interp(at, nodes, [-2e-5, 4e-5, 3e-5]))
        assert off[0, 1] == pytest.approx(0.5 * np.interp(HOME_M, nodes, [-2e-5, 4e-5, 3e-5]))
