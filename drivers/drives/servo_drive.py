"""One CiA 402 servo drive in profile or cyclic synchronous position mode, in metres and seconds."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from drivers.can.can_line import NMT_START, CanLine
from drivers.can.drive_object import DriveObject
from drivers.can.sdo import SdoAccess
from drivers.clock import HostClock, RigClock
from drivers.drives import cia402, objects
from drivers.drives.cia402 import State
from drivers.drives.drive_messages import DriveMessages
from drivers.drives.drive_profile import DriveProfile, load_profile
from drivers.drives.drive_records import (
    DriveExpectation,
    DriveIdentity,
    DriveSample,
    DriveTimeouts,
    Emergency,
    Heartbeat,
)
from drivers.drives.drive_setup import DriveSetup
from drivers.drives.reference import ReferenceState
from drivers.errors import DriveFault, MotionTimeout, StaleData

__all__ = ["DriveExpectation", "DriveIdentity", "DriveSample", "DriveTimeouts", "Emergency", "Heartbeat", "ServoDrive"]

_OPERATIONAL = 5
_MIN_POLLS = 10  # however fast rig time runs


class ServoDrive:
    """One drive on a CAN line.

    SDO transfers are one at a time; controlwords are sent by RPDO1 and wait for no transfer. With a `master_node_id`
    the drive quick-stops by itself when that node's heartbeat, once heard, stays away. Every method that communicates
    with the drive raises ConnectionFailed, NoAnswer, SdoRefused or ProtocolError if that fails.
    """

    def __init__(
        self,
        line: CanLine,
        node_id: int,
        name: str,
        clock: RigClock | None = None,
        expected: DriveExpectation | None = None,
        *,
        profile: DriveProfile | None = None,
        partner_node_id: int | None = None,
        master_node_id: int | None = None,
        timeouts: DriveTimeouts | None = None,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise ValueError(f"{name}: node id {node_id} is not in 1..127")
        self.line = line
        self.profile = profile or load_profile("pkm-mock")
        self.node_id = node_id
        self.name = name
        self.expected = expected or DriveExpectation()
        self.metres_per_increment = self.expected.metres_per_increment
        self.identity: DriveIdentity | None = None
        self.limits_m = (-math.inf, math.inf)
        self.rated_torque_n_m = math.nan
        self.target_m = math.nan
        self.reference = ReferenceState(self)
        self.mode: int | None = None
        self.sync_period_s = math.nan
        self._timeouts = timeouts or DriveTimeouts()
        self.sdo = SdoAccess(line, node_id, name, self._timeouts.sdo_s)
        self._clock = clock or HostClock()
        self._partner_node_id = partner_node_id
        self._master_node_id = master_node_id
        self._profile: dict[DriveObject, int] = {}
        self.messages = DriveMessages(line, node_id, self._clock)

    @property
    def emergencies(self) -> tuple[Emergency, ...]:
        """The last EMCY messages, the oldest first."""
        return tuple(self.messages.emergencies)

    @property
    def where(self) -> str:
        """Node and line, for messages."""
        return f"node {self.node_id} on {self.line.name}"

    def connect(self, *, unreferenced: bool = False) -> DriveIdentity:
        """Find the drive, compare identity and units, set PDOs, heartbeat and mode, and start the node.

        Raises ConnectionFailed naming an absent node, IdentityMismatch for a wrong drive or wrong units, and
        NotReferenced for one that has to be homed or is outside its travel, unless it may be `unreferenced`.
        """
        self.line.check()
        self.messages.restarted = False
        setup = self.setup()
        setup.find()
        self.identity = setup.read_identity(self.expected)
        setup.compare_factors(self.expected)
        setup.set_pdos(self._partner_node_id)
        self._read_limits()
        self.reference.distrust_outside_travel()
        self.reference.ask()
        if not unreferenced:
            self.reference.require()
        setup.set_and_compare(objects.HEARTBEAT_PRODUCER, self._timeouts.heartbeat_ms)
        if self._master_node_id is not None:
            setup.watch_master(self._master_node_id, min(self._timeouts.master_lost_ms, 0xFFFF))
        self.set_mode(cia402.PROFILE_POSITION)
        self.rated_torque_n_m = self.sdo.read_twice(objects.RATED_TORQUE) * 1e-3
        self.target_m = self.sdo.read_twice(objects.TARGET_POSITION) * self.metres_per_increment
        self._profile.clear()
        self.messages.nmt_state = None
        self.line.send_nmt(NMT_START, self.node_id)
        self._wait(lambda: self.messages.nmt_state == _OPERATIONAL, "NMT state operational")
        self.check()  # a restart in between has undone the settings
        return self.identity

    def close(self) -> None:
        """Stop listening to the drive; the line stays open. May be called again."""
        if self.messages.close():
            self.sdo.close()

    def set_mode(self, mode: int) -> None:
        """Write the mode of operation and wait until the drive shows it. Raises MotionTimeout."""
        self.mode = None
        self.sdo.write(objects.MODE, mode)
        self._wait(lambda: self.sdo.read(objects.MODE_DISPLAY) == mode, f"mode of operation {mode}")
        self.mode = mode

    def set_cyclic_position(self, period_s: float) -> None:
        """Cyclic synchronous position mode with a SYNC every `period_s`, set before the drive is powered.

        It gets a PDO for its target, and is started again if it was stopped for that. Raises ValueError for a drive
        that has no such mode or is powered, or a period that 0x60C2 cannot express; IdentityMismatch, MotionTimeout.
        """
        self.require_cyclic_position()
        self.require_no_power()
        setup = self.setup()
        setup.set_interpolation_period(period_s)
        setup.set_cyclic_pdo()
        self.line.send_nmt(NMT_START, self.node_id)
        self.set_mode(cia402.CYCLIC_POSITION)
        self.sync_period_s = period_s

    def require_cyclic_position(self) -> None:
        """Raise ValueError for a make without cyclic synchronous position mode."""
        if not self.profile.capabilities.cyclic_position:
            raise ValueError(f"{self.name}: a '{self.profile.name}' has no cyclic synchronous position mode")

    def require_no_power(self) -> None:
        """Raise ValueError if the drive is powered."""
        state = self.state()
        if state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE):
            raise ValueError(f"{self.name}: it is in {state.value}; this can only be set without power")

    def require_mode(self, mode: int) -> None:
        """Raise ValueError unless this mode of operation was set last."""
        if self.mode != mode:
            raise ValueError(f"{self.name}: mode of operation {mode} is required, {self.mode} is set")

    def setup(self) -> DriveSetup:
        """What compares and sets the drive's objects."""
        return DriveSetup(self.line, self.sdo, self.node_id, self.name, self.where, self.profile)

    def position_actual_m(self) -> float:
        """The position that the drive reports, read by SDO."""
        return self.sdo.read(objects.POSITION_ACTUAL) * self.metres_per_increment

    def _read_limits(self) -> None:
        low, high = self.sdo.read_twice(objects.LIMIT_LOW), self.sdo.read_twice(objects.LIMIT_HIGH)
        if low < high:
            self.limits_m = (low * self.metres_per_increment, high * self.metres_per_increment)

    def stop_master_watchdog(self) -> None:
        """Turn the drive's watchdog off: the master is about to leave."""
        if self._master_node_id is not None and self.profile.watchdog:
            self.sdo.write(objects.HEARTBEAT_CONSUMER, 0)

    def state(self) -> State:
        """State of the drive, read by SDO."""
        state = cia402.state_of(self.sdo.read(objects.STATUSWORD))
        self.messages.keep_state(state)
        return state

    def enable(self, send: Callable[[int], None] | None = None) -> None:
        """Go to operation enabled. Raises DriveFault in fault and MotionTimeout.

        `send` is used for the controlwords instead of `send_controlword`: a group's refuses when stopped. In cyclic
        synchronous position mode the target is first set to the present position.
        """

        def has_arrived() -> bool:
            state = self.state()
            if state in (State.FAULT, State.FAULT_REACTION):
                raise self.fault(f"the drive is in {state.value}")
            controlword = cia402.controlword_to_enable(state)
            if controlword == cia402.ENABLE_OPERATION and self.mode == cia402.CYCLIC_POSITION:
                self._target_present_position()
            if controlword is not None:
                (send or self.send_controlword)(controlword)
            return state is State.OPERATION_ENABLED

        self._wait(has_arrived, State.OPERATION_ENABLED.value)

    def _target_present_position(self) -> None:
        """Otherwise the next SYNC would move the drive to its previous target, without any set-point signal."""
        position = self.sdo.read(objects.POSITION_ACTUAL)
        self.setup().set_and_compare(objects.TARGET_POSITION, position)
        self.target_m = position * self.metres_per_increment

    def disable(self) -> None:
        """Take the power off; a drive in fault has none. Raises MotionTimeout."""

        def has_arrived() -> bool:
            state = self.state()
            controlword = cia402.controlword_to_disable(state)
            if controlword is not None:
                self.send_controlword(controlword)
            return state in (State.SWITCH_ON_DISABLED, State.FAULT, State.NOT_READY)

        self._wait(has_arrived, "a state without power")

    def quick_stop(self) -> None:
        """Stop on the quick stop ramp, at once and without waiting for anything."""
        self.line.send_anyway(0x200 + self.node_id, struct.pack("<H", cia402.QUICK_STOP))

    def fault_reset(self) -> None:
        """Acknowledge a fault; nothing happens without one. Raises DriveFault if it stays."""
        if self.state() is not State.FAULT:
            return
        self.send_controlword(cia402.DISABLE_VOLTAGE)
        self.send_controlword(cia402.FAULT_RESET)
        try:
            self._wait(lambda: self.state() is not State.FAULT, "a state without fault")
        except MotionTimeout as error:
            raise self.fault("the fault cannot be reset") from error
        finally:
            self.send_controlword(cia402.DISABLE_VOLTAGE)

    def send_controlword(self, controlword: int) -> None:
        """Send a controlword by RPDO1: no answer, no waiting behind a transfer. Raises ConnectionFailed."""
        self.line.send(0x200 + self.node_id, struct.pack("<H", controlword))

    def send_target(self, position_m: float) -> None:
        """Send a target by RPDO3; the drive goes there by the next SYNC in cyclic mode. Raises ConnectionFailed."""
        self.line.send(0x300 + self.node_id, struct.pack("<i", self.increments(position_m)))
        self.target_m = position_m

    def set_profile(self, velocity_m_per_s: float, acceleration_m_per_s2: float | None = None) -> None:
        """Velocity and, if given, acceleration and deceleration of the next moves; changes are written."""
        values = {objects.PROFILE_VELOCITY: velocity_m_per_s}
        if acceleration_m_per_s2 is not None:
            values[objects.PROFILE_ACCELERATION] = acceleration_m_per_s2
            values[objects.PROFILE_DECELERATION] = acceleration_m_per_s2
        for entry, value in values.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{self.name}: {entry.name} must be positive, not {value}")
            increments = max(1, round(value / self.metres_per_increment))
            if self._profile.get(entry) != increments:
                self._profile.pop(entry, None)
                self.sdo.write(entry, increments)
                self._profile[entry] = increments

    def set_quick_stop(self, deceleration_m_per_s2: float) -> None:
        """Deceleration of the quick stop (0x6085) from now on; written where it differs from the last one."""
        if not (math.isfinite(deceleration_m_per_s2) and deceleration_m_per_s2 > 0.0):
            raise ValueError(f"{self.name}: the quick stop needs a deceleration, not {deceleration_m_per_s2}")
        increments = max(1, round(deceleration_m_per_s2 / self.metres_per_increment))
        entry = objects.QUICK_STOP_DECELERATION
        if self._profile.get(entry) != increments:
            self._profile.pop(entry, None)
            self.sdo.write(entry, increments)
            self._profile[entry] = increments

    def set_torque_limit(self, ratio: float) -> None:
        """Largest torque over the rated one (0x6072), written and read back. Raises IdentityMismatch."""
        self.setup().set_and_compare(objects.MAX_TORQUE, round(1000.0 * ratio))

    def write_target(self, position_m: float) -> None:
        """Write the target position; nothing moves before a new set-point is signalled. Raises SdoRefused."""
        self.sdo.write(objects.TARGET_POSITION, self.increments(position_m))
        self.target_m = position_m

    def increments(self, position_m: float) -> int:
        """A position in increments. Raises ValueError if it is not finite or does not fit."""
        if not math.isfinite(position_m) or abs(position_m) >= self.metres_per_increment * 2**31:
            raise ValueError(f"{self.name}: impossible position: {position_m} m")
        return round(position_m / self.metres_per_increment)

    def heartbeat(self) -> Heartbeat:
        """Whether the heartbeat is alive, late, lost or was never seen."""
        age_s = self.messages.heartbeat_age_s()
        if age_s is None:
            return Heartbeat.NEVER
        if age_s > self._timeouts.heartbeat_lost_s or age_s < 0.0:  # after a clock has gone back ages are unknown
            return Heartbeat.LOST
        return Heartbeat.LATE if age_s > self._timeouts.heartbeat_late_s else Heartbeat.ALIVE

    def check(self) -> None:
        """Raise ConnectionFailed (line lost), StaleData (heartbeat lost) or DriveFault (drive restarted)."""
        self.line.check()
        if self.messages.restarted:
            raise DriveFault(
                self.name, self.where, "the drive has restarted, its compensation is off", "connect to it again"
            )
        self.require_heartbeat()

    def require_heartbeat(self) -> None:
        """Raise StaleData if the drive has been silent for too long; nothing is asked of it."""
        if self.heartbeat() is Heartbeat.LOST:
            age_s = self.messages.heartbeat_age_s()
            raise StaleData(
                self.name, self.where, f"no heartbeat for {age_s:.1f} s", "check power and cable of the drive"
            )

    def latest(self, t_rig_s: float, t_host_s: float) -> DriveSample:
        """What the drive sent last, as one sample with the given times of its SYNC."""
        return self.messages.sample(self.metres_per_increment, t_rig_s, t_host_s)

    def fault(self, what: str) -> DriveFault:
        """A DriveFault with the last emergency in its text."""
        last = self.messages.last_emergency()
        because = f", {last}" if last else ""
        return DriveFault(self.name, self.where, what + because, "remove the cause, then reset the fault")

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        end_s = self._clock.now_s() + self._timeouts.state_s
        polls = 0
        while not condition():
            self.line.check()
            polls += 1
            if polls >= _MIN_POLLS and self._clock.now_s() >= end_s:
                raise MotionTimeout(
                    self.name,
                    self.where,
                    f"{what} not reached in {self._timeouts.state_s:g} s",
                    "check the drive's display, its power and its enable inputs",
                )
            self._clock.sleep_s(self._timeouts.poll_period_s)
