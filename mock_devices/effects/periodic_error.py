"""Errors of a screw that repeat with its turns."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, Leg, MotionState
from mock_devices.effects.leg_memory import LegMemory, ways_m

FULL_PAYLOAD_KG = 400.0
KEPLER = 12  # steps of Newton's iteration
BALL_ORBIT = 0.5 * (1.0 - 0.16 * math.cos(math.radians(45.0)))
BENT = math.cos(math.radians(30.0))  # of a universal joint
SLIP_M = 6.0  # travel over which the balls of a nut fall behind by a whole orbit
RIPPLES = 6  # of a motor's torque in one turn of the screw
FRESH, ROUGHENS_M = 0.1, 100.0  # runout of a new bearing over the size; way of its drive after which it has the size
GEARED, PASSED_ON = (0.25, 0.6), 0.8  # turns of a shaft for one of the next screw; what it passes on, over one's own
CONE = (0.08, 0.3)  # by how much longer than in the middle a turn of a conical drum is at the upper end
BENDS = (-0.95, -0.4)  # of half the travel, from its middle: where a screw begins to be bent
SQUARE = (-0.3, 0.3)  # of half the travel of the next drive, from its middle: where it racks no bearing
TWISTS_RAD = 2.5  # of a screw by a full payload, over its whole length
OFF_FOCUS = (0.25, 0.6)  # of a wheel that turns a screw as a planet goes: eccentricity of its orbit
ASKEW = (0.6, 0.95)  # tilt of one thrust face over that of the other


class PeriodicError(Effect):
    """An error that repeats with every turn of the screw.

    `ball_orbit`: balls go round at (1 - d cos(alpha) / D) / 2 of the screw's speed, as in T. A. Harris, "Rolling
    Bearing Analysis" (1966), so that unequal balls add a longer period that no number of turns repeats.
    `bowed_screw`: a screw that turns bowed between its bearings has the line sin(pi x / l), as shafts in S. Timoshenko,
    "Vibration Problems in Engineering" (1928); the nut goes to and fro by its slope, most at both ends.
    `universal_joint`: the motor turns the screw through a bent universal joint, tan(out) = cos(bend) tan(in), that errs
    twice a turn: J. E. Shigley, J. J. Uicker, "Theory of Machines and Mechanisms" (1980).
    `slipping_balls`: unequal balls also slip in their track, further with every motion, so that their part of the error
    does not repeat at the same position: E. P. Kingsbury, "Basic Speed Ratio of an Angular Contact Bearing" (1980).
    `other_flank`: the nut lies against one flank of the thread on its way up and against the other on its way down, and
    each flank is drunken in its own way: F. H. Rolt, "Gauges and Fine Measurements" (1929).
    `thrust_faces`: the collar of the screw and the face that it turns against are both askew to the axis and touch
    where they stand out most, so that they are apart by the length of a sum of two arrows, one of which turns: axial
    runout of thrust bearings in A. H. Slocum, "Precision Machine Design" (1992).
    `torque_ripple`: the motor's torque ripples RIPPLES times a turn, in proportion to its current, which bears the
    weight and has friction to overcome on its way up: T. M. Jahns, W. L. Soong, "Pulsating Torque Minimization
    Techniques for Permanent Magnet AC Motor Drives: A Review" (1996). The size is that upwards without payload.
    `twisted_phase`: the payload twists the screw between its nut and the encoder at its upper end, the more of it there
    is in between, so that the whole error comes later in the turn: torsion in J. P. Den Hartog, "Advanced Strength of
    Materials" (1952).
    `growing_runout`: the bearing that holds the screw wears on one side, by the way that it runs, and what was hardly
    an error grows with it: J. F. Archard, "Contact and Rubbing of Flat Surfaces" (1953). The size is that after
    ROUGHENS_M.
    `geared_together`: a shaft that gears this screw to the next one is not true either, and adds an error by the sum of
    what both have turned: R. Willis, "Principles of Mechanism" (1841). Both screws have the same lead.
    `conical_drum`: a rope that moves the encoder's drum lies on a cone, so that a turn takes the longer a way the
    higher the drive stands, and its error comes ever more rarely: W. Emerson, "The Principles of Mechanics" (1754). The
    period is that in the middle of the travel.
    `bent_end`: a blow has bent the upper end of the screw, which is true up to one place and runs out from there on,
    ever more: S. Timoshenko, "Strength of Materials" (1930). The size is that at the upper end.
    `racked_bearings`: the next carriage racks the frame by where it stands, and with it the bearings of this screw,
    which runs out of true to one side or the other, but for where the frame is square: A. Föppl, "Das Problem der
    Laval'schen Turbinenwelle" (1895). The size is that half the next drive's travel from there.
    `off_focus`: elliptic wheels, each turning about one of its foci, drive the screw as a planet goes round the sun,
    fast near it and slowly far from it: J. Kepler, "Astronomia nova" (1609). The size is that of the first harmonic.
    """

    def setup(self) -> None:
        """Phase of the turn."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self._ways = LegMemory(ways_m)
        self.apart = float(self.rng.uniform(0.3, 0.7)) * np.pi  # phase between both flanks
        self.askew = float(self.rng.uniform(*ASKEW))
        self.geared = float(self.rng.uniform(*GEARED))
        self.cone = float(self.rng.uniform(*CONE))
        middle, half = self.site.drive_range_m(self.place)
        self.bends_m = middle + half * float(self.rng.uniform(*BENDS))
        self.next = (self.place + 1) % len(self.site.machine.sliders)
        middle, half = self.site.drive_range_m(self.next)
        self.square_m = middle + half * float(self.rng.spawn(1)[0].uniform(*SQUARE))
        self.orbit = float(self.rng.spawn(1)[0].uniform(*OFF_FOCUS))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the balls of this drive slip, or its bearing wear."""
        if self.variant in ("slipping_balls", "growing_runout") and drive == self.place:
            self._ways.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        q = state.q_m[:, self.place]
        turn = 2.0 * np.pi * q / self.values["period_m"] + self.phase
        y = np.sin(turn)
        if self.variant == "two_harmonics":
            y = 0.85 * y + 0.4 * np.sin(2.0 * turn + 1.0)
        elif self.variant == "geared_together":
            others_m = state.q_m[:, (self.place + 1) % len(self.site.machine.sliders)]
            shaft = turn + 2.0 * np.pi * self.geared * others_m / self.values["period_m"] + self.apart
            y = (1.0 - PASSED_ON) * y + PASSED_ON * np.sin(shaft)
        elif self.variant == "conical_drum":
            middle, half = self.site.drive_range_m(self.place)
            wider = np.log1p(self.cone * (q - middle) / half) * half / self.cone
            y = np.sin(2.0 * np.pi * wider / self.values["period_m"] + self.phase)
        elif self.variant == "ball_orbit":
            y = 0.9 * y + 0.6 * np.sin(BALL_ORBIT * turn + 2.0)
        elif self.variant == "slipping_balls":
            slipped = 2.0 * np.pi * self._ways.at(state, self.place)[:, 0] / SLIP_M
            y = 0.7 * y + 0.7 * np.sin(BALL_ORBIT * turn - slipped)
        elif self.variant == "other_flank":
            down = 0.8 * np.sin(turn + self.apart) + 0.3 * np.sin(2.0 * turn)
            y = np.where(state.direction[:, self.place] < 0.0, down, y)
        elif self.variant == "torque_ripple":
            own_kg = self.site.machine.moving_mass_kg
            weight = (own_kg + state.payload_kg) / own_kg
            y = (0.6 * weight + 0.4 * state.direction[:, self.place]) * np.sin(RIPPLES * turn)
        elif self.variant == "twisted_phase":
            low, high = self.site.machine.sliders[self.place].travel_m
            y = np.sin(turn - TWISTS_RAD * state.payload_kg / FULL_PAYLOAD_KG * (high - q) / (high - low))
        elif self.variant == "thrust_faces":
            whole = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
            lifts = self._faces_apart(whole)
            y = (self._faces_apart(turn) - lifts.mean()) / (2.0 * np.mean(lifts * np.cos(whole)))
        elif self.variant in ("universal_joint", "off_focus"):
            y = self._unevenly(turn)
        elif self.variant in ("bowed_screw", "modulated", "with_load", "growing_runout", "bent_end", "racked_bearings"):
            y = y * self._large(state)
        elif self.variant == "triangle":
            y = 2.0 / np.pi * np.arcsin(y) * 1.2
        deviation.travel_m[:, self.place] += self.size * y

    def _large(self, state: MotionState) -> Array:
        """How large the error of a whole turn is (n,), over the size."""
        q = state.q_m[:, self.place]
        if self.variant == "bowed_screw":
            low, high = self.site.machine.sliders[self.place].travel_m
            return np.asarray(np.cos(np.pi * (q - low) / (high - low)))
        if self.variant == "racked_bearings":
            return np.asarray((state.q_m[:, self.next] - self.square_m) / self.site.drive_range_m(self.next)[1])
        if self.variant == "bent_end":
            high = self.site.machine.sliders[self.place].travel_m[1]
            return np.asarray(np.maximum(q - self.bends_m, 0.0) / (high - self.bends_m))
        if self.variant == "modulated":  # the screw runs out of true towards one end
            middle, half = self.site.drive_range_m(self.place)
            return np.asarray(1.0 + 0.8 * (q - middle) / half)
        if self.variant == "growing_runout":
            return np.asarray(FRESH + (1.0 - FRESH) * self._ways.at(state, self.place)[:, 0] / ROUGHENS_M)
        return np.asarray(0.6 + 0.8 * state.payload_kg / FULL_PAYLOAD_KG)

    def _unevenly(self, turn: Array) -> Array:
        """By how much a joint or a wheel is ahead of an even turn (n,), over its largest term."""
        if self.variant == "off_focus":
            whole = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
            return np.asarray(self._ahead(turn) / (2.0 * np.mean(self._ahead(whole) * np.sin(whole))))
        ahead = np.arctan2(BENT * np.sin(turn), np.cos(turn)) - turn
        return np.asarray(((ahead + np.pi) % (2.0 * np.pi) - np.pi) * (1.0 + BENT) / (1.0 - BENT))

    def _ahead(self, turn: Array) -> Array:
        """By how much a planet is ahead of its mean motion (n,), by Kepler's equation and the half angles."""
        e, mean = self.orbit, (turn + np.pi) % (2.0 * np.pi) - np.pi
        at = mean + e * np.sin(mean)
        for _ in range(KEPLER):
            at = at - (at - e * np.sin(at) - mean) / (1.0 - e * np.cos(at))
        half = np.arctan2(math.sqrt(1.0 + e) * np.sin(0.5 * at), math.sqrt(1.0 - e) * np.cos(0.5 * at))
        return np.asarray(2.0 * half - mean)

    def _faces_apart(self, turn: Array) -> Array:
        """How far both faces are apart (n,), over the tilt of the one that does not turn."""
        return np.asarray(np.abs(1.0 + self.askew * np.exp(1j * turn)))
