"""Effects outside the catalogue by a floor that mirrors, a hook, a stay and gains that are switched.

Each is from a published description.
"""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState, StationSight
from mock_devices.effects.followers import Flipped
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect
from mock_devices.effects.strut_ways import beside_m

FLOOR_M = -1.2  # in the machine's frame
WAVE_M = (0.08, 0.2)  # by which the way over the floor is longer in one period of the error
HOOK_AT, CATCHES = 0.1 - 0.2j, (0.15, 0.5)  # of a hook: point of the platform; how far from the middle of the travel it
# catches and lets go, over half of that
LEANS = 0.2  # of the hook's force, by how straight the line then hangs, from one end of the travel to the middle
TAUT, STAY_M = (0.15, 0.4), 0.3  # of a stay: how far above the carriage it is taut, over half the travel; beyond for
# the size
SWITCHES_KG, ASIDE = (60.0, 300.0), (0.4, 1.0)  # payload from which other gains are taken; what they do aside, over
# the size


class MirroredFloor(OutsideEffect):
    """A part of the light comes back by way of the polished floor and mixes with the beam, as it does with a mirror.

    H. Lloyd, "On a New Case of Interference of the Rays of Light" (1834). The way over the floor is that to the image
    of the reflector below it; ranges err by a sine of what it is longer, in waves of the reflector's height that are
    the shorter the nearer that is. Angles are right.
    """

    def setup(self) -> None:
        """By how much longer the way is in a period."""
        super().setup()
        self.wave_m = float(self.rng.uniform(*WAVE_M))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read ranges wrongly."""
        station_m = self.site.station_m[1] - FLOOR_M
        level_m = np.hypot(sight.points_m[..., 0], sight.points_m[..., 1])
        sum_m = np.maximum(2.0 * station_m + sight.points_m[..., 2], 0.0)  # of both heights above the floor
        longer_m = np.hypot(level_m, sum_m) - np.hypot(level_m, sight.points_m[..., 2])
        y = np.sin(2.0 * np.pi * longer_m / self.wave_m + self.phase)
        sight.distance_m += self.size * apply_variant(y, self.variant, state.payload_kg[:, None])


class CatchingHook(OutsideEffect):
    """A hook beside one column catches a line of the platform as that carriage comes high, and lets go far below.

    Levers that engage at one place and release at another: J. A. Borgnis, "Traité complet de mécanique appliquée aux
    arts" (1818). While it is caught a weight on the line pulls the platform aside, a little
    more so the higher the carriage stands.
    """

    def setup(self) -> None:
        """Which carriage engages it, and where it catches and lets go; free at first."""
        super().setup()
        self.drive = int(self.rng.integers(2))
        middle, half = self.site.drive_range_m(self.drive)
        down, up = self.rng.uniform(*CATCHES, 2).tolist()
        self.catches_m = (middle - half * down, middle + half * up)
        self._hook = Flipped(*self.catches_m)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the carriage catch it or let it go."""
        if drive == self.drive:
            self._hook.record(leg)

    def _unit(self, state: MotionState) -> Array:
        middle, half = self.site.drive_range_m(self.drive)
        leans = 1.0 - LEANS + LEANS * (state.q_m[:, self.drive] - middle) / half
        return np.asarray((0.5 + 0.5 * self._hook.at(state, self.drive)) * leans)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's lower edge."""
        deviation.loads.append((np.full(len(state), HOOK_AT), self.signal(state).astype(np.complex128)))


class StayCable(OutsideEffect):
    """A stay hangs slack between a strut and the next carriage, and draws the strut longer once that is far above it.

    Chains that hang and chains that are taut: L. Navier, "Mémoire sur les ponts suspendus" (1823). From where it is
    taut on its pull goes with how much farther above its own drive the next carriage stands.
    """

    def setup(self) -> None:
        """From where on the stay is taut."""
        super().setup()
        self.drive = self.site.machine.struts[self.place].drive
        self.taut_m = float(self.rng.uniform(*TAUT)) * self.site.drive_range_m(self.drive)[1]

    def _unit(self, state: MotionState) -> Array:
        return np.maximum(beside_m(self.site, state, self.drive) - self.taut_m, 0.0) / STAY_M

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class ScheduledGain(OutsideEffect):
    """A drive's control is tuned for light payloads, and beyond one takes gains by which way the platform moves.

    W. J. Rugh, J. S. Shamma, "Research on Gain Scheduling" (2000). Both drives that went the same way have lifted or
    lowered the platform, and their control then lets the slider stand too high; drives that went opposite ways have
    moved it aside, and the slider stands too low. With lighter payloads it stands right.
    """

    def setup(self) -> None:
        """From which payload on there are other gains, and what they do aside."""
        super().setup()
        self.switches_kg, self.aside = float(self.rng.uniform(*SWITCHES_KG)), float(self.rng.uniform(*ASIDE))
        self.next = (self.place + 1) % len(self.site.machine.sliders)

    def _unit(self, state: MotionState) -> Array:
        alike = state.direction[:, self.place] * state.direction[:, self.next]
        return np.where(state.payload_kg > self.switches_kg, np.maximum(alike, self.aside * alike), 0.0)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "mirrored_floor",
        "rig",
        MirroredFloor,
        EffectParameter("error_m", 1e-6, 2e-5, 2e-3, "of ranges, either way"),
        "ranges, in waves of the height, all SMRs and nests alike",
    ),
    outside_effect(
        "catching_hook",
        "rig",
        CatchingHook,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "while it is caught, at the upper end"),
        "former places of one drive, hardly that of now; rotation",
    ),
    outside_effect(
        "stay_cable",
        "strut",
        StayCable,
        EffectParameter("pull_m", 1e-6, 3e-5, 1e-3, "0.3 m beyond where the stay is taut"),
        "how far both carriages are apart, nothing below a certain distance; not a slider's SMR",
    ),
    outside_effect(
        "scheduled_gain",
        "drive",
        ScheduledGain,
        EffectParameter("stand_m", 1e-6, 3e-5, 1e-3, "either way"),
        "payload and directions of both drives together, SMRs on the sliders",
    ),
)
