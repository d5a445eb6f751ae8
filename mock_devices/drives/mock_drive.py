"""A servo drive on a CAN bus: canopen's LocalNode around `DriveAxis`, by our own EDS.

Adds what LocalNode lacks: SYNC consumer with TPDOs, event timers, RPDOs (operational only), heartbeat and
heartbeat consumer on the rig clock with what 0x6007 asks for, boot-up after a reset, no SDO when stopped, SDO
block transfer, upkeep of 0x1001 and 0x1003, storing of parameters (0x1010, 0x1011). Not modelled: LSS, bus
errors, the error register's other bits; limits that the master sets outlive a restart.
"""

from __future__ import annotations

import bisect
import logging
import threading
from collections.abc import Callable
from copy import deepcopy
from typing import Any, TypeVar

import can
import canopen
from canopen.sdo.exceptions import SdoAbortedError

from mock_devices.can.node_services import Heartbeat, NmtSlave, NmtState
from mock_devices.can.node_watch import ErrorHistory, HeartbeatConsumer, Watchdog, error_register
from mock_devices.can.pdo_traffic import PdoTraffic
from mock_devices.can.sdo_abort import RefusedWrite
from mock_devices.can.sdo_server import SdoServer
from mock_devices.can.sync_moments import DriveTime, SyncMoments
from mock_devices.clock import RigClock
from mock_devices.drives.cia402 import State
from mock_devices.drives.compensation import Compensation
from mock_devices.drives.drive_axis import EMCY_FOLLOWING_ERROR, EMCY_STRAIN, AxisLimits, DriveAxis
from mock_devices.drives.drive_node import DriveNode
from mock_devices.drives.drive_objects import LASTING, METRES_PER_INCREMENT, DriveObjects
from mock_devices.drives.mock_axis import MockAxis
from mock_devices.drives.trial import Trial
from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.plant.base_plant import Motion, SetPoint

_NOTIFIER_CYCLE_S = 0.05
SIMULATED_SERIAL = int.from_bytes(b"SIM\0", "big")  # by its identity it is no real drive
_RPDO_LENGTH_ERROR = 0x8210
_OVER_CURRENT = 0x2310
_PARAMETERS = range(0x1400, 0x1C00)  # what 0x1010 keeps

_log = logging.getLogger(__name__)
_T = TypeVar("_T")

__all__ = ["DriveServer", "MockAxis"]


