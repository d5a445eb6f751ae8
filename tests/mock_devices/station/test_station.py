"""The station's answers: golden transcripts, aiming, measuring, two faces, any line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mock_devices.plant.atmosphere import ppm
from mock_devices.plant.optics import hz_difference
from mock_devices.settings import InstrumentProfile
from mock_devices.station.mock_station import MockStation
from mock_devices.station.telescope import Telescope

WARMING_RAD = 1e-8  # what parts that warm up move a reflector in some seconds
QUIET = InstrumentProfile(
    angle_sd_rad=0.0,
    range_sd_m=0.0,
    range_constant_u_m=0.0,
    range_scale_u=0.0,
    drift_about_vertical_rad=0.0,
    drift_of_level_rad=0.0,
    drift_m=0.0,
)


@pytest.fixture
def station(plant):
    return MockStation(plant)


@pytest.fixture
def quiet(make_plant):
    return make_plant(seed=3, instrument=QUIET)


def ask(station, rpc, *params):
    """Code and values of one call."""
    text = ",".join(str(p) for p in params)
    answer = station.respond(f"%R1Q,{rpc},1:{text}".encode())
    assert answer.startswith(b"%R1P,0,1:")
    assert answer.endswith(b"\r\n")
    code, *values = answer[len(b"%R1P,0,1:") : -2].decode().split(",")
    return int(code), [float(v) if '"' not in v else v for v in values]


def seen(plant, name):
    return next(s for s in plant.sightings(plant.clock.now_s()) if s.name == name)


def aim_at(station, plant, name, off=1e-3):
    polar = seen(plant, name).polar
    assert ask(station, 9027, polar.hz_rad + off, polar.v_rad - off, 0, 0, 0) == (0, [])
    return ask(station, 9037, 0.01, 0.01, 0)


GOLDEN = [
    (b"%R1Q,0,1:", b"%R1P,0,1:0\r\n"),
    (b"%R1Q,110,2:", b"%R1P,0,2:0,1,50,0\r\n"),
    (b"%R1Q,111,3:1", b"%R1P,0,3:5\r\n"),
    (b"%R1Q,5003,4:", b"%R1P,0,4:0,990001\r\n"),
    (b"%R1Q,5004,5:", b'%R1P,0,5:0,"MOCK TDRA"\r\n'),
    (b"%R1Q,108,6:", b"%R1P,0,6:0,4\r\n"),
    (b"%R1Q,2107,7:1", b"%R1P,0,7:0,0.0000,1.5708\r\n"),
    (b"%R1Q,107,8:15", b"%R1P,0,8:0\r\n"),
    (b"%R1Q,108,9:", b"%R1P,0,9:0,15\r\n"),
    (b"%R1Q,2107,10:1", b"%R1P,0,10:0,0.000000000000000,1.570796326794897\r\n"),
    (b"%R1Q,107,11:16", b"%R1P,0,11:2\r\n"),
    (b"%R1Q,2021,12:", b"%R1P,0,12:0,2\r\n"),
    (b"%R1Q,2020,13:10", b"%R1P,0,13:0\r\n"),
    (b"%R1Q,2021,14:", b"%R1P,0,14:0,10\r\n"),
    (b"%R1Q,2020,15:99", b"%R1P,0,15:2\r\n"),
    (b"%R1Q,17008,16:1", b"%R1P,0,16:0\r\n"),
    (b"%R1Q,17009,17:", b"%R1P,0,17:0,1\r\n"),
    (b"%R1Q,2023,18:", b"%R1P,0,18:0,0.017500000000000\r\n"),
    (b"%R1Q,2024,19:0.0", b"%R1P,0,19:0\r\n"),
    (b"%R1Q,2026,20:", b"%R1P,0,20:0,0\r\n"),
    (b"%R1Q,6021,21:", b"%R1P,0,21:0,0\r\n"),
    (b"%R1Q,9019,22:", b"%R1P,0,22:0,1\r\n"),
    (b"%R1Q,9021,23:", b"%R1P,0,23:0,0\r\n"),
    (b"%R1Q,18007,24:1", b"%R1P,0,24:0\r\n"),
    (b"%R1Q,18008,25:", b"%R1P,0,25:0,1\r\n"),
    (b"%R1Q,1004,26:1", b"%R1P,0,26:0\r\n"),
    (b"%R1Q,23,27:", b"%R1P,0,27:5\r\n"),
    (b"%R1Q,9027,28:1.0", b"%R1P,0,28:2\r\n"),
    (b"%R1Q,9027,29:nan,1.0,0,0,0", b"%R1P,0,29:2\r\n"),
    (b"%R1Q,112,30:0", b"%R1P,0,30:0\r\n"),
    (b"%R1Q,0,31:", b"%R1P,3109,31:0\r\n"),
    (b"%R1Q,111,32:1", b"%R1P,0,32:0\r\n"),
    (b"%R1Q,0,33:", b"%R1P,0,33:0\r\n"),
    (b"%R1Q,0", b"%R1P,3080,0:0\r\n"),
    (b"c", b"?\r\n"),
    (b"R1Q,0,1:", None),
    (b"", None),
]


def test_a_session_byte_for_byte(station):
    for request, answer in GOLDEN:
        assert station.respond(request) == answer, request


def test_a_measurement_is_where_the_reflector_is(quiet):
    station, plant = MockStation(quiet.plant), quiet.plant
    ask(station, 107, 15)
    assert aim_at(station, plant, "P2") == (0, [])
    ask(station, 2028, 0.658e-6, plant.thermal.pressure_hpa(0.0), plant.thermal.air_c(0.0), 15.0)
    assert ask(station, 2008, 1, 1) == (0, [])
    code, values = ask(station, 2167, 5000, 1)
    polar = seen(plant, "P2").polar
    assert code == 0
    assert values[0] == pytest.approx(polar.hz_rad + 1e-6 / math.sin(polar.v_rad), abs=WARMING_RAD)
    assert values[1] == pytest.approx(polar.v_rad + 1e-6, abs=WARMING_RAD)
    assert values[6] == pytest.approx(polar.distance_m, abs=10e-6)
    assert ask(station, 2108, 5000, 1)[1] == pytest.approx([values[0], values[1], values[6]], abs=1e-14)


def test_coordinates_are_east_north_height(quiet):
    station, plant = MockStation(quiet.plant), quiet.plant
    ask(station, 107, 15)
    aim_at(station, plant, "SR")
    code, (hz, v, d) = ask(station, 2117)
    expected = [d * math.sin(v) * math.sin(hz), d * math.sin(v) * math.cos(hz), d * math.cos(v)]
    assert code == 0
    assert ask(station, 2116, 1000, 1)[1] == pytest.approx(expected)
    assert ask(station, 2082, 1000, 1)[1][:3] == pytest.approx(expected)
    east, north, up = expected
    assert (east > 1.0, north > 3.0, up > 0.7) == (True, True, True)  # right, ahead, above


def test_the_two_faces_differ_by_twice_the_errors_and_their_mean_is_free_of_them(quiet):
    station, plant = MockStation(quiet.plant), quiet.plant
    ask(station, 107, 15)
    aim_at(station, plant, "P1")
    _, (hz1, v1, d1) = ask(station, 2117)
    assert ask(station, 9028, 0, 1, 0) == (0, [])
    assert ask(station, 2026)[1] == [1]
    _, (hz2, v2, d2) = ask(station, 2117)
    polar = seen(plant, "P1").polar
    assert hz_difference(hz1, hz2 - math.pi) == pytest.approx(2e-6 / math.sin(polar.v_rad), abs=WARMING_RAD)
    mean = hz2 - math.pi + 0.5 * hz_difference(hz1, hz2 - math.pi)
    assert hz_difference(mean, polar.hz_rad) == pytest.approx(0.0, abs=WARMING_RAD)
    assert 0.5 * (v1 + 2 * math.pi - v2) == pytest.approx(polar.v_rad, abs=WARMING_RAD)
    assert d1 == pytest.approx(d2, abs=1e-7)


def test_noise_of_repeated_measurements_has_the_profile_s_size(standing):
    station, plant = MockStation(standing.plant), standing.plant
    ask(station, 107, 15)
    aim_at(station, plant, "P3")
    readings = np.array([ask(station, 2117)[1] for _ in range(400)])
    polar = seen(plant, "P3").polar
    sd = readings.std(axis=0) / [2.4e-6 / math.sin(polar.v_rad), 2.4e-6, 1e-4]
    assert sd == pytest.approx([1.0, 1.0, 1.0], rel=0.15)


def test_prism_constant_and_ppm_are_honoured(quiet):
    station, plant = MockStation(quiet.plant), quiet.plant
    ask(station, 107, 15)
    aim_at(station, plant, "P3")
    before = ask(station, 2117)[1][2]
    ask(station, 2024, 0.0175)
    assert ask(station, 2117)[1][2] - before == pytest.approx(0.0175, abs=1e-7)
    ask(station, 17008, 2)
    assert (ask(station, 17009)[1], ask(station, 2023)[1]) == ([2], [0.0344])
    assert ask(station, 2117)[1][2] - before == pytest.approx(0.0344, abs=1e-7)
    ask(station, 2024, 0.0)
    assert (ask(station, 17009)[1], ask(station, 2023)[1]) == ([2], [0.0])
    ppm_before = ask(station, 2151)[1][0]
    ask(station, 2028, 0, 900.0, 30.0, 25.0)
    assert ask(station, 2029)[1][1:] == [900.0, 30.0, 25.0]
    ppm_after = ask(station, 2151)[1][0]
    assert ppm_after == pytest.approx(ppm(30.0, 900.0, wet_c=25.0))
    change_m = ask(station, 2117)[1][2] - before
    assert change_m == pytest.approx(before * (ppm_after - ppm_before) * 1e-6, rel=0.01)


def test_aiming_needs_one_reflector_in_the_window(station, plant):
    polar = seen(plant, "P1").polar
    ask(station, 9027, polar.hz_rad + 0.02, polar.v_rad, 0, 0, 0)
    assert ask(station, 9037, 0.01, 0.01, 0)[0] == 8710
    assert ask(station, 9027, polar.hz_rad + 0.02, polar.v_rad, 0, 1, 0)[0] == 8710
    assert ask(station, 2117)[0] == 1285
    assert ask(station, 9029, 0.05, 0.05)[0] == 0
    ask(station, 9018, 0)
    assert ask(station, 9037, 0.01, 0.01, 0)[0] == 8714


def test_two_reflectors_side_by_side_cannot_be_told_apart(station, standing, plant):
    p1 = plant.truth.machine.file.smrs[0]
    twin = plant.truth.machine.file.smrs[1]
    object.__setattr__(twin, "position_m", (p1.position_m[0] + 0.003, *p1.position_m[1:]))
    assert aim_at(station, plant, "P1")[0] == 8711


def test_a_reflector_that_moved_away_gives_no_distance(station, standing, plant):
    aim_at(station, plant, "SL")
    standing.drives[0].put(1.2)
    assert ask(station, 2117) == (1285, [])
    assert ask(station, 2108, 100, 1) == (1285, [])


def test_a_locked_reflector_is_followed(station, standing, plant):
    aim_at(station, plant, "SL")
    assert ask(station, 9013)[0] == 8714
    ask(station, 9020, 1)
    assert ask(station, 9013)[0] == 0
    assert ask(station, 6021)[1] == [1]
    standing.drives[0].put(1.2)
    ask(station, 107, 15)
    assert ask(station, 2003, 1)[1][1] == pytest.approx(seen(plant, "SL").polar.v_rad, abs=2e-6)
    assert ask(station, 2117)[0] == 0
    ask(station, 9020, 0)
    assert ask(station, 6021)[1] == [0]


def test_turning_aiming_and_measuring_take_rig_time(station, plant, clock):
    start_s = clock.now_s()
    ask(station, 9027, 1.5, math.pi / 2, 0, 0, 0)
    assert clock.now_s() - start_s == pytest.approx(0.2 + 1.5 / 1.5)
    aim_at(station, plant, "P1")
    before_s = clock.now_s()
    ask(station, 2008, 1, 1)
    assert clock.now_s() == before_s
    assert ask(station, 2108, 300, 1)[0] == 1285  # not ready yet
    assert clock.now_s() == pytest.approx(before_s + 0.3)
    assert ask(station, 2108, 5000, 1)[0] == 0
    assert clock.now_s() == pytest.approx(before_s + 1.0)
    ask(station, 2020, 10)
    ask(station, 17017, 2)
    assert clock.now_s() == pytest.approx(before_s + 4.0)


def test_a_moving_reflector_is_measured_where_it_is_in_the_middle(machine_path, clock, quiet):
    class Mover:
        def encoder_m(self, t_s):
            return 1.118 + 1e-4 * t_s

        def set_point(self, t_s):
            return quiet.drives[0].set_point(t_s)

        def is_moving(self, t_s):
            return True

    quiet.plant.attach((Mover(), Mover()))
    telescope = Telescope(quiet.plant)
    target = seen(quiet.plant, "SL").polar
    telescope.turn_to(target.hz_rad, target.v_rad)
    telescope.aim()
    start_s = clock.now_s()
    measured = telescope.measure()
    middle = quiet.plant.sightings(start_s + 0.5)[3].polar
    assert measured.v_rad == pytest.approx(middle.v_rad + 1e-6, abs=1e-12)


def test_a_measurement_can_be_stopped(station, plant):
    aim_at(station, plant, "P1")
    ask(station, 2008, 1, 1)
    ask(station, 2008, 0, 1)
    assert ask(station, 2108, 5000, 1)[0] == 1285


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.one_of(
        st.binary(max_size=60),
        st.tuples(
            st.sampled_from([107, 2008, 2020, 2024, 2028, 2108, 9027, 9028, 9029, 9037, 17008, 17017, 1, 2]),
            st.lists(st.one_of(st.integers(), st.floats(), st.text("0123456789.e-", max_size=5)), max_size=6),
        ).map(lambda p: f"%R1Q,{p[0]},5:{','.join(map(str, p[1]))}".encode()),
    )
)
def test_the_station_survives_any_line(station, line):
    answer = station.respond(line)
    assert answer is None or answer == b"?\r\n" or (answer.startswith(b"%R1P,") and answer.endswith(b"\r\n"))
