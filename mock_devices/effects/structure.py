"""Elastic effects, which act inside the equilibrium: columns, struts, clearance."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
)
from mock_devices.effects.column_compliance import ColumnCompliance
from mock_devices.effects.followers import Flipped
from mock_devices.effects.joint_clearance import JointClearance
from mock_devices.effects.leg_memory import LegMemory, motions
from mock_devices.effects.reversal import above_reference_k
from mock_devices.effects.strut_laws import (
    bowed,
    hertz_contact,
    joint_separates,
    soft_in_compression,
    yielding,
)
from mock_devices.effects.strut_ways import swing_rad

LOOSE_N = (1000.0, 6000.0)  # preload of a joint that separates
BUCKLES_N = (3000.0, 12000.0)  # force at which a bowed strut would buckle
BOND, BOND_S = 0.3, (4.0, 12.0)  # of a bonded end: share of its compliance at once; time constant of the rest
NEEDLES = (40, 70)  # of a joint's bearing
RUBBER, RUBBER_S = (0.15, 0.35), 16.0  # exponent of rubber's creep; rest after which it has the size
SOFT_AT_K, SOFTENS_K = (-0.5, 2.0), 3.0  # where an adhesive turns soft, above the reference; half the width of that
SEATS_M_PER_S = 0.12  # speed of a stop upwards that seats a taper but for 1 / e
LOOSENS = 200.0  # motions after which a bolt has lost 1 - 1 / e of its hold
CLOSES_KG, CLOSED = (60.0, 300.0), (0.02, 0.15)  # payload from which a spring lies coil on coil; how soft that still is
CRACK, STRAINS_M_PER_S, BREAKS = (0.02, 0.1), 0.5, (20.0, 80.0)  # of a crack: its share of the end at first; speed of a
# stop that counts one; stops after which it has gone through
SPOTS, TOUCHES = 4096, (0.02, 1.0)  # of an end: motions until chance repeats itself; how soft its spots are
SNAPS = (0.1, 0.4)  # of half the travel, either way from its middle: where a truss snaps
SOFT_ENDS = (
    "creeping_bond", "warm_adhesive", "seated_taper", "fractional_rubber", "needles_in_turn", "snapped_truss",
    "closed_spring", "opening_crack", "chance_contacts",
)  # fmt: skip
FULL_PAYLOAD_KG = 400.0
GONE = 600.0  # logarithm of a ratio at which nothing of a strut is left


class LinkStiffness(Effect):
    """One strut is softer than the others, by exp(-size).

    `hertz`: its joints' contacts give way with the power 2/3 of the force, as H. Hertz, "Über die Berührung fester
    elastischer Körper" (1881) has it of points; exp(-size) is then the ratio of stiffness from rest to HERTZ_N.
    `joint_separates`: a bolted joint as in VDI 2230, "Systematische Berechnung hochbeanspruchter Schraubenverbindungen"
    (1977): bolt and plates share the force until it takes away the preload, then the bolt alone gives way; exp(-size)
    is the bolt's share of the strut's stiffness.
    `fork_bearing`: the fork of its joint turns in a bearing, across which the strut lies in the middle of the travel;
    it is softer along than across, and the strut's angle decides how much of its force goes along: stiffness in T. C.
    Lim, R. Singh, "Vibration Transmission Through Rolling Element Bearings, Part I: Bearing Stiffness Formulation"
    (1990). The whole size is that of a strut along the bearing.
    `loosening`: a screwed end that every swing of the strut loosens a little: G. H. Junker, "New Criteria for
    Self-Loosening of Fasteners Under Vibration" (1969). The whole size is reached when no hold is left.
    `bowed`: a strut that is not straight is stretched straight by tension and bent further by compression, towards the
    force at which it would buckle: W. E. Ayrton, J. Perry, "On Struts" (1886). exp(-size) is the ratio of stiffness
    without force.
    `creeping_bond`: the adhesive of a bonded end gives way by a part at once and by the rest as it creeps after each
    motion, a standard linear solid: N. W. Tschoegl, "The Phenomenological Theory of Linear Viscoelastic Behavior"
    (1989). exp(-size) is the ratio of stiffness after long rest.
    `warm_adhesive`: the adhesive of a bonded end turns from hard to soft over some kelvin around the temperature of the
    shop, so that the strut is softer whenever it is warmer: adhesives and temperature in R. D. Adams, W. C. Wake,
    "Structural Adhesives in Engineering" (1984). exp(-size) is the ratio of stiffness when all of it is soft.
    `seated_taper`: a tapered end is driven into its seat by a stop on the way up, the firmer the faster it was, and
    loosened by one on the way down: tapered joints in E. I. Rivin, "Stiffness and Damping in Mechanical Design" (1999).
    exp(-size) is the ratio of stiffness when it is loose, as it also is at first.
    `fractional_rubber`: its rubber gives way with a small power of the time that it has rested, neither at once nor
    ever at an end: R. L. Bagley, P. J. Torvik, "A Theoretical Basis for the Application of Fractional Calculus to
    Viscoelasticity" (1983). exp(-size) is the ratio of stiffness after RUBBER_S.
    `needles_in_turn`: needles of its joint's bearing come under the force one by one, their cage going half as far as
    the joint, and it is stiff with one right under the force: T. A. Harris, "Rolling Bearing Analysis" (1966).
    exp(-size) is the ratio of stiffness between two of them.
    `snapped_truss`: a flat truss of two bars in its end snaps through as its drive comes high enough, and is soft until
    it snaps back, farther down: R. von Mises, "Über die Stabilitätsprobleme der Elastizitätstheorie" (1923). exp(-size)
    is the ratio of stiffness when it has snapped; else it is as stiff as the others.
    `closed_spring`: a spring in its end lies coil on coil beyond one payload and gives way little from there on: A. M.
    Wahl, "Mechanical Springs" (1944). exp(-size) is the ratio of stiffness while it is open.
    `opening_crack`: every stop of its drive lets a crack in its end grow in proportion to its length and to the square
    of the speed, and so ever more: P. C. Paris, F. Erdogan, "A Critical Analysis of Crack Propagation Laws" (1963).
    exp(-size) is the ratio of stiffness once it has gone through.
    `chance_contacts`: after each motion of its drive other spots of its end touch, many or few, and it is as soft as
    these: R. Holm, "Electric Contacts" (1946). exp(-size) is the ratio of stiffness with the fewest.
    """

    def setup(self) -> None:
        """How little the joint of variant `joint_separates` is preloaded, and what a bowed strut would carry."""
        self.preload_n = float(self.rng.uniform(*LOOSE_N))
        self.buckles_n = float(self.rng.uniform(*BUCKLES_N))
        self.creeps_s = float(self.rng.uniform(*BOND_S))
        self.soft_at_k = float(self.rng.uniform(*SOFT_AT_K))
        self.rubber = float(self.rng.uniform(*RUBBER))
        self.needles = int(self.rng.integers(NEEDLES[0], NEEDLES[1] + 1))
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self._swings = LegMemory(motions)
        middle, half = self.site.drive_range_m(self.site.machine.struts[self.place].drive)
        down, up = self.rng.uniform(*SNAPS, 2).tolist()
        self.snaps_m = (middle - half * down, middle + half * up)
        self._truss = Flipped(*self.snaps_m)
        self.closes_kg, self.closed = float(self.rng.uniform(*CLOSES_KG)), float(self.rng.uniform(*CLOSED))
        self.crack, self.breaks = float(self.rng.uniform(*CRACK)), float(self.rng.uniform(*BREAKS))
        self.touches = self.rng.spawn(1)[0].uniform(*TOUCHES, SPOTS)
        self._strained = LegMemory(lambda way, speed, _: (speed / STRAINS_M_PER_S) ** 2 * (way != 0.0))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Count the motions of the strut's own drive, or let them snap its truss."""
        if self.variant == "loosening" and drive == self.site.machine.struts[self.place].drive:
            self._swings.record(leg)
        if self.variant == "opening_crack" and drive == self.site.machine.struts[self.place].drive:
            self._strained.record(leg)
        if self.variant == "snapped_truss" and drive == self.site.machine.struts[self.place].drive:
            self._truss.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Change the strut's stiffness or its law."""
        i, x = self.place, min(self.size, GONE)
        if self.variant == "joint_angle":  # a joint that is stiff only in its middle position
            strut = self.site.machine.struts[i]
            swing = (state.q_m[:, strut.drive] - self.site.drive_range_m(strut.drive)[0]) / strut.length_m
            deviation.ln_stiffness[:, i] -= x * (0.4 + 8.0 * swing**2)
        elif self.variant == "soft_in_compression":
            deviation.laws.setdefault(i, []).append(soft_in_compression(float(np.exp(-x))))
        elif self.variant == "hertz":
            deviation.laws.setdefault(i, []).append(hertz_contact(float(np.expm1(x))))
        elif self.variant == "bowed":
            deviation.laws.setdefault(i, []).append(bowed(float(np.expm1(x)), self.buckles_n))
        elif self.variant == "fork_bearing":
            deviation.ln_stiffness[:, i] -= np.log1p(
                np.expm1(x) * np.sin(swing_rad(self.site.machine, i, state.q_m)) ** 2
            )
        elif self.variant in SOFT_ENDS:
            deviation.ln_stiffness[:, i] -= np.log1p(np.expm1(x) * self._soft_end(state))
        elif self.variant == "joint_separates":
            deviation.laws.setdefault(i, []).append(joint_separates(float(np.exp(-x)), self.preload_n))
        elif self.variant == "yielding":
            deviation.laws.setdefault(i, []).append(yielding(x / 1.0e-4))
        elif self.variant == "softens_with_load":
            deviation.ln_stiffness[:, i] -= x * (0.3 + 0.7 * state.payload_kg / FULL_PAYLOAD_KG)
        elif self.variant == "loosening":
            swings = self._swings.at(state, self.site.machine.struts[i].drive)[:, 0]
            deviation.ln_stiffness[:, i] -= x * (1.0 - np.exp(-swings / LOOSENS))
        else:
            deviation.ln_stiffness[:, i] -= x

    def _soft_end(self, state: MotionState) -> Array:
        """How soft the bonded, tapered or turning end is (n,), from 0 to 1."""
        drive = self.site.machine.struts[self.place].drive
        if self.variant == "needles_in_turn":
            turn = 0.5 * self.needles * swing_rad(self.site.machine, self.place, state.q_m) + self.phase
            return np.asarray(0.5 * (1.0 - np.cos(turn)))
        if self.variant == "snapped_truss":
            return np.asarray(0.5 + 0.5 * self._truss.at(state, drive))
        if self.variant == "creeping_bond":
            return np.asarray(1.0 - (1.0 - BOND) * np.exp(-state.since_s[:, drive] / self.creeps_s))
        if self.variant == "fractional_rubber":
            return np.asarray((state.since_s[:, drive] / RUBBER_S) ** self.rubber)
        if self.variant == "warm_adhesive":
            beyond = (above_reference_k(self.site, state, "struts") - self.soft_at_k) / SOFTENS_K
            return np.asarray(0.5 * (1.0 + np.tanh(beyond)))
        by_legs = {"seated_taper": self._seated, "opening_crack": self._cracked, "chance_contacts": self._touched}
        return by_legs[self.variant](state, drive) if self.variant in by_legs else self._open(state)

    def _open(self, state: MotionState) -> Array:
        """How soft a spring is (n,) while it is open, or coil on coil."""
        return np.where(state.payload_kg > self.closes_kg, self.closed, 1.0)

    def _cracked(self, state: MotionState, drive: int) -> Array:
        """How soft an end is (n,) by the crack that all stops of its drive have opened."""
        left = np.maximum(1.0 - self._strained.at(state, drive)[:, 0] / self.breaks, 0.0)
        return np.asarray(self.crack**left)

    def _touched(self, state: MotionState, drive: int) -> Array:
        """How soft an end is (n,) by the spots that touch since the last motion of its drive."""
        return np.asarray(self.touches[state.leg[:, drive] % SPOTS])

    def _seated(self, state: MotionState, drive: int) -> Array:
        """How soft a taper is (n,) after the last stop of its drive."""
        loose = np.exp(-((state.speed_m_per_s[:, drive] / SEATS_M_PER_S) ** 2))
        return np.where(state.direction[:, drive] > 0.0, loose, 1.0)


