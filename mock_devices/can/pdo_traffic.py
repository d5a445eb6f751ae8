"""A node's PDOs: what SYNC and event timers send, what arrives while the node is operational (CiA 301)."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from functools import partial

import canopen
from canopen.sdo.exceptions import SdoAbortedError

from mock_devices.can.node_services import Heartbeat
from mock_devices.can.pdo import Mapping, read_mapping
from mock_devices.clock import RigClock

_RPDOS, _TPDOS = 3, 2

_log = logging.getLogger(__name__)


class PdoTraffic:
    """The PDOs of `node` on `network`, as its dictionary describes them.

    lock: held while the dictionary is read or written; send: takes a frame; length_error: called for an RPDO that is
    too short.
    """

    def __init__(
        self,
        node: canopen.LocalNode,
        network: canopen.Network,
        clock: RigClock,
        lock: threading.RLock,
        *,
        is_operational: Callable[[], bool],
        send: Callable[[int, bytes], None],
        length_error: Callable[[], None],
    ) -> None:
        self._node, self._network, self._clock, self._lock = node, network, clock, lock
        self._is_operational, self._send, self._length_error = is_operational, send, length_error
        self._rpdos: list[Mapping] = []
        self._tpdos: list[Mapping] = []
        self._timers: list[Heartbeat] = []
        self._syncs = 0

    def describe(self) -> None:
        """Read the mappings from the dictionary and listen for what they name."""
        read = self._node.get_data
        for mapping in self._rpdos:
            if self._on_rpdo in self._network.subscribers.get(mapping.cob_id, []):
                self._network.unsubscribe(mapping.cob_id, self._on_rpdo)
        self._rpdos = [read_mapping(read, 0x1400 + i, 0x1600 + i) for i in range(_RPDOS)]
        self._tpdos = [read_mapping(read, 0x1800 + i, 0x1A00 + i) for i in range(_TPDOS)]
        for mapping in self._rpdos:
            if mapping.enabled:
                self._network.subscribe(mapping.cob_id, self._on_rpdo)
        self.set_timers()

    def set_timers(self) -> None:
        """Event timers run while the node is operational."""
        self.stop_timers()
        if self._is_operational():
            for mapping in (m for m in self._tpdos if m.on_timer):
                timer = Heartbeat(self._clock, partial(self._send_tpdo, mapping))
                self._timers.append(timer)
                timer.start(mapping.event_timer_s)

    def stop_timers(self) -> None:
        """No more TPDOs by event timers."""
        timers, self._timers = self._timers, []
        for timer in timers:
            timer.stop()

    def on_sync(self) -> list[tuple[int, bytes]]:
        """Count a SYNC; the frames that it asks for, none unless the node is operational. The caller holds the lock."""
        self._syncs += 1
        if not self._is_operational():
            return []
        due = [m for m in self._tpdos if m.on_sync and self._syncs % m.transmission_type == 0]
        return [(m.cob_id, m.pack(self._node.get_data)) for m in due]

    def _on_rpdo(self, cob_id: int, data: bytearray, _timestamp: float) -> None:
        with self._lock:
            if not self._is_operational():
                return
            for mapping in (m for m in self._rpdos if m.enabled and m.cob_id == cob_id):
                try:
                    objects = mapping.unpack(bytes(data))
                except ValueError:
                    self._length_error()
                    continue
                for index, sub, value in objects:
                    try:
                        self._node.set_data(index, sub, value)
                    except SdoAbortedError as error:
                        _log.info("node %d: RPDO value refused: %s", self._node.id, error)

    def _send_tpdo(self, mapping: Mapping) -> None:
        with self._lock:
            data = mapping.pack(self._node.get_data)
        self._send(mapping.cob_id, data)
