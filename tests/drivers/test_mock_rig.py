"""Drives and PLC of the whole mock rig together, over every kind of transport that a test machine has."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.can.can_line import CanLine
from drivers.drives.drive_group import DriveGroup
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from drivers.plc.modbus_line import TcpLine
from drivers.plc.plc import Plc, PlcTiming
from pkm_rig.rig.clock import ScaledClock
from tests.drivers.mock_rig_bench import TRANSPORTS, Bench, mock_rigs


@pytest.fixture(params=TRANSPORTS)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    yield from mock_rigs(request.param)


def test_two_drives(bench: Bench) -> None:
    slow = bench.clock.time_scale if isinstance(bench.clock, ScaledClock) else 1.0
    with CanLine(bench.new_bus(), "bus") as line:
        drives = [
            ServoDrive(
                line,
                node,
                f"q{node}",
                bench.clock,
                DriveExpectation(),
                partner_node_id=3 - node,
                timeouts=DriveTimeouts(
                    heartbeat_ms=round(500 * slow),
                    heartbeat_late_s=slow,
                    heartbeat_lost_s=5.0 * slow,
                    state_s=3.0 * slow,
                ),
            )
            for node in (1, 2)
        ]
        for drive in drives:
            drive.connect()
        group = DriveGroup(drives, bench.clock)
        start_m = [sample.position_m for sample in group.sample()]
        group.enable()
        target_m = [start_m[0] + 0.05, start_m[1] - 0.05]
        samples = group.move_to(target_m, 0.1, 1.0)
        assert [s.position_m for s in samples] == pytest.approx(target_m, abs=1e-6)
        group.disable()


def test_the_plc(bench: Bench) -> None:
    slow = bench.clock.time_scale if isinstance(bench.clock, ScaledClock) else 1.0
    host, port = bench.mock.plc_address
    plc = Plc(TcpLine(host, port), clock=bench.clock, timing=PlcTiming(heartbeat_limit_s=slow))
    try:
        state = plc.connect()
        state.require_safe()
        assert state.payload == 0
        assert 0.0 < state.humidity < 1.0
        assert set(state.temperatures_c) == {"air", "struts", "columns", "base", "platform"}
    finally:
        plc.close()