_PER_N = EffectParameter(
    "compliance_m_per_n", 5e-10, 1e-8, 2e-6, "of the carriage, at mid travel, at 0.25 m lever if in yaw"
)

EFFECTS = (
    EffectSpec(
        name="column_compliance",
        kind="catalogue",
        place="drive",
        size=_PER_N,
        variants=(
            "lateral",
            "cantilever",
            "yaw",
            "hardening",
            "screw_length",
            "held_at_both_ends",
            "portal",
            "ball_nut",
            "rail_between_bolts",
            "resin_bed",
            "rocking_foot",
            "warm_resin",
            "swaying_frame",
            "floating_carriage",
            "opening_joint",
            "clamped_at_rest",
            "balls_in_turn",
            "shared_pressure",
            "embedding_bolts",
        ),
        final="embedding_bolts",
        reveals="payload, SMRs on the sliders, height; by variant dwell, speed, temperature, many drive positions off "
        "a grid, the other drive's coordinate, speed and dwell, exchanges of payload",
        make=ColumnCompliance,
    ),
    EffectSpec(
        name="link_stiffness",
        kind="catalogue",
        place="strut",
        size=EffectParameter("ln_ratio", 0.05, 0.7, 6.0, "logarithm of nominal over true"),
        variants=(
            "softer",
            "soft_in_compression",
            "yielding",
            "joint_angle",
            "softens_with_load",
            "hertz",
            "joint_separates",
            "fork_bearing",
            "loosening",
            "bowed",
            "creeping_bond",
            "warm_adhesive",
            "seated_taper",
            "fractional_rubber",
            "needles_in_turn",
            "snapped_truss",
            "closed_spring",
            "opening_crack",
            "chance_contacts",
        ),
        final="chance_contacts",
        reveals="payload, pose; by variant dwell, direction, speed, number and places of motions, also by chance, "
        "temperature",
        make=LinkStiffness,
    ),
    EffectSpec(
        name="joint_clearance",
        kind="catalogue",
        place="strut",
        size=EffectParameter("clearance_m", 1e-6, 1.5e-5, 4e-4, "play each way"),
        variants=(
            "dead_zone",
            "soft_contact",
            "one_sided",
            "load_dependent",
            "gravity_seated",
            "contact_force",
            "ball_bearing",
            "spring_seated",
            "oil_journal",
            "worn_hole",
            "friction_held",
            "wearing_pin",
            "shrinking_bush",
            "lobed_hole",
            "turning_bush",
            "ratcheted_bush",
            "carried_by_film",
            "fitted_anew",
            "beaten_wide",
        ),
        final="beaten_wide",
        reveals="poses where the strut's force changes its sign, payload; by variant dwell, speed, direction, way, "
        "temperature, exchanges of payload",
        make=JointClearance,
    ),
)
