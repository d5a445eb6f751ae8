"""What lies between an encoder's count and the slider: the screw's cumulative and periodic error."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    smooth_curve,
)
from mock_devices.effects.leg_memory import LegMemory, ways_m

FULL_PAYLOAD_KG = 400.0
BALL_ORBIT = 0.5 * (1.0 - 0.16 * math.cos(math.radians(45.0)))
TAPE = 5.0  # half length of a scale over the length in which its adhesive passes its force on
WORN, FLANK = 0.25, 0.2  # of half the travel: half the stretch that is worn throughout, and the nut's length
BENT = math.cos(math.radians(30.0))  # of a universal joint
TURNS = 138  # of a screw over its travel
SLIP_M = 6.0  # travel over which the balls of a nut fall behind by a whole orbit
COPIES_M, THREADS = (0.2, 0.45), 0.4  # travel of a turn of a grinder's wheel; its third harmonic over its first
RIPPLES = 6  # of a motor's torque in one turn of the screw
PIECE_M = 0.2  # of a rack
HELD_M = 0.25  # from one holder of a tape to the next
FIELDS_M = (0.09, 0.16)  # of a grating that was written in fields
CHANGE_M, UNEQUAL = (
    (0.06, 0.1),
    (0.06, 0.12),
)  # of change wheels: travel of a turn of one; by how much the other differs
FRESH, ROUGHENS_M = 0.1, 100.0  # runout of a new bearing over the size; way of its drive after which it has the size
BLOW_M, WAVES = (0.4, 0.7), (4.0, 7.0)  # of a blow on a tape: how far below the travel; waves along that
GEARED, PASSED_ON = (0.25, 0.6), 0.8  # turns of a shaft for one of the next screw; what it passes on, over one's own
TWISTS_RAD = 2.5  # of a screw by a full payload, over its whole length
ASKEW = (0.6, 0.95)  # tilt of one thrust face over that of the other


class CumulativeError(Effect):
    """A smooth error along the travel; a straight part would be the drive's scale.

    `glued_scale`: a scale that shrank on its adhesive, which holds it in the middle and gives way at both ends: the
    shear lag of O. Volkersen, "Die Nietkraftverteilung in zugbeanspruchten Nietverbindungen mit konstanten
    Laschenquerschnitten" (1938), without its straight part.
    `worn_stretch`: one flank is worn where the nut went to and fro in daily work, by a depth that goes with its way: J.
    F. Archard, "Contact and Rubbing of Flat Surfaces" (1953). At both ends of the stretch it falls off over a nut's
    length.
    `pitch_walk`: every turn of the thread has an error of its own, the travel variation within 2 pi rad of ISO 3408-3,
    "Ball Screws: Acceptance Conditions and Acceptance Tests" (2006), and these errors add up along the screw.
    `rack_pieces`: a rack is put together from pieces, each a little beside its place and with a cumulative pitch error
    of its own, as ISO 1328-1, "Cylindrical Gears: ISO System of Accuracy" (1995), states that; it jumps at every joint.
    `sagging_tape`: a scale of tape hangs slack between its holders, and each field is longer than it is straight by its
    own sag, most of that near the holders: the correction for sag of G. L. Hosmer, "Geodesy" (1919), of a parabola.
    `copied_gear`: wheels that drove the grinder's own screw were not true, and their turns are copied into this one:
    masters and copies in C. Evans, "Precision Engineering: An Evolutionary View" (1989).
    `stitched_fields`: a scale's grating was written field by field, every field at its place but too long by the same,
    so that the error is a saw: A. Teimel, "Technology and Applications of Grating Interferometers in High-Precision
    Measurement" (1992).
    `beating_wheels`: two change wheels of nearly equal numbers of teeth, neither true, drove the screw's grinder, and
    their waves add up here and cancel there: E. Buckingham, "Analytical Mechanics of Gears" (1949).
    `dispersed_blow`: a blow below its end has run along a tape while that was glued, long waves ahead of short ones,
    and they have stayed: phase with one over the distance, height with its power -3/2, as in Lord Kelvin, "On the Waves
    Produced by a Single Impulse in Water of Any Depth, or in a Dispersive Medium" (1887).
    """

    def setup(self) -> None:
        """Draw the curve of variant `irregular`, the places of kink and worn stretch, and the walk of the pitch."""
        self.curve = smooth_curve(self.rng)
        self.kink = float(self.rng.uniform(-0.4, 0.4))
        self.worn = float(self.rng.uniform(-0.3, 0.3))
        self.at = np.linspace(-1.0, 1.0, TURNS + 1)
        walk = np.concatenate([[0.0], np.cumsum(self.rng.standard_normal(TURNS))])
        walk -= np.polyval(np.polyfit(self.at, walk, 1), self.at)  # a straight part would be the drive's scale
        self.walk = walk / np.abs(walk).max()
        middle, half = self.site.drive_range_m(self.place)
        pieces = math.ceil(2.0 * half / PIECE_M) + 1
        self.joint_m = middle - half - PIECE_M * float(self.rng.uniform(0.0, 1.0))  # where the first piece begins
        self.beside, self.pitch = self.rng.uniform(-1.0, 1.0, (2, pieces))
        fine = np.linspace(middle - half, middle + half, 2001)
        rack = self._along_pieces(fine)
        self.level = np.polyfit(fine, rack, 1)  # a straight part would be the drive's scale
        self.most = float(np.abs(rack - np.polyval(self.level, fine)).max())
        self.slack = np.square(self.rng.uniform(0.0, 1.0, math.ceil(2.0 * half / HELD_M)))  # square of each field's sag
        tape = self._along_tape(fine)
        self.tape_level = np.polyfit(fine, tape, 1)
        self.tape_most = float(np.abs(tape - np.polyval(self.tape_level, fine)).max())
        self.copied_m = float(self.rng.uniform(*COPIES_M))
        self.phases = self.rng.uniform(0.0, 2.0 * np.pi, 2)
        copied = self._copied(fine)
        self.copied_level = np.polyfit(fine, copied, 1)
        self.field_m = float(self.rng.uniform(*FIELDS_M))
        self.field_at_m = float(self.rng.uniform(0.0, self.field_m))
        first_m = float(self.rng.uniform(*CHANGE_M))
        self.change_m = first_m * np.array([1.0, 1.0 + float(self.rng.uniform(*UNEQUAL))])
        self.change_phases = self.rng.uniform(0.0, 2.0 * np.pi, 2)
        beating = self._beating(fine)
        self.beating_level = np.polyfit(fine, beating, 1)
        self.beating_most = float(np.abs(beating - np.polyval(self.beating_level, fine)).max())
        self.blow_m = middle - half - float(self.rng.uniform(*BLOW_M))
        self.waves = float(self.rng.uniform(*WAVES))
        blown = self._blown(fine)
        self.blown_level = np.polyfit(fine, blown, 1)
        self.blown_most = float(np.abs(blown - np.polyval(self.blown_level, fine)).max())
        self.copied_most = float(np.abs(copied - np.polyval(self.copied_level, fine)).max())

    def _along_pieces(self, q_m: Array) -> Array:
        """Error of the rack (n,): where its piece lies, and half of that again by the pitch within the piece."""
        at = np.clip((q_m - self.joint_m) / PIECE_M, 0.0, len(self.pitch) - 1.0e-9)
        piece = at.astype(int)
        return np.asarray(self.beside[piece] + self.pitch[piece] * (at - piece - 0.5))

    def _along_tape(self, q_m: Array) -> Array:
        """What all fields up to a place are too long (n,), over the most that one field may be."""
        middle, half = self.site.drive_range_m(self.place)
        at = np.clip((q_m - middle + half) / HELD_M, 0.0, len(self.slack) - 1.0e-9)
        field = at.astype(int)
        before = np.concatenate([[0.0], np.cumsum(self.slack)])
        return np.asarray(before[field] + self.slack[field] * (1.0 - (1.0 - 2.0 * (at - field)) ** 3) / 2.0)

    def _copied(self, q_m: Array) -> Array:
        """What the wheels of a grinder have left (n,), over their first harmonic."""
        turn = 2.0 * np.pi * q_m / self.copied_m
        return np.asarray(np.sin(turn + self.phases[0]) + THREADS * np.sin(3.0 * turn + self.phases[1]))

    def _beating(self, q_m: Array) -> Array:
        """What both change wheels have left (n,), over the error of one."""
        return np.asarray(np.sin(2.0 * np.pi * q_m[:, None] / self.change_m + self.change_phases).sum(axis=1))

    def _blown(self, q_m: Array) -> Array:
        """What a blow has left (n,), over its height at the travel's lower end."""
        low, high = self.site.machine.sliders[self.place].travel_m
        near_m, far_m = low - self.blow_m, high - self.blow_m
        from_blow_m = np.maximum(q_m - self.blow_m, 0.5 * near_m)
        turns = self.waves / (1.0 / near_m - 1.0 / far_m) / from_blow_m
        return np.asarray((near_m / from_blow_m) ** 1.5 * np.cos(2.0 * np.pi * turns - 0.25 * np.pi))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        middle, half = self.site.drive_range_m(self.place)
        x = (state.q_m[:, self.place] - middle) / half
        if self.variant == "cubic":
            y = 2.6 * (x**3 - x)
        elif self.variant == "irregular":
            y = self.curve(x)
        elif self.variant == "glued_scale":
            slope = 3.0 * (1.0 / (math.tanh(TAPE) * TAPE) - 1.0 / TAPE**2)  # of the straight line that fits best
            y = (np.sinh(TAPE * x) / math.sinh(TAPE) - slope * x) / (1.0 - slope)
        elif self.variant == "worn_stretch":
            y = 1.0 - 2.0 * np.clip((WORN + FLANK - np.abs(x - self.worn)) / FLANK, 0.0, 1.0)
        elif self.variant == "pitch_walk":
            y = np.interp(x, self.at, self.walk)
        elif self.variant == "rack_pieces":
            q = state.q_m[:, self.place]
            y = (self._along_pieces(q) - np.polyval(self.level, q)) / self.most
        elif self.variant == "sagging_tape":
            q = state.q_m[:, self.place]
            y = (self._along_tape(q) - np.polyval(self.tape_level, q)) / self.tape_most
        elif self.variant in ("copied_gear", "beating_wheels", "dispersed_blow"):
            waves, level, most = {
                "copied_gear": (self._copied, self.copied_level, self.copied_most),
                "beating_wheels": (self._beating, self.beating_level, self.beating_most),
                "dispersed_blow": (self._blown, self.blown_level, self.blown_most),
            }[self.variant]
            q = state.q_m[:, self.place]
            y = (waves(q) - np.polyval(level, q)) / most
        elif self.variant == "stitched_fields":
            y = 2.0 * ((state.q_m[:, self.place] - self.field_at_m) / self.field_m % 1.0) - 1.0
        elif self.variant == "two_pieces":  # two scales butted together
            y = 2.0 * np.abs(x - self.kink) - 1.0
        else:
            y = 2.0 * x**2 - 1.0
        deviation.travel_m[:, self.place] += self.size * y


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
    """

    def setup(self) -> None:
        """Phase of the turn."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self._ways = LegMemory(ways_m)
        self.apart = float(self.rng.uniform(0.3, 0.7)) * np.pi  # phase between both flanks
        self.askew = float(self.rng.uniform(*ASKEW))
        self.geared = float(self.rng.uniform(*GEARED))

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
        elif self.variant == "universal_joint":
            ahead = np.arctan2(BENT * np.sin(turn), np.cos(turn)) - turn
            y = ((ahead + np.pi) % (2.0 * np.pi) - np.pi) * (1.0 + BENT) / (1.0 - BENT)
        elif self.variant in ("bowed_screw", "modulated", "with_load", "growing_runout"):
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
        if self.variant == "modulated":  # the screw runs out of true towards one end
            middle, half = self.site.drive_range_m(self.place)
            return np.asarray(1.0 + 0.8 * (q - middle) / half)
        if self.variant == "growing_runout":
            return np.asarray(FRESH + (1.0 - FRESH) * self._ways.at(state, self.place)[:, 0] / ROUGHENS_M)
        return np.asarray(0.6 + 0.8 * state.payload_kg / FULL_PAYLOAD_KG)

    def _faces_apart(self, turn: Array) -> Array:
        """How far both faces are apart (n,), over the tilt of the one that does not turn."""
        return np.asarray(np.abs(1.0 + self.askew * np.exp(1j * turn)))


