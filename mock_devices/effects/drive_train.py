"""What lies between an encoder's count and the slider: the screw's cumulative and periodic error."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j0, jn_zeros

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    MotionState,
    smooth_curve,
)
from mock_devices.effects.periodic_error import PeriodicError

TAPE = 5.0  # half length of a scale over the length in which its adhesive passes its force on
WORN, FLANK = 0.25, 0.2  # of half the travel: half the stretch that is worn throughout, and the nut's length
TURNS = 138  # of a screw over its travel
COPIES_M, THREADS = (0.2, 0.45), 0.4  # travel of a turn of a grinder's wheel; its third harmonic over its first
PIECE_M = 0.2  # of a rack
HELD_M = 0.25  # from one holder of a tape to the next
FIELDS_M = (0.09, 0.16)  # of a grating that was written in fields
CHANGE_M, UNEQUAL = (
    (0.06, 0.1),
    (0.06, 0.12),
)  # of change wheels: travel of a turn of one; by how much the other differs
TERMS = (2, 5)  # of a corrector
LONE_M = (0.05, 0.15)  # half width of a lone wave, for the hyperbolic secant
SPOOL_M, THICKER = (0.12, 0.22), (0.15, 0.4)  # of a tape on a spool: length of the first turn; by how much longer, over
# that, each next one is
NODES, HANGS_M = (4, 7), ((0.02, 0.25), (0.0, 0.4))  # of a tape that hung: places that stood still; how far below the
# travel it ended, and how far above it it was held
BLOW_M, WAVES = (0.4, 0.7), (4.0, 7.0)  # of a blow on a tape: how far below the travel; waves along that


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
    `few_terms`: two pieces of a screw are off by a step, and a corrector that has only some harmonics of twice the
    travel takes it away but for its edge, which rings on both sides: J. W. Gibbs, "Fourier's Series" (1899).
    `lone_wave`: a push has run along a tape while it was glued as one wave without a trough, and has stayed there: the
    square of a hyperbolic secant in D. J. Korteweg, G. de Vries, "On the Change of Form of Long Waves" (1895).
    `spooled_tape`: a tape lay long on its spool and has kept a wave for each turn, all alike but each longer than the
    one below by the tape's thickness: Archimedes, "On Spirals", ed. T. L. Heath (1897).
    `hung_tape`: a tape swung while it hung freely before it was glued, and has kept that, in waves that are longer and
    lower the higher up: D. Bernoulli, "Theoremata de oscillationibus corporum filo flexili connexorum" (1738).
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
        own = self.rng.spawn(1)[0]
        self.terms = int(own.integers(TERMS[0], TERMS[1] + 1))
        self.step_m = middle + half * float(own.uniform(-0.4, 0.4))
        left = self._beyond_terms(fine)
        self.left_level = np.polyfit(fine, left, 1)
        self.left_most = float(np.abs(left - np.polyval(self.left_level, fine)).max())
        self.copied_most = float(np.abs(copied - np.polyval(self.copied_level, fine)).max())
        self._draw_waves(fine)

    def _draw_waves(self, fine: Array) -> None:
        """A lone wave, the turns of a tape on its spool, and the swing of one that hung."""
        middle, half = self.site.drive_range_m(self.place)
        own = self.rng.spawn(1)[0]
        self.lone_at_m = middle + half * float(own.uniform(-0.5, 0.5))
        self.lone_m = float(own.uniform(*LONE_M)) * float(own.choice([-1.0, 1.0]))  # its sign is that of the wave
        lone = self._lone(fine)
        self.lone_level = np.polyfit(fine, lone, 1)
        self.lone_most = float(np.abs(lone - np.polyval(self.lone_level, fine)).max())
        own = self.rng.spawn(1)[0]
        self.spool_m, self.thicker = float(own.uniform(*SPOOL_M)), float(own.uniform(*THICKER))
        self.spool_at = float(own.uniform(0.0, 2.0 * np.pi))
        spooled = self._spooled(fine)
        self.spooled_level = np.polyfit(fine, spooled, 1)
        self.spooled_most = float(np.abs(spooled - np.polyval(self.spooled_level, fine)).max())

        own = self.rng.spawn(1)[0]
        self.nodes = int(own.integers(NODES[0], NODES[1] + 1))
        self.hangs_m = (
            middle - half - float(own.uniform(*HANGS_M[0])),
            middle + half + float(own.uniform(*HANGS_M[1])),
        )
        hung = self._hung(fine)
        self.hung_level = np.polyfit(fine, hung, 1)
        self.hung_most = float(np.abs(hung - np.polyval(self.hung_level, fine)).max())

    def _hung(self, q_m: Array) -> Array:
        """What a tape that swung while it hung has kept (n,), over its swing at the lower end."""
        free_m, held_m = self.hangs_m
        up = np.maximum(q_m - free_m, 0.0) / (held_m - free_m)
        return np.asarray(j0(float(jn_zeros(0, self.nodes)[-1]) * np.sqrt(up)))

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

    def _lone(self, q_m: Array) -> Array:
        """What a lone wave has left (n,), over its height."""
        return np.asarray(np.sign(self.lone_m) / np.cosh((q_m - self.lone_at_m) / self.lone_m) ** 2)

    def _spooled(self, q_m: Array) -> Array:
        """What turns on a spool have left (n,), over the height of their waves."""
        way_m = np.maximum(q_m - self.site.machine.sliders[self.place].travel_m[0], -0.5 * self.spool_m)
        turns = (np.sqrt(1.0 + 2.0 * self.thicker * way_m / self.spool_m) - 1.0) / self.thicker
        return np.asarray(np.sin(2.0 * np.pi * turns + self.spool_at))

    def _beyond_terms(self, q_m: Array) -> Array:
        """What odd harmonics leave of a step (n,), over half the step."""
        _, half = self.site.drive_range_m(self.place)
        odd = 2.0 * np.arange(self.terms) + 1.0
        turn = np.pi * (q_m - self.step_m) / (2.0 * half)
        return np.asarray(np.where(turn < 0.0, -1.0, 1.0) - 4.0 / np.pi * np.sin(np.outer(turn, odd)) @ (1.0 / odd))

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
        elif self.variant in (
            "copied_gear",
            "beating_wheels",
            "dispersed_blow",
            "few_terms",
            "lone_wave",
            "spooled_tape",
            "hung_tape",
        ):
            waves, level, most = {
                "copied_gear": (self._copied, self.copied_level, self.copied_most),
                "beating_wheels": (self._beating, self.beating_level, self.beating_most),
                "spooled_tape": (self._spooled, self.spooled_level, self.spooled_most),
                "hung_tape": (self._hung, self.hung_level, self.hung_most),
                "lone_wave": (self._lone, self.lone_level, self.lone_most),
                "few_terms": (self._beyond_terms, self.left_level, self.left_most),
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
            "few_terms",
            "lone_wave",
            "spooled_tape",
            "hung_tape",
        ),
        final="hung_tape",
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
            "conical_drum",
            "bent_end",
            "racked_bearings",
            "off_focus",
        ),
        final="off_focus",
        reveals="many drive positions off a grid, by variant direction, payload and distance moved, the other "
        "drive's coordinate, SMRs on the sliders",
        make=PeriodicError,
        others=(EffectParameter("period_m", 4e-3, 1e-2, 4e-2, "lead of the screw"),),
    ),
)
