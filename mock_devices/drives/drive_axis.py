"""The drive without its bus: power states, set-point handshake, motion and compensation.

A following error beyond its window (0x6065) is a fault at the next SYNC.
The encoder is absolute unless it is said to be incremental: then a restart makes the drive count from zero and its
position is not referenced until it is homed; until then it moves as commanded, which the master has to prevent.
An axis that would need more torque than 0x6072 permits is a following error at the next SYNC.
Not modelled: other modes, quick stop options (it stops and waits), limits of current, the time-out of the
following error (0x6066); a halted homing starts again from the beginning.
"""

from __future__ import annotations

from collections.abc import Callable

from mock_devices.can.sdo_abort import STATE_FORBIDS, VALUE_RANGE, RefusedWrite
from mock_devices.drives import cia402
from mock_devices.drives.axis_limits import AxisLimits
from mock_devices.drives.axis_motion import AxisMotion, Dynamics, command_for
from mock_devices.drives.cia402 import State
from mock_devices.drives.compensation import Compensation
from mock_devices.drives.cyclic_position import FASTEST_INC_PER_S, CyclicPosition
from mock_devices.drives.homing import Homing

WINDOW_TIME_S = 0.050
EMCY_COMPENSATION = 0xFF10
EMCY_HEARTBEAT = 0x8130
EMCY_FOLLOWING_ERROR = 0x8611
EMCY_SYNC = 0x8700
EMCY_STRAIN = 0xFF20  # the machine's own: a strut bears more than it may
PROFILE_POSITION, HOMING, CYCLIC_POSITION = 1, 6, 8


