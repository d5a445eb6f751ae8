"""What is stated and not so: growth, weight, tables and references by hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Deviation, Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable, draw_known_tables
from mock_devices.plant.affected_machine import AffectedMachine
from mock_devices.settings import MockSettings
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along, bench

WARM_K = 3.0
NODES_M = (0.3, 0.8, 1.2, 1.7)


class PartsWarm(Alone):
    """Alone, with the recorded temperatures of a test."""

    def __init__(self, name, size, warm_k=WARM_K, **kinds):
        super().__init__(name, size, **kinds)
        self.warm_k = warm_k

    def motion_states(self, *args, **kinds):
        state = super().motion_states(*args, **kinds)
        for part in state.parts_c:
            warm_k = self.warm_k[part] if isinstance(self.warm_k, dict) else self.warm_k
            state.parts_c[part] = np.full(len(state), FILE.reference_temperature_c + warm_k)
        return state


def test_screws_of_another_coefficient_grow_from_their_zero():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="screws")
    d = one.deviation(q=[[0.8, 1.4]])
    assert d.travel_m[0] == pytest.approx([4e-6 * WARM_K * 0.8, 4e-6 * WARM_K * 1.4])
    assert not np.any(d.base_joint_m)


def test_a_frame_of_another_coefficient_grows_about_the_origin_with_all_that_it_carries():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="frame")
    d = one.deviation(q=[[0.8, 1.4]])
    strain = 4e-6 * WARM_K
    # Joints of the left column are 1.2 m to the left: its slider goes left, which is +90 degrees from up.
    assert d.sideways_m[0] == pytest.approx([1.2 * strain, -1.2 * strain])
    assert d.travel_m[0] == pytest.approx([0.8 * strain, 1.4 * strain])
    assert d.base_joint_m[0] == pytest.approx([0.125j * strain, -0.125j * strain] * 2)


def test_a_frame_between_two_sensors_goes_by_their_mean():
    warm_k = {"base": 1.0, "columns": 3.0, "struts": 0.0, "platform": 0.0}
    one = PartsWarm("expansion_coefficient", 4e-6, warm_k, variant="mean_of_sensors")
    d = one.deviation(q=[[0.8, 1.4]])
    assert d.sideways_m[0, 0] == pytest.approx(1.2 * 4e-6 * 2.0)
    assert d.travel_m[0] == pytest.approx([0.0, 0.0], abs=1e-18)


def test_two_bonded_layers_bend_as_timoshenko_says():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="bimetal")
    low = FILE.sliders[0].travel_m[0]
    d = one.deviation(t_s=[0.0] * 3, q=[[low, low], [low + 0.4, low], [low + 0.8, low]])
    m = n = 1.0  # thickness and stiffness of one layer over the other's
    timoshenko = (
        6.0 * 4e-6 * WARM_K * (1.0 + m) ** 2
        / (0.2 * (3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n))))
    )  # fmt: skip
    assert d.yaw_rad[:, 0] == pytest.approx([0.0, 0.4 * timoshenko, 0.8 * timoshenko])
    assert d.sideways_m[:, 0] == pytest.approx([0.0, 0.08 * timoshenko, 0.32 * timoshenko])


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


def table(drive, generation=1, scale=1.0e-5):
    partner = "right" if drive == "left" else "left"
    rows = tuple(tuple(scale * (i + 10 * j) for j in range(4)) for i in range(4))
    return KnownTable(generation, drive, NODES_M, rows, partner, NODES_M)


def left_on(variant, tables, **kinds):
    one = Alone("tables_left_on", 1.0, variant=variant, **kinds)
    choice = EffectChoice("tables_left_on", 1.0, variant=variant, parameters=tuple(kinds.items()))
    one.effect = make(choice, Site(FILE, STATION_M, 0.0, tables), 1)
    return one


def test_a_table_is_bilinear_between_its_nodes_and_held_at_its_edge():
    own, partner = np.array([0.8, 0.55, 1.0, 0.1, 1.9]), np.array([0.8, 0.8, 1.0, 0.3, 5.0])
    expected = 1e-5 * np.array([11.0, 10.5, 16.5, 0.0, 33.0])
    assert table("left").correction_m(own, partner) == pytest.approx(expected)
    plain = KnownTable(1, "left", NODES_M, ((0.0,), (1e-5,), (2e-5,), (4e-5,)))
    assert plain.correction_m(np.array([0.55, 1.45, 2.0]), np.zeros(3)) == pytest.approx([0.5e-5, 3e-5, 4e-5])


def test_tables_that_are_on_are_added_to_the_command():
    d = left_on("whole", (table("left"), table("right"))).deviation(q=[[0.8, 1.2]])
    assert d.travel_m[0] == pytest.approx([1e-5 * (1 + 20), 1e-5 * (2 + 10)])
    alone = left_on("one_drive", (table("left"), table("right"))).deviation(q=[[0.8, 1.2]])
    assert np.count_nonzero(alone.travel_m) == 1
    weighed = Alone("tables_left_on", 0.25, variant="whole")
    whole = Alone("tables_left_on", 1.0, variant="whole")
    assert weighed.deviation(q=[[0.8, 1.2]]).travel_m == pytest.approx(0.25 * whole.deviation(q=[[0.8, 1.2]]).travel_m)


def test_tables_are_switched_on_at_one_moment():
    one = left_on("switched", (table("left"), table("right")), onset_s=1000.0)
    d = one.deviation(t_s=[999.0, 1001.0], q=[[0.8, 1.2]] * 2)
    assert d.travel_m[:, 0] == pytest.approx([0.0, 21e-5])


def test_each_direction_has_its_own_table():
    tables = tuple(table(drive, g, 1e-5 * g) for drive in ("left", "right") for g in (1, 2))
    one = left_on("bidirectional", tables)
    one.move(0, 0.7)
    one.move(0, 0.8)
    up = one.travel_m()
    one.move(0, 0.9)
    one.move(0, 0.8)
    down = one.travel_m()
    assert sorted([up, down]) == pytest.approx([1e-5 * (1 + 17.5), 2e-5 * (1 + 17.5)])


def test_known_tables_are_stated_alike_whatever_the_effect_is():
    tables = draw_known_tables(FILE, np.random.default_rng(3))
    plain = bench(visits=4, known_tables=tables).record().header
    with_effect = bench(visits=4, known_tables=tables, effects=(EffectChoice("tables_left_on", 1.0),)).record().header
    assert plain == with_effect
    sections = plain["known_tables"]
    assert [(s["drive"], s["generation"]) for s in sections] == [(d, g) for d in ("left", "right") for g in (1, 2, 3)]
    assert "known_tables" not in bench(visits=4).record().header
    for section, known in zip(sections, tables, strict=True):
        whole = np.array(section["corrections_m"])
        assert whole.shape == (len(section["own_m"]), len(section["partner_m"]))
        assert 2e-5 < np.sqrt(np.mean(whole**2)) < 8e-5
        assert np.allclose(whole / 1e-8, np.round(whole / 1e-8), atol=1e-6)
        assert known.correction_m(np.array([section["own_m"][2]]), np.array([section["partner_m"][5]])) == (
            pytest.approx(whole[2, 5])
        )
    assert MockSettings().known_tables == ()


def test_zero_and_scale_of_a_drive_jump_at_the_onset():
    middle, half = 1.01, 0.69
    zero = Alone("drive_scale", 2e-5, place="right", onset_s=500.0)
    d = zero.deviation(t_s=[499.0, 501.0], q=along([0.5, 1.5], 1))
    assert abs(d.travel_m[:, 1]) == pytest.approx([0.0, 2e-5])
    assert not np.any(d.travel_m[:, 0])
    scale = Alone("drive_scale", 2e-5, variant="scale_step", onset_s=500.0)
    d = scale.deviation(t_s=[501.0] * 3, q=along([middle - half, middle, middle + half]))
    assert d.travel_m[:, 0] * scale.effect.sign == pytest.approx([-2e-5, 0.0, 2e-5], abs=1e-15)


def test_each_exchange_leaves_another_zero():
    one = Alone("drive_scale", 2e-5, variant="homed_at_exchanges")
    zero = [one.travel_m(exchanges=float(k)) for k in range(4)]
    assert zero[0] == 0.0
    assert abs(zero[1]) == pytest.approx(2e-5)
    assert len(set(zero)) == 4


def test_a_held_scale_slips_only_beyond_its_limit():
    ramp = Temperatures(lambda t: 20.0 + np.minimum(t, 3600.0) / 3600.0 - np.maximum(t - 3600.0, 0.0) / 3600.0)
    one = Alone("drive_scale", 1e-5, variant="thermal_slip", temperatures=ramp)
    top = FILE.sliders[0].travel_m[1]
    d = one.deviation(t_s=[1200.0, 3600.0, 5400.0, 7200.0], q=along([top] * 4))
    # Held within 0.4 K: slides up by 0.6 K, stays while it cools by 0.5 K, comes back to 0.4 K above the last.
    assert d.travel_m[:, 0] == pytest.approx([0.0, 0.6e-5, 0.6e-5, 0.4e-5], abs=2e-7)
    assert one.deviation(t_s=7200.0, q=along([FILE.sliders[0].travel_m[0]])).travel_m[0, 0] == pytest.approx(0.0)
