"""One move of all drives in profile position mode: targets, set-point handshake, and waiting until all are at rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from drivers.clock import RigClock
from drivers.drives import cia402
from drivers.drives.drive_records import DriveSample
from drivers.drives.group_stop import GroupStop
from drivers.drives.servo_drive import ServoDrive
from drivers.errors import DeviceError, MotionTimeout

_MIN_SAMPLES_AT_REST = 3
_MIN_POLLS = 10  # however fast rig time runs, the drives get the chance to answer
_CLOCK_GRAIN_S = 1e-9

Ready = Callable[[DriveSample, float], bool]
Pause = Callable[[list[DriveSample]], float]


@dataclass(frozen=True)
class RestLimits:
    """When a drive counts as at rest on its target, for `hold_s` of rig time without interruption.

    Besides target reached (bit 10) and no following error (bit 13): the demand is on the target to
    `demand_m`, and velocity and following error are small.
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


@dataclass(frozen=True)
class ProfileMove:
    """Moves `drives`. `sample` returns a sample of each drive at one SYNC; it raises if one of them is not in order."""

    drives: tuple[ServoDrive, ...]
    clock: RigClock
    stop: GroupStop
    sample: Callable[[], list[DriveSample]]
    rest: RestLimits
    timing: GroupTiming

    def write_targets(self, targets_m: Sequence[float], velocity: float, acceleration: float | None) -> None:
        """Write profiles and targets; nothing moves yet. If one is refused, the others get their previous one back."""
        previous_m = [drive.target_m for drive in self.drives]
        for drive, target_m in zip(self.drives, targets_m, strict=True):
            drive.increments(target_m)  # all numbers are good before anything is written
            drive.set_profile(velocity, acceleration)
        written: list[tuple[ServoDrive, float]] = []
        try:
            for drive, target_m, old_m in zip(self.drives, targets_m, previous_m, strict=True):
                drive.write_target(target_m)
                written.append((drive, old_m))
        except DeviceError:
            for drive, old_m in written:
                _restore_target(drive, old_m)
            raise

    def start(self, targets_m: Sequence[float]) -> None:
        """Set-point handshake: bit 4 up on all back to back, bit 12 seen on all, bit 4 down.

        Bit 4 is sent again while bit 12 is awaited: only its edge counts, so that nothing is started twice.
        """

        def is_acknowledged(sample: DriveSample, _target_m: float) -> bool:
            return bool(sample.statusword & cia402.SET_POINT_ACKNOWLEDGED)

        def resend(_samples: list[DriveSample]) -> float:
            self.stop.send_all(cia402.NEW_SET_POINT)
            return self.timing.poll_period_s

        self.stop.send_all(cia402.NEW_SET_POINT)
        limit_s = self.timing.handshake_limit_s
        self._wait(is_acknowledged, targets_m, limit_s, "set-point not acknowledged", pause_s=resend)
        self.stop.send_all(cia402.ENABLE_OPERATION)

    def wait_for_rest(self, targets_m: Sequence[float], velocity_m_per_s: float, limit_s: float) -> list[DriveSample]:
        """Wait until all drives are at rest on their targets; returns the last samples. Raises MotionTimeout."""

        def pause_s(samples: list[DriveSample]) -> float:
            if any(sample.statusword & cia402.SET_POINT_ACKNOWLEDGED for sample in samples):
                self.stop.send_all(cia402.ENABLE_OPERATION)  # bit 4 is still up somewhere
            remaining_s = farthest_m(samples, targets_m) / velocity_m_per_s
            poll_s = self.timing.poll_period_s
            return min(max(0.5 * remaining_s, poll_s), max(self.timing.cruise_period_s, poll_s))

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
            hold_s=self.rest.hold_s,
            min_samples=_MIN_SAMPLES_AT_REST,
            pause_s=pause_s,
        )

    def _wait(
        self,
        ready: Ready,
        targets_m: Sequence[float],
        limit_s: float,
        what: str,
        *,
        pause_s: Pause,
        hold_s: float = 0.0,
        min_samples: int = 1,
    ) -> list[DriveSample]:
        """Sample until all drives have been ready for `hold_s` and for `min_samples` samples in a row."""
        end_s = self.clock.now_s() + limit_s
        since_s, in_a_row, polls = 0.0, 0, 0
        while True:
            samples = self.sample()
            waiting = [
                (drive, sample)
                for drive, sample, target_m in zip(self.drives, samples, targets_m, strict=True)
                if not ready(sample, target_m)
            ]
            t_s = samples[0].t_rig_s
            since_s = t_s if waiting or in_a_row == 0 else since_s
            in_a_row = 0 if waiting else in_a_row + 1
            if in_a_row >= min_samples and t_s - since_s >= hold_s - _CLOCK_GRAIN_S:
                return samples
            polls += 1
            if waiting and polls >= _MIN_POLLS and self.clock.now_s() >= end_s:
                raise timeout_error(*waiting[0], what, limit_s)
            self.clock.sleep_s(pause_s(samples))
            self.stop.raise_if_stopped()


def longest_s(samples: Sequence[DriveSample], targets_m: Sequence[float], velocity_m_per_s: float) -> float:
    """A generous time limit for a move, from its distance."""
    return 15.0 + 1.5 * farthest_m(samples, targets_m) / velocity_m_per_s


def farthest_m(samples: Sequence[DriveSample], targets_m: Sequence[float]) -> float:
    """The largest distance of a drive's demand from its target."""
    return max(abs(target - sample.demand_m) for sample, target in zip(samples, targets_m, strict=True))


def timeout_error(drive: ServoDrive, sample: DriveSample, what: str, limit_s: float) -> MotionTimeout:
    """The error for a drive that has not done what it should in time, with its last sample."""
    last = drive.messages.last_emergency()
    return MotionTimeout(
        drive.name,
        drive.where,
        f"{what} after {limit_s:g} s: at {sample.position_m:.6f} m, following error"
        f" {sample.following_error_m * 1e6:.1f} um, velocity {sample.velocity_m_per_s:.6f} m/s,"
        f" statusword 0x{sample.statusword:04X}" + (f", {last}" if last else ""),
        "look for what holds the drive, then clear the stop",
    )


def _restore_target(drive: ServoDrive, target_m: float) -> None:
    """Restore a target that never was started; without a set-point signal a failure is harmless."""
    if math.isfinite(target_m):
        with suppress(DeviceError):
            drive.write_target(target_m)
