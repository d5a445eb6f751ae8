"""Effects outside the catalogue in what counts motions or remembers rests, each from a published description."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState, StationSight
from mock_devices.effects.leg_memory import LegMemory, motions
from mock_devices.effects.outside_counts import FastMotions, RestedAt
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect

LOST, LOSES_M_PER_S, HOMES_S = 30.0, 0.2, (900.0, 1800.0)  # of fringes: fast motions to the size; speed from which some
# are lost; how often the station is homed
STOP_AT, TACKY_M = -0.1 + 0.2j, 0.12  # of a tacky film: point of the platform; how far it pulls hardest
FORMS_S, RESTS_S = (3.0, 12.0), 2.0  # in which a film forms; rest from which it does
TEETH = (6, 12)  # of a collar
TRIGGER_M = (0.03, 0.1)  # shortest motion that a trigger feels
LEANS = 0.25  # of a trigger's jump over the travel, over the size


class LostFringes(OutsideEffect):
    """An interferometer counts fringes, loses some in every fast motion of any drive, and is homed now and then.

    A. A. Michelson, "Light Waves and Their Uses" (1903): who counts has to begin anew once a fringe is lost. All ranges
    are short by what has been lost since the station was homed last.
    """

    def setup(self) -> None:
        """How often the station is homed; fast motions of each drive."""
        super().setup()
        self.homes_s = float(self.rng.uniform(*HOMES_S))
        self._fast = [FastMotions(LOSES_M_PER_S) for _ in self.site.machine.sliders]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Lose some fringes."""
        self._fast[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        homed_s = self.site.start_s + np.floor(self.elapsed_s(state) / self.homes_s) * self.homes_s
        lost = sum(fast.since(homed_s, state, drive) for drive, fast in enumerate(self._fast))
        return np.asarray(lost / LOST)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read all ranges short."""
        sight.distance_m -= self.signal(state)[:, None]


class TackyFilm(OutsideEffect):
    """A film of old oil between platform and a stop beside it holds back whoever leaves, the more it has rested there.

    Tack and its strings, which pull harder until they tear: J. J. Bikerman, "The Science of Adhesive Joints" (1961).
    The film is that of the last rest of the first two drives; it pulls towards there, sideways, for some centimetres.
    """

    def setup(self) -> None:
        """How fast the film forms, and where each drive has rested."""
        super().setup()
        self.forms_s = float(self.rng.uniform(*FORMS_S))
        self._rested = [RestedAt(RESTS_S, self.site.drive_range_m(drive)[0]) for drive in range(2)]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let a film form where a drive rests."""
        if drive < len(self._rested):
            self._rested[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        left, right = (rested.at(state, drive) for drive, rested in enumerate(self._rested))
        from_there_m = 0.5 * (state.q_m[:, 0] - left[:, 0] - state.q_m[:, 1] + right[:, 0])
        formed = -np.expm1(-np.minimum(left[:, 1], right[:, 1]) / self.forms_s)
        stretched = from_there_m / TACKY_M
        return np.asarray(-formed * stretched * np.exp(0.5 - 0.5 * stretched**2))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull sideways at the platform's upper edge."""
        deviation.loads.append((np.full(len(state), STOP_AT), self.signal(state).astype(np.complex128)))


class SteppingCollar(OutsideEffect):
    """A toothed collar on a strut steps on with every motion of its drive, and falls back after its last tooth.

    An escapement as in C. Huygens, "Horologium Oscillatorium" (1673). Each step makes the strut longer by the same.
    """

    def setup(self) -> None:
        """How many teeth there are."""
        super().setup()
        self.teeth = int(self.rng.integers(TEETH[0], TEETH[1] + 1))
        self.drive = self.site.machine.struts[self.place].drive
        self._steps = LegMemory(motions)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Step on."""
        if drive == self.drive:
            self._steps.record(leg)

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(self._steps.at(state, self.drive)[:, 0] % self.teeth / (self.teeth - 1.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class EveryOtherStop(OutsideEffect):
    """A worn trigger has two states and changes them with every motion that it feels, so that every other stop differs.

    W. H. Eccles, F. W. Jordan, "A Trigger Relay Utilising Three-Electrode Thermionic Vacuum Tubes" (1919). A short
    motion is not felt. The stops differ a little more towards the upper end of the travel.
    """

    def setup(self) -> None:
        """Which motions the trigger feels, and its state at first."""
        super().setup()
        self.trigger_m = float(self.rng.uniform(*TRIGGER_M))
        self._felt = LegMemory(lambda way, _speed, _start_s: (np.abs(way) > self.trigger_m).astype(np.float64))
        self.first = math.copysign(1.0, self.levels[0])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Change the state."""
        if drive == self.place:
            self._felt.record(leg)

    def _unit(self, state: MotionState) -> Array:
        middle, half = self.site.drive_range_m(self.place)
        leans = 1.0 - LEANS + LEANS * (state.q_m[:, self.place] - middle) / half
        side = self.first * np.where(self._felt.at(state, self.place)[:, 0] % 2.0 == 0.0, 1.0, -1.0)
        return np.asarray(side * leans)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "lost_fringes",
        "rig",
        LostFringes,
        EffectParameter("short_m", 1e-6, 4e-5, 2e-3, "of ranges, after 30 fast motions of drives"),
        "ranges against fast motions since the station was homed, all SMRs and nests alike",
    ),
    outside_effect(
        "tacky_film",
        "rig",
        TackyFilm,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "at most, after long rest"),
        "the place of the last rest and how long that was, near it only; rotation",
    ),
    outside_effect(
        "stepping_collar",
        "strut",
        SteppingCollar,
        EffectParameter("steps_m", 1e-6, 3e-5, 1e-3, "of all steps together"),
        "number of motions, in a saw; not a slider's SMR",
    ),
    outside_effect(
        "every_other_stop",
        "drive",
        EveryOtherStop,
        EffectParameter("jump_m", 1e-6, 3e-5, 1e-3, "either way, at the upper end of the travel"),
        "odd and even numbers of long motions, SMRs on the sliders",
    ),
)