class DriveAxis:
    """One axis. Times are rig time; `now_s` asks the clock; `emergency` sends an EMCY code.

    It starts at the true position `start_inc`; an encoder that is not `absolute` counts that as zero.
    """

    def __init__(
        self,
        now_s: Callable[[], float],
        limits: AxisLimits,
        compensation: Compensation,
        start_inc: float,
        emergency: Callable[[int], None],
        *,
        absolute: bool = True,
    ) -> None:
        self._now_s = now_s
        self.limits = limits
        self.compensation = compensation
        self.absolute = absolute
        self.swaps = 0  # how often another drive has taken this one's place
        self.homing = Homing(referenced=absolute)
        self.motion = AxisMotion(start_inc) if absolute else AxisMotion(0.0, start_inc)
        self.state = State.SWITCH_ON_DISABLED
        self.target_inc = round(start_inc) if absolute else 0
        self.error_code = 0
        self._emergency = emergency
        self._controlword = 0
        self._acknowledged = False
        self._halted = False
        self.mode = PROFILE_POSITION
        self.abort_connection_option = 1
        self.cyclic = CyclicPosition()

    @property
    def controlword(self) -> int:
        """The last controlword."""
        return self._controlword

    @property
    def powered(self) -> bool:
        """Whether the motor holds the axis."""
        return self.state in cia402.POWERED

    def control(self, controlword: int) -> None:
        """Object 0x6040: state commands first, then the bits of profile position mode."""
        self.refresh()
        before, previous, self._controlword = self.state, self._controlword, controlword
        self.state = cia402.next_state(before, controlword, previous)
        self._carry_out(before)
        if before is State.FAULT and self.state is not State.FAULT:
            self._clear_error()
        both = self.state is State.OPERATION_ENABLED and before is State.OPERATION_ENABLED
        if both and self.mode == PROFILE_POSITION:
            self._halt(bool(controlword & cia402.HALT))
            if controlword & cia402.NEW_SET_POINT and not previous & cia402.NEW_SET_POINT:
                self._new_set_point(controlword)
        if both and self.mode == HOMING:
            self._home(controlword, previous)
        if not controlword & cia402.NEW_SET_POINT:
            self._acknowledged = False

    def set_mode(self, mode: int) -> None:
        """Object 0x6060. Raises RefusedWrite."""
        if mode not in (PROFILE_POSITION, HOMING, CYCLIC_POSITION):
            raise RefusedWrite(VALUE_RANGE)
        self._abort_homing()
        self.mode, self.cyclic.under_way = mode, False

    def set_target(self, target_inc: int) -> None:
        """Object 0x607A. Raises RefusedWrite."""
        self.cyclic.ignores = True
        if not self.limits.low_inc <= target_inc <= self.limits.high_inc:
            raise RefusedWrite(VALUE_RANGE)
        self.compensation.check_target(target_inc)
        self.target_inc, self.cyclic.ignores = target_inc, False

    def statusword(self) -> int:
        """Object 0x6041."""
        self.refresh()
        t_s = self._now_s()
        if self.mode == HOMING:
            return cia402.statusword(
                self.state,
                target_reached=self.homing.begun_s is None,
                set_point_acknowledged=self.homing.attained,
                following_error=self.homing.failed,
            )
        acknowledged = self._acknowledged or self._waiting(t_s)
        if self.mode == CYCLIC_POSITION:
            acknowledged = self.state is State.OPERATION_ENABLED and not self.cyclic.ignores
        return cia402.statusword(
            self.state,
            target_reached=t_s >= self.motion.end_s + WINDOW_TIME_S,
            set_point_acknowledged=acknowledged,
            following_error=self.error_code == EMCY_FOLLOWING_ERROR or self._following_error_too_large(),
        )

    def actual_inc(self) -> float:
        """Object 0x6064: position in command coordinates."""
        t_s = self._now_s()
        if self.powered:
            return self.motion.command(t_s)[0] - self.motion.following_error(t_s)
        compensation = self.compensation
        partner_inc = compensation.partner.command_inc
        return command_for(self.encoder_inc(t_s), compensation.table_in_use, partner_inc, self.motion.course)

    def demand_inc(self) -> float:
        """Object 0x6062: the command; where the axis stands if the motor is off."""
        return self.motion.command(self._now_s())[0] if self.powered else self.actual_inc()

    def encoder_inc(self, t_s: float) -> float:
        """Object 0x6063, not rounded."""
        return self.motion.encoder_inc(t_s, self.compensation.partner.command_inc)

    def true_position_inc(self, t_s: float) -> float:
        """The true position of the axis, whatever its encoder counts."""
        return self.motion.true_position_inc(t_s, self.compensation.partner.command_inc)

    def sync(self) -> None:
        """A SYNC: take over the partner's command; stop if motion is no longer permitted."""
        self.compensation.partner.sync()
        if self.state is State.OPERATION_ENABLED and self._following_error_too_large():
            self.fault(EMCY_FOLLOWING_ERROR)
        self._follow()
        self.watch_motion()

    def sync_lost(self) -> None:
        """No SYNC has arrived for too long in a cyclic motion."""
        if self.mode == CYCLIC_POSITION and self.state is State.OPERATION_ENABLED:
            self.fault(EMCY_SYNC)

    def _follow(self) -> None:
        """Cyclic mode: go to the target received since the previous SYNC."""
        self.cyclic.under_way = False
        if self.mode != CYCLIC_POSITION or self.state is not State.OPERATION_ENABLED:
            return
        t_s = self._now_s()
        step = self.cyclic.step(self.target_inc - self.motion.command(t_s)[0], self.limits.position_window_inc)
        if step is None:
            return
        if step.speed > FASTEST_INC_PER_S:
            self.fault(EMCY_FOLLOWING_ERROR)
            return
        self.motion.go(t_s, self.target_inc, step, at_once=True)

    def _following_error_too_large(self) -> bool:
        return abs(self.motion.following_error(self._now_s())) > self.limits.following_error_window_inc

    def abort_connection(self) -> None:
        """The master is gone (0x6007): nothing, fault, power off or quick stop."""
        option = self.abort_connection_option
        if option == 1:
            self.fault(EMCY_HEARTBEAT)
            return
        if option == 2:
            self.remove_power()
        if option == 3:
            self.quick_stop()
        self._raise_error(EMCY_HEARTBEAT)

    def remove_power(self) -> None:
        """Brake on, motor off, as far as it is on."""
        if self.powered:
            self._brake()
            self.state = State.SWITCH_ON_DISABLED

    def connection_is_back(self) -> None:
        """The master's heartbeat is back."""
        if self.error_code == EMCY_HEARTBEAT and self.state not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            self._clear_error()

    def watch_motion(self) -> None:
        """Quick stop if the axis moves and compensation does not permit it."""
        t_s = self._now_s()
        moving = self.state is State.OPERATION_ENABLED and self.motion.is_moving(t_s)
        if moving and not self.compensation.permits_motion():
            self.state = State.QUICK_STOP_ACTIVE
            self.motion.stop(t_s, self.limits.quick_stop_deceleration)
            self._raise_error(EMCY_COMPENSATION)

    def quick_stop(self) -> None:
        """Stop without a controlword: the node has left OPERATIONAL."""
        self.refresh()
        if self.state is State.OPERATION_ENABLED:
            self.state = State.QUICK_STOP_ACTIVE
            self.motion.stop(self._now_s(), self.limits.quick_stop_deceleration)

    def fault(self, code: int) -> None:
        """A fault: stop and then switch off. `code` is that of 0x603F and EMCY."""
        self.refresh()
        before, self.state = self.state, cia402.after_fault(self.state)
        if before in cia402.POWERED:
            self._brake()
        self._raise_error(code)

    def boot(self) -> None:
        """Restart: motor off, brake on; an incremental encoder loses its reference."""
        self.refresh()
        if self.powered:
            self._brake()
        self.homing.abort()
        if not self.absolute:
            self.motion.recount(self._now_s(), 0.0)
            self.homing.referenced, self.target_inc = False, 0
        self.state = State.SWITCH_ON_DISABLED
        self.error_code = 0
        self._controlword, self._acknowledged, self._halted = 0, False, False
        self.mode, self.abort_connection_option = PROFILE_POSITION, 1
        self.cyclic.under_way = False
        self.compensation.boot()

    def refresh(self) -> None:
        """End the fault reaction, and homing if its mark is reached or the motor is off."""
        if self.state is State.FAULT_REACTION_ACTIVE and not self.motion.is_moving(self._now_s()):
            self.state = State.FAULT
        begun_s = self.homing.begun_s
        if begun_s is None:
            return
        if self.state is not State.OPERATION_ENABLED:
            self.homing.abort()
        elif not self.motion.is_moving(self._now_s()):
            self.motion.recount(begun_s, float(self.homing.offset_inc))
            self.target_inc = self.homing.offset_inc
            self.homing.arrive()

    def _home(self, controlword: int, previous: int) -> None:
        """Bit 4 up starts homing, bit 4 down or halt aborts it."""
        if not controlword & cia402.NEW_SET_POINT or controlword & cia402.HALT:
            self._abort_homing()
            return
        if previous & cia402.NEW_SET_POINT:
            return
        t_s = self._now_s()
        if self.motion.is_moving(t_s) or self.compensation.table_in_use is not None:
            self.homing.abort(failed=True)
            return
        self.homing.begin(t_s)
        way_inc = self.homing.way_inc(self.true_position_inc(t_s))
        if way_inc:
            steep = float(self.homing.acceleration)
            target_inc = round(self.demand_inc() + way_inc)
            self.motion.go(t_s, target_inc, Dynamics(float(self.homing.speed), steep, steep), at_once=True)
        self.refresh()

    def _abort_homing(self) -> None:
        self.refresh()
        if self.homing.begun_s is not None:
            self.motion.stop(self._now_s(), float(self.homing.acceleration))
            self.homing.abort()

    def _carry_out(self, before: State) -> None:
        if self.state is before:
            return
        t_s = self._now_s()
        if self.state is State.OPERATION_ENABLED and before is State.SWITCHED_ON:
            partner_inc = self.compensation.partner.command_inc
            self.motion.release(t_s, self.compensation.table_in_use, partner_inc)
            self._halted = False
        elif self.state is State.QUICK_STOP_ACTIVE:
            self.motion.stop(t_s, self.limits.quick_stop_deceleration)
        elif before in cia402.POWERED and not self.powered:
            self._brake()

    def _brake(self) -> None:
        partner_inc = self.compensation.partner.command_inc
        self.motion.apply_brake(self._now_s(), self.limits.quick_stop_deceleration, partner_inc)

    def _new_set_point(self, controlword: int) -> None:
        t_s, at_once = self._now_s(), bool(controlword & cia402.CHANGE_IMMEDIATELY)
        if self._halted or (not at_once and self._waiting(t_s)):
            return
        target_inc = self.target_inc
        if controlword & cia402.RELATIVE:
            target_inc += self.motion.set_point(t_s).target_inc
        if not (self._permits(target_inc) and self.compensation.permits_motion()):
            self._raise_error(EMCY_COMPENSATION)
            return
        if self.error_code == EMCY_COMPENSATION:
            self._clear_error()
        self.motion.go(t_s, target_inc, self.limits.dynamics(), at_once=at_once)
        self._acknowledged = True

    def _permits(self, target_inc: int) -> bool:
        try:
            self.compensation.check_target(target_inc)
        except RefusedWrite:
            return False
        return self.limits.low_inc <= target_inc <= self.limits.high_inc

    def _halt(self, halt: bool) -> None:
        if halt and not self._halted:
            self.motion.stop(self._now_s(), float(self.limits.deceleration))
        self._halted = halt

    def _waiting(self, t_s: float) -> bool:
        """Whether a set-point waits for the motion under way."""
        return self.motion.set_point(t_s) != self.motion.set_point(float("inf"))

    def _raise_error(self, code: int) -> None:
        self.error_code = code
        self._emergency(code)

    def _clear_error(self) -> None:
        self.error_code = 0
        self._emergency(0)


__all__ = ["EMCY_COMPENSATION", "STATE_FORBIDS", "WINDOW_TIME_S", "AxisLimits", "DriveAxis"]
