"""The host's CAN bus with faults: frames lost, bus off, a peer that is gone without a word."""

from __future__ import annotations

import struct
import threading
from collections import deque

import can

from mock_devices.faults import FaultPlan

# To node 1: a target (0x607A), then enable operation and a new set-point, relative to where it is.
_MOVE_FIRST_DRIVE = (
    (0x601, struct.pack("<BHBi", 0x23, 0x607A, 0, 10_000_000)),
    (0x201, struct.pack("<H", 0x000F)),
    (0x201, struct.pack("<H", 0x005F)),
)


class FaultyBus(can.BusABC):
    """Wraps the bus that a host uses and owns it. Frames sent and received count as operations, in their order.

    Not modelled: error frames, error counters, recovery from bus off other than by a new bus.
    """

    def __init__(self, bus: can.BusABC, faults: FaultPlan) -> None:
        self._bus = bus
        self._faults = faults
        self._lock = threading.Lock()
        self._left = False
        self._foreign: deque[can.Message] = deque()
        self.channel_info = bus.channel_info
        super().__init__(channel=str(bus.channel_info))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame. Raises can.CanOperationError at bus off."""
        self._check()
        if self._passes():
            self._bus.send(msg, timeout)
        self._send_as_another()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive a frame. Raises can.CanOperationError at bus off."""
        self._check()
        if self._foreign:
            return self._foreign.popleft()
        message = self._bus.recv(timeout)
        if message is None or not self._passes():
            return None
        return message

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._leave()

    def _leave(self) -> None:
        """A controller that is bus off takes part in nothing: frames for it must not wait to be fetched."""
        with self._lock:
            left, self._left = self._left, True
        if not left:
            self._bus.shutdown()

    def _send_as_another(self) -> None:
        """What another master sends goes to the drives, and to the host as well."""
        if self._faults.strikes("can-other-master"):
            for identifier, data in _MOVE_FIRST_DRIVE:
                frame = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
                self._bus.send(frame)
                self._foreign.append(frame)

    def _check(self) -> None:
        if self._faults.lasts("can-bus-off"):
            self._leave()
            raise can.CanOperationError("bus off")

    def _passes(self) -> bool:
        if self._faults.strikes("can-bus-off"):
            self._leave()
            raise can.CanOperationError("bus off")
        dead, lost = self._faults.strikes("can-peer-dead"), self._faults.strikes("can-lost-frame")
        return not (dead or lost)
