"""Homing (CiA 402, mode 6): a drive goes to its mark, or takes the place where it stands, and knows where it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers import cia402, objects
from drivers.cia402 import State
from drivers.clock import RigClock
from drivers.errors import DriveFault, MotionTimeout

if TYPE_CHECKING:
    from drivers.servo_drive import ServoDrive

_POLLS_ATTAINED = 3  # drives may tell of the homing before until they have taken the start


@dataclass(frozen=True)
class Homing:
    """How one drive is homed: method of 0x6098, and the position that its mark has.

    Times are rig time. Afterwards the drive must say that it stands within `tolerance_m` of the mark: a drive may run
    past it while it brakes, but a home offset with the wrong sign is far off.
    """

    method: int
    position_m: float
    speed_m_per_s: float = 0.002
    acceleration_m_per_s2: float = 0.1
    limit_s: float = 60.0
    tolerance_m: float = 1e-3

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        rates = (self.speed_m_per_s, self.acceleration_m_per_s2, self.limit_s, self.tolerance_m)
        if not all(math.isfinite(rate) and rate > 0.0 for rate in rates):
            raise ValueError("homing: speed, acceleration, time limit and tolerance must be positive")
        if not -128 <= self.method <= 127:
            raise ValueError(f"homing: there is no method {self.method}")


def home(drive: ServoDrive, homing: Homing, send: Callable[[int], None], clock: RigClock, poll_period_s: float) -> None:
    """Home one drive and leave it without power, in profile position mode.

    `send` sends its controlwords and raises when the drives were stopped. Raises DriveFault for a homing that failed,
    a drive that dropped out or a position that cannot be, NotReferenced, MotionTimeout, and what talking raises.
    """
    drive.referenced = False
    _write(drive, homing)
    drive.set_mode(cia402.HOMING)
    drive.enable(send)
    _run(drive, homing, send, clock, poll_period_s)
    send(cia402.ENABLE_OPERATION)
    drive.set_mode(cia402.PROFILE_POSITION)
    drive.disable()
    step_m = drive.metres_per_increment
    found_m = drive.sdo.read(objects.POSITION_ACTUAL) * step_m
    if not abs(found_m - homing.position_m) <= homing.tolerance_m:
        raise DriveFault(
            drive.name,
            drive.where,
            f"after homing it stands at {found_m:.6f} m, not at {homing.position_m:.6f} m",
            "check home offset and its sign (profile), and home it again before it moves",
        )
    drive.target_m = drive.sdo.read(objects.TARGET_POSITION) * step_m
    drive.read_reference()


def _write(drive: ServoDrive, homing: Homing) -> None:
    def increments(value: float) -> int:
        return max(1, round(value / drive.metres_per_increment))

    setup = drive.setup()
    speed = increments(homing.speed_m_per_s)
    setup.set_and_compare(objects.HOMING_METHOD, homing.method)
    setup.set_and_compare(objects.HOME_OFFSET, drive.profile.home_offset_sign * drive.increments(homing.position_m))
    setup.set_and_compare(objects.HOMING_SPEED_SWITCH, speed)
    setup.set_and_compare(objects.HOMING_SPEED_ZERO, speed)
    setup.set_and_compare(objects.HOMING_ACCELERATION, increments(homing.acceleration_m_per_s2))


def _run(drive: ServoDrive, homing: Homing, send: Callable[[int], None], clock: RigClock, poll_period_s: float) -> None:
    end_s = clock.now_s() + homing.limit_s
    attained = 0
    while attained < _POLLS_ATTAINED:
        send(cia402.START_HOMING)  # again and again: only the edge of bit 4 counts, and a frame may be lost
        clock.sleep_s(poll_period_s)
        drive.check()
        word = drive.sdo.read(objects.STATUSWORD)
        state = cia402.state_of(word)
        if state is not State.OPERATION_ENABLED:
            send(cia402.ENABLE_OPERATION)  # raises where it was stopped: that is the cause then
            raise drive.fault(f"homing ended in {state.value}")
        if word & cia402.HOMING_ERROR:
            raise drive.fault("homing failed")
        done = word & cia402.TARGET_REACHED and word & cia402.HOMING_ATTAINED
        attained = attained + 1 if done else 0
        if not done and clock.now_s() >= end_s:
            raise MotionTimeout(
                drive.name,
                drive.where,
                f"not homed in {homing.limit_s:g} s",
                "check method, speed and what marks its home",
            )
