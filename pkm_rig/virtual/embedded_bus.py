"""A CAN bus inside one process whose frames hold the rig clock until they are dealt with."""

from __future__ import annotations

import threading
import time
from typing import Any

import can
from can.interfaces.virtual import VirtualBus

from pkm_rig.rig.clock import RigClock

# A frame for a bus that has just been emptied would hold the clock for ever.
_leaving = threading.Lock()


class EmbeddedBus(VirtualBus):
    """python-can's virtual bus; a frame in flight keeps virtual time from advancing.

    A receiver counts as done with a frame when it asks for the next one, which is what `can.Notifier` does
    after the listeners have returned. Without this a heartbeat that is sent now could be
    seen minutes of rig time later.
    """

    def __init__(self, channel: str, clock: RigClock, **kwargs: Any) -> None:
        self._clock = clock
        self._in_hand = False
        super().__init__(channel=channel, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to every other bus of the channel; each receiver holds the clock.

        Receivers share one frame, which nobody changes: copying it for each takes longer than the rest.
        """
        self._check_if_open()
        del timeout  # the queues are not bounded
        frame = can.Message(
            timestamp=time.time(),
            arbitration_id=msg.arbitration_id,
            is_extended_id=msg.is_extended_id,
            is_remote_frame=msg.is_remote_frame,
            data=msg.data,
            channel=self.channel_id,
        )
        with _leaving:
            for bus_queue in list(self.channel):
                if bus_queue is not self.queue:
                    self._clock.hold()
                    bus_queue.put(frame)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._release_frame()
        message, filtered = super()._recv_internal(timeout)
        self._in_hand = message is not None
        return message, filtered

    def _release_frame(self) -> None:
        if self._in_hand:
            self._in_hand = False
            self._clock.release()

    def shutdown(self) -> None:
        """Leave the channel and let go of the frames that nobody will read."""
        with _leaving:
            super().shutdown()
        self._release_frame()
        while not self.queue.empty():
            self.queue.get_nowait()
            self._clock.release()
