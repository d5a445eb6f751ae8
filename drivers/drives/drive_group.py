"""The drives of one machine, moved and stopped together."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise

from drivers.clock import HostClock, RigClock
from drivers.drives import cia402
from drivers.drives.cia402 import State
from drivers.drives.cyclic_path import PathWalk, Row, check_path, require_on_path
from drivers.drives.drive_setup import interpolation_period
from drivers.drives.group_stop import GroupStop
from drivers.drives.homing import AT_PRESENT_POSITION, DriveHoming, HomingParameters
from drivers.drives.profile_move import (
    GroupTiming,
    ProfileMove,
    RestLimits,
    farthest_m,
    longest_s,
    timeout_error,
)
from drivers.drives.servo_drive import DriveSample, ServoDrive
from drivers.drives.sync_sampler import CyclicSync, SyncSampler
from drivers.errors import DeviceError

__all__ = ["DriveGroup", "GroupTiming", "RestLimits"]

_SYNC_COUNT_TO_ARRIVE = 10
_BRAKE_S = 0.1  # from full speed to rest along a path
_BRAKE_GUARD_S = 2.0  # host time after which a stop no longer waits for that
_QUICK_STOP_S = 0.05  # from the fastest part of a path to rest, for all drives alike
_SLOWEST_RAMPED = 1e-4  # m/s or rad/s: a drive that hardly moves
_FAULT_STATES = (State.FAULT, State.FAULT_REACTION)


class DriveGroup:
    """Moves all drives together, samples them at SYNC and stops them as one.

    `sync` sends SYNC (default: the drives' line). `stop_all` and `sample` may be called from any thread at any time;
    one move at a time. An EMCY of one drive stops all without waiting for the next poll.
    `only_led`: there are more drives than coordinates for them to command, so that they must agree at any time. They
    only `follow` paths, a stop brings them to rest along the path, and their quick-stop ramps are scaled so that they
    stop together where nobody leads them.
    """

    def __init__(
        self,
        drives: Sequence[ServoDrive],
        clock: RigClock | None = None,
        *,
        sync: Callable[[], None] | None = None,
        rest: RestLimits | None = None,
        timing: GroupTiming | None = None,
        only_led: bool = False,
    ) -> None:
        timing = timing or GroupTiming()
        self.only_led = only_led
        self._leading = False
        if not drives or any(drive.line is not drives[0].line for drive in drives):
            raise ValueError("a group is one or more drives on one CAN line")
        self.drives = tuple(drives)
        self.poll_period_s = timing.poll_period_s
        self.rest = rest or RestLimits()
        self.line = drives[0].line
        self._clock = clock or HostClock()
        self._sampler = SyncSampler(self.drives, self._clock, sync or self.line.send_sync, timing.pdo_timeout_s)
        self._stop = GroupStop(self.drives, self.line)
        self._move_lock = threading.Lock()
        self._profile_move = ProfileMove(
            self.drives, self._clock, self._stop, lambda: self._check_all(self.sample()), self.rest, timing
        )

    @property
    def stop_reason(self) -> str | None:
        """Why the drives were stopped; None while they may move."""
        return self._stop.reason or self._stop.requested

    def stop_all(self, reason: str) -> None:
        """Quick stop of all drives at once, remembered until `clear_stop`; the first reason is kept.

        Sent twice, so that one lost frame does not matter. A drive that cannot be reached does not prevent the stop of
        the others; the first such failure is raised afterwards (ConnectionFailed). While drives that must agree are led
        along a path they first brake along it; they are stopped at once if that does not come to its end.
        """
        if not self._leading:
            self._stop.stop(reason)
            return
        if self._stop.requested is None:
            self._stop.requested = reason
            guard = threading.Timer(_BRAKE_GUARD_S, self._stop_unless_rested, [reason])
            guard.daemon = True
            guard.start()

    def _stop_unless_rested(self, reason: str) -> None:
        if self._leading and self._stop.requested == reason:
            with suppress(DeviceError):
                self._stop.stop(reason)

    def clear_stop(self) -> None:
        """Allow moves again. The drives have to be enabled again."""
        self._stop.clear()

    def enable(self) -> None:
        """Enable all drives; if one fails, all are disabled again.

        Each is asked whether it is still referenced, which may have changed since it was connected.
        Raises DriveFault (NotReferenced for one that has to be homed), Stopped, MotionTimeout.
        """
        self._stop.raise_if_stopped()
        for drive in self.drives:
            drive.reference.read()
        try:
            for drive in self.drives:
                drive.check()
                drive.enable(partial(self._stop.send, drive))
        except DeviceError:
            self._stop.disable_voltage()
            raise

    def disable(self) -> None:
        """Take the power off all drives, also if one of them fails. Raises MotionTimeout."""
        failures: list[DeviceError] = []
        for drive in self.drives:
            try:
                drive.disable()
            except DeviceError as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def fault_reset(self) -> None:
        """Acknowledge the faults of all drives and ask which are still referenced. Raises DriveFault if one remains."""
        for drive in self.drives:
            drive.fault_reset()
            drive.reference.ask()

    def home(self, homings: Sequence[HomingParameters | None]) -> None:
        """Home drives one after the other, omitting those with None; the others are without power meanwhile.

        All are without power afterwards. Any failure stops all, and the stop is remembered. Raises DriveFault,
        NotReferenced, MotionTimeout, Stopped, ConnectionFailed, NoAnswer, SdoRefused and StaleData; before anything
        is written ValueError for numbers that do not fit and for drives that cannot be homed.
        """
        if len(homings) != len(self.drives):
            raise ValueError(f"{len(self.drives)} drives, {len(homings)} sets of homing parameters")
        for drive, homing in zip(self.drives, homings, strict=True):
            if self.only_led and homing is not None and homing.method not in AT_PRESENT_POSITION:
                raise ValueError(
                    f"{drive.name}: homing method {homing.method} moves it while the others stand; they must agree"
                )
        runs = [
            DriveHoming(
                drive,
                homing,
                partial(self._stop.send, drive),
                partial(self._require_no_fault, drive),
                self._clock,
                self.poll_period_s,
            )
            for drive, homing in zip(self.drives, homings, strict=True)
            if homing is not None
        ]
        with self._one_move():
            self._stop.raise_if_stopped()
            with self._stop.stopping_on_failure():
                self.disable()
                for run in runs:
                    run.home()
                    self._stop.raise_if_stopped()

    def sample(self) -> list[DriveSample]:
        """Send SYNC and return a sample of each drive, in their order; during `follow` those of its last SYNC.

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
        if self.only_led:
            raise ValueError("each drive on its own way would strain the machine: these are only led along paths")
        with self._one_move():
            self._stop.raise_if_stopped()
            for drive in self.drives:
                drive.check()
                drive.reference.require()
                drive.require_mode(cia402.PROFILE_POSITION)
            # Twice: a drive uses its partner's command from the previous SYNC.
            self.sample()
            before = self._check_all(self.sample())
            if limit_s is None:
                limit_s = longest_s(before, positions_m, velocity_m_per_s)
            self._profile_move.write_targets(positions_m, velocity_m_per_s, acceleration_m_per_s2)
            with self._stop.stopping_on_failure():
                self._profile_move.start(positions_m)
                return self._profile_move.wait_for_rest(positions_m, velocity_m_per_s, limit_s)

    def set_cyclic_position(self, period_s: float) -> None:
        """Cyclic synchronous position mode with a SYNC every `period_s` for all drives, which are without power.

        Raises ValueError for powered drives, makes without this mode and a period that 0x60C2 cannot express, and what
        `ServoDrive.set_cyclic_position` raises.
        """
        interpolation_period(period_s)
        for drive in self.drives:
            drive.require_cyclic_position()
            drive.require_no_power()
        for drive in self.drives:
            drive.set_cyclic_position(period_s)

    def follow(self, path_m: Sequence[Row], velocity_m_per_s: float) -> list[DriveSample]:
        """Move all drives along a path, one row per SYNC, at the period of `set_cyclic_position`.

        The drives are enabled; each row has one position per drive, the first row is where they are, all are within the
        software limits, and no step is longer than `velocity_m_per_s` permits. SYNC continues until all demands are at
        the end of the path; returns the samples of the last one, which may still show a following error. Any failure
        stops all drives, also a demand that is not on the path. A drive that receives no SYNC, or cannot follow, goes
        into fault by itself. Raises Stopped, DriveFault, NotReferenced,
        MotionTimeout, NoAnswer, ConnectionFailed, StaleData, ValueError.
        """
        with self._one_move():
            self._stop.raise_if_stopped()
            for drive in self.drives:
                drive.reference.require()
                drive.require_mode(cia402.CYCLIC_POSITION)
            period_s = self.drives[0].sync_period_s
            if any(drive.sync_period_s != period_s for drive in self.drives):
                raise ValueError("the drives have different SYNC periods: set the mode of all together")
            check_path(self.drives, path_m, velocity_m_per_s * period_s)
            samples = self._check_all(self.sample())
            deviation_m = farthest_m(samples, path_m[0])
            if deviation_m > self.rest.demand_m + self.rest.following_error_m:
                raise ValueError(f"the path begins {deviation_m * 1e6:.0f} um from the position of the drives")
            if self.only_led:
                self._scale_quick_stops(path_m, period_s)
            with self._stop.stopping_on_failure(), self._sampler.cyclic_sync(samples, period_s) as send_row:
                try:
                    self._leading = self.only_led
                    return self._follow_path(path_m, period_s, [sample.demand_m for sample in samples], send_row)
                finally:
                    self._leading = False

    def _scale_quick_stops(self, path_m: Sequence[Row], period_s: float) -> None:
        """Ramps (0x6085) with which all drives need the same time to rest, from where each is fastest on the path."""
        for drive, places_m in zip(self.drives, zip(*path_m, strict=True), strict=True):
            fastest = max((abs(b - a) for a, b in pairwise(places_m)), default=0.0) / period_s
            drive.set_quick_stop(max(fastest, _SLOWEST_RAMPED) / _QUICK_STOP_S)

    def _follow_path(
        self, path_m: Sequence[Row], period_s: float, start_m: Row, send_row: CyclicSync
    ) -> list[DriveSample]:
        last_rows = deque[Row]([start_m, start_m], maxlen=3)
        walk = PathWalk(path_m, max(1, round(_BRAKE_S / period_s)))
        due_s, rows_at_rest = self._clock.now_s(), 0
        while rows_at_rest <= _SYNC_COUNT_TO_ARRIVE:
            row = walk.next_row(brake=self._stop.requested is not None)
            if not rows_at_rest:  # what has not quite arrived at the end is still between the rows before it
                last_rows.append(row)
            samples = self._check_all(send_row(partial(self._send_targets, row)))
            require_on_path(self.drives, samples, last_rows, self.rest.demand_m)
            if walk.at_rest:
                rows_at_rest += 1
                if farthest_m(samples, row) <= self.rest.demand_m:
                    self._stop_where_requested()
                    return samples
            late_s = samples[0].t_rig_s - due_s
            due_s += period_s + (late_s if late_s > 0.5 * period_s else 0.0)  # a repeated SYNC starts a new period
            self._clock.sleep_s(due_s - self._clock.now_s())
        raise timeout_error(self.drives[0], samples[0], "not on the end of the path", period_s * _SYNC_COUNT_TO_ARRIVE)

    def _stop_where_requested(self) -> None:
        """At rest on the path: end a stop that was asked for meanwhile. Raises Stopped."""
        if self._stop.requested is not None:
            self._stop.stop(self._stop.requested)
            self._stop.raise_if_stopped()

    def _send_targets(self, row: Row) -> None:
        self._stop.raise_if_stopped()
        for drive, position_m in zip(self.drives, row, strict=True):
            drive.check()
            drive.send_target(position_m)

    def _check_all(self, samples: list[DriveSample]) -> list[DriveSample]:
        self.line.require_only_master()
        pairs = list(zip(self.drives, samples, strict=True))
        pairs.sort(
            key=lambda pair: (pair[1].state not in _FAULT_STATES, pair[0].messages.last_emergency() is None)
        )  # the cause first
        for drive, sample in pairs:
            drive.check()
            if sample.state in _FAULT_STATES:
                raise drive.fault("the drive is in fault")
            if sample.state is not State.OPERATION_ENABLED:
                self._stop.raise_if_stopped()
                raise drive.fault(f"the drive is not enabled but in {sample.state.value}")
            if sample.statusword & cia402.FOLLOWING_ERROR:
                raise drive.fault("following error")
        return samples

    def _require_no_fault(self, homed: ServoDrive) -> None:
        """Raise if the drives were stopped, one cannot be reached, or one that is not being homed is in fault."""
        self._stop.raise_if_stopped()
        for drive in self.drives:
            drive.check()
            if drive is not homed and drive.state() in _FAULT_STATES:
                self._stop.raise_if_stopped()  # by its EMCY, which is more specific
                raise drive.fault("the drive is in fault")

    @contextmanager
    def _one_move(self) -> Iterator[None]:
        if not self._move_lock.acquire(blocking=False):
            raise RuntimeError("another move is under way")
        try:
            yield
        finally:
            self._move_lock.release()
