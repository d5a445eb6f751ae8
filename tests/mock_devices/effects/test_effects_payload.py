"""Payloads that are not as stated, by hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.effects.base import Deviation
from mock_devices.plant.affected_machine import AffectedMachine
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along, bench


def test_a_heavier_payload_is_seen_by_the_torque_and_a_payload_beside_its_place_is_not():
    heavier = Alone("payload", 12.0, variant="mass")
    d = heavier.deviation(payload_kg=200.0)
    assert d.payload_mass_kg[0] == pytest.approx(6.0)
    assert d.force_n[0] == pytest.approx([6.0 * 9.80665 / 2.0] * 2)
    assert heavier.deviation(payload_kg=0.0).payload_mass_kg[0] == 0.0
    beside = Alone("payload", 12.0, variant="centre").deviation(payload_kg=400.0)
    assert abs(beside.payload_shift_m[0]) * 400.0 == pytest.approx(12.0 * 0.5)  # as 12 kg that hang 0.5 m off
    assert not np.any(beside.force_n)


def test_a_wrong_block_is_mounted_once():
    swapped = Alone("payload", 12.0, variant="swapped")
    extra = [swapped.deviation(payload_kg=400.0, exchanges=float(k)).payload_mass_kg[0] for k in range(4)]
    assert sorted(extra) == pytest.approx([0.0, 0.0, 0.0, 12.0])
    assert extra[swapped.effect.exchange] == pytest.approx(12.0)


def test_a_tool_left_on_adds_its_mass_and_its_first_moment():
    d = Alone("payload", 50.0, variant="tool_left_on").deviation(payload_kg=200.0)
    assert d.payload_mass_kg[0] == pytest.approx(50.0)
    assert abs(d.payload_shift_m[0]) * 250.0 == pytest.approx(50.0 * 0.5)


def test_more_mass_lowers_the_platform_by_what_the_structure_gives():
    site = bench(visits=2, seed=3)
    still = Alone("payload", 0.0).motion_states(q=along([HOME_M]), payload_kg=400.0)
    down_m = []
    for kg in (0.0, 40.0, 80.0):
        d = Deviation.none(1, FILE)
        d.payload_mass_kg += kg
        equilibria, _ = AffectedMachine(site.machine, site.view).equilibria(still, d, np.array([2]))
        down_m.append(float(equilibria.p[0].imag))
    assert down_m[0] - down_m[1] == pytest.approx(down_m[1] - down_m[2], rel=1e-3)
    # Four struts of 1e8 N/m (to 30 %), 1.118 m of 1.5 m upright.
    expected = 40.0 * 9.80665 / (4.0e8 * (1.118 / 1.5) ** 2)
    assert down_m[0] - down_m[1] == pytest.approx(expected, rel=0.3)
