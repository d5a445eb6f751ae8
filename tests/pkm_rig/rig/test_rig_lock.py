from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys

import can
import pytest
import serial

from drivers.can.bus import open_bus
from drivers.errors import ConnectionFailed, DeviceError
from drivers.station.geocom import GeoComSession
from mock_devices.can.slcan_adapter import SlcanAdapter
from pkm_rig.errors import StoreError
from pkm_rig.jobs.session import open_rig
from pkm_rig.rig import rig_lock
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import load_rig, mock_rig_path
from pkm_rig.rig.rig_lock import device_addresses

HOLDS = """
import sys
from pathlib import Path
from pkm_rig.rig import rig_lock
from pkm_rig.rig.config import load_rig, mock_rig_path
rig_lock.lock_folder = lambda: Path(sys.argv[1])
with rig_lock.rig_lock(load_rig(mock_rig_path())[0]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def locks(tmp_path, monkeypatch):
    monkeypatch.setattr(rig_lock, "lock_folder", lambda: tmp_path / "locks")
    return tmp_path / "locks"


@pytest.fixture
def file():
    return load_rig(mock_rig_path())[0]


def test_a_rig_of_another_process_is_refused_until_that_is_killed(locks, file):
    arguments = [sys.executable, "-c", HOLDS, locks]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(StoreError, match=rf"the station at .* is in use by '-c .*', process {process.pid} of"):
            rig_lock.rig_lock(file).__enter__()
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=10)
    with rig_lock.rig_lock(file):
        pass
    with rig_lock.rig_lock(file):
        pass


def test_a_command_does_not_touch_a_rig_that_another_one_has(locks, file):
    """Nothing listens where these devices would be: they are not even asked."""
    with rig_lock.rig_lock(file), pytest.raises(StoreError, match=r"the station at .* is in use by"):
        open_rig(mock_rig_path()).__enter__()
    with pytest.raises(DeviceError):
        open_rig(mock_rig_path()).__enter__()


def test_another_rig_file_with_one_of_the_devices_is_refused(locks, file):
    station = file.station.model_copy(update={"port": "/dev/ttyOTHER"})
    can = file.can.model_copy(update={"port": file.can.port + 1})
    other = file.model_copy(update={"station": station, "can": can})
    with rig_lock.rig_lock(file):
        with pytest.raises(StoreError, match=f"the PLC at {file.plc.host}:{file.plc.port} is in use"):
            rig_lock.rig_lock(other).__enter__()
        apart = other.model_copy(update={"plc": file.plc.model_copy(update={"port": file.plc.port + 1})})
        with rig_lock.rig_lock(apart):
            pass
    with rig_lock.rig_lock(other):  # those that it had taken before were given back
        pass


def test_a_link_to_a_port_is_the_port(locks, file, tmp_path):
    """Also two names of one device, as /dev/serial/by-id has them."""
    (tmp_path / "port").touch()
    (tmp_path / "link").symlink_to(tmp_path / "port")
    first, second = (
        file.model_copy(update={"station": file.station.model_copy(update={"port": str(tmp_path / name)})})
        for name in ("port", "link")
    )
    assert device_addresses(first) == device_addresses(second)


def test_this_computer_is_one_whatever_it_is_called(file):
    here = file.model_copy(update={
        "plc": file.plc.model_copy(update={"host": "LOCALHOST"}),
        "can": file.can.model_copy(update={"host": "::1"}),
    })  # fmt: skip
    there = file.model_copy(update={"plc": file.plc.model_copy(update={"host": "192.0.2.1"})})
    assert file.plc.host == file.can.host == "127.0.0.1"
    assert device_addresses(here) == device_addresses(file) != device_addresses(there)


def test_a_serial_plc_and_adapter_are_their_ports(file):
    plc = file.plc.model_copy(update={"transport": "rtu", "serial_port": "/dev/ttyRTU"})
    can = file.can.model_copy(update={"interface": "slcan", "channel": "/dev/ttySLCAN"})
    addresses = device_addresses(file.model_copy(update={"plc": plc, "can": can}))
    assert addresses[1:] == [("CAN bus", "/dev/ttySLCAN"), ("PLC", "/dev/ttyRTU")]


def test_all_users_share_the_folder(locks, file):
    with rig_lock.rig_lock(file):
        assert locks.stat().st_mode & 0o7777 == 0o1777
        assert {path.stat().st_mode & 0o777 for path in locks.iterdir()} == {0o666}


def test_the_stations_port_is_opened_exclusively():
    """Freed by the kernel when its process ends, however that is."""
    master, slave = pty.openpty()
    name = os.ttyname(slave)
    connection = GeoComSession("station", name, VirtualClock())
    with pytest.raises(serial.SerialException, match="exclusively lock"):
        serial.Serial(name, exclusive=True)
    with pytest.raises(ConnectionFailed, match="another program has the port; end"):
        GeoComSession("station", name, VirtualClock())
    connection.close()
    serial.Serial(name, exclusive=True).close()
    os.close(master)
    os.close(slave)


def test_an_adapters_port_is_opened_exclusively_and_not_touched_while_another_program_has_it():
    """Freed by the kernel when its process ends, however that is."""
    adapter = SlcanAdapter(can.Bus(interface="virtual", channel="exclusive adapter"))
    first = open_bus("slcan", adapter.port, bitrate=1_000_000)
    with pytest.raises(serial.SerialException, match="exclusively lock"):
        serial.Serial(adapter.port, exclusive=True)
    with pytest.raises(ConnectionFailed, match="another program has the port; end that program"):
        open_bus("slcan", adapter.port, bitrate=1_000_000)
    heard = None
    with can.Bus(interface="virtual", channel="exclusive adapter") as drive:
        for _ in range(50):  # the adapter may not have opened its line yet
            drive.send(can.Message(arbitration_id=0x701, data=[5], is_extended_id=False))
            if (heard := first.recv(0.2)) is not None:
                break
    assert heard is not None
    assert (heard.arbitration_id, bytes(heard.data)) == (0x701, b"\x05")
    first.shutdown()
    open_bus("slcan", adapter.port, bitrate=1_000_000).shutdown()
    adapter.close()