class DriveServer:
    """One drive at `node_id`. It owns `bus` and shuts it down in `close`; `load_kg` gives the mass that it carries.

    `watch` is called with the moment of every SYNC, when it has been answered; `changed`, before the answer to the
    master, when something was written that a drive keeps without power. All drives of a rig share `sync_moments`.
    """

    def __init__(
        self,
        node_id: int,
        axis: MockAxis,
        bus: can.BusABC,
        clock: RigClock,
        *,
        load_kg: Callable[[], float] = lambda: 0.0,
        watch: Callable[[float], None] = lambda _t_s: None,
        sync_moments: SyncMoments | None = None,
        changed: Callable[[DriveAxis], None] = lambda _axis: None,
        faults: FaultPlan = NO_FAULTS,
    ) -> None:
        self.node_id, self.axis_name, self._changed = node_id, axis.name, changed
        self._watch_machine = watch
        self._lock = threading.RLock()
        self._closed = False
        self._clock, self.faults, self.is_first = clock, faults, axis.is_first
        self._time = DriveTime(clock, sync_moments or SyncMoments(clock))
        low_inc, high_inc = (_increments(limit) for limit in axis.travel_m)
        self.compensation = Compensation(node_id, axis.machine_id)
        self.axis = DriveAxis(
            self._time.now_s,
            AxisLimits(low_inc, high_inc),
            self.compensation,
            axis.start_m / METRES_PER_INCREMENT,
            self._send_emergency,
            absolute=axis.absolute_encoder,
        )
        self._node = DriveNode(node_id, self._on_stored, faults)
        self._node.data_store = {0x1018: {4: self.serial.to_bytes(4, "little")}}
        partner = 0x80000000 if axis.partner_node_id is None else 0x280 + axis.partner_node_id
        self._node.data_store[0x1401] = {1: partner.to_bytes(4, "little")}
        self._node.add_read_callback(self._read)  # type: ignore[no-untyped-call]
        self._node.add_write_callback(self._write)  # type: ignore[no-untyped-call]
        self._heartbeat = Heartbeat(clock, self._send_state)
        self._watch = HeartbeatConsumer(clock, self._master_lost, self._master_found)
        self._sync_watch = Watchdog(clock, self._sync_lost)
        self._history = ErrorHistory()
        self._trial = Trial(clock, self.axis, self._watch, self._lock, self._send_emergency)
        self._objects = DriveObjects(
            self.axis, self._time.now_s, load_kg, self._heartbeat.start, self._watch, self._history, self._trial
        )
        self._defaults = deepcopy(self._node.data_store)
        self._saved = deepcopy(self._node.data_store)
        self._sdo = SdoServer(
            self._node,
            lambda frame: self.send_frame(self._node.sdo.tx_cobid, frame),
            self._node.sdo.on_request,
            faults,
            self.power_cycle,
            blocks=axis.block_transfer,
        )
        self._nmt = NmtSlave(node_id, send=self._send_heartbeat, changed=self._nmt_changed, reset=self._nmt_reset)
        self._network = canopen.Network(bus)
        self._network.NOTIFIER_CYCLE = _NOTIFIER_CYCLE_S
        self._pdos = PdoTraffic(
            self._node,
            self._network,
            clock,
            self._lock,
            is_operational=lambda: self._nmt.state is NmtState.OPERATIONAL,
            send=self.send_frame,
            length_error=lambda: self._send_emergency(_RPDO_LENGTH_ERROR),
        )
        self._connect()

    # Interface to the plant.

    def encoder_m(self, t_s: float) -> float:
        """Where the drive stands at rig time `t_s`, compensation included, not rounded."""
        with self._lock:
            return self.axis.true_position_inc(t_s) * METRES_PER_INCREMENT

    def set_point(self, t_s: float) -> SetPoint:
        """The set-point that was followed at `t_s`."""
        with self._lock:
            return self.axis.motion.set_point(t_s)

    def is_moving(self, t_s: float) -> bool:
        """Whether a motion is under way at `t_s`."""
        with self._lock:
            return self.axis.motion.is_moving(t_s)

    def motions_after(self, t_s: float) -> list[Motion]:
        """All motions that began after `t_s`, in encoder positions without compensation."""
        with self._lock:
            trail = self.axis.motion.trail
            first = bisect.bisect_right(trail, t_s, key=lambda entry: entry[0])
            return [
                Motion(
                    start_s,
                    start_s + profile.duration_s,
                    (profile.at(0.0)[0] + shift_inc) * METRES_PER_INCREMENT,
                    (profile.target + shift_inc) * METRES_PER_INCREMENT,
                    max(abs(phase.v) for phase in (*profile.phases, profile.phases[-1])) * METRES_PER_INCREMENT,
                )
                for start_s, profile, shift_inc in trail[first:]
            ]

    # Interface to tests and the rig.

    def with_axis(self, act: Callable[[DriveAxis], _T]) -> _T:
        """Do something with the axis while no frame changes it."""
        with self._lock:
            return act(self.axis)

    def inject_fault(self, code: int = 0x2310) -> None:
        """Trigger a fault, e.g. 0x2310 overcurrent."""
        with self._lock:
            self.axis.fault(code)

    def strain(self) -> None:
        """The machine does not bear it: a fault, if the motor is on."""
        with self._lock:
            if self.axis.state is State.OPERATION_ENABLED:
                self.axis.fault(EMCY_STRAIN)

    def power_cycle(self) -> None:
        """Switch the drive off and on again: boot-up, banks kept, payload unknown, mode 0."""
        with self._lock:
            self._nmt.on_command(bytes([129, self.node_id]))

    @property
    def serial(self) -> int:
        """Object 0x1018:04; another drive of the same make, in its place, has another one."""
        return SIMULATED_SERIAL + (self.node_id + 16 * self.axis.swaps) % 256

    def identify(self) -> None:
        """Show the serial number of the drive that is there."""
        with self._lock:
            for store in (self._node.data_store, self._defaults, self._saved):
                store[0x1018] = {4: self.serial.to_bytes(4, "little")}

    def replace(self, more_m: float) -> None:
        """Put another drive of the same make in its place: empty banks, another serial number, counting more."""
        with self._lock:
            self.recount(more_m)
            self.axis.swaps += 1
            for bank in self.compensation.banks.values():
                bank.write(b"")
            self.compensation.active_bank = 0
            self.identify()
            self.power_cycle()
            self._changed(self.axis)

    def recount(self, more_m: float) -> None:
        """Count so much more from now on, as after a reference that was taken elsewhere."""
        with self._lock:
            t_s = self._clock.now_s()
            self.axis.motion.recount(t_s, self.axis.encoder_inc(t_s) + more_m / METRES_PER_INCREMENT)
            self._changed(self.axis)

    def close(self) -> None:
        """Leave the bus. May be called again."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._heartbeat.stop()
        self._watch.close()
        self._trial.stop()
        self._sync_watch.set_limit(0.0)
        self._pdos.stop_timers()
        self._network.disconnect()

    def _connect(self) -> None:
        self._network.connect()
        self._network.add_node(self._node)
        self._network.unsubscribe(self._node.sdo.rx_cobid, self._node.sdo.on_request)
        self._network.subscribe(self._node.sdo.rx_cobid, self._on_sdo)
        self._network.subscribe(0x000, lambda _id, data, _t: self._on_nmt(bytes(data)))
        self._network.subscribe(0x080, lambda _id, _data, stamp: self._on_sync(stamp))
        for node_id in range(1, 128):
            if node_id != self.node_id:
                self._network.subscribe(0x700 + node_id, self._on_heartbeat)
        self._pdos.describe()
        self._nmt.boot_up()

    # Frames from the bus.

    def _on_sdo(self, cob_id: int, data: bytearray, timestamp: float) -> None:
        if self._nmt.state is not NmtState.STOPPED and len(data) == 8:
            self._sdo.on_request(cob_id, data, timestamp)

    def _on_heartbeat(self, cob_id: int, _data: bytearray, _timestamp: float) -> None:
        self._watch.on_heartbeat(cob_id - 0x700)
        self._trial.on_heartbeat(cob_id - 0x700)

    def _master_lost(self) -> None:
        with self._lock:
            self.axis.abort_connection()

    def _master_found(self) -> None:
        with self._lock:
            self.axis.connection_is_back()

    def _sync_lost(self) -> None:
        with self._lock:
            self.axis.sync_lost()

    def _on_nmt(self, data: bytes) -> None:
        with self._lock:
            self._nmt.on_command(data)

    def _on_sync(self, timestamp: float) -> None:
        with self._lock, self._time.at_sync(timestamp) as moment_s:
            if self.is_first and self.faults.strikes("drive-emergency"):
                self.axis.fault(_OVER_CURRENT)
            self.axis.sync()
            if self.axis.state is State.OPERATION_ENABLED and self._objects.beyond_torque():
                self.axis.fault(EMCY_FOLLOWING_ERROR)
            if self._sync_watch.limit_s != self.axis.cyclic.patience_s:
                self._sync_watch.set_limit(self.axis.cyclic.patience_s)
            self._sync_watch.on_message()
            frames = self._pdos.on_sync()
            is_operational = self._nmt.state is NmtState.OPERATIONAL
        for cob_id, data in frames:
            self.send_frame(cob_id, data)
        if is_operational:
            self._watch_machine(moment_s)

    # Frames to the bus.

    def send_frame(self, cob_id: int, data: bytes) -> None:
        """Send a frame; without a bus it is lost."""
        if not self._closed:
            try:
                self._network.send_message(cob_id, data)
            except (can.CanError, RuntimeError) as error:
                _log.info("%s: frame not sent: %s", self.axis_name, error)

    def _send_emergency(self, code: int) -> None:
        if code:
            self._history.add(code)
        self.send_frame(0x080 + self.node_id, code.to_bytes(2, "little") + bytes([error_register(code)]) + bytes(5))

    def _send_heartbeat(self, data: bytes) -> None:
        if self.is_first and self.faults.strikes("drive-heartbeat"):
            return
        self.send_frame(0x700 + self.node_id, data)

    def _send_state(self) -> None:
        self._send_heartbeat(bytes([self._nmt.state]))

    # NMT.

    def _nmt_changed(self, before: NmtState) -> None:
        if before is NmtState.OPERATIONAL:
            self.axis.quick_stop()
        self._pdos.set_timers()

    def _nmt_reset(self, whole_node: bool) -> None:
        self._heartbeat.stop()
        self._watch.configure(0)
        self._sdo.reset()
        self._node.data_store = deepcopy(self._saved)
        self._pdos.describe()
        self._pdos.stop_timers()
        if whole_node:
            self._trial.stop()
            self.axis.boot()

    # The object dictionary.

    def _on_stored(self, index: int) -> None:
        if index == 0x1010:
            self._saved = {i: v for i, v in deepcopy(self._node.data_store).items() if i in _PARAMETERS}
            self._saved |= {i: v for i, v in self._defaults.items() if i not in self._saved}
        elif index == 0x1011:
            self._saved = deepcopy(self._defaults)
        if 0x1400 <= index < 0x1C00:
            with self._lock:
                self._pdos.describe()

    def _read(self, *, index: int, subindex: int, od: Any) -> int | bytes | None:
        with self._lock:
            return self._objects.read(index, subindex)

    def _write(self, *, index: int, subindex: int, od: Any, data: bytes) -> None:
        with self._lock:
            try:
                self._objects.write(index, subindex, od.decode_raw(bytes(data)))
            except RefusedWrite as refusal:
                raise SdoAbortedError(refusal.abort_code) from None
            if index in LASTING:
                self._changed(self.axis)


def _increments(position_m: float) -> int:
    return round(position_m / METRES_PER_INCREMENT)
