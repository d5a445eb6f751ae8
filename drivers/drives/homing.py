"""Homing (CiA 402, mode 6): a drive finds its reference at a mark, or takes its present position as the reference."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from drivers.can.drive_object import DriveObject
from drivers.clock import RigClock
from drivers.drives import cia402, objects
from drivers.drives.cia402 import State
from drivers.drives.servo_drive import ServoDrive
from drivers.errors import DeviceError, DriveFault, MotionTimeout

_POLLS_ATTAINED = 3
_MIN_POLLS = 10  # however fast rig time runs, the drive gets its chance to answer
AT_PRESENT_POSITION = (35, 37)  # no motion: the bit may fall and rise between polls


@dataclass(frozen=True)
class HomingParameters:
    """How one drive is homed: method of 0x6098, and the position of its mark.

    Times are rig time. Afterwards the drive must report a position within `tolerance_m` of the mark: a drive may
    overrun it while braking, but with a home offset of the wrong sign the position is far off.
    """

    method: int
    position_m: float
    speed_m_per_s: float = 0.002
    acceleration_m_per_s2: float = 0.1
    limit_s: float = 60.0
    tolerance_m: float = 1e-3

    def __post_init__(self) -> None:
        """Raise ValueError for numbers that are not possible."""
        rates = (self.speed_m_per_s, self.acceleration_m_per_s2, self.limit_s, self.tolerance_m)
        if not all(math.isfinite(rate) and rate > 0.0 for rate in rates):
            raise ValueError("homing: speed, acceleration, time limit and tolerance must be positive")
        if not -128 <= self.method <= 127:
            raise ValueError(f"homing: there is no method {self.method}")


class DriveHoming:
    """One homing of one drive, its numbers converted beforehand.

    `send` sends its controlwords and raises if the drives were stopped; `require_no_fault` raises then as well, and if
    anything is wrong with any of them. Raises ValueError for numbers that do not fit, and for a drive that cannot say
    whether it is referenced: an aborted homing would then pass for a successful one.
    """

    def __init__(
        self,
        drive: ServoDrive,
        homing: HomingParameters,
        send: Callable[[int], None],
        require_no_fault: Callable[[], None],
        clock: RigClock,
        poll_period_s: float,
    ) -> None:
        if drive.profile.referenced is None:
            raise ValueError(f"{drive.name}: its profile does not say how to tell whether it is referenced")
        if not drive.profile.capabilities.homing:
            raise ValueError(f"{drive.name}: a '{drive.profile.name}' cannot be homed by this software")
        self._drive, self._homing = drive, homing
        self._send, self._require_no_fault = send, require_no_fault
        self._clock, self._poll_period_s = clock, poll_period_s
        self._settings = _settings(drive, homing)

    def home(self) -> None:
        """Home the drive and leave it without power, in profile position mode.

        Raises DriveFault if homing failed, the drive left operation enabled or the position is wrong afterwards,
        NotReferenced, MotionTimeout, and the errors of communication.
        """
        drive, setup = self._drive, self._drive.setup()
        for entry, value in self._settings:
            setup.set_and_compare(entry, value)
        drive.set_mode(cia402.HOMING)
        drive.enable(self._send)
        drive.reference.distrust("homing did not complete successfully")
        self._run()
        drive.disable()
        drive.set_mode(cia402.PROFILE_POSITION)
        self._compare_position()
        drive.target_m = drive.sdo.read(objects.TARGET_POSITION) * drive.metres_per_increment
        drive.reference.trust()

    def _run(self) -> None:
        end_s = self._clock.now_s() + self._homing.limit_s
        before = self._statusword()
        old_bit = bool(before & cia402.HOMING_ATTAINED) and self._homing.method not in AT_PRESENT_POSITION
        started, attained, polls = False, 0, 0
        while attained < _POLLS_ATTAINED:
            if not started:
                self._send(cia402.START_HOMING)  # repeated: only the edge of bit 4 counts, and a frame may be lost
            self._clock.sleep_s(self._poll_period_s)
            word = self._statusword()
            if word & cia402.HOMING_ERROR:
                raise self._drive.fault("homing failed")
            started = started or not word & cia402.TARGET_REACHED
            old_bit = old_bit and bool(word & cia402.HOMING_ATTAINED)  # the bit of the previous homing must fall first
            is_attained = not old_bit and word & cia402.TARGET_REACHED and word & cia402.HOMING_ATTAINED
            attained = attained + 1 if is_attained else 0
            polls += 1
            if not is_attained and polls >= _MIN_POLLS and self._clock.now_s() >= end_s:
                raise MotionTimeout(
                    self._drive.name,
                    self._drive.where,
                    f"not homed in {self._homing.limit_s:g} s",
                    "check method, speed and home mark",
                )

    def _statusword(self) -> int:
        """The statusword of a drive that is still enabled; nothing is sent that would enable it again."""
        self._require_no_fault()
        word = self._drive.sdo.read(objects.STATUSWORD)
        state = cia402.state_of(word)
        if state is not State.OPERATION_ENABLED:
            self._require_no_fault()  # raises if it was stopped, which is then the cause
            raise self._drive.fault(f"homing ended in {state.value}")
        return word

    def _compare_position(self) -> None:
        drive, mark_m = self._drive, self._homing.position_m
        position_m = drive.position_actual_m()
        if abs(position_m - mark_m) <= self._homing.tolerance_m:
            return
        still_referenced = "" if self._lose_reference() else " and still reports that it is referenced"
        raise DriveFault(
            drive.name,
            drive.where,
            f"after homing it stands at {position_m:.6f} m, not at {mark_m:.6f} m{still_referenced}",
            "check home offset and its sign (profile), then `pkm-rig home --rig RIG.toml --again` before it moves",
        )

    def _lose_reference(self) -> bool:
        """Start homing again and abort it, which makes a drive lose its reference; returns whether it then says so.

        Not for methods without motion, which would only take the present position once more.
        """
        drive = self._drive
        with suppress(DeviceError):
            try:
                if self._homing.method not in AT_PRESENT_POSITION:
                    drive.set_mode(cia402.HOMING)
                    drive.enable(self._send)
                    self._send(cia402.START_HOMING)
                    self._clock.sleep_s(self._poll_period_s)
            finally:
                drive.disable()
            drive.set_mode(cia402.PROFILE_POSITION)
            return not drive.setup().is_referenced()
        return False


def _settings(drive: ServoDrive, homing: HomingParameters) -> list[tuple[DriveObject, int]]:
    """The values to write before homing, in increments. Raises ValueError if one does not fit its object."""

    def increments(value: float) -> int:
        return max(1, round(value / drive.metres_per_increment))

    speed = increments(homing.speed_m_per_s)
    settings = [
        (objects.HOMING_METHOD, homing.method),
        (objects.HOME_OFFSET, drive.profile.home_offset_sign * drive.increments(homing.position_m)),
        (objects.HOMING_SPEED_SWITCH, speed),
        (objects.HOMING_SPEED_ZERO, speed),
        (objects.HOMING_ACCELERATION, increments(homing.acceleration_m_per_s2)),
    ]
    for entry, value in settings:
        try:
            struct.pack(entry.format, value)
        except struct.error as error:
            raise ValueError(f"{drive.name}: {entry}: {value} increments do not fit") from error
    return settings
