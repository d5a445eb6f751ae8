"""One CAN line: sending, receiving in a thread of its own, and detecting the loss of the line."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection
from types import TracebackType
from typing import Self

import can
import canopen

from drivers.can.other_master import master_frame
from drivers.errors import ConnectionFailed, OtherMaster

_log = logging.getLogger(__name__)
logging.getLogger("canopen").addHandler(logging.NullHandler())

NMT_START = 1
NMT_PRE_OPERATIONAL = 128
_SYNC = 0x080
_HEARTBEAT = 0x700
_OPERATIONAL = 5
_RECEIVE_S = 0.02

FrameCallback = Callable[[int, bytearray, float], None]


class CanLine:
    """A python-can bus with canopen's frame distribution on it; owns the bus.

    Replaces canopen's notifier, whose thread spins or ends silently when a bus fails: here `failed` then holds the
    reason, threads that wait on `received` are woken, and each use raises ConnectionFailed. Callbacks run in the
    receiving thread and must not start an SDO transfer.
    """

    def __init__(self, bus: can.BusABC, name: str = "CAN") -> None:
        self.name = name
        self.failed: str | None = None
        self.received = threading.Condition()
        self.seen_nodes: set[int] = set()
        self.on_other_master: Callable[[str], None] = lambda _what: None
        self._other_master: str | None = None
        self._own_nodes: Collection[int] = ()
        self._master_node_id = 0
        self.network = canopen.Network(bus)
        self._bus = bus
        self._closing = False
        self._reader = threading.Thread(target=self._read, name=f"{name} receiver", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame at once. Raises ConnectionFailed."""
        self.check()
        self.send_anyway(cob_id, data)

    def send_anyway(self, cob_id: int, data: bytes) -> None:
        """The same on a line that counts as lost: a stop is tried in any case. Raises ConnectionFailed."""
        try:
            self.network.send_message(cob_id, data)
        except (can.CanError, OSError, RuntimeError, ValueError) as error:
            self.mark_lost(error)
            self.check()

    def send_sync(self) -> None:
        """Send SYNC. Raises ConnectionFailed."""
        self.send(_SYNC, b"")

    def send_nmt(self, command: int, node_id: int) -> None:
        """Send an NMT command to a node. Raises ConnectionFailed."""
        self.send(0x000, bytes((command, node_id)))

    def send_heartbeat(self, node_id: int) -> None:
        """Send the heartbeat of an operational node. Raises ConnectionFailed."""
        self.send(_HEARTBEAT + node_id, bytes([_OPERATIONAL]))

    def subscribe(self, cob_id: int, callback: FrameCallback) -> None:
        """Have `callback(cob_id, data, host time stamp)` called for each frame with this identifier."""
        self.network.subscribe(cob_id, callback)

    def unsubscribe(self, cob_id: int, callback: FrameCallback) -> None:
        """Undo `subscribe`."""
        self.network.unsubscribe(cob_id, callback)

    def check(self) -> None:
        """Raise ConnectionFailed if the line is lost or closed."""
        if self.failed is not None:
            raise ConnectionFailed(
                "CAN line", self.name, self.failed, "check adapter, server and cable, then connect again"
            )

    def watch_for_other_masters(self, nodes: Collection[int], master_node_id: int) -> None:
        """From now on remember a frame of another master to these nodes, or in the name of `master_node_id`.

        `on_other_master` is then called in the receiving thread, as a callback is.
        """
        self._master_node_id = master_node_id
        self._own_nodes = tuple(nodes)

    def require_only_master(self) -> None:
        """Raise OtherMaster if another master has been heard. Not in `check`: a stop must go out all the same."""
        if self._other_master is not None:
            raise OtherMaster(
                "CAN line",
                self.name,
                f"another master on CAN has sent {self._other_master}",
                "disconnect it, then connect again",
            )

    def mark_lost(self, error: Exception) -> None:
        """Mark the line as lost for this reason."""
        reason = " ".join(str(error).split()) or type(error).__name__
        with self.received:
            self.failed = self.failed or f"the line is lost: {reason}"
            self.received.notify_all()

    def close(self) -> None:
        """End the receiving thread and shut the bus down. May be called again."""
        if self._closing:
            return
        self._closing = True
        self._reader.join(timeout=5.0)
        self.failed = self.failed or "closed"
        try:
            self._bus.shutdown()
        except (can.CanError, OSError) as error:  # an unplugged adapter cannot be closed properly
            _log.info("%s: %s", self.name, error)

    def _read(self) -> None:
        while not self._closing:
            try:
                message = self._bus.recv(_RECEIVE_S)
            except Exception as error:  # a garbled frame may raise anything: never end silently
                if not self._closing:
                    self.mark_lost(error)
                return
            if message is not None and not (message.is_error_frame or message.is_remote_frame):
                self._hand_out(message)

    def _hand_out(self, message: can.Message) -> None:
        cob_id = message.arbitration_id
        if self._own_nodes and message.is_rx and self._other_master is None:  # an echo of our own frames is not meant
            self._other_master = master_frame(cob_id, bytes(message.data), self._own_nodes, self._master_node_id)
            if self._other_master is not None:
                self.on_other_master(f"another master on CAN has sent {self._other_master}")
        if _HEARTBEAT < cob_id < _HEARTBEAT + 0x80:
            self.seen_nodes.add(cob_id - _HEARTBEAT)
        try:
            self.network.notify(cob_id, message.data, message.timestamp)
        except Exception:  # one bad frame must not stop reception
            _log.exception("frame 0x%03X could not be handled", cob_id)
