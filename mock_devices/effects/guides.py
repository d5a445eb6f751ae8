"""Guides that are not straight: sliders beside their ideal place."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    smooth_curve,
)
from mock_devices.effects.bolted_rail import BoltedRail
from mock_devices.effects.guides_by_motion import ABREAST_M, BY_MOTION, OPENS_K, PAD_S, GuideByMotion
from mock_devices.effects.leg_memory import LegMemory, ways_m

FULL_PAYLOAD_KG = 400.0
RAIL_PER_M = 12.0
STEEPEST = math.exp(-0.25 * math.pi) * math.sqrt(0.5)
BLOCKS_M = 0.2  # from one runner block of a carriage to the other
WAVES = 40
SUPPORTS = 6  # of a rail, from one end of the travel to the other
CAGE_M, CREEPS = (0.12, 0.5), 0.004  # of rollers in a cage: waves of their diameters; creep over travel
BALLS_M, BALLS_BACK = (0.018, 0.03), 0.3  # travel from ball to ball; share of it that they are behind on the way back
SPANS_M, SAG = (0.26, 0.4), 0.6  # from support to support; sag without payload midway between two, over the size
ROLLERS_M, UNLIKE = (0.025, 0.045), (0.03, 0.1)  # of a carriage: diameter of its rollers; by how much they differ
BY_RAIL = ("bolt_dips", "moving_load", "two_blocks_one_dent", "unloaded_block", "unround_rollers")
OVAL = 0.4  # error of a roller twice a turn, over that once a turn
DENT_M, DENTS = 0.045, 1.8  # of a dent in a rail: half width; depth under one block, over the size
UNLOADS_KG, TIPS, LEANS = (60.0, 180.0), 3.0, 1.0  # payload that unloads a block; what then adds to waves and lean
HELD = 0.4  # waves of a carriage whose blocks are both pressed, over the size


class _Guide(GuideByMotion):
    """A curve along the travel.

    `loose_bolt_of_rail`: a rail that lies on an elastic base and is pressed off it at one place dips as in M. Hetényi,
    "Beams on Elastic Foundation" (1946); the guide's angle is the slope of that line.
    `random_surface`: a rail as rough surfaces are, a spectrum that falls with the square of the frequency: R. S.
    Sayles, T. R. Thomas, "Surface topography as a nonstationary random process" (1978). Two runner blocks follow it:
    the carriage's place is their mean and its angle their difference.
    `uneven_supports`: a rail is bent over supports of unequal heights by the theorem of three moments of B. P. E.
    Clapeyron, "Calcul d'une poutre élastique reposant librement sur des appuis inégalement espacés" (1857); the guide's
    angle is the slope of that line.
    `gib_play`: a carriage lies against one side of a worn gib on its way up and against the other on its way down,
    offset by the gap where it stands: gibs of sliding guides in A. H. Slocum, "Precision Machine Design" (1992). The
    gap is widest where the carriage runs most.
    `creeping_cage`: the carriage runs on rollers of unequal diameters in a cage, which goes half its way and creeps
    besides, as rolling bodies under load do in K. L. Johnson, "Contact Mechanics" (1985), so that the line of the guide
    moves with the distance run.
    `ball_passage`: balls that come under a runner block and leave it tilt it by a short period of the travel: H. Ohta,
    E. Hayashi, "Vibration of Linear Guideway Type Recirculating Linear Ball Bearings" (2000). They have play in their
    channel, so that the period is elsewhere on the way back.
    `bolt_dips`: each bolt of the rail presses it down by its own torque, so that the line dips at every bolt: P. Majda,
    "Modeling of Geometric Errors of Linear Guideway and Their Influence on Joint Kinematic Error in Machine Tools"
    (2012).
    `off_centre_drive`: the drive does not pull at the centre of the guide's friction, which turns the carriage to one
    side on its way up and to the other on its way down, the more the more it carries: A. H. Slocum, "Precision Machine
    Design" (1992).
    `moving_load`: the rail yields under what its carriage carries, most midway between two supports and in proportion
    to the load: S. Timoshenko, "Method of Analysis of Statical and Dynamical Stresses in Rail" (1926). Each span is
    clamped at its supports.
    `unround_rollers`: a carriage runs on two rollers that are neither round nor quite equal, and the difference of
    their errors turns it, less or more as they come in step and out of it: rolling and roundness in W. R. Moore,
    "Foundations of Mechanical Accuracy" (1970).
    `two_blocks_one_dent`: the rail has one dent, and the carriage sinks there twice, as one of its runner blocks passes
    it and then the other: straightness of carriages on rails in G. Schlesinger, "Testing Machine Tools" (1932).
    `unloaded_block`: above a certain payload a runner block has lost its preload, and the carriage tips over the others
    and follows the waves of the rail further, in proportion to what is beyond: preload of guides in M. Weck, C.
    Brecher, "Werkzeugmaschinen 2" (2006).
    `racked_frame`: both guides belong to one frame, which the next carriage racks by where it stands, one way when it
    is high and the other way when it is low; this guide then leans and bows: H. Cross, "Analysis of Continuous Frames
    by Distributing Fixed-End Moments" (1930).
    `tilting_pad`: the pad under the carriage rides up on its oil at the edge that leads, with the root of the speed,
    and turns the carriage by the direction of its motion, until the film is pressed out at rest: A. G. M. Michell, "The
    Lubrication of Plane Surfaces" (1905). The size is that when a motion at PAD_M_PER_S stops.
    `carriage_abreast`: the next carriage presses this guide aside when it comes abreast, and the less the farther above
    or below it stands, as stresses die away from where a load is: A. de Saint-Venant, "Mémoire sur la torsion des
    prismes" (1855).
    `warm_gap`: the blocks of the carriage open as they grow warmer than their rail was fitted for, and it follows the
    waves of the rail further, in proportion to the gap: E. Oberg, F. D. Jones, "Machinery's Handbook" (1914).
    `buckled_rail`: bolts at both ends hold the rail, which a change of temperature presses until it buckles aside, by
    the root of what is beyond: A. D. Kerr, "Analysis of Thermal Track Buckling in the Lateral Plane" (1978). The size
    is that of the middle when it is warmer than that by BUCKLE_K.
    `pulsing_pockets`: the pressure in the carriage's pockets rises and falls slowly with the pump's control, and with
    it how, and to which side, they follow the waves of the rail: D. D. Fuller, "Theory and Practice of Lubrication for
    Engineers" (1956).
    `lagging_shoe`: what holds the carriage to its rail is a shoe with play along the way, which it drags behind it, so
    that it follows the line late, from either side: F. Preisach, "Über die magnetische Nachwirkung" (1935).
    `dragged_beam`: a beam between both carriages is dragged along by the next one and leans on this guide by the
    direction in which that last went, the more, or the less, the higher this carriage stands: G. Amontons, "De la
    résistance causée dans les machines" (1699). The size is that in the middle of the travel.
    `three_seats`: every motion of the carriage leaves it in one of three seats, by chance: R. von Mises,
    "Wahrscheinlichkeit, Statistik und Wahrheit" (1928). The outer ones are the size to either side.
    `dented_by_rest`: where the carriage last rested for a while its balls have left a dent, deeper after longer rest,
    and near that place it tilts into it, one way above and the other way below: J. O. Almen, "Lubricants and False
    Brinelling of Ball and Roller Bearings" (1937). The next rest leaves another one and the first is rolled out.
    `sinks_into_waves`: a motion leaves the carriage afloat on a film, which hardly lets it follow the waves of its
    rail, and at rest it sinks into them as the film goes: G. G. Stokes, "On the Theories of the Internal Friction of
    Fluids in Motion" (1845). The size is that of long rest.
    `skewed_rollers`: rollers that stand askew turn the carriage on with every way, to one side upwards and to the other
    downwards, until they slide, and a short way back turns it back by as much only: F. W. Carter, "On the Action of a
    Locomotive Driving Wheel" (1926). The size is where they slide, to either side.
    """

    slope = False

    def setup(self) -> None:
        """Draw phase, curve and the place of a step."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.curve = smooth_curve(self.rng, 6)
        self.joint = float(self.rng.uniform(-0.4, 0.4))
        self.waves = self.rng.standard_normal((2, WAVES)) / np.arange(1.0, WAVES + 1.0)
        middle, half = self.site.drive_range_m(self.place)
        travel_m = np.linspace(-half, half, 401)
        surface = self._over_blocks(travel_m)
        self.line = np.polyfit(travel_m, surface, 0 if self.slope else 1)  # from which a guide's errors count
        self.rms = float(np.std(surface - np.polyval(self.line, travel_m)))
        self.heights = self.rng.standard_normal(SUPPORTS)
        self.bends = np.zeros(SUPPORTS)  # curvature over each support, none at both ends
        apart = 2.0 * half / (SUPPORTS - 1)
        three = (4.0 * np.eye(SUPPORTS - 2) + np.eye(SUPPORTS - 2, k=1) + np.eye(SUPPORTS - 2, k=-1)) * apart / 6.0
        self.bends[1:-1] = np.linalg.solve(three, np.diff(self.heights, 2) / apart)
        bent = self._over_supports(travel_m)
        self.level = np.polyfit(travel_m, bent, 0 if self.slope else 1)
        self.bent_rms = float(np.std(bent - np.polyval(self.level, travel_m)))
        self.rollers_m = self.rng.uniform(*CAGE_M, 3)
        self.phases = self.rng.uniform(0.0, 2.0 * np.pi, 3)
        self.balls_m = float(self.rng.uniform(*BALLS_M))
        self._ways = LegMemory(ways_m)
        self.bolts = BoltedRail(middle - half, middle + half, self.rng)
        self.span_m = float(self.rng.uniform(*SPANS_M))
        diameter_m = float(self.rng.uniform(*ROLLERS_M))
        self.unloads_kg = float(self.rng.uniform(*UNLOADS_KG))
        self.turns_m = np.pi * diameter_m * np.array([1.0, 1.0 + float(self.rng.uniform(*UNLIKE))])
        self.pad_s = float(self.rng.uniform(*PAD_S))
        self.abreast_m = float(self.rng.uniform(*ABREAST_M))
        self.opens_k = float(self.rng.uniform(*OPENS_K))
        self.draw_of_motions()

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the cage creep, or what motions and rests leave be there."""
        if self.variant == "creeping_cage" and drive == self.place:
            self._ways.record(leg)
        self.record_of_motions(drive, leg)

    def _over_blocks(self, from_middle_m: Array) -> Array:
        """The random surface under both blocks: their mean, or their difference for the angle (n,)."""
        _, half = self.site.drive_range_m(self.place)
        rate = np.pi * np.arange(1.0, WAVES + 1.0) / (2.0 * half)  # the longest wave is twice the travel
        turn, block = np.outer(from_middle_m, rate), 0.5 * BLOCKS_M * rate
        if self.slope:
            cosine, sine = np.sin(block) * self.waves[1], -np.sin(block) * self.waves[0]
        else:
            cosine, sine = np.cos(block) * self.waves[0], np.cos(block) * self.waves[1]
        return np.asarray(np.cos(turn) @ cosine + np.sin(turn) @ sine)

    def _over_supports(self, from_middle_m: Array) -> Array:
        """The rail over its supports, or its slope (n,)."""
        _, half = self.site.drive_range_m(self.place)
        apart = 2.0 * half / (SUPPORTS - 1)
        at = np.clip((from_middle_m + half) / apart, 0.0, SUPPORTS - 1.0)
        i = np.minimum(at.astype(int), SUPPORTS - 2)
        b = at - i
        a = 1.0 - b
        h, m = self.heights, self.bends
        if self.slope:
            bending = (3.0 * b**2 - 1.0) * m[i + 1] - (3.0 * a**2 - 1.0) * m[i]
            return np.asarray((h[i + 1] - h[i]) / apart + bending * apart / 6.0)
        bending = (a**3 - a) * m[i] + (b**3 - b) * m[i + 1]
        return np.asarray(a * h[i] + b * h[i + 1] + bending * apart**2 / 6.0)

    def _by_rail(self, q_m: Array, payload_kg: Array) -> Array:
        """What bolts, supports, dents, blocks or rollers make of the line or the angle (n,)."""
        if self.variant == "bolt_dips":
            return 0.7 * self.bolts.line(q_m)
        if self.variant == "two_blocks_one_dent":
            middle, half = self.site.drive_range_m(self.place)
            from_dent = q_m[:, None] - middle - self.joint * half + 0.5 * BLOCKS_M * np.array([-1.0, 1.0])
            return np.asarray(-DENTS * np.exp(-((from_dent / DENT_M) ** 2)).sum(axis=1))
        if self.variant == "unloaded_block":
            beyond = np.maximum(payload_kg - self.unloads_kg, 0.0) / FULL_PAYLOAD_KG
            wave = np.sin(2.0 * np.pi * q_m / self.values["wavelength_m"] + self.phase)
            return np.asarray((HELD + TIPS * beyond) * wave + LEANS * beyond)
        return self._carried(q_m, payload_kg) if self.variant == "moving_load" else self._rolled(q_m)

    def _carried(self, q_m: Array, payload_kg: Array) -> Array:
        """How far the rail yields under its carriage (n,)."""
        span, own_kg = (q_m / self.span_m + self.phase) % 1.0, self.site.machine.moving_mass_kg
        return np.asarray(-SAG * (own_kg + payload_kg) / own_kg * (4.0 * span * (1.0 - span)) ** 3)

    def _rolled(self, q_m: Array) -> Array:
        """Difference of what two rollers lift a carriage (n,)."""
        turn = 2.0 * np.pi * q_m[:, None] / self.turns_m + self.phases[:2]
        lifts = np.sin(turn) + OVAL * np.sin(2.0 * turn)
        return np.asarray(0.7 * (lifts[:, 0] - lifts[:, 1]))

    def error(self, state: MotionState) -> Array:
        q = state.q_m[:, self.place]
        middle, half = self.site.drive_range_m(self.place)
        x = (q - middle) / half
        if self.variant in ("bow", "irregular"):
            y = self.curve(x) if self.variant == "irregular" else 2.0 * x**2 - 1.0
        elif self.variant == "with_load":
            y = np.sin(2.0 * np.pi * q / self.values["wavelength_m"] + self.phase)
            y = y * (0.6 + 0.8 * state.payload_kg / FULL_PAYLOAD_KG)
        elif self.variant == "loose_bolt_of_rail":
            away = RAIL_PER_M * np.abs(q - middle - self.joint * half)
            dip = np.exp(-away)
            y = 2.0 * dip * (np.cos(away) + np.sin(away))
            if self.slope:  # over its largest value
                y = -2.0 * np.sign(q - middle - self.joint * half) * dip * np.sin(away) / STEEPEST
        elif self.variant == "random_surface":
            y = 0.7 * (self._over_blocks(q - middle) - np.polyval(self.line, q - middle)) / self.rms
        elif self.variant == "uneven_supports":
            y = 0.7 * (self._over_supports(q - middle) - np.polyval(self.level, q - middle)) / self.bent_rms
        elif self.variant in BY_MOTION:
            y = self._by_motion(x, state)
        elif self.variant == "creeping_cage":
            cage = 0.5 * q + CREEPS * self._ways.at(state, self.place)[:, 0]
            y = np.sin(2.0 * np.pi * cage[:, None] / self.rollers_m + self.phases).sum(axis=1) / math.sqrt(3.0)
        elif self.variant == "ball_passage":
            ball = 2.0 * np.pi * (q / self.balls_m + BALLS_BACK * (state.direction[:, self.place] < 0.0)) + self.phase
            y = np.sin(ball) + 0.35 * np.sin(2.0 * ball)
        elif self.variant in BY_RAIL:
            y = self._by_rail(q, state.payload_kg)
        elif self.variant == "rail_joint":  # two rails meet
            y = np.tanh((x - self.joint) / 0.04)
        else:
            y = np.sin(2.0 * np.pi * q / self.values["wavelength_m"] + self.phase)
        return self.size * np.asarray(y)


class Straightness(_Guide):
    """The guide bends sideways; the slider follows it without turning."""

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider across its axis."""
        deviation.sideways_m[:, self.place] += self.error(state)


