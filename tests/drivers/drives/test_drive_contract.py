"""One contract for drives and their line, run over every kind of bus that a test machine has.

`socketcan` needs a kernel's interface: it shares every line but the bus's name with these.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import can
import pytest

from drivers.can.bus import open_bus
from drivers.can.can_line import CanLine
from drivers.can.drive_object import DriveObject
from drivers.drives.cia402 import PROFILE_POSITION, State
from drivers.drives.drive_group import DriveGroup, GroupTiming
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.homing import HomingParameters
from drivers.drives.servo_drive import DriveExpectation, Heartbeat, ServoDrive
from drivers.errors import ConnectionFailed, DeviceError, DriveFault, NotReferenced, SdoRefused
from mock_devices.can.slcan_adapter import SlcanAdapter
from mock_devices.can.socketcand_server import SocketCandServer
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus

SLOW = 20.0  # rig seconds a second: what is host time elsewhere is multiplied by it
IMAGE = DriveObject(0x2101, 1, "", "image")
_channels = itertools.count()


class Bench:
    """Two mock drives, a line of some kind to them, and what ends that line."""

    def __init__(self, kind: str, stack: ExitStack) -> None:
        channel = f"contract {next(_channels)}"
        self.clock = ScaledClock(SLOW)
        stack.callback(self.clock.close)

        def bus() -> can.BusABC:
            if kind == "virtual":
                return can.Bus(interface="virtual", channel=channel)
            return EmbeddedBus(channel, self.clock)

        self.servers = []
        for node in (1, 2):
            server = DriveServer(
                node,
                MockAxis(
                    name=f"q{node}",
                    partner_node_id=3 - node,
                    machine_id=b"\0" * 16,
                    travel_m=(-0.5, 0.5),
                    start_m=0.0,
                    block_transfer=node == 1,
                ),
                bus(),
                self.clock,
            )
            stack.callback(server.close)
            self.servers.append(server)
        self.pull_plug: Callable[[], None] = lambda: None
        host_bus = self._host_bus(kind, channel, bus, stack)
        self.line = CanLine(host_bus, kind)
        stack.callback(self.line.close)
        self.drives = [
            ServoDrive(
                self.line,
                node,
                f"q{node}",
                self.clock,
                DriveExpectation(),
                partner_node_id=3 - node,
                master_node_id=127,
                timeouts=DriveTimeouts(
                    master_lost_ms=60_000,
                    heartbeat_ms=round(500 * SLOW),
                    heartbeat_late_s=SLOW,
                    heartbeat_lost_s=5.0 * SLOW,
                    state_s=3.0 * SLOW,
                ),
            )
            for node in (1, 2)
        ]
        self.group = DriveGroup(self.drives, self.clock, timing=GroupTiming(handshake_limit_s=SLOW))
        for drive in self.drives:
            drive.connect()

    def _host_bus(self, kind: str, channel: str, bus: Callable[[], can.BusABC], stack: ExitStack) -> can.BusABC:
        if kind == "socketcand":
            server = SocketCandServer(bus)
            stack.callback(server.close)
            self.pull_plug = server.close
            return open_bus("socketcand", "can0", *server.address)
        if kind == "slcan":
            adapter = SlcanAdapter(bus())
            stack.callback(adapter.close)
            self.pull_plug = adapter.close
            return open_bus("slcan", adapter.port, bitrate=1_000_000)
        return open_bus("virtual", channel)


@pytest.fixture(params=["virtual", "socketcand", "slcan"], scope="module")
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(request.param, stack)


def test_identity_units_heartbeat_and_watchdog(bench: Bench) -> None:
    for node, drive in enumerate(bench.drives, start=1):
        assert drive.identity is not None
        assert drive.identity.serial == int.from_bytes(b"SIM", "big") << 8 | node
        assert drive.limits_m == pytest.approx((-0.5, 0.5))
        assert drive.heartbeat() is Heartbeat.ALIVE
        assert drive.sdo.read(DriveObject(0x1016, 1, "<I", "watch")) == 127 << 16 | 60_000
        assert drive.sdo.read(DriveObject(0x6007, 0, "<h", "option")) == 3


def test_moves_and_samples(bench: Bench) -> None:
    bench.group.enable()
    for target in ([0.05, -0.05], [0.0, 0.0]):
        samples = bench.group.move_to(target, 0.2, 2.0)
        assert [s.position_m for s in samples] == pytest.approx(target, abs=1e-6)
        assert samples[0].t_rig_s == samples[1].t_rig_s
    bench.group.disable()
    assert all(drive.state() is State.SWITCH_ON_DISABLED for drive in bench.drives)


def test_long_objects_by_blocks_and_by_segments(bench: Bench) -> None:
    data = bytes(range(256)) * 2
    for drive in bench.drives:
        drive.sdo.write_bytes(IMAGE, data)
        assert drive.sdo.read_bytes(IMAGE) == data


def test_refusals_are_typed(bench: Bench) -> None:
    with pytest.raises(SdoRefused, match="no such object"):
        bench.drives[0].sdo.read(DriveObject(0x5555, 0, "<I", "nothing"))
    with pytest.raises(SdoRefused, match="outside"):
        bench.drives[0].write_target(0.9)


def test_a_drive_without_reference_is_homed_first(bench: Bench) -> None:
    server, drive = bench.servers[0], bench.drives[0]
    server.axis.absolute = False
    server.power_cycle()
    with pytest.raises(NotReferenced):
        drive.connect()
    drive.connect(unreferenced=True)
    bench.group.home([HomingParameters(34, 0.010, speed_m_per_s=0.01, limit_s=30.0 * SLOW), None])
    assert server.encoder_m(bench.clock.now_s()) == pytest.approx(0.010, abs=1e-8)
    drive.connect()
    bench.group.enable()
    samples = bench.group.move_to([0.0, 0.0], 0.2, 2.0)
    assert [s.position_m for s in samples] == pytest.approx([0.0, 0.0], abs=1e-6)
    bench.group.disable()


def test_targets_at_sync_in_cyclic_position_mode(bench: Bench) -> None:
    period_s = 0.2 * SLOW  # three of them without a SYNC are a fault, and this computer may be busy for a moment
    bench.group.set_cyclic_position(period_s)
    bench.group.enable()
    path = [[0.001 * k, -0.0005 * k] for k in range(5)]
    samples = bench.group.follow(path, 0.0011 / period_s)
    assert [s.demand_m for s in samples] == pytest.approx(path[-1], abs=2e-6)
    for drive, position_m in zip(bench.drives, (0.005, -0.0025), strict=True):
        drive.send_target(position_m)
    bench.line.send_sync()  # and no more
    bench.clock.sleep_s(4.0 * period_s)
    assert [drive.state() for drive in bench.drives] == [State.FAULT, State.FAULT]
    assert [drive.emergencies[-1].code for drive in bench.drives] == [0x8700, 0x8700]
    bench.group.fault_reset()
    bench.group.clear_stop()
    for drive in bench.drives:
        drive.set_mode(PROFILE_POSITION)


def test_one_fault_stops_both(bench: Bench) -> None:
    bench.group.enable()
    bench.clock.call_at(bench.clock.now_s() + 5.0, bench.servers[1].inject_fault)
    with pytest.raises(DriveFault, match="0x2310"):
        bench.group.move_to([0.45, 0.45], 0.002)  # for 11 s of host time
    limit_s = time.monotonic() + 5.0  # the frame is on its way, and this computer may be busy
    while bench.servers[0].is_moving(bench.clock.now_s()):
        assert time.monotonic() < limit_s
        bench.clock.sleep_s(0.1)
    assert bench.servers[0].encoder_m(bench.clock.now_s()) < 0.3
    bench.group.clear_stop()
    bench.group.fault_reset()
    bench.group.disable()


def test_a_line_that_is_gone_is_a_typed_error_and_no_spinning_core(bench: Bench) -> None:
    """The last test: the line does not come back."""
    if bench.line.name == "virtual":
        bench.line.mark_lost(RuntimeError("the bus is off"))
    bench.pull_plug()
    with bench.line.received:
        bench.line.received.wait_for(lambda: bench.line.failed, 5.0)
    with pytest.raises(ConnectionFailed, match="lost"):
        bench.line.send_sync()
    with pytest.raises(DeviceError):
        bench.drives[0].state()
