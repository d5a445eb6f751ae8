"""Reflectors that were taken off and put on again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.base import (
    ONSET,
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    names_of,
)
from mock_devices.effects.followers import LastThrow
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.relays import thrown
from mock_devices.effects.walks import HOUR_S
from mock_devices.effects.warming import grid_from

GIVES, CREEPS = 0.2, 0.25  # of the size at once; exponent of time
SLIDES_M_PER_S, SLIDES = 0.2, 300.0  # a stop from this speed moves no holder; sum of excesses that moves it by the size
BALL_TURN_M = 80.0  # travel of all drives in which a ball turns once in its seat
HOME_M = (12.0, 40.0)  # way of all drives after which a ball is 1 / e as far beside its seat
NEST_PART = "platform"
NEST_K = 0.5  # change of the platform's temperature that moves a reflector by the size
STEM_M_PER_S, STEM_S, CALMS_S = 0.1, (3.0, 6.0), (10.0, 20.0)  # of a stem: stop for the size; period; time constant
SPOTS = 4096  # in a seat, until chance repeats itself
GREASE_S = (4.0, 15.0)  # time constant with which a reflector sags in its grease
THROWS_M_PER_S = 0.2  # a stop from this speed does not yet throw a ball
CLICKS_K = (0.02, 0.1)  # of a disc: how far above and below the temperature of the onset it clicks to either side
LETS_GO_S, LEAKS, SLIDES_SHARE = (300.0, 1500.0), 0.5, 0.3  # of a cup: when it lets go after the onset; time constant
# of its vacuum over that; what it slides before, over the size, were all vacuum gone
TURNED_RAD = (0.5, 2.6)  # by which a reflector is turned on at an exchange of payload, to either side
SEATS_S = 900.0  # how long a reflector stays in one of two seats, in the mean


class Reseat(Effect):
    """A reflector that was taken off and does not sit where it sat.

    `adhesive_tape`: its mount gives at once and creeps on with a power of time, as plastics do in W. N. Findley, "Creep
    Characteristics of Plastics" (1944); the size is reached after an hour.
    `chip_in_seat`: put on again upon a chip, it sits in one of two places and jumps by chance: the random telegraph
    signal of S. O. Rice, "Mathematical Analysis of Random Noise" (1944).
    `turning_ball`: the machine's motions turn the ball in its seat, and the vertex of its mirrors, which is off the
    ball's centre, goes round: runout in R. E. Bridges, "Method for Measuring 3D Coordinates of a Spherically Mounted
    Retroreflector from Multiple Stations" (US patent 9,074,869, 2015). The size is the circle's diameter.
    `sliding_holder`: its magnetic holder slides down its face a little at every stop that is harder than the magnet
    holds, by what the kinetic energy exceeds that: the sliding block of N. M. Newmark, "Effects of Earthquakes on Dams
    and Embankments" (1965). The size is that of some sixty stops from 0.5 m/s after the onset.
    `warm_nest`: put back into a nest of another material beside its own, it is moved as that grows with the platform's
    temperature from then on: an offset between materials in A. H. Slocum, "Precision Machine Design" (1992). The size
    is that of NEST_K.
    `thrown_ball`: put back into a seat with play, the ball is thrown to one side or the other of it by every hard stop
    of the first drive, and slow ones leave it: W. Goldsmith, "Impact" (1960). The size is the play.
    `ringing_stem`: put back on a stem that stands in rubber, it swings on after every stop of a drive, in the sense of
    that motion, and calms down: free damped vibration in J. P. Den Hartog, "Mechanical Vibrations" (1934). The size is
    the swing after a stop of one drive from STEM_M_PER_S.
    `sagging_grease`: put back into a seat full of stiff grease, it sags in it while all drives rest, until the grease
    bears it, and the next motion shakes it up again: E. C. Bingham, "Fluidity and Plasticity" (1922). The size is what
    it would sag in long rest.
    `rattling`: put back without its magnet, it lies anywhere in its seat after each motion of any drive: S.
    Chandrasekhar, "Stochastic Problems in Physics and Astronomy" (1943). The size is how far it may go from the middle.
    `creeps_home`: put back beside its seat, the ball is drawn home by its magnet with every metre that any drive shakes
    it, by a share of what is left: microslip in K. L. Johnson, "Surface Interaction Between Elastically Loaded Bodies
    Under Tangential Forces" (1955). The size is how far beside it was put.
    `clicking_disc`: put back on a disc of two metals, it is moved at once as that clicks to one side above one
    temperature of the air, and to the other side below another one: W. H. Wittrick, "Stability of a Bimetallic Disk"
    (1953). Both lie near the temperature of the onset, where it lies flat. The size is how far it goes to either side.
    `leaking_cup`: put back on a cup that holds by its vacuum, it slides as that leaks, ever more slowly, and falls all
    the way at once when it holds no more: O. von Guericke, "Experimenta nova Magdeburgica de vacuo spatio" (1672).
    `turned_on`: put back on a stem beside whose axis it sits, it is turned on by the same angle with every exchange of
    the payload: J.-C. de Borda, "Description et usage du cercle de réflexion" (1787). The size is how far beside the
    axis it sits.
    """

    def setup(self) -> None:
        """Directions of the shifts, in the plane."""
        angles = self.rng.uniform(0.0, 2.0 * np.pi, 64)
        lengths = np.concatenate([[1.0], self.rng.uniform(0.3, 1.2, 63)])
        self.shifts = np.stack([lengths * np.cos(angles), lengths * np.sin(angles)], axis=1)
        self.jumps_s = np.cumsum(self.rng.exponential(SEATS_S, 256))
        onset_s = self.site.start_s + self.values["onset_s"]
        self._ways = [
            LegMemory(lambda way, _speed, start_s: np.abs(way) * (start_s >= onset_s))
            for _ in self.site.machine.sliders
        ]
        self._stops = [
            LegMemory(
                lambda way, speed, start_s: (
                    np.maximum((speed / SLIDES_M_PER_S) ** 2 - 1.0, 0.0) * ((way != 0.0) & (start_s >= onset_s))
                )
            )
            for _ in self.site.machine.sliders
        ]
        self.stem_s = float(self.rng.uniform(*STEM_S))
        self.calms_s = float(self.rng.uniform(*CALMS_S))
        self.grease_s = float(self.rng.uniform(*GREASE_S))
        angles, radii = self.rng.uniform(0.0, 2.0 * np.pi, SPOTS), np.sqrt(self.rng.uniform(0.0, 1.0, SPOTS))
        self.spots = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)  # even over the seat
        self.home_m = float(self.rng.uniform(*HOME_M))
        own = self.rng.spawn(1)[0]
        self.clicks_k, self.back_k = float(own.uniform(*CLICKS_K)), -float(own.uniform(*CLICKS_K))
        self.lets_go_s = float(own.uniform(*LETS_GO_S))
        own = self.rng.spawn(1)[0]
        self.turned_rad = float(own.uniform(*TURNED_RAD)) * float(own.choice([-1.0, 1.0]))
        self._thrown = LastThrow(lambda speed, start_s: (speed > THROWS_M_PER_S) & (start_s >= onset_s))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let all travel after the onset turn the ball, or all stops move the holder or the ball."""
        if self.variant in ("turning_ball", "creeps_home"):
            self._ways[drive].record(leg)
        elif self.variant == "sliding_holder":
            self._stops[drive].record(leg)
        elif self.variant == "thrown_ball" and drive == 0:
            self._thrown.record(leg)

    def _swung(self, state: MotionState) -> Array:
        """Where a stem is (n,), by the last stop of every drive; one under way has not stopped yet."""
        swing = state.direction * state.speed_m_per_s / STEM_M_PER_S * (state.t_s[:, None] >= state.leg_end_s)
        turn = 2.0 * np.pi * state.since_s / self.stem_s
        return np.asarray((swing * np.exp(-state.since_s / self.calms_s) * np.cos(turn)).sum(axis=1))

    def _sagged(self, state: MotionState) -> Array:
        """How far it has sagged since the last drive came to rest (n,), over what it ends at."""
        return np.asarray(-np.expm1(-state.since_s.min(axis=1) / self.grease_s))

    def _clicked(self, state: MotionState) -> Array:
        """To which side the disc has clicked (n,): 1 or -1, and 0 at the onset."""
        grid = grid_from(self.site.start_s + self.values["onset_s"], state)
        air_c = state.thermal.air_series_c(grid)
        at = np.searchsorted(grid, state.t_s, side="right") - 1
        return np.asarray(thrown(air_c - air_c[0], self.clicks_k, self.back_k)[np.maximum(at, 0)])

    def _let_go(self, state: MotionState) -> Array:
        """How far a cup has slid or fallen since the onset (n,), over how far it falls."""
        t = np.maximum(state.t_s - self.site.start_s - self.values["onset_s"], 0.0)
        slides = -SLIDES_SHARE * np.expm1(-t / (LEAKS * self.lets_go_s))
        return np.where(t >= self.lets_go_s, 1.0, slides)

    def _each_time(self, state: MotionState, after: NDArray[np.bool_]) -> Array:
        """Where it lies (n, 2) over the size, if anywhere else after each exchange of payload or after each motion."""
        if self.variant == "rattling":
            return np.asarray(after[:, None] * self.spots[state.leg.sum(axis=1) % SPOTS])
        if self.variant == "turned_on":
            corner = complex(*self.shifts[0]) * np.exp(1j * self.turned_rad * state.exchanges)
            return np.asarray(after[:, None] * np.stack([corner.real, corner.imag], axis=1))
        number = state.exchanges.astype(int) % 64  # taken off whenever the payload is exchanged
        return np.where((number > 0)[:, None], self.shifts[number], 0.0)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the reflector."""
        t = state.t_s - self.site.start_s - self.values["onset_s"]
        after = t >= 0.0
        if self.variant in ("each_exchange", "rattling", "turned_on"):
            y = self._each_time(state, after)
        elif self.variant == "glue":
            y = np.outer(1.0 - np.exp(-np.maximum(t, 0.0) / 900.0), self.shifts[0])
        elif self.variant == "loose":  # a little further every few minutes
            number = np.floor(np.maximum(t, 0.0) / 600.0).astype(int) % 64
            y = np.where(after[:, None], self.shifts[number], 0.0)
        elif self.variant == "chip_in_seat":
            jumped = np.searchsorted(self.jumps_s, np.maximum(t, 0.0), side="right")
            y = np.where((after & (jumped % 2 == 0))[:, None], self.shifts[0], 0.0)
        elif self.variant == "adhesive_tape":
            crept = GIVES + (1.0 - GIVES) * (np.maximum(t, 0.0) / HOUR_S) ** CREEPS
            y = np.where(after[:, None], np.outer(crept, self.shifts[0]), 0.0)
        elif self.variant in ("turning_ball", "creeps_home"):
            way_m = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._ways))
            left = after * np.exp(-way_m / self.home_m)
            corner = complex(*self.shifts[0]) * 0.5 * np.expm1(2j * np.pi * way_m / BALL_TURN_M)
            turns = self.variant == "turning_ball"
            y = np.stack([corner.real, corner.imag], axis=1) if turns else np.outer(left, self.shifts[0])
        elif self.variant == "sliding_holder":
            slid = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._stops))
            y = np.outer(slid / SLIDES, self.shifts[0])
        elif self.variant == "warm_nest":
            from_s = np.maximum(state.t_s, self.site.start_s + self.values["onset_s"])
            grown_k = state.thermal.part_series_c(NEST_PART, from_s) - state.thermal.part_series_c(
                NEST_PART, np.full(len(state), self.site.start_s + self.values["onset_s"])
            )
            y = np.outer(grown_k / NEST_K, self.shifts[0])
        elif self.variant == "thrown_ball":
            y = np.outer(0.5 * self._thrown.at(state, 0), self.shifts[0])
        elif self.variant in ("ringing_stem", "sagging_grease", "clicking_disc", "leaking_cup"):
            moved = {
                "ringing_stem": self._swung,
                "sagging_grease": self._sagged,
                "clicking_disc": self._clicked,
                "leaking_cup": self._let_go,
            }
            y = np.outer(after * moved[self.variant](state), self.shifts[0])
        elif self.variant == "put_back":
            y = np.where((after & (t < 1500.0))[:, None], self.shifts[0], 0.0)
        else:
            y = np.where(after[:, None], self.shifts[0], 0.0)
        names = [smr.name for smr in self.site.machine.smrs]
        index = names.index(names_of(self.site.machine, "smr")[self.place])
        deviation.smr_m[:, index, :2] += self.size * y


EFFECTS = (
    EffectSpec(
        name="smr_reseat",
        kind="catalogue",
        place="smr",
        size=EffectParameter("shift_m", 1e-6, 2e-5, 4e-4, "of one reflector"),
        variants=(
            "step",
            "each_exchange",
            "glue",
            "loose",
            "put_back",
            "adhesive_tape",
            "chip_in_seat",
            "turning_ball",
            "sliding_holder",
            "warm_nest",
            "thrown_ball",
            "ringing_stem",
            "sagging_grease",
            "rattling",
            "creeps_home",
            "clicking_disc",
            "leaking_cup",
            "turned_on",
        ),
        final="turned_on",
        reveals="time, or dwell, distance, speed and direction moved, exchanges of payload, a temperature "
        "swing, one SMR against the others",
        make=Reseat,
        others=(ONSET,),
    ),
)
