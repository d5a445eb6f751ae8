"""Guides whose line or angle goes by motions, warmth or the other carriage rather than by their rail alone."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Effect, Leg, MotionState
from mock_devices.effects.followers import Dragged
from mock_devices.effects.outside_counts import RestedAt
from mock_devices.effects.reversal import above_reference_k
from mock_devices.effects.strut_ways import beside_m

FULL_PAYLOAD_KG = 400.0
GIB_LEFT, GIB_WORN = 0.3, 0.4  # gap of a gib at its ends over the widest gap; half width of the worn part
RACKS, BOWS = 0.7, 0.8  # of a racked frame: lean and bow of a guide at the other carriage's upper end, over the size
WAVY, PAD_M_PER_S, PAD_S = 0.3, 0.5, (6.0, 20.0)  # of a pad on oil: waves of its rail over the size; speed that gives
# the size; time in which its film is pressed out to 1 / sqrt(2)
BY_MOTION = (
    "gib_play", "off_centre_drive", "racked_frame", "tilting_pad", "carriage_abreast", "warm_gap", "buckled_rail",
    "pulsing_pockets", "lagging_shoe", "dented_by_rest", "dragged_beam", "three_seats",
    "sinks_into_waves", "skewed_rollers",
)  # fmt: skip
ABREAST_M = (0.12, 0.22)  # in which the push of a carriage that is abreast falls by e
TIGHT, OPENS_K = 0.25, (-0.4, 0.4)  # of warm blocks: waves while they are tight, over the size; when they open
GAP_K = 1.0  # by how much warmer they then follow the waves by the size more
PRELOADED, LOADED = 0.5, 0.7  # of a guide's friction: by its preload, and more with a full payload
BUCKLE_M, BUCKLES_K = (0.5, 0.9), (-0.4, 0.4)  # of a rail: length of its buckle; when it begins, above the reference
BUCKLE_K = 1.0  # by how much warmer than that a rail has buckled by the size
STEADY, PULSES = 0.4, 1.2  # of pockets: waves at their mean pressure, over the size; what a pulse adds
LAGS_M = (0.02, 0.06)  # half of the play of a shoe
DENTS_M, DENTS_S, RESTS_S = (0.15, 0.3), (5.0, 20.0), 2.0  # of a dent: half width; time in which it forms; least rest
BEAM_LEANS = (0.2, 0.8)  # of a beam: by how much more it leans at the upper end than in the middle, or less, by lot
SEATS, OFF_MIDDLE = 4096, 0.4  # of a carriage, until chance repeats itself; how far off the middle one may be
AFLOAT, SINKS_S = 0.2, (4.0, 15.0)  # of a carriage: waves that it follows at a stop, over the size; time constant
ROLLS_M = (0.08, 0.3)  # way in which skewed rollers turn a carriage from the middle to a side
POCKETS_S = (200.0, 700.0)  # period of their pressure


class GuideByMotion(Effect):
    """What motions, warmth and the other carriage make of a guide; `_Guide` says of each form where it is from."""

    phase: float
    joint: float
    pad_s: float
    abreast_m: float
    opens_k: float

    def draw_of_motions(self) -> None:
        """Place, length and begin of a buckle, and how fast pockets pulse; from a generator of their own."""
        own = self.rng.spawn(1)[0]
        middle, half = self.site.drive_range_m(self.place)
        self.buckle_at_m = middle + half * float(own.uniform(-0.3, 0.3))
        self.buckle_m = float(own.uniform(*BUCKLE_M))
        self.buckles_k = float(own.uniform(*BUCKLES_K))
        self.pockets_s = float(own.uniform(*POCKETS_S))
        self.pockets_at = float(own.uniform(0.0, 2.0 * np.pi))
        self.lags_m = float(own.uniform(*LAGS_M))
        self.dent_m, self.dents_s = float(own.uniform(*DENTS_M)), float(own.uniform(*DENTS_S))
        self.beam_leans = float(own.uniform(*BEAM_LEANS)) * float(own.choice([-1.0, 1.0]))
        self.seats = np.array([-1.0, float(own.uniform(-OFF_MIDDLE, OFF_MIDDLE)), 1.0])
        self.seated = own.integers(3, size=SEATS)
        own = self.rng.spawn(1)[0]
        self.sinks_s, self.rolls_m = float(own.uniform(*SINKS_S)), float(own.uniform(*ROLLS_M))
        self._rollers = Dragged(self.rolls_m, middle)
        self._shoe = Dragged(self.lags_m, middle)
        self._rested = RestedAt(RESTS_S, middle)

    def record_of_motions(self, drive: int, leg: Leg) -> None:
        """Let the carriage drag its shoe, be turned by its rollers, or dent its rail where it rests."""
        if self.variant == "lagging_shoe" and drive == self.place:
            self._shoe.record(leg)
        elif self.variant == "skewed_rollers" and drive == self.place:
            self._rollers.record(leg)
        elif self.variant == "dented_by_rest" and drive == self.place:
            self._rested.record(leg)

    def _to_a_side(self, x: Array, payload_kg: Array) -> Array:
        """How far the carriage leans to the side that its last motion puts it to (n,)."""
        if self.variant == "off_centre_drive":
            return np.asarray(PRELOADED + LOADED * payload_kg / FULL_PAYLOAD_KG)
        worn = np.exp(-(((x - self.joint) / GIB_WORN) ** 2))
        return np.asarray(GIB_LEFT + (1.0 - GIB_LEFT) * worn)

    def _by_motion(self, x: Array, state: MotionState) -> Array:
        """What the last motion, the next carriage or warmth makes of the line or the angle (n,)."""
        if self.variant == "carriage_abreast":
            return np.asarray(np.exp(-np.abs(beside_m(self.site, state, self.place)) / self.abreast_m))
        forms = {
            "buckled_rail": self._buckled,
            "pulsing_pockets": self._pulsed,
            "lagging_shoe": self._lagged,
            "dented_by_rest": self._dented,
            "three_seats": self._seated,
            "sinks_into_waves": self._sunk,
            "skewed_rollers": self._turned_on,
            "warm_gap": self._opened,
            "tilting_pad": self._ridden_up,
        }
        if self.variant in forms:
            return forms[self.variant](state)
        if self.variant in ("racked_frame", "dragged_beam"):
            return self._racked(x, state) if self.variant == "racked_frame" else self._leant_on(x, state)
        return state.direction[:, self.place] * self._to_a_side(x, state.payload_kg)

    def _opened(self, state: MotionState) -> Array:
        """How far a carriage with open blocks follows the waves of its rail (n,)."""
        gap = np.maximum(above_reference_k(self.site, state) - self.opens_k, 0.0) / GAP_K
        return np.asarray((TIGHT + gap) * self._wave(state))

    def _wave(self, state: MotionState) -> Array:
        """The waves of the rail where the carriage stands (n,)."""
        return np.asarray(np.sin(2.0 * np.pi * state.q_m[:, self.place] / self.values["wavelength_m"] + self.phase))

    def _racked(self, x: Array, state: MotionState) -> Array:
        """How a frame that the next carriage racks moves this guide (n,)."""
        b = (self.place + 1) % len(self.site.machine.sliders)
        middle, half = self.site.drive_range_m(b)
        return np.asarray((state.q_m[:, b] - middle) / half * (RACKS * x + BOWS * (2.0 * x**2 - 1.0)))

    def _leant_on(self, x: Array, state: MotionState) -> Array:
        """To which side a dragged beam leans on this guide, and how much (n,)."""
        direction = state.direction[:, (self.place + 1) % len(self.site.machine.sliders)]
        return np.asarray(direction * (1.0 + self.beam_leans * x))

    def _seated(self, state: MotionState) -> Array:
        """How a carriage tilts in the seat that its last motion left it in (n,)."""
        return np.asarray(self.seats[self.seated[state.leg[:, self.place] % SEATS]])

    def _sunk(self, state: MotionState) -> Array:
        """How far a carriage follows the waves of its rail (n,) as its film goes."""
        left = np.exp(-state.since_s[:, self.place] / self.sinks_s)
        return np.asarray((1.0 - (1.0 - AFLOAT) * left) * self._wave(state))

    def _turned_on(self, state: MotionState) -> Array:
        """How far skewed rollers have turned a carriage (n,), from -1 to 1, where they slide."""
        return np.asarray((state.q_m[:, self.place] - self._rollers.at(state, self.place)) / self.rolls_m)

    def _ridden_up(self, state: MotionState) -> Array:
        """How far a pad has tilted (n,), with the waves of its rail."""
        a = self.place
        film = np.sqrt(np.maximum(state.speed_m_per_s[:, a], 0.0) / PAD_M_PER_S)
        left = state.direction[:, a] * film / np.sqrt(1.0 + state.since_s[:, a] / self.pad_s)
        return np.asarray(left + WAVY * self._wave(state))

    def _buckled(self, state: MotionState) -> Array:
        """How far a rail has buckled where its carriage stands (n,): a whole wave with level ends."""
        beyond_k = np.maximum(above_reference_k(self.site, state) - self.buckles_k, 0.0)
        turn = 2.0 * np.pi * np.clip((state.q_m[:, self.place] - self.buckle_at_m) / self.buckle_m, -0.5, 0.5)
        return np.asarray(np.sqrt(beyond_k / BUCKLE_K) * 0.5 * (1.0 + np.cos(turn)))

    def _lagged(self, state: MotionState) -> Array:
        """The waves of the rail where the shoe is (n,)."""
        at_m = self._shoe.at(state, self.place)
        return np.asarray(np.sin(2.0 * np.pi * at_m / self.values["wavelength_m"] + self.phase))

    def _dented(self, state: MotionState) -> Array:
        """How far a carriage tilts beside the dent of its last rest (n,), one way above and the other way below."""
        at_m, rested_s = self._rested.at(state, self.place).T
        off = (state.q_m[:, self.place] - at_m) / self.dent_m
        return np.asarray(-np.expm1(-rested_s / self.dents_s) * np.sqrt(2.0 * np.e) * off * np.exp(-(off**2)))

    def _pulsed(self, state: MotionState) -> Array:
        """How far a carriage on pulsing pockets follows the waves of its rail (n,), this way or that."""
        pulse = np.sin(2.0 * np.pi * self.elapsed_s(state) / self.pockets_s + self.pockets_at)
        return np.asarray((STEADY + PULSES * pulse) * self._wave(state))
