"""The host's CAN bus with faults: frames lost, bus off, a peer that is gone without a word."""

from __future__ import annotations

import threading

import can

from mock_devices.faults import FaultPlan


class FaultyBus(can.BusABC):
    """Wraps the bus that a host uses and owns it. Frames sent and received count as operations, in their order.

    Not modelled: error frames, error counters, recovery from bus off other than by a new bus.
    """

    def __init__(self, bus: can.BusABC, faults: FaultPlan) -> None:
        self._bus = bus
        self._faults = faults
        self._lock = threading.Lock()
        self._left = False
        self.channel_info = bus.channel_info
        super().__init__(channel=str(bus.channel_info))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame. Raises can.CanOperationError at bus off."""
        self._check()
        if self._passes():
            self._bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Receive a frame. Raises can.CanOperationError at bus off."""
        self._check()
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
