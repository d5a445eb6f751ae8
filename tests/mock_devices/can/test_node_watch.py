"""What a mock drive watches and remembers: heartbeats, errors, parameters, event timers."""

from __future__ import annotations

import canopen
import pytest

from mock_devices.can.node_watch import ErrorHistory, HeartbeatConsumer, error_register
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from tests.mock_devices.images import MACHINE_ID


class Calls:
    def __init__(self):
        self.made = []

    def __call__(self, name):
        return lambda: self.made.append(name)


@pytest.fixture
def drive(bus_factory, clock):
    drive = DriveServer(
        1,
        MockAxis(name="left", partner_node_id=2, machine_id=MACHINE_ID, travel_m=(-1.0, 1.0), start_m=0.0),
        bus_factory(),
        clock,
    )
    yield drive
    drive.close()


@pytest.fixture
def master(bus_factory, drive):
    network = canopen.Network(bus_factory())
    network.NOTIFIER_CYCLE = 0.05
    network.connect()
    node = network.add_node(canopen.RemoteNode(1, drive._node.object_dictionary))
    node.sdo.RESPONSE_TIMEOUT = 5.0
    yield node
    network.disconnect()


def test_a_heartbeat_that_was_never_heard_is_not_missed(clock):
    calls = Calls()
    watch = HeartbeatConsumer(clock, calls("lost"), calls("found"))
    watch.configure(127 << 16 | 1000)
    assert watch.value == 127 << 16 | 1000
    clock.sleep_s(10.0)
    assert calls.made == []
    watch.on_heartbeat(126)
    clock.sleep_s(10.0)
    assert calls.made == []


def test_lost_found_and_lost_again(clock):
    calls = Calls()
    watch = HeartbeatConsumer(clock, calls("lost"), calls("found"))
    watch.configure(127 << 16 | 1000)
    for _ in range(20):
        watch.on_heartbeat(127)
        clock.sleep_s(0.5)
    assert calls.made == []
    clock.sleep_s(0.6)
    assert calls.made == ["lost"]
    clock.sleep_s(5.0)
    watch.on_heartbeat(127)
    assert calls.made == ["lost", "found"]
    clock.sleep_s(1.1)
    assert calls.made == ["lost", "found", "lost"]
    watch.close()
    watch.on_heartbeat(127)
    clock.sleep_s(5.0)
    assert len(calls.made) == 3


def test_the_last_eight_errors_newest_first():
    history = ErrorHistory()
    for code in range(1, 12):
        history.add(code)
    assert history.count() == 8
    assert [history.code(i) for i in (1, 8)] == [11, 4]
    history.write_count(0)
    assert (history.count(), history.code(1)) == (0, 0)
    with pytest.raises(Exception, match="0x06090030"):
        history.write_count(1)


def test_the_error_register_tells_communication_errors():
    assert [error_register(code) for code in (0, 0x2310, 0x8130)] == [0, 0x01, 0x11]


def test_parameters_are_lost_at_a_restart_unless_stored(master, drive, clock):
    sdo = master.sdo
    sdo[0x1800][2].raw = 5
    drive.power_cycle()
    assert sdo[0x1800][2].raw == 1
    sdo[0x1800][2].raw = 5
    with pytest.raises(canopen.SdoAbortedError):
        sdo[0x1010][1].raw = 1
    sdo[0x1010][1].raw = 0x65766173
    drive.power_cycle()
    assert sdo[0x1800][2].raw == 5
    sdo[0x1011][1].raw = 0x64616F6C
    assert sdo[0x1800][2].raw == 5
    drive.power_cycle()
    assert sdo[0x1800][2].raw == 1
    assert sdo[0x1018][4].raw == 0x53494D01


def test_a_pdo_by_its_event_timer(master, clock):
    frames = []
    master.network.subscribe(0x181, lambda _id, data, _t: frames.append(bytes(data)))
    master.sdo[0x1800][2].raw = 255
    master.sdo[0x1800][5].raw = 100
    clock.sleep_s(1.0)
    assert frames == []
    master.network.send_message(0x000, bytes([1, 1]))
    clock.sleep_s(1.05)
    assert len(frames) == 10
    master.network.send_message(0x000, bytes([128, 1]))
    clock.sleep_s(1.0)
    assert len(frames) == 10


def test_block_transfer_with_another_makes_client(master):
    data = bytes(range(250)) * 4
    with master.sdo[0x2101][1].open("wb", size=len(data), block_transfer=True) as stream:
        stream.write(data)
    with master.sdo[0x2101][1].open("rb", block_transfer=True) as stream:
        assert stream.read() == data
    assert master.sdo[0x2101][1].raw == data
