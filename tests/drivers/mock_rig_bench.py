"""The whole mock rig for contract tests, over every kind of transport that a test machine has."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import can

import calibration
from drivers.can.bus import open_bus
from mock_devices.faults import FaultPlan
from mock_devices.rig import MockPorts, MockRig
from mock_devices.settings import MockSettings
from pkm_rig.rig.clock import RigClock, ScaledClock, VirtualClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus

MACHINE = Path(calibration.__file__).parent / "machine" / "data" / "planar4.toml"
TRANSPORTS = ("one process", "sockets")
_channels = itertools.count()


@dataclass
class Bench:
    clock: RigClock
    mock: MockRig
    new_bus: Callable[[], can.BusABC]
    faults: FaultPlan


def _start(stack: ExitStack, clock: RigClock, *, tcp: bool = False, socketcand: bool = False) -> Bench:
    channel = f"mock rig {next(_channels)}"

    def bus() -> can.BusABC:
        return EmbeddedBus(channel, clock)

    stack.callback(clock.close)
    faults = FaultPlan()
    mock = stack.enter_context(
        MockRig(
            MACHINE,
            MockSettings(),
            clock,
            bus,
            faults=faults,
            ports=MockPorts(station="tcp" if tcp else "pty", socketcand_port=0 if socketcand else None),
        )
    )
    if not socketcand:
        return Bench(clock, mock, bus, faults)
    host, port = mock.socketcand_address
    return Bench(clock, mock, lambda: open_bus("socketcand", "can0", host, port), faults)


def mock_rigs(transport: str) -> Iterator[Bench]:
    """Virtual time, a pty and an in-process bus; or scaled time, TCP and socketcand."""
    with ExitStack() as stack:
        if transport == "one process":
            made = _start(stack, VirtualClock())
        else:
            made = _start(stack, ScaledClock(50.0), tcp=True, socketcand=True)
        with made.clock.activity():
            yield made
