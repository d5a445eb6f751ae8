"""The drives of one machine, moved and stopped together."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, repeat

from drivers.clock import HostClock, RigClock
from drivers.drives import cia402
from drivers.drives.cia402 import State
from drivers.drives.cyclic_path import Row, check_path, require_on_path
from drivers.drives.drive_setup import interpolation_period
from drivers.drives.homing import DriveHoming, HomingParameters
from drivers.drives.servo_drive import DriveSample, Emergency, ServoDrive
from drivers.drives.sync_sampler import CyclicSync, SyncSampler
from drivers.errors import DeviceError, MotionTimeout, Stopped

_MIN_SAMPLES_AT_REST = 3
_MIN_POLLS = 10  # however fast rig time runs, the drives get their chance to answer
_CLOCK_GRAIN_S = 1e-9
_SYNC_COUNT_TO_ARRIVE = 10
_FAULT_STATES = (State.FAULT, State.FAULT_REACTION)


@dataclass(frozen=True)
class RestLimits:
    """When a drive counts as at rest on its target, held for `hold_s` of rig time.

    Besides target reached (bit 10) and no following error (bit 13): the demand is on the target to
    `demand_m`, the velocity and the following error are small.
    """

    hold_s: float = 0.2
    demand_m: float = 1e-6
    velocity_m_per_s: float = 1e-3
    following_error_m: float = 20e-6


@dataclass(frozen=True)
class GroupTiming:
    """Rig time, except `pdo_timeout_s` for the answers to one SYNC, which is host time.

    A move is polled every `poll_period_s`, far from its end every `cruise_period_s` (at least `poll_period_s`); a new
    set-point must be acknowledged within `handshake_limit_s`.
    """

    poll_period_s: float = 0.05
    cruise_period_s: float = 0.2
    pdo_timeout_s: float = 1.0
    handshake_limit_s: float = 1.0


class DriveGroup:
    """Moves all drives together, samples them at SYNC and stops them as one.

    `sync` sends SYNC (default: the drives' line). `stop_all` and `sample` may be called from any thread at any time;
    one move at a time. An EMCY of one drive stops all without waiting for the next poll.
    """

    def __init__(
        self,
        drives: Sequence[ServoDrive],
        clock: RigClock | None = None,
        *,
        sync: Callable[[], None] | None = None,
        rest: RestLimits | None = None,
        timing: GroupTiming | None = None,
    ) -> None:
        timing = timing or GroupTiming()
        if not drives or any(drive.line is not drives[0].line for drive in drives):
            raise ValueError("a group is one or more drives on one CAN line")
        self.drives = tuple(drives)
        self.poll_period_s = timing.poll_period_s
        self.cruise_period_s = max(timing.cruise_period_s, timing.poll_period_s)
        self.rest = rest or RestLimits()
        self.line = drives[0].line
        self._clock = clock or HostClock()
        self._sampler = SyncSampler(self.drives, self._clock, sync or self.line.send_sync, timing.pdo_timeout_s)
        self._handshake_limit_s = timing.handshake_limit_s
        self._command_lock = threading.Lock()
        self._move_lock = threading.Lock()
        self._stop_reason: str | None = None
        self._guilty: ServoDrive | None = None  # whose EMCY has stopped the motion under way
        self._moving = False
        for drive in self.drives:
            drive.on_emergency = partial(self._on_emergency, drive)

    @property
    def stop_reason(self) -> str | None:
        """Why the drives were stopped; None while they may move."""
        return self._stop_reason

    def stop_all(self, reason: str) -> None:
        """Quick stop of all drives at once, remembered until `clear_stop`; sent twice, so that no lost frame undoes it.

        The first reason is kept. A drive that cannot be reached does not keep the others from being
        stopped; the first such failure is raised afterwards (ConnectionFailed).
        """
        if self._stop_reason is None:
            self._stop_reason = reason
        failures: list[DeviceError] = []
        with self._command_lock:
            for drive in (*self.drives, *self.drives):
                try:
                    drive.quick_stop()
                except DeviceError as error:
                    failures.append(error)
        if failures:
            raise failures[0]

    def clear_stop(self) -> None:
        """Allow moves again. The drives have to be enabled anew."""
        self._stop_reason = None

    def enable(self) -> None:
        """Enable all drives; if one fails all are disabled again.

        Each is asked whether it is still referenced, which it may have lost since it was connected.
        Raises DriveFault (NotReferenced for one that has to be homed), Stopped, MotionTimeout.
        """
        self._raise_if_stopped()
        for drive in self.drives:
            drive.reference.read()
        try:
            for drive in self.drives:
                drive.check()
                drive.enable(partial(self._send, drive))
        except DeviceError:
            with self._command_lock:
                for drive in self.drives:
                    drive.send_controlword(cia402.DISABLE_VOLTAGE)
            raise

    def disable(self) -> None:
        """Take the power off all drives; one that fails does not spare the others. Raises MotionTimeout."""
        failures: list[DeviceError] = []
        for drive in self.drives:
            try:
                drive.disable()
            except DeviceError as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def fault_reset(self) -> None:
        """Acknowledge the faults of all drives and ask which are still referenced. Raises DriveFault if one stays."""
        for drive in self.drives:
            drive.fault_reset()
            drive.reference.ask()

    def home(self, homings: Sequence[HomingParameters | None]) -> None:
        """Home drives one after the other, leaving out where there is None; the others stand without power meanwhile.

        All are without power afterwards. Whatever goes wrong stops all, and the stop is remembered. Raises DriveFault,
        NotReferenced, MotionTimeout, Stopped, ConnectionFailed, NoAnswer, SdoRefused and StaleData; before anything
        is written ValueError for numbers that do not fit and drives that cannot say whether they are referenced.
        """
        if len(homings) != len(self.drives):
            raise ValueError(f"{len(self.drives)} drives, {len(homings)} ways to home them")
        runs = [
            DriveHoming(
                drive,
                homing,
                partial(self._send, drive),
                partial(self._require_no_fault, drive),
                self._clock,
                self.poll_period_s,
            )
            for drive, homing in zip(self.drives, homings, strict=True)
            if homing is not None
        ]
        with self._one_move():
            self._raise_if_stopped()
            with self._stopping_on_failure():
                self.disable()
                for run in runs:
                    run.home()
                    self._raise_if_stopped()

    def sample(self) -> list[DriveSample]:
        """Send SYNC and return what each drive says at it, in the order of the drives; what they last said in `follow`.

        Raises NoAnswer naming the drive that is silent, ConnectionFailed.
        """
        return self._sampler.sample()

    def move_to(
        self,
        positions_m: Sequence[float],
        velocity_m_per_s: float,
        acceleration_m_per_s2: float | None = None,
        *,
        limit_s: float | None = None,
    ) -> list[DriveSample]:
        """Move all drives to their positions and wait until all are at rest there; returns the last samples.

        No drive starts unless all have accepted their target. If one faults, drops out or does not arrive
        within `limit_s` (default: from the distance), all are stopped and the stop is remembered.
        Raises SdoRefused (nothing moved), Stopped, DriveFault, MotionTimeout, NoAnswer, ConnectionFailed and
        StaleData.
        """
        if len(positions_m) != len(self.drives):
            raise ValueError(f"{len(self.drives)} drives, {len(positions_m)} positions")
        with self._one_move():
            self._raise_if_stopped()
            for drive in self.drives:
                drive.check()
                drive.reference.require()
                drive.require_mode(cia402.PROFILE_POSITION)
            # Twice: a drive takes its partner's command from the SYNC before.
            self.sample()
            before = self._check_all(self.sample())
            if limit_s is None:
                limit_s = _longest_s(before, positions_m, velocity_m_per_s)
            self._write_targets(positions_m, velocity_m_per_s, acceleration_m_per_s2)
            with self._stopping_on_failure():
                self._start(positions_m)
                return self._wait_for_rest(positions_m, velocity_m_per_s, limit_s)

    def set_cyclic_position(self, period_s: float) -> None:
        """Cyclic synchronous position mode with a SYNC every `period_s` for all drives, which are without power.

        Raises ValueError for drives with power and for a period that cannot be told; what setting raises.
        """
        interpolation_period(period_s)
        for drive in self.drives:
            drive.require_cyclic_position()
            drive.require_no_power()
        for drive in self.drives:
            drive.set_cyclic_position(period_s)

    def follow(self, path_m: Sequence[Row], velocity_m_per_s: float) -> list[DriveSample]:
        """Lead all drives along a path by SYNC, a row a SYNC, at the period of `set_cyclic_position`.

        The drives are enabled; each row is a position a drive, the first one where they stand, all within the software
        limits, no step longer than `velocity_m_per_s` permits. SYNC goes on until all demands are on the end of the
        path, so that none is left under way; returns the samples of the last one, at which the drives may still lag.
        Whatever goes wrong stops all, also a demand that is not on the path.
        A drive that hears no SYNC, or cannot follow, faults by itself. Raises Stopped, DriveFault, NotReferenced,
        MotionTimeout, NoAnswer, ConnectionFailed, StaleData, ValueError.
        """
        with self._one_move():
            self._raise_if_stopped()
            for drive in self.drives:
                drive.reference.require()
                drive.require_mode(cia402.CYCLIC_POSITION)
            period_s = self.drives[0].sync_period_s
            if any(drive.sync_period_s != period_s for drive in self.drives):
                raise ValueError("the drives wait for SYNC at different periods: set the mode of all together")
            check_path(self.drives, path_m, velocity_m_per_s * period_s)
            samples = self._check_all(self.sample())
            off_m = _farthest_m(samples, path_m[0])
            if off_m > self.rest.demand_m + self.rest.following_error_m:
                raise ValueError(f"the path begins {off_m * 1e6:.0f} um from where the drives stand")
            with self._stopping_on_failure(), self._sampler.cyclic_sync(samples, period_s) as lead:
                return self._follow_path(path_m, period_s, [sample.demand_m for sample in samples], lead)

    def _follow_path(self, path_m: Sequence[Row], period_s: float, start_m: Row, lead: CyclicSync) -> list[DriveSample]:
        last_rows = deque[Row]([start_m, start_m], maxlen=3)
        due_s = self._clock.now_s()
        for step, row in enumerate(chain(path_m, repeat(path_m[-1], _SYNC_COUNT_TO_ARRIVE)), start=1):
            last_rows.append(row)
            samples = self._check_all(lead(partial(self._send_targets, row)))
            require_on_path(self.drives, samples, last_rows, self.rest.demand_m)
            if step >= len(path_m) and _farthest_m(samples, row) <= self.rest.demand_m:
                return samples
            late_s = samples[0].t_rig_s - due_s
            due_s += period_s + (late_s if late_s > 0.5 * period_s else 0.0)  # a SYNC sent again begins a period anew
            self._clock.sleep_s(due_s - self._clock.now_s())
        raise _timeout_error(self.drives[0], samples[0], "not on the end of the path", period_s * _SYNC_COUNT_TO_ARRIVE)

    def _send_targets(self, row: Row) -> None:
        self._raise_if_stopped()
        for drive, position_m in zip(self.drives, row, strict=True):
            drive.check()
            drive.send_target(position_m)

    def _check_all(self, samples: list[DriveSample]) -> list[DriveSample]:
        pairs = list(zip(self.drives, samples, strict=True))
        pairs.sort(
            key=lambda pair: (pair[1].state not in _FAULT_STATES, pair[0].last_emergency() is None)
        )  # the guilty first
        for drive, sample in pairs:
            drive.check()
            if sample.state in _FAULT_STATES:
                raise drive.fault("the drive is in fault")
            if sample.state is not State.OPERATION_ENABLED:
                self._raise_if_stopped()
                raise drive.fault(f"the drive is not enabled but in {sample.state.value}")
            if sample.statusword & cia402.FOLLOWING_ERROR:
                raise drive.fault("following error")
        return samples

    def _write_targets(self, positions_m: Sequence[float], velocity: float, acceleration: float | None) -> None:
        former_m = [drive.target_m for drive in self.drives]
        for drive, position_m in zip(self.drives, positions_m, strict=True):
            drive.increments(position_m)  # all numbers are good before anything is written
            drive.set_profile(velocity, acceleration)
        written: list[tuple[ServoDrive, float]] = []
        try:
            for drive, position_m, old_m in zip(self.drives, positions_m, former_m, strict=True):
                drive.write_target(position_m)
                written.append((drive, old_m))
        except DeviceError:
            for drive, old_m in written:
                _restore_target(drive, old_m)
            raise

    def _start(self, targets_m: Sequence[float]) -> None:
        """Set-point handshake: bit 4 up on all back to back, bit 12 seen on all, bit 4 down.

        Bit 4 is sent again while bit 12 is awaited: only its edge counts, so that nothing is started twice.
        """

        def acknowledged(sample: DriveSample, _target_m: float) -> bool:
            return bool(sample.statusword & cia402.SET_POINT_ACKNOWLEDGED)

        def resend(_samples: list[DriveSample]) -> float:
            self._send_all(cia402.NEW_SET_POINT)
            return self.poll_period_s

        self._send_all(cia402.NEW_SET_POINT)
        self._wait(acknowledged, targets_m, self._handshake_limit_s, "set-point not acknowledged", pause_s=resend)
        self._send_all(cia402.ENABLE_OPERATION)

    def _wait_for_rest(self, targets_m: Sequence[float], velocity_m_per_s: float, limit_s: float) -> list[DriveSample]:
        def pause_s(samples: list[DriveSample]) -> float:
            if any(sample.statusword & cia402.SET_POINT_ACKNOWLEDGED for sample in samples):
                self._send_all(cia402.ENABLE_OPERATION)  # bit 4 is still up somewhere
            left_s = _farthest_m(samples, targets_m) / velocity_m_per_s
            return min(max(0.5 * left_s, self.poll_period_s), self.cruise_period_s)

        def at_rest(sample: DriveSample, target_m: float) -> bool:
            return bool(
                sample.statusword & cia402.TARGET_REACHED
                and not sample.statusword & cia402.SET_POINT_ACKNOWLEDGED
                and abs(sample.demand_m - target_m) <= self.rest.demand_m
                and abs(sample.velocity_m_per_s) <= self.rest.velocity_m_per_s
                and abs(sample.following_error_m) <= self.rest.following_error_m
            )

        return self._wait(
            at_rest,
            targets_m,
            limit_s,
            "not at rest on the target",
            self.rest.hold_s,
            _MIN_SAMPLES_AT_REST,
            pause_s,
        )

    def _wait(
        self,
        ready: Callable[[DriveSample, float], bool],
        targets_m: Sequence[float],
        limit_s: float,
        what: str,
        hold_s: float = 0.0,
        fewest: int = 1,
        pause_s: Callable[[list[DriveSample]], float] | None = None,
    ) -> list[DriveSample]:
        """Sample until all drives have been ready for `hold_s` and for `fewest` samples in a row."""
        end_s = self._clock.now_s() + limit_s
        since_s, in_a_row, polls = 0.0, 0, 0
        while True:
            samples = self._check_all(self.sample())
            waiting = [
                (drive, sample)
                for drive, sample, target_m in zip(self.drives, samples, targets_m, strict=True)
                if not ready(sample, target_m)
            ]
            t_s = samples[0].t_rig_s
            since_s = t_s if waiting or in_a_row == 0 else since_s
            in_a_row = 0 if waiting else in_a_row + 1
            if in_a_row >= fewest and t_s - since_s >= hold_s - _CLOCK_GRAIN_S:
                return samples
            polls += 1
            if waiting and polls >= _MIN_POLLS and self._clock.now_s() >= end_s:
                raise _timeout_error(*waiting[0], what, limit_s)
            self._clock.sleep_s(pause_s(samples) if pause_s else self.poll_period_s)
            self._raise_if_stopped()

    def _send(self, drive: ServoDrive, controlword: int) -> None:
        with self._command_lock:
            self._raise_if_stopped()
            drive.send_controlword(controlword)

    def _send_all(self, controlword: int) -> None:
        with self._command_lock:
            self._raise_if_stopped()
            for drive in self.drives:
                drive.send_controlword(controlword)

    def _require_no_fault(self, homed: ServoDrive) -> None:
        """Raise if the drives were stopped, one cannot be reached or another one than that being homed is in fault."""
        self._raise_if_stopped()
        for drive in self.drives:
            drive.check()
            if drive is not homed and drive.state() in _FAULT_STATES:
                self._raise_if_stopped()  # by its EMCY, which says more
                raise drive.fault("the drive is in fault")

    def _raise_if_stopped(self) -> None:
        guilty = self._guilty
        if guilty is not None and self._moving:
            raise guilty.fault("its emergency has stopped all drives")
        if self._stop_reason is not None:
            raise Stopped(
                "drives",
                self.line.name,
                f"stopped: {self._stop_reason}",
                "remove the cause, then clear the stop",
            )

    @contextmanager
    def _one_move(self) -> Iterator[None]:
        if not self._move_lock.acquire(blocking=False):
            raise RuntimeError("another move is under way")
        try:
            yield
        finally:
            self._move_lock.release()

    @contextmanager
    def _stopping_on_failure(self) -> Iterator[None]:
        """Whatever ends a move early stops all drives."""
        self._guilty, self._moving = None, True
        try:
            yield
        except BaseException as error:
            with suppress(DeviceError):
                self.stop_all(str(error) or type(error).__name__)
            raise
        finally:
            self._moving = False

    def _on_emergency(self, drive: ServoDrive, emergency: Emergency) -> None:
        """Called from the line's receiving thread: all that is done here is to remember the stop, then to send it.

        Remembered first: whoever polls the drives meanwhile must not send what enables one of them again.
        """
        if self._moving and emergency.is_error:
            if self._stop_reason is None:
                self._guilty, self._stop_reason = drive, f"{drive.name} ({drive.where}): {emergency}"
            with self._command_lock, suppress(DeviceError):
                for each in self.drives:
                    each.quick_stop()


def _longest_s(samples: Sequence[DriveSample], targets_m: Sequence[float], velocity_m_per_s: float) -> float:
    """A generous limit for a move, from its distance."""
    return 15.0 + 1.5 * _farthest_m(samples, targets_m) / velocity_m_per_s


def _farthest_m(samples: Sequence[DriveSample], targets_m: Sequence[float]) -> float:
    return max(abs(target - sample.demand_m) for sample, target in zip(samples, targets_m, strict=True))


def _restore_target(drive: ServoDrive, target_m: float) -> None:
    """Restore a target that never was started; without a set-point signal it is harmless if that fails."""
    if math.isfinite(target_m):
        with suppress(DeviceError):
            drive.write_target(target_m)


def _timeout_error(drive: ServoDrive, sample: DriveSample, what: str, limit_s: float) -> DeviceError:
    last = drive.last_emergency()
    return MotionTimeout(
        drive.name,
        drive.where,
        f"{what} after {limit_s:g} s: at {sample.position_m:.6f} m, following error"
        f" {sample.following_error_m * 1e6:.1f} um, velocity {sample.velocity_m_per_s:.6f} m/s,"
        f" statusword 0x{sample.statusword:04X}" + (f", {last}" if last else ""),
        "look for what holds the drive, then clear the stop",
    )
