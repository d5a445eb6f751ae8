"""The station's lines: a real client over a pty and over TCP."""

from __future__ import annotations

import math
import os

import pytest
import serial
from geocompy.communication import SerialConnection
from geocompy.geo import GeoCom
from geocompy.geo.gcdata import EDMModeV2, Face, Inclination, Measurement, Prism

from mock_devices.plant.plant import Plant
from mock_devices.settings import MockSettings
from mock_devices.station.mock_station import MockStation
from mock_devices.station.station_server import PtyStationServer, TcpStationServer
from pkm_rig.rig.clock import VirtualClock
from tests.mock_devices.standing import StandingPlant


@pytest.fixture(params=[PtyStationServer, TcpStationServer])
def server(plant, request):
    server = request.param(MockStation(plant))
    yield server
    server.close()


def exchange(port, line):
    port.write(line)
    return port.read_until(b"\r\n")


def test_a_client_gets_its_answer_and_the_next_client_too(server):
    for _ in range(2):
        with serial.serial_for_url(server.url, timeout=10) as port:
            assert exchange(port, b"\n%R1Q,0,1:\r\n") == b"%R1P,0,1:0\r\n"
            assert exchange(port, b"garbage\n%R1Q,108,2:\r\n") == b"%R1P,0,2:0,4\r\n"


def test_a_request_in_pieces_is_one_request(server):
    with serial.serial_for_url(server.url, timeout=10) as port:
        port.write(b"%R1Q,1")
        port.write(b"10,7:\r")
        assert exchange(port, b"\n") == b"%R1P,0,7:0,1,50,0\r\n"


def test_a_bad_line_can_be_played(server):
    with serial.serial_for_url(server.url, timeout=10) as port:
        server.tamper = lambda answer: answer[1:]
        assert exchange(port, b"%R1Q,0,1:\r\n") == b"R1P,0,1:0\r\n"
        server.tamper = lambda _answer: None
        port.write(b"%R1Q,0,2:\r\n")
        server_side_done = b"%R1Q,0,3:\r\n"
        port.timeout = 0.2
        assert port.read_until(b"\r\n") == b""
        server.tamper = None
        port.timeout = 10
        assert exchange(port, server_side_done) == b"%R1P,0,3:0\r\n"


def test_closing_twice_is_once_and_frees_the_pty(plant):
    server = PtyStationServer(MockStation(plant))
    path = server.url
    server.close()
    server.close()
    assert not os.path.exists(path)


@pytest.fixture(scope="module")
def geocom(machine_path):
    """geocompy's own client, checksums on. Its constructor takes a second of host time: one for all."""
    clock = VirtualClock()
    plant = StandingPlant(Plant(machine_path, MockSettings(seed=3), clock)).plant
    server = PtyStationServer(MockStation(plant))
    port = serial.serial_for_url(server.url, timeout=10)
    with clock.activity():
        yield GeoCom(SerialConnection(port), checksum=True), plant
    port.close()
    server.close()
    clock.close()


def test_geocompy_accepts_every_answer(geocom):
    client, _ = geocom
    assert client.com.set_double_precision(15).error == 0
    values = [
        client.com.get_double_precision(),
        client.com.get_geocom_version(),
        client.csv.get_instrument_name(),
        client.csv.get_serial_number(),
        client.csv.get_firmware_version(),
        client.csv.get_voltage_battery(),
        client.csv.get_internal_temperature(),
        client.tmc.get_angle(Inclination.AUTO),
        client.tmc.get_angle_inclination(Inclination.AUTO),
        client.tmc.get_edm_mode_v2(),
        client.tmc.get_prism_correction(),
        client.tmc.get_atmospheric_corrections(),
        client.tmc.get_atmospheric_correction_ppm(),
        client.tmc.get_face(),
        client.aut.get_atr_status(),
        client.aut.get_lock_status(),
        client.aus.get_user_lock_state(),
        client.mot.get_lockon_status(),
        client.bap.get_prism_type(),
    ]
    for response in values:
        assert response.error == 0, response
        assert response.params is not None, response
    assert client.csv.get_instrument_name().params == "MOCK TDRA"
    assert client.edm.switch_laserpointer(True).error == 0


def test_geocompy_sets_what_it_reads_back(geocom):
    client, _ = geocom
    assert client.bap.set_prism_type(Prism.MINI).error == 0
    assert client.bap.get_prism_type().params is Prism.MINI
    assert client.tmc.set_prism_correction(0.0).error == 0
    assert client.tmc.get_prism_correction().params == 0.0
    assert client.tmc.set_edm_mode_v2(EDMModeV2.SINGLE_STANDARD).error == 0
    assert client.tmc.get_edm_mode_v2().params is EDMModeV2.SINGLE_STANDARD
    assert client.tmc.set_atmospheric_corrections(658e-9, 1001.0, 21.5, 15.0).error == 0
    assert client.tmc.get_atmospheric_corrections().params[1:] == (1001.0, 21.5, 15.0)


def test_geocompy_aims_and_measures(geocom):
    client, plant = geocom
    client.com.set_double_precision(15)
    polar = plant.sightings(plant.clock.now_s())[0].polar
    assert client.aut.turn_to(polar.hz_rad + 1e-3, polar.v_rad).error == 0
    assert client.aut.fine_adjust(0.01, 0.01).error == 0
    assert client.tmc.do_measurement(Measurement.DISTANCE).error == 0
    full = client.tmc.get_complete_measurement(5)
    assert full.error == 0
    assert float(full.params[1]) == pytest.approx(polar.v_rad, abs=2e-5)
    assert full.params[6] == pytest.approx(polar.distance_m, abs=1e-3)
    for response in (
        client.tmc.get_simple_measurement(5),
        client.tmc.get_coordinate(5),
        client.tmc.get_simple_coordinate(5),
        client.tmc.quick_distance(),
        client.bap.measure_distance_angle(),
    ):
        assert response.error == 0, response
        assert response.params is not None, response
    assert client.aut.change_face().error == 0
    assert client.tmc.get_face().params is Face.F2
    assert client.aut.search(0.05, 0.05).error == 0
    assert client.aut.switch_lock(True).error == 0
    assert client.aut.lock_in().error == 0
    assert client.aut.turn_to(math.pi, 1.0).error == 0
    assert client.aut.fine_adjust(0.01, 0.01).error == 8710
    assert client.com.switch_to_local().error == 5
