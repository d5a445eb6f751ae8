"""Recordings straight from the plant: the reader takes them, noise is as stated, nothing in them tells the truth."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from calibration.instruments.station_geometry import point_covariances as expected_covariances
from calibration.recording.columns import column_names as expected_columns
from calibration.recording.columns import columns_of
from calibration.recording.folder import read_folder
from mock_devices.effects import EffectChoice
from mock_devices.known_tables import draw_known_tables
from mock_devices.plant.thermal import SENSORS
from mock_devices.recordings.design import DesignOptions, draw_design, nominal_drives
from mock_devices.recordings.files import to_toml, write_recording
from mock_devices.recordings.maker import SimulatedCampaign, column_names, points
from mock_devices.settings import DisturbanceLevels, MockSettings
from tests.mock_devices.effects_bench import FILE, MACHINE, bench

EFFECTS = (EffectChoice("backlash", 4e-5), EffectChoice("friction_windup", 2e-8, "right"))


def test_columns_are_those_of_the_format():
    assert column_names(FILE) == expected_columns(("left", "right"), SENSORS)


def test_values_of_the_mock_are_within_the_limits_of_the_table():
    made = bench(effects=EFFECTS).record()
    table = {column.name: column for column in columns_of(("left", "right"), SENSORS)}
    for name, values in made.columns.items():
        assert (table[name].kind == "text") == (values.dtype.kind == "U"), name
        table[name].check(values)


def test_the_reader_takes_what_is_written_digit_for_digit(tmp_path):
    tables = draw_known_tables(FILE, np.random.default_rng(1))
    levels = DisturbanceLevels(1e-5, 2e-6, 1e-6, 0.02)
    made = bench(effects=EFFECTS, nuisance=levels, fly_share=0.2, known_tables=tables).record("some-name")
    write_recording(made, tmp_path / "folder")
    read = read_folder(tmp_path / "folder")
    assert read.file.campaign == "some-name"
    assert read.file.nuisance.reseat_m == 2e-6
    assert read.file.known_tables is not None
    assert len(read.file.known_tables) == len(tables)
    for kept, table in zip(read.file.known_tables, tables, strict=True):
        assert (kept.generation, kept.drive, kept.partner) == (table.generation, table.drive, table.partner)
        assert np.array_equal(kept.corrections_m, table.corrections_m)
    for name, column in made.columns.items():
        assert np.array_equal(read[name], column), name
    stated = read.file.station.accuracy.to_station_accuracy()
    single = expected_covariances(read["hz_rad"], read["v_rad"], read["slope_distance_m"], stated)
    assert read.covariances_m2 == pytest.approx(single / read["samples"][:, None, None], rel=1e-9, abs=1e-20)


def test_nothing_in_a_recording_names_effects_or_seeds():
    with_effects, without = bench(effects=EFFECTS).record(), bench().record()
    assert with_effects.header == without.header
    assert not {"seed", "effects"} & set(str(with_effects.header).replace("'", " ").split())


def test_noise_is_as_stated_and_the_same_of_one_seed():
    b = bench(visits=200)
    made = b.record()
    again = b.record().columns
    assert all(np.array_equal(column, again[name]) for name, column in made.columns.items())
    k = b.timeline.smr
    seen, _, _ = b.sight()
    rows = np.arange(len(made))
    hz = (made.columns["hz_rad"] - seen.hz_rad[rows, k] + np.pi) % (2.0 * np.pi) - np.pi
    single = ~b.timeline.is_nest
    assert np.std(hz[single] * np.sin(seen.v_rad[rows, k][single])) == pytest.approx(2.4e-6, rel=0.08)
    assert np.std(hz[~single]) == pytest.approx(2.4e-6 / np.sqrt(5.0), rel=0.3)
    place = points(made.columns["hz_rad"], made.columns["v_rad"], made.columns["slope_distance_m"])
    assert place == pytest.approx(np.stack([made.columns[c] for c in ("x_m", "y_m", "z_m")], axis=1))


def test_heavy_tails_have_the_same_deviation_and_more_outliers():
    def residuals(tails):
        b = bench(visits=240, noise_tails=tails, seed=8)
        seen, _, _ = b.sight()
        k = b.timeline.smr
        return (b.record().columns["v_rad"] - seen.v_rad[np.arange(len(k)), k])[~b.timeline.is_nest] / 2.4e-6

    normal, heavy = residuals(0.0), residuals(4.0)
    assert np.std(heavy) == pytest.approx(1.0, rel=0.25)
    assert np.sum(np.abs(heavy) > 4.0) > np.sum(np.abs(normal) > 4.0)


def test_sensors_are_biased_and_clocks_jitter_only_where_asked():
    plain = bench()
    biased = bench(temperature_sensor_bias_k=0.3, clock_jitter_s=0.2)
    a, b = plain.record().columns, biased.record().columns
    shift = b["struts_temperature_c"] - a["struts_temperature_c"]
    assert np.ptp(shift) < 1e-12
    assert 0.001 < abs(shift[0]) < 1.5
    assert np.std(b["t_rig_s"] - a["t_rig_s"]) == pytest.approx(0.2, rel=0.2)
    assert np.array_equal(plain.points_m(), biased.points_m())


def test_a_swing_of_the_shop_reaches_parts_one_after_the_other():
    swing = ((3600.0, 0.0), (3601.0, 4.0), (90000.0, 4.0))
    b, still = bench(visits=160, temperature_programme=swing), bench(visits=160)
    t, after = b.timeline.t_s, b.timeline.t_s - 3600.0
    for part, tau in (("struts", 900.0), ("base", 5400.0)):
        risen = b.thermal.part_series_c(part, t) - still.thermal.part_series_c(part, t)
        assert risen == pytest.approx(4.0 * (1.0 - np.exp(-after / tau)), abs=0.15)
        assert b.thermal.part_c(part, float(t[9])) == pytest.approx(
            b.thermal.part_series_c(part, t[9:10])[0], abs=1e-12
        )


def test_torque_shows_friction_by_the_side():
    made = bench(effects=EFFECTS).record().columns
    at_pose = (made["phase"] == "calibration") & (made["payload"] == 0.0)
    by_side = [made["right_torque_ratio"][at_pose & (made["right_direction"] == side)] for side in (1.0, -1.0)]
    assert by_side[0].mean() - by_side[1].mean() == pytest.approx(600.0 * 0.01 / (2.0 * np.pi) / 10.0, abs=2e-3)
    assert np.ptp(made["left_torque_ratio"][at_pose]) == 0.0


def test_nuisance_has_its_declared_level():
    reversal = []
    for seed in range(40):
        with_it = bench(visits=12, seed=seed, nuisance=DisturbanceLevels(reversal_m=5e-6))
        on_slider = np.array([smr.on == "left" for smr in FILE.smrs])[with_it.timeline.smr]
        change = (with_it.points_m() - with_it.points_m([])) @ with_it.view.rotation
        reversal.append(np.std(change[on_slider, 1]) if np.ptp(change[on_slider, 1]) else 0.0)
    assert np.sqrt(np.mean(np.square(reversal))) == pytest.approx(5e-6, rel=0.35)


def test_designs_vary_what_they_are_told_to():
    rng = np.random.default_rng(3)
    raster = draw_design(FILE, rng, DesignOptions(60, 60, randomised=False, both_directions=False, payload_blocks=(0,)))
    assert {visit.direction for visit in raster.visits} == {(1, 1)}
    assert [visit.pose for visit in raster.visits] == list(range(60))
    full = draw_design(FILE, rng)
    assert {visit.payload for visit in full.visits} == {0, 2}
    assert len({visit.direction for visit in full.visits}) == 4
    bare = draw_design(FILE, rng, DesignOptions(platform_only=True))
    assert bare.smrs == ("P1", "P2", "P3")
    assert bare.nests == ()
    assert len(SimulatedCampaign(MACHINE, MockSettings(), bare).timeline) == 240 * 3


def test_drives_of_the_golden_pose():
    assert nominal_drives(FILE, 0.35 + 0.30j) == pytest.approx((0.953834841531101, 1.651850583459577), abs=1e-14)


def test_directions_are_those_of_the_last_motion():
    b = bench()
    _, m, _ = b.sight()
    rows = (b.timeline.visit >= 0) & ~b.timeline.is_nest
    sides = np.array([visit.direction for visit in b.timeline.design.visits])[b.timeline.visit[rows]]
    assert np.array_equal(m.direction[rows], sides)
    assert np.all(m.since_s[rows] > 0.0)
    assert np.all(np.diff(b.timeline.t_s) > 0.0)


def test_a_recording_takes_no_time_to_speak_of():
    b = bench(visits=240, effects=EFFECTS)
    started = time.process_time()
    SimulatedCampaign(MACHINE, replace(b.settings, seed=9), b.timeline).record()
    assert time.process_time() - started < 1.0


def test_toml_is_written_as_tables():
    text = to_toml({"a": 1, "b": {"c": [1.5, 2.0], "d": {"e": 'x"y'}}, "f": [{"g": 0.1}]})
    assert text == 'a = 1\n\n[b]\nc = [1.5, 2.0]\n\n[b.d]\ne = "x\\"y"\n\n[[f]]\ng = 0.1\n'


def test_new_effects_are_told_of_every_motion_and_leave_the_moments_as_they_are():
    b = bench(effects=EFFECTS)
    first = b.points_m()
    b.points_m([])
    assert np.array_equal(b.points_m(), first)
    _, m, _ = b.sight()
    untouched = bench(effects=EFFECTS).moments
    assert m is b.moments
    assert all(np.array_equal(getattr(m, name), getattr(untouched, name)) for name in ("q_m", "leg", "from_m", "t_s"))
    assert all(np.array_equal(m.parts_c[name], untouched.parts_c[name]) for name in m.parts_c)