class Angular(_Guide):
    """The slider turns in the plane along its way; its joints and its reflector go by their lever arms."""

    slope = True

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the slider."""
        deviation.yaw_rad[:, self.place] += self.error(state)


_WAVE = (EffectParameter("wavelength_m", 0.15, 0.6, 1.5, "of the sine"),)
_VARIANTS = (
    "sine",
    "bow",
    "irregular",
    "with_load",
    "rail_joint",
    "loose_bolt_of_rail",
    "random_surface",
    "uneven_supports",
    "gib_play",
)

EFFECTS = (
    EffectSpec(
        name="guide_straightness",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 1e-5, 4e-4, "sideways"),
        variants=(
            *_VARIANTS,
            "creeping_cage",
            "bolt_dips",
            "moving_load",
            "two_blocks_one_dent",
            "racked_frame",
            "carriage_abreast",
            "buckled_rail",
            "lagging_shoe",
            "dragged_beam",
            "sinks_into_waves",
        ),
        final="sinks_into_waves",
        reveals="drive coordinate, by variant the other one's, direction, also of the other drive, payload, dwell, "
        "distance moved or temperature, SMRs on the sliders",
        make=Straightness,
        others=_WAVE,
    ),
    EffectSpec(
        name="guide_angular",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_rad", 2e-6, 3e-5, 4e-3, "rotation in the plane"),
        variants=(
            *_VARIANTS,
            "ball_passage",
            "off_centre_drive",
            "unround_rollers",
            "unloaded_block",
            "tilting_pad",
            "warm_gap",
            "pulsing_pockets",
            "dented_by_rest",
            "three_seats",
            "skewed_rollers",
        ),
        final="skewed_rollers",
        reveals="drive coordinate, by variant direction, speed, dwell, former rests, number of motions, payload, "
        "temperature and time, platform rotation; not a slider's SMR",
        make=Angular,
        others=_WAVE,
    ),
)
