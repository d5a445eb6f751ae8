"""Contract of the drivers with the mock drives, which were written from the same page and by other hands."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.can.can_line import CanLine
from drivers.drives.cia402 import State
from drivers.drives.drive_group import DriveGroup
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.servo_drive import DriveExpectation, Heartbeat, ServoDrive
from drivers.drives.table_bank import CompensationMode, TableBank
from drivers.drives.table_group import Activation, activate_all
from drivers.drives.table_image import TableImage, machine_id_of
from drivers.errors import ConnectionFailed, DriveFault, SdoRefused, Stopped
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from tests.drivers.drives.test_table_image import make_image

_channels = itertools.count()


@dataclass
class Bench:
    clock: VirtualClock
    line: CanLine
    servers: list[DriveServer]
    drives: list[ServoDrive]
    group: DriveGroup
    banks: list[TableBank]


@pytest.fixture
def bench() -> Iterator[Bench]:
    channel = f"mock drives {next(_channels)}"
    with ExitStack() as stack:
        clock = VirtualClock()
        stack.callback(clock.close)
        servers = []
        for node in (1, 2):
            server = DriveServer(
                node,
                MockAxis(
                    name=f"q{node}",
                    partner_node_id=3 - node,
                    machine_id=machine_id_of("planar4"),
                    travel_m=(-0.5, 0.5),
                    start_m=0.0,
                ),
                EmbeddedBus(channel, clock),
                clock,
            )
            stack.callback(server.close)
            servers.append(server)
        line = CanLine(EmbeddedBus(channel, clock), "bus")
        stack.callback(line.close)
        drives = [
            ServoDrive(
                line, n, f"q{n}", clock, DriveExpectation(), partner_node_id=3 - n, timeouts=DriveTimeouts(sdo_s=0.2)
            )
            for n in (1, 2)
        ]
        with clock.activity():
            for drive in drives:
                drive.connect()
            yield Bench(clock, line, servers, drives, DriveGroup(drives, clock), [TableBank(d) for d in drives])


def _image(node: int, generation: int, payload_kg: float = 0.0) -> TableImage:
    corrections = np.full((5, 5), 20e-6 * node)
    return make_image(
        corrections,
        node_id=node,
        generation=generation,
        payload_kg=payload_kg,
        own_start_m=-0.2,
        own_step_m=0.1,
        partner_start_m=-0.2,
        partner_step_m=0.1,
    )


def _compensate(bench: Bench, payload_kg: float = 0.0) -> None:
    bench.group.disable()
    for bank in bench.banks:
        bank.set_mode(CompensationMode.OFF)
    written = [b.write_inactive(_image(b.drive.node_id, b.state().next_generation, payload_kg)) for b in bench.banks]
    activate_all([Activation(b, w.bank, w.crc, w.generation) for b, w in zip(bench.banks, written, strict=True)])
    for bank in bench.banks:
        bank.set_payload(0.0)
        bank.set_mode(CompensationMode.KEPT)
    bench.group.enable()


def test_identity_units_and_heartbeat(bench: Bench) -> None:
    drive = bench.drives[0]
    assert drive.identity is not None
    assert drive.limits_m == pytest.approx((-0.5, 0.5))
    assert drive.heartbeat() is Heartbeat.ALIVE
    bench.clock.sleep_s(60.0)
    assert drive.heartbeat() is Heartbeat.ALIVE


def test_an_absent_node(bench: Bench) -> None:
    absent = ServoDrive(bench.line, 9, "q9", bench.clock, timeouts=DriveTimeouts(sdo_s=0.05))
    with pytest.raises(ConnectionFailed, match="node id 9"):
        absent.connect()


def test_moves(bench: Bench) -> None:
    bench.group.enable()
    for target in ([0.1, -0.1], [0.0, 0.2], [-0.3, 0.2]):
        samples = bench.group.move_to(target, 0.1, 1.0)
        assert [s.position_m for s in samples] == pytest.approx(target, abs=1e-6)
    began_s = bench.clock.now_s()
    bench.group.move_to([0.1, -0.2], 0.1, 1.0)
    assert 4.0 < bench.clock.now_s() - began_s < 6.0


def test_out_of_limits_nothing_moves(bench: Bench) -> None:
    bench.group.enable()
    with pytest.raises(SdoRefused, match="outside"):
        bench.group.move_to([0.1, 0.6], 0.1)
    assert [s.position_m for s in bench.group.sample()] == pytest.approx([0.0, 0.0], abs=1e-6)
    bench.group.move_to([0.1, 0.1], 0.1)


def test_stop_in_motion(bench: Bench) -> None:
    bench.group.enable()
    bench.clock.call_at(bench.clock.now_s() + 1.0, lambda: bench.group.stop_all("guard open"))
    with pytest.raises(Stopped, match="guard open"):
        bench.group.move_to([0.4, 0.4], 0.1)
    bench.clock.sleep_s(1.0)
    samples = bench.group.sample()
    assert all(s.velocity_m_per_s == 0.0 and 0.05 < s.position_m < 0.2 for s in samples)
    bench.group.clear_stop()
    bench.group.enable()
    bench.group.move_to([0.0, 0.0], 0.1)


def test_a_fault_in_motion_stops_both(bench: Bench) -> None:
    bench.group.enable()
    bench.clock.call_at(bench.clock.now_s() + 1.0, bench.servers[1].inject_fault)
    with pytest.raises(DriveFault, match=r"q2.*0x2310"):
        bench.group.move_to([0.4, 0.4], 0.1)
    bench.clock.sleep_s(1.0)
    assert abs(bench.group.sample()[0].position_m - 0.1) < 5e-3  # at once, not at the next poll
    assert bench.drives[0].state() is not State.OPERATION_ENABLED
    bench.group.clear_stop()
    bench.group.fault_reset()
    bench.group.enable()
    bench.group.move_to([0.0, 0.0], 0.1)


def test_compensated_motion(bench: Bench) -> None:
    _compensate(bench)
    assert all(bank.state().valid for bank in bench.banks)
    samples = bench.group.move_to([0.1, -0.1], 0.1, 1.0)
    assert [s.position_m for s in samples] == pytest.approx([0.1, -0.1], abs=1e-6)
    t_s = bench.clock.now_s()
    encoder_m = [server.encoder_m(t_s) for server in bench.servers]
    assert encoder_m == pytest.approx([0.1 + 20e-6, -0.1 + 40e-6], abs=1e-6)
    with pytest.raises(SdoRefused, match="grid"):
        bench.group.move_to([0.3, 0.0], 0.1)
    with pytest.raises(SdoRefused, match="disable the drive"):
        bench.banks[0].set_mode(CompensationMode.OFF)


def test_another_payload_makes_the_table_invalid(bench: Bench) -> None:
    _compensate(bench)
    for bank in bench.banks:
        bank.set_payload(200.0)
    assert not bench.banks[0].state().valid
    with pytest.raises(SdoRefused, match="no valid table"):
        bench.group.move_to([0.1, 0.1], 0.1)


def test_roll_back_to_the_former_tables(bench: Bench) -> None:
    _compensate(bench)
    first = [bank.state() for bank in bench.banks]
    _compensate(bench)
    bench.group.disable()
    activate_all([Activation(b, s.active, s.crc, s.generation) for b, s in zip(bench.banks, first, strict=True)])
    assert [bank.state().generation for bank in bench.banks] == [s.generation for s in first]


def test_a_restart_is_noticed_and_connecting_again_helps(bench: Bench) -> None:
    bench.group.enable()
    bench.servers[0].power_cycle()
    bench.clock.sleep_s(0.01)
    with pytest.raises(DriveFault, match="restarted"):
        bench.group.move_to([0.1, 0.1], 0.1)
    bench.drives[0].connect()
    bench.group.enable()
    bench.group.move_to([0.1, 0.1], 0.1)


def test_a_drive_that_came_back_moves_with_compensation(bench: Bench) -> None:
    bench.servers[0].power_cycle()
    bench.clock.sleep_s(0.01)
    bench.drives[0].connect()
    _compensate(bench)
    bench.group.enable()
    bench.group.move_to([0.1, -0.1], 0.1)


def test_time_for_a_move(bench: Bench) -> None:
    """Rig hours pass quickly: 40 moves of some seconds each."""
    bench.group.enable()
    for i in range(40):
        bench.group.move_to([0.1 * (-1) ** i, 0.1], 0.05, 1.0)
    assert bench.clock.now_s() > 100.0
