"""What an axis did over time: its gap, and the motion and load on which effects depend."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.ndimage import gaussian_filter1d
from scipy.signal import savgol_filter

from calibration.base.arrays import Array
from calibration.base.rounded_values import rounding_deviation
from calibration.recording.axis_recording import AxisRecording

MOST_SAMPLES = 6000  # more are averaged in groups: motion and wind-up are far slower
SMOOTHING_S = 0.02  # half width of the cubics that give velocity, and half of that of acceleration
ORDER = 3
WIDEST_REVERSAL, REVERSALS = 0.1, 14  # of the travel; half widths that are tried
LEAST_HALF_WIDTH, MOST_HALF_WIDTH = 3, 50  # samples


@dataclass(frozen=True)
class Signals:
    """Evenly sampled signals (n,) of an axis in SI units.

    gap: second position less the motor's. position, velocity, acceleration: of the motor, smoothed. torque: smoothed.
    unit: of positions; load_unit: of the torque. scale_u: standard uncertainty of the second position's scale.
    torque_of_motor: whether the torque is the motor's, part of which accelerates the motor. rounding: standard
    deviation that the rounding of the values leaves in the gap; smoothed_off: RMS of what smoothing takes off the
    position. slope: scale of the second position, less one, that is no longer in the gap.
    """

    step_s: float
    gap: Array
    position: Array
    velocity: Array
    acceleration: Array
    torque: Array | None
    unit: str
    load_unit: str
    scale_u: float
    torque_of_motor: bool = False
    rounding: float = 0.0
    smoothed_off: float = 0.0
    slope: float = 0.0

    @classmethod
    def of(cls, recording: AxisRecording) -> Signals:
        """The gap between motor and second position."""
        return cls._between(recording, recording.motor, recording.second)

    @classmethod
    def of_following(cls, recording: AxisRecording, command: Array) -> Signals:
        """The gap between command (n,) and motor: what a drive follows late."""
        return cls._between(recording, command, recording.motor)

    @classmethod
    def _between(cls, recording: AxisRecording, first: Array, second: Array) -> Signals:
        group = samples_in_group(recording)
        rounding = math.hypot(*(_rounding(x, recording.step_s) for x in (first, second))) / math.sqrt(group)
        first, second = _averaged(first, group), _averaged(second, group)
        torque = None if recording.torque is None else _averaged(recording.torque, group)
        step = recording.step_s * group
        narrow = _half_width(SMOOTHING_S / step)
        wide = _half_width(2.0 * SMOOTHING_S / step)
        position = savgol_filter(first, 2 * narrow + 1, ORDER)
        return cls(
            step_s=step,
            gap=second - first,
            position=position,
            velocity=savgol_filter(first, 2 * narrow + 1, ORDER, deriv=1, delta=step),
            acceleration=savgol_filter(first, 2 * wide + 1, ORDER, deriv=2, delta=step),
            torque=None if torque is None else savgol_filter(torque, 2 * narrow + 1, ORDER),
            unit=recording.file.unit,
            load_unit=recording.file.load_unit,
            scale_u=recording.file.second_scale_u,
            torque_of_motor=recording.file.torque_side == "motor",
            rounding=rounding,
            smoothed_off=float(np.sqrt(np.mean((first - position) ** 2))),
        )

    def __len__(self) -> int:
        return len(self.gap)

    def with_gap(self, gap: Array) -> Signals:
        """The same motion with another gap (n,)."""
        return replace(self, gap=gap)

    @property
    def rotary(self) -> bool:
        """Whether positions are angles."""
        return self.unit == "rad"

    @cached_property
    def travel(self) -> float:
        """Range of the positions."""
        return float(np.ptp(self.position))

    @cached_property
    def moving(self) -> Array:
        """1 (n,) where the axis moves, else 0: faster than a hundredth of its top speed."""
        speed = np.abs(self.velocity)
        return np.asarray(speed > 0.01 * speed.max(), dtype=np.float64)

    @cached_property
    def resolution(self) -> float:
        """Distance below which a reversal may be noise: a few deviations of slow positions from their motion."""
        rest = np.abs(self.velocity) <= np.quantile(np.abs(self.velocity), 0.1)
        moved = np.diff(self.position) - 0.5 * self.step_s * (self.velocity[1:] + self.velocity[:-1])
        jitter = float(np.std(moved[rest[1:]])) if np.any(rest[1:]) else 0.0
        return max(10.0 * jitter, 1e-5 * self.travel)

    @cached_property
    def spacing(self) -> float:
        """Distance between two samples in motion, in the median."""
        steps = np.abs(np.diff(self.position))[self.moving[1:] > 0.0]
        return float(np.median(steps)) if steps.size else self.travel

    def moved_late(self, delay_s: float) -> Array:
        """The position (n,) a time earlier less the position: what a channel adds that is late by that time.

        Smoothed as the velocity, which it is for short times.
        """
        time_s = np.arange(len(self)) * self.step_s
        late = np.clip(time_s - delay_s, 0.0, time_s[-1])
        return np.asarray(self._travelled(late) - self._travelled(time_s))

    def averaged(self, x: Array, width_s: float) -> Array:
        """A signal (n,) smoothed by a Gaussian of this width: two standard deviations."""
        width = 0.5 * width_s / self.step_s
        return x if width < 0.5 else np.asarray(gaussian_filter1d(x, width, mode="nearest"))

    def side(self, half_width: float) -> Array:
        """Side (n,) of a play that the motor leans on, -1 to 1: it is crossed within two half widths of motion.

        The stop operator of Prandtl, scaled to one. Zero before the first motion.
        """
        out, state = np.empty(len(self)), 0.0
        steps = np.diff(self.position, prepend=self.position[0]) / half_width
        for i, step in enumerate(steps.tolist()):
            state = min(1.0, max(-1.0, state + step))
            out[i] = state
        return out

    @cached_property
    def reversal(self) -> float:
        """Half width of motion within which the gap turns round at reversals, by least squares beside smooth motion.

        Sharp corners at the wrong place would look like no effect at all: they are what noise has least of.
        """
        ones = np.ones(len(self))
        smooth, _ = np.linalg.qr(np.column_stack([ones, self.position, self.velocity, self.acceleration]))
        gap = self.gap - smooth @ (smooth.T @ self.gap)

        def explained(half_width: float) -> float:
            side = self.side(half_width)
            side -= smooth @ (smooth.T @ side)
            return float(side @ gap) ** 2 / max(float(side @ side), 1e-300)

        widest = max(WIDEST_REVERSAL * self.travel, 2.0 * self.resolution)
        tried = np.geomspace(self.resolution, widest, REVERSALS)
        for _ in range(3):
            best = int(np.argmax([explained(half_width) for half_width in tried.tolist()]))
            around = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
            last, tried = float(tried[best]), np.geomspace(*around, 7)
        return last

    @cached_property
    def _travelled(self) -> PPoly:
        """The integral of the velocity."""
        return CubicSpline(np.arange(len(self)) * self.step_s, self.velocity).antiderivative()


def samples_in_group(recording: AxisRecording) -> int:
    """How many samples of a recording are averaged to one; 1 where all are used as they are."""
    return -(-len(recording.motor) // MOST_SAMPLES)


def _averaged(x: Array, group: int) -> Array:
    if group == 1:
        return x
    whole = len(x) // group * group
    return np.asarray(x[:whole].reshape(-1, group).mean(axis=1))


def _rounding(x: Array, step_s: float) -> float:
    smooth = savgol_filter(x, 2 * _half_width(SMOOTHING_S / step_s) + 1, ORDER)
    return rounding_deviation(x, smooth)


def _half_width(samples: float) -> int:
    return int(np.clip(round(samples), LEAST_HALF_WIDTH, MOST_HALF_WIDTH))
