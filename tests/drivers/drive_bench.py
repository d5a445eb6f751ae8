"""Two mock drives and our drivers on a bus that loses frames on request, in virtual time."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field

import can

from drivers.can.can_line import CanLine
from drivers.drives.drive_group import DriveGroup, GroupTiming
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from mock_devices.can.sync_moments import SyncMoments
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from mock_devices.faults import FaultPlan
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus

MASTER = 127
GUARD_S = 1.0  # host time: a computer that is busy for a moment is no lost frame
_channels = itertools.count()


class LossyBus(EmbeddedBus):
    """Loses the frames of the host that the test names, or has one come late; keeps those that the host sends.

    `misses` is asked of each frame that comes, and `overtaken`: where that says yes, what it has had sent comes first.
    """

    def __init__(self, channel: str, clock: VirtualClock) -> None:
        super().__init__(channel, clock)
        self.loses: Callable[[can.Message], bool] = lambda _frame: False
        self.misses: Callable[[can.Message], bool] = lambda _frame: False
        self.overtaken: Callable[[can.Message], bool] = lambda _frame: False
        self.sent: list[can.Message] = []
        self.late = -1  # the first frame with this identifier comes only with the second
        self._held: list[can.Message] = []
        self._due: list[can.Message] = []

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._due:
            return self._due.pop()
        frame = super().recv(timeout)
        if frame is None or self.misses(frame):
            return None
        if self.overtaken(frame):
            self._due.append(frame)
            return super().recv(timeout)
        if frame.arbitration_id == self.late:
            if not self._held:
                self._held.append(frame)
                return None
            self.late, self._due = -1, [frame]
            return self._held.pop()
        return frame

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.sent.append(msg)
        if not self.loses(msg):
            super().send(msg, timeout)


@dataclass
class Bench:
    clock: VirtualClock
    bus: LossyBus
    line: CanLine
    servers: list[DriveServer]
    drives: list[ServoDrive]
    group: DriveGroup
    beating: bool = field(default=True)

    def beat(self) -> None:
        if self.beating:
            self.line.send_heartbeat(MASTER)
            self.clock.call_at(self.clock.now_s() + 0.25, self.beat)


Open = Callable[..., Bench]


def benches() -> Iterator[Open]:
    """What opens benches one at a time, closing that before; its pieces are the mock drives and our own drivers."""
    with ExitStack() as stack:

        def make(faults: FaultPlan | None = None, *, blocks: bool = True, absolute: bool = True) -> Bench:
            stack.close()
            channel, clock = f"supervision {next(_channels)}", VirtualClock()
            stack.callback(clock.close)
            servers, moments = [], SyncMoments(clock)
            for node in (1, 2):
                server = DriveServer(
                    node,
                    MockAxis(
                        name=f"q{node}",
                        partner_node_id=3 - node,
                        machine_id=b"\0" * 16,
                        travel_m=(-0.5, 0.5),
                        start_m=0.0 if absolute else 0.003,
                        is_first=node == 1,
                        absolute_encoder=absolute,
                        block_transfer=blocks,
                    ),
                    EmbeddedBus(channel, clock),
                    clock,
                    faults=faults or FaultPlan(),
                    sync_moments=moments,
                )
                stack.callback(server.close)
                servers.append(server)
            bus = LossyBus(channel, clock)
            line = CanLine(bus, "bus")
            stack.callback(line.close)
            drives = [
                ServoDrive(
                    line,
                    n,
                    f"q{n}",
                    clock,
                    DriveExpectation(),
                    partner_node_id=3 - n,
                    master_node_id=MASTER,
                    timeouts=DriveTimeouts(sdo_s=GUARD_S),
                )
                for n in (1, 2)
            ]
            stack.enter_context(clock.activity())
            bench = Bench(
                clock, bus, line, servers, drives, DriveGroup(drives, clock, timing=GroupTiming(pdo_timeout_s=GUARD_S))
            )
            for drive in drives:
                drive.connect(unreferenced=not absolute)
            bench.beat()
            return bench

        yield make