EFFECTS = (
    EffectSpec(
        name="screw_cumulative_error",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 1e-5, 6e-4, "largest error along the travel"),
        variants=(
            "parabola",
            "cubic",
            "irregular",
            "two_pieces",
            "glued_scale",
            "worn_stretch",
            "pitch_walk",
            "rack_pieces",
            "sagging_tape",
            "copied_gear",
            "stitched_fields",
            "beating_wheels",
            "dispersed_blow",
        ),
        final="dispersed_blow",
        reveals="drive coordinate, SMRs on the sliders",
        make=CumulativeError,
    ),
    EffectSpec(
        name="screw_periodic_error",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 5e-7, 8e-6, 3e-4, "first harmonic"),
        variants=(
            "sine",
            "two_harmonics",
            "modulated",
            "with_load",
            "triangle",
            "ball_orbit",
            "bowed_screw",
            "universal_joint",
            "slipping_balls",
            "other_flank",
            "thrust_faces",
            "torque_ripple",
            "twisted_phase",
            "growing_runout",
            "geared_together",
        ),
        final="geared_together",
        reveals="many drive positions off a grid, by variant direction, payload and distance moved, the other "
        "drive's coordinate, SMRs on the sliders",
        make=PeriodicError,
        others=(EffectParameter("period_m", 4e-3, 1e-2, 4e-2, "lead of the screw"),),
    ),
)
