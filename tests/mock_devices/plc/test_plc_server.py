"""The PLC with pymodbus' own client."""

from __future__ import annotations

import logging
import struct
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

import calibration
from mock_devices.plant.plant import Plant
from mock_devices.plc.plc_server import PlcServer, PlcState
from mock_devices.settings import MockSettings, PlcReading

MACHINE = Path(calibration.__file__).parent / "machine" / "data" / "planar4.toml"

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


@pytest.fixture
def plc(plant):
    plc = PlcServer(plant)
    yield plc
    plc.close()


@pytest.fixture
def client(plc):
    host, port = plc.address
    client = ModbusTcpClient(host, port=port, retries=0, timeout=10)
    assert client.connect()
    yield client
    client.close()


def read(client, address, count=1):
    answer = client.read_holding_registers(address, count=count, device_id=1)
    assert not answer.isError()
    return answer.registers


def floats(client, address, count):
    words = read(client, address, 2 * count)
    return struct.unpack(f">{count}f", struct.pack(f">{2 * count}H", *words))


def command(client, sequence, code, argument):
    assert not client.write_registers(31, [sequence, code, argument], device_id=1).isError()
    return read(client, 34, 2)


def test_values_are_where_the_document_says(client, plant, clock):
    clock.sleep_s(12.34)
    assert read(client, 0, 3) == [123, 0b1111, 0]
    thermal, t_s = plant.thermal, clock.now_s()
    expected = [thermal.sensor_c(name, t_s) for name in ("air", "struts", "columns", "base", "platform")]
    assert floats(client, 4, 5) == pytest.approx(expected, abs=1e-5)
    pressure_hpa, humidity = floats(client, 14, 2)
    assert pressure_hpa == pytest.approx(thermal.pressure_hpa(t_s), abs=1e-3)
    assert 30.0 < humidity < 60.0
    for name, value in zip(("struts", "platform"), floats(client, 6, 4)[::3], strict=True):
        assert value == pytest.approx(thermal.part_c(name, t_s), abs=0.02)


def test_the_heartbeat_wraps(client, clock):
    clock.sleep_s(6553.65)
    assert read(client, 0)[0] == 0


def test_an_operator_needs_a_minute_for_a_payload(client, plant, clock):
    assert command(client, 1, 1, 2) == [1, 2]
    assert read(client, 2) == [65535]
    clock.sleep_s(59.9)
    assert read(client, 2) == [65535]
    assert plant.payload == 0
    clock.sleep_s(0.2)
    assert read(client, 2) == [2]
    assert read(client, 34, 2) == [1, 0]
    assert plant.payload == 2


def test_a_command_is_taken_once_for_each_sequence(client, clock):
    command(client, 5, 1, 1)
    clock.sleep_s(61.0)
    assert command(client, 5, 1, 0) == [5, 0]
    assert read(client, 2) == [1]
    assert command(client, 6, 1, 1) == [6, 0]  # it is on already


@pytest.mark.parametrize(("code", "argument"), [(1, 3), (2, 0), (0, 0)])
def test_unknown_commands_and_payloads_are_refused(client, code, argument):
    assert command(client, 9, code, argument) == [9, 1]


def test_no_payload_change_while_a_drive_moves_or_another_is_under_way(client, standing, clock):
    standing.drives[1].moving = True
    assert command(client, 1, 1, 1) == [1, 1]
    standing.drives[1].moving = False
    assert command(client, 2, 1, 1) == [2, 2]
    assert command(client, 3, 1, 2) == [3, 1]
    clock.sleep_s(61.0)
    assert read(client, 34, 2) == [3, 1]
    assert read(client, 2) == [1]


def test_interlocks_can_be_opened_and_closed(client, plc):
    plc.set_interlock(1, good=False)
    assert read(client, 1) == [0b1101]
    plc.set_interlock(1, good=True)
    assert read(client, 1) == [0b1111]


def test_other_units_registers_and_functions_are_refused_without_harm(client):
    assert client.read_holding_registers(0, count=1, device_id=7).exception_code == 11
    assert client.write_registers(0, [1], device_id=1).isError()
    assert client.write_registers(34, [1], device_id=1).isError()
    assert client.read_holding_registers(50, count=20, device_id=1).isError()
    assert client.read_coils(0, count=1, device_id=1).isError()
    assert read(client, 1) == [0b1111]


def test_a_port_in_use_is_an_error(plc, plant):
    with pytest.raises(OSError, match="cannot listen"):
        PlcServer(plant, port=plc.address[1])


def test_closing_twice_is_once(plant):
    plc = PlcServer(plant)
    plc.close()
    plc.close()


@pytest.mark.parametrize(
    ("reading", "complaint"),
    [
        (PlcReading("coolant", 36), "register 36 is not free in the mock PLC; use 37 to 58"),
        (PlcReading("coolant", 59), "register 59 is not free"),
        (PlcReading("coolant", 40, part="spindle"), "no part 'spindle'"),
    ],
)
def test_further_registers_that_cannot_be(clock, reading, complaint):
    with pytest.raises(ValueError, match=complaint):
        PlcState(Plant(MACHINE, MockSettings(plc_readings=(reading,)), clock))
