"""Effects outside the catalogue in what flips, relaxes or is left to chance, each from a published description."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState
from mock_devices.effects.followers import Flipped
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect

STRAP_AT, STRAP_M = -0.1 + 0.2j, 0.3  # of a strap: point of the platform; sideways motion that leaves the size
RELAXES_S = (40.0, 150.0)  # time constant of a strap
FLIPS, LEANS = (0.15, 0.4), 0.3  # of a fork: places of its flips over half the travel; lean within its place
STOPS = 4096  # stops until chance repeats itself


class MaxwellStrap(OutsideEffect):
    """A strap of a tough plastic between frame and platform pulls back after every sideways motion, and relaxes.

    A spring and a damper one after the other: J. C. Maxwell, "On the Dynamical Theory of Gases" (1867). All earlier
    motions act together, each by what is left of it; where the platform stands does not matter.
    """

    def setup(self) -> None:
        """How fast it relaxes."""
        super().setup()
        self.relaxes_s = float(self.rng.uniform(*RELAXES_S))
        self._ways = [LegMemory(lambda way, _speed, _: way, self.relaxes_s) for _ in range(2)]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let it be stretched by its two drives."""
        if drive < len(self._ways):
            self._ways[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        left_m, right_m = (memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._ways))
        return np.asarray(0.5 * (left_m - right_m) / STRAP_M)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's upper edge."""
        deviation.loads.append((np.full(len(state), STRAP_AT), self.signal(state).astype(np.complex128)))


class FlippingFork(OutsideEffect):
    """A strut's fork has play and flips over when its drive has gone far enough, and back when that has come far down.

    The relay with two thresholds of F. Preisach, "Über die magnetische Nachwirkung" (1935). In between it stays where
    it is, and leans a little with the strut. The strut is longer or shorter by that.
    """

    def setup(self) -> None:
        """Places where it flips; at first it lies as after a way down."""
        super().setup()
        self.drive = self.site.machine.struts[self.place].drive
        middle, half = self.site.drive_range_m(self.drive)
        up, down = self.rng.uniform(*FLIPS, 2)
        self.flips_m = (middle - half * float(down), middle + half * float(up))
        self._fork = Flipped(*self.flips_m)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let its drive flip it."""
        if drive == self.drive:
            self._fork.record(leg)

    def _unit(self, state: MotionState) -> Array:
        middle, half = self.site.drive_range_m(self.drive)
        leans = (state.q_m[:, self.drive] - middle) / half
        return np.asarray((1.0 - LEANS) * self._fork.at(state, self.drive) + LEANS * leans)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen or shorten the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class ChanceOfBalls(OutsideEffect):
    """Which balls of the nut carry at a stop is chance, so that every stop is another one, and stays until the next.

    What remains of a positioning when all that can be repeated is known: ISO 230-2, "Determination of Accuracy and
    Repeatability of Positioning of Numerically Controlled Axes" (1997). Any place within the size is as likely.
    """

    def setup(self) -> None:
        """Where the slider ends after each motion."""
        super().setup()
        self.ends = self.rng.uniform(-1.0, 1.0, STOPS)

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(self.ends[state.leg[:, self.place] % STOPS])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "maxwell_strap",
        "rig",
        MaxwellStrap,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "right after a sideways motion by 0.3 m"),
        "former motions and the time since then, not the place; rotation",
    ),
    outside_effect(
        "flipping_fork",
        "strut",
        FlippingFork,
        EffectParameter("flip_m", 1e-6, 3e-5, 1e-3, "either way"),
        "former places of the drive; not a slider's SMR",
    ),
    outside_effect(
        "chance_of_balls",
        "drive",
        ChanceOfBalls,
        EffectParameter("spread_m", 1e-6, 3e-5, 1e-3, "either way"),
        "every stop another one, all SMRs of the platform together, SMRs on the sliders",
    ),
)
