"""The whole mock rig: started, reachable, repeatable, closed."""

from __future__ import annotations

import socket

import canopen
import pytest
import serial
from canopen.objectdictionary import eds

import mock_devices.drives.mock_drive
from mock_devices.machine_file import MachineFileError
from mock_devices.plant.plant import home_m
from mock_devices.rig import MockPorts, MockRig
from mock_devices.settings import MockSettings

EDS = mock_devices.drives.mock_drive.__file__.replace("mock_drive.py", "mock_drive.eds")


@pytest.fixture
def rig(machine_path, clock, bus_factory):
    with MockRig(machine_path, MockSettings(seed=5), clock, bus_factory, ports=MockPorts(socketcand_port=0)) as rig:
        yield rig


def test_everything_is_reachable_on_loopback(rig):
    with serial.serial_for_url(rig.station_url, timeout=10) as port:
        port.write(b"%R1Q,0,1:\r\n")
        assert port.read_until(b"\r\n") == b"%R1P,0,1:0\r\n"
    for host, port_number in (rig.plc_address, rig.socketcand_address):
        assert host == "127.0.0.1"
        socket.create_connection((host, port_number)).close()


def test_a_move_over_the_bus_moves_the_reflectors(rig, bus_factory, clock):
    network = canopen.Network(bus_factory())
    network.NOTIFIER_CYCLE = 0.05
    network.connect()
    before = rig.plant.sightings(clock.now_s())
    for node_id in (1, 2):
        sdo = network.add_node(canopen.RemoteNode(node_id, eds.import_eds(EDS, node_id))).sdo
        sdo.RESPONSE_TIMEOUT = 5.0
        for word in (0x06, 0x07, 0x0F):
            sdo[0x6040].raw = word
        sdo[0x607A].raw = 120_000_000
        sdo[0x6040].raw = 0x3F
    assert rig.plant.is_moving()
    clock.sleep_s(5.0)
    assert not rig.plant.is_moving()
    after = rig.plant.sightings(clock.now_s())
    moved = [b.polar.v_rad - a.polar.v_rad for a, b in zip(before, after, strict=True)]
    assert all(m == pytest.approx(-0.082 / 3.2, rel=0.15) for m in moved[:5])
    assert all(abs(m) < 1e-5 for m in moved[5:])
    x, y, rz = rig.plant.truth.tool_pose((1.2, 1.2), 0, clock.now_s())
    assert (x, y, rz) == pytest.approx((0.0, 0.082, 0.0), abs=1e-3)
    network.disconnect()


def test_the_station_can_be_behind_tcp(machine_path, clock, bus_factory):
    with MockRig(machine_path, MockSettings(), clock, bus_factory, ports=MockPorts(station="tcp")) as rig:
        assert rig.station_url.startswith("socket://127.0.0.1:")
        with pytest.raises(ValueError, match="no socketcand"):
            _ = rig.socketcand_address


def test_the_drives_start_at_pose_zero(rig, machine_file, clock):
    assert [d.encoder_m(clock.now_s()) for d in rig.drives] == pytest.approx([1.118033988749895] * 2, abs=1e-12)
    assert home_m(machine_file, 0) == pytest.approx(1.118033988749895)
    assert [d.node_id for d in rig.drives] == [1, 2]


def test_closing_twice_is_once_and_a_failed_start_leaves_nothing_behind(machine_path, clock, bus_factory, tmp_path):
    rig = MockRig(machine_path, MockSettings(), clock, bus_factory)
    rig.close()
    rig.close()
    taken = socket.create_server(("127.0.0.1", 0))
    with taken, pytest.raises(OSError, match="cannot listen"):
        MockRig(machine_path, MockSettings(), clock, bus_factory, ports=MockPorts(plc_port=taken.getsockname()[1]))
    bad = tmp_path / "bad.toml"
    bad.write_text("format = 2")
    with pytest.raises(MachineFileError):
        MockRig(bad, MockSettings(), clock, bus_factory)
    with pytest.raises(ValueError, match="2 drives, 1 node ids"):
        MockRig(machine_path, MockSettings(), clock, bus_factory, node_ids=(1,))
