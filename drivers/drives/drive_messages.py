"""What a drive sends without being asked by SDO: heartbeat, EMCY, and TPDO1 and TPDO2 after each SYNC."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable

from drivers.can.can_line import CanLine
from drivers.clock import RigClock
from drivers.drives.cia402 import State, state_of
from drivers.drives.drive_records import DriveSample, Emergency

_TPDO1 = struct.Struct("<Hih")
_TPDO2 = struct.Struct("<ii")
_EMERGENCY = struct.Struct("<HB")


class DriveMessages:
    """Receives the messages of one node in the line's receiving thread and keeps the latest.

    `restarted`: the node has sent its boot-up message since this was set to False. `tpdo_counts` are the numbers of
    TPDO1 and TPDO2 so far; whoever waits for one waits on `line.received`. `on_emergency` is called for each EMCY.
    """

    def __init__(self, line: CanLine, node_id: int, clock: RigClock) -> None:
        self.emergencies: deque[Emergency] = deque(maxlen=100)
        self.on_emergency: Callable[[Emergency], None] | None = None
        self.restarted = False
        self.nmt_state: int | None = None
        self.tpdo_counts = [0, 0]
        self._line, self._clock = line, clock
        self._tpdos = [b"", b""]
        self._read_state: tuple[State | None, int] = (None, 0)
        self._heartbeat_s: float | None = None
        self._callbacks = {
            0x080 + node_id: self._on_emergency,
            0x180 + node_id: self._on_tpdo1,
            0x280 + node_id: self._on_tpdo2,
            0x700 + node_id: self._on_heartbeat,
        }
        for cob_id, callback in self._callbacks.items():
            line.subscribe(cob_id, callback)

    def close(self) -> bool:
        """Stop listening; False if that was done before."""
        callbacks, self._callbacks = self._callbacks, {}
        for cob_id, callback in callbacks.items():
            self._line.unsubscribe(cob_id, callback)
        return bool(callbacks)

    def heartbeat_age_s(self) -> float | None:
        """Rig seconds since the last heartbeat; None before the first."""
        return None if self._heartbeat_s is None else self._clock.now_s() - self._heartbeat_s

    def last_emergency(self) -> Emergency | None:
        """The last emergency, unless the drive has reported since that the error is gone."""
        emergencies = tuple(self.emergencies)
        return emergencies[-1] if emergencies and emergencies[-1].is_error else None

    def keep_state(self, state: State) -> None:
        """Keep a state that was read by SDO: without SYNC there is no newer TPDO."""
        self._read_state = (state, self.tpdo_counts[0])

    def last_state(self) -> State | None:
        """The drive's state by what it has said last, TPDO1 or SDO; None before either."""
        read, count = self._read_state
        if read is not None and count == self.tpdo_counts[0]:
            return read
        return state_of(_TPDO1.unpack(self._tpdos[0][: _TPDO1.size])[0]) if self.tpdo_counts[0] else None

    def sample(self, metres_per_increment: float, t_rig_s: float, t_host_s: float) -> DriveSample:
        """The last TPDO1 and TPDO2 as one sample with the given times of their SYNC."""
        statusword, position, torque = _TPDO1.unpack(self._tpdos[0][: _TPDO1.size])
        demand, velocity = _TPDO2.unpack(self._tpdos[1][: _TPDO2.size])
        return DriveSample(
            statusword=statusword,
            position_m=position * metres_per_increment,
            demand_m=demand * metres_per_increment,
            velocity_m_per_s=velocity * metres_per_increment,
            torque_fraction=torque * 1e-3,
            following_error_m=(demand - position) * metres_per_increment,
            t_rig_s=t_rig_s,
            t_host_s=t_host_s,
        )

    def _on_heartbeat(self, _cob_id: int, data: bytearray, _stamp: float) -> None:
        if len(data) != 1:
            return
        state = data[0] & 0x7F
        if state == 0:
            self.restarted = True
        self.nmt_state = state
        self._heartbeat_s = self._clock.now_s()

    def _on_emergency(self, _cob_id: int, data: bytearray, _stamp: float) -> None:
        if len(data) >= _EMERGENCY.size:
            code, register = _EMERGENCY.unpack_from(data)
            emergency = Emergency(code, register, self._clock.now_s(), time.monotonic())
            self.emergencies.append(emergency)
            if self.on_emergency is not None:
                self.on_emergency(emergency)

    def _on_tpdo1(self, _cob_id: int, data: bytearray, _stamp: float) -> None:
        self._store_tpdo(0, data, _TPDO1.size)

    def _on_tpdo2(self, _cob_id: int, data: bytearray, _stamp: float) -> None:
        self._store_tpdo(1, data, _TPDO2.size)

    def _store_tpdo(self, number: int, data: bytearray, size: int) -> None:
        if len(data) < size:
            return
        with self._line.received:
            self._tpdos[number] = bytes(data)
            self.tpdo_counts[number] += 1
            self._line.received.notify_all()
