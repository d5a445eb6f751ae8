"""Tables that are on though they are said to be off, and references of drives, by hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable, draw_known_tables
from mock_devices.settings import MockSettings
from tests.mock_devices.effects_bench import FILE, STATION_M, Alone, Temperatures, along, bench

NODES_M = (0.3, 0.8, 1.2, 1.7)


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
