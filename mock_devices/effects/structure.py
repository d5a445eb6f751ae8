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
    Site,
)
from mock_devices.effects.joint_clearance import JointClearance
from mock_devices.effects.leg_memory import LegMemory, motions
from mock_devices.effects.strut_laws import (
    bowed,
    hertz_contact,
    joint_separates,
    soft_in_compression,
    yielding,
)
from mock_devices.effects.strut_ways import swing_rad

LEVER_M = 0.25
PORTAL_M = 0.3
LOOSE_N = (1000.0, 6000.0)  # preload of a joint that separates
BOLTS_M, AT_BOLTS = 0.24, 0.2  # spacing on a rail; its compliance at a bolt over that midway between two
BUCKLES_N = (3000.0, 12000.0)  # force at which a bowed strut would buckle
AT_ONCE, BED_S = 0.4, (6.0, 20.0)  # of a rail on resin: share of its compliance at once; time constant of the rest
BOND, BOND_S = 0.3, (4.0, 12.0)  # of a bonded end: share of its compliance at once; time constant of the rest
FOOT_M = -1.2
PRESSED, FLOATS_M_PER_S, FILM_S = 0.25, 0.5, (4.0, 12.0)  # of a carriage on oil: compliance without a film over the
# size; speed of a stop that gives the size; time in which the film is pressed out to 1 / sqrt(2)
CLOSED, OPENS_KG = 0.15, (60.0, 180.0)  # of a joint: compliance while closed, over the size; what opens it
EXCESS_KG = 250.0  # payload beyond that which opens a joint, for the size
NEEDLES = (40, 70)  # of a joint's bearing
RUBBER, RUBBER_S = (0.15, 0.35), 16.0  # exponent of rubber's creep; rest after which it has the size
CHAINS, CHAINS_K = 8.86, 101.6  # of a resin fifty kelvin above its glass transition
SOFT_AT_K, SOFTENS_K = (-0.5, 2.0), 3.0  # where an adhesive turns soft, above the reference; half the width of that
SEATS_M_PER_S = 0.12  # speed of a stop upwards that seats a taper but for 1 / e
LOOSENS = 200.0  # motions after which a bolt has lost 1 - 1 / e of its hold
FULL_PAYLOAD_KG = 400.0
_ALONG, _ACROSS, _YAW = 0, 1, 2


class ColumnCompliance(Effect):
    """The column or the carriage on it gives way to the struts' force.

    `held_at_both_ends`: the screw between two axial bearings, softest in the middle of the travel, of K. K. Varanasi,
    S. A. Nayfeh, "The Dynamics of Lead-Screw Drives: Low-Order Modeling and Experiments" (2004).
    `portal`: a column that is clamped at its foot and at the beam above, PORTAL_M beyond the travel at either end, and
    pushed aside where the carriage stands: the beam with fixed ends of R. J. Roark, "Formulas for Stress and Strain"
    (1938).
    `ball_nut`: the balls of a nut, pressed by what the drive carries, give way the less the more it is: the stiffness
    goes with the cube root of the load in ISO 3408-4, "Ball Screws: Static Axial Rigidity" (2006). The size is that
    without payload.
    `rail_between_bolts`: a rail that only its bolts hold gives way most between two of them, with the square of the
    distance to either, like a beam on two supports: C. L. Navier, "Résumé des leçons données à l'École des ponts et
    chaussées" (1826).
    `resin_bed`: the resin under the rail gives way by a part at once and creeps by the rest where the carriage comes to
    stand, a standard linear solid of J. D. Ferry, "Viscoelastic Properties of Polymers" (1961). The size is that after
    long rest.
    `rocking_foot`: the joint between foot and foundation turns, so that the carriage gives way with the square of its
    height and turns with the column: joints of a machine in D. N. Reshetov, V. T. Portman, "Accuracy of Machine Tools"
    (1988).
    `warm_resin`: the resin under the rail yields faster and so further the warmer the column is, by the shift of M. L.
    Williams, R. F. Landel, J. D. Ferry, "The Temperature Dependence of Relaxation Mechanisms in Amorphous Polymers and
    Other Glass-Forming Liquids" (1955). The size is that at the reference temperature.
    `swaying_frame`: the columns and what joins them are one frame, which sways under the struts' force the more the
    higher the other carriage stands, by the cube of its height, wherever this one is: S. Timoshenko, D. H. Young,
    "Theory of Structures" (1945). The size is that with the other one in the middle of its travel.
    `floating_carriage`: a stop leaves the carriage on a film of oil, thicker by the root of the speed and as much
    softer, which is pressed out at rest with one over the root of time: O. Pinkus, B. Sternlicht, "Theory of
    Hydrodynamic Lubrication" (1961). The size is that at the moment of a stop from FLOATS_M_PER_S.
    `opening_joint`: beyond a certain payload the joint of the carriage opens at its edge, and gives way the further the
    larger the excess: J. H. Bickford, "An Introduction to the Design and Behavior of Bolted Joints" (1981). The size is
    that EXCESS_KG beyond.
    """

    def setup(self) -> None:
        """Where the bolts are, and how fast resin creeps and oil is pressed out."""
        self.first_m = float(self.rng.uniform(0.0, BOLTS_M))
        self.creeps_s = float(self.rng.uniform(*BED_S))
        self.film_s = float(self.rng.uniform(*FILM_S))
        self.opens_kg = float(self.rng.uniform(*OPENS_KG))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Add compliance at the carriage."""
        a, c = self.place, self.size
        middle, half = self.site.drive_range_m(a)
        height = 1.0 + 0.6 * (state.q_m[:, a] - middle) / half  # 1 in the middle of the travel
        if self.variant == "cantilever":
            deviation.carriage_compliance[:, a, _ACROSS] += c * height**3
        elif self.variant == "yaw":
            deviation.carriage_compliance[:, a, _YAW] += c / LEVER_M**2
        elif self.variant == "hardening":
            deviation.carriage_compliance[:, a, _ACROSS] += c
            if c:
                deviation.carriage_hardening[:, a, _ACROSS] += 1.0 / c / 1.5e-5**2
        elif self.variant == "held_at_both_ends":
            low, high = self.site.machine.sliders[a].travel_m
            share = (state.q_m[:, a] - low) / (high - low)
            deviation.carriage_compliance[:, a, _ALONG] += c * 4.0 * share * (1.0 - share)
        elif self.variant == "ball_nut":
            own_kg = self.site.machine.moving_mass_kg
            deviation.carriage_compliance[:, a, _ALONG] += c * np.cbrt(own_kg / (own_kg + state.payload_kg))
        elif self.variant == "rail_between_bolts":
            span = (state.q_m[:, a] - self.first_m) / BOLTS_M % 1.0
            between = 16.0 * (span * (1.0 - span)) ** 2
            deviation.carriage_compliance[:, a, _ACROSS] += c * (AT_BOLTS + (1.0 - AT_BOLTS) * between)
        elif self.variant in ("resin_bed", "warm_resin", "swaying_frame", "floating_carriage", "opening_joint"):
            shares = {
                "swaying_frame": self._swayed,
                "floating_carriage": self._floated,
                "opening_joint": self._opened,
            }
            share = shares.get(self.variant, self._resin)(state)
            deviation.carriage_compliance[:, a, _ACROSS] += c * share
        elif self.variant == "rocking_foot":
            strut = next(s for s in self.site.machine.struts if s.drive == a)
            foot_m = FOOT_M - strut.base_joint.imag  # by the drive's coordinate
            deviation.carriage_compliance[:, a, _ACROSS] += c * ((state.q_m[:, a] - foot_m) / (middle - foot_m)) ** 2
            deviation.carriage_compliance[:, a, _YAW] += c / (middle - foot_m) ** 2
        elif self.variant == "portal":
            share = 0.5 + 0.5 * (state.q_m[:, a] - middle) / (half + PORTAL_M)
            deviation.carriage_compliance[:, a, _ACROSS] += c * (4.0 * share * (1.0 - share)) ** 3
        elif self.variant == "screw_length":  # a screw that is held above: soft where the nut is low
            deviation.carriage_compliance[:, a, _ALONG] += c * (2.0 - height)
        else:
            deviation.carriage_compliance[:, a, _ACROSS] += c

    def _swayed(self, state: MotionState) -> Array:
        """Compliance of the frame (n,) over the size, by the height of the next carriage."""
        other = (self.place + 1) % len(self.site.machine.sliders)
        strut = next(s for s in self.site.machine.struts if s.drive == other)
        middle, _ = self.site.drive_range_m(other)
        foot_m = FOOT_M - strut.base_joint.imag
        return np.asarray(((state.q_m[:, other] - foot_m) / (middle - foot_m)) ** 3)

    def _floated(self, state: MotionState) -> Array:
        """Compliance of the film (n,) over the size, with what gives way without it."""
        film = np.sqrt(np.maximum(state.speed_m_per_s[:, self.place], 0.0) / FLOATS_M_PER_S)
        left = film / np.sqrt(1.0 + state.since_s[:, self.place] / self.film_s)
        return np.asarray(PRESSED + (1.0 - PRESSED) * left)

    def _opened(self, state: MotionState) -> Array:
        """Compliance of a joint (n,) over the size, by the payload beyond that which opens it."""
        beyond = np.maximum(state.payload_kg - self.opens_kg, 0.0) / EXCESS_KG
        return np.asarray(CLOSED + (1.0 - CLOSED) * beyond)

    def _resin(self, state: MotionState) -> Array:
        """Compliance of the resin under the rail (n,) over the size."""
        if self.variant == "warm_resin":
            warmer_k = _above_reference_k(self.site, state, "drives")
            return np.asarray(10.0 ** (CHAINS * warmer_k / (CHAINS_K + warmer_k)))
        crept = 1.0 - np.exp(-state.since_s[:, self.place] / self.creeps_s)
        return np.asarray(AT_ONCE + (1.0 - AT_ONCE) * crept)


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

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Count the motions of the strut's own drive."""
        if self.variant == "loosening" and drive == self.site.machine.struts[self.place].drive:
            self._swings.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Change the strut's stiffness or its law."""
        i, x = self.place, self.size
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
        elif self.variant in ("creeping_bond", "warm_adhesive", "seated_taper", "fractional_rubber", "needles_in_turn"):
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
        if self.variant == "creeping_bond":
            return np.asarray(1.0 - (1.0 - BOND) * np.exp(-state.since_s[:, drive] / self.creeps_s))
        if self.variant == "fractional_rubber":
            return np.asarray((state.since_s[:, drive] / RUBBER_S) ** self.rubber)
        if self.variant == "warm_adhesive":
            beyond = (_above_reference_k(self.site, state, "struts") - self.soft_at_k) / SOFTENS_K
            return np.asarray(0.5 * (1.0 + np.tanh(beyond)))
        loose = np.exp(-((state.speed_m_per_s[:, drive] / SEATS_M_PER_S) ** 2))
        return np.where(state.direction[:, drive] > 0.0, loose, 1.0)


def _above_reference_k(site: Site, state: MotionState, part: str) -> Array:
    """Temperature (n,) that a part's sensor shows above the machine's reference."""
    return state.parts_c[site.machine.expansion[part].sensor] - site.machine.reference_temperature_c


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
        ),
        final="opening_joint",
        reveals="payload, SMRs on the sliders, height; by variant dwell, speed, temperature, the other drive's "
        "coordinate",
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
        ),
        final="needles_in_turn",
        reveals="payload, pose; by variant dwell, direction, speed, the number of motions, temperature",
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
        ),
        final="turning_bush",
        reveals="poses where the strut's force changes its sign, payload; by variant dwell, direction, distance moved, "
        "temperature",
        make=JointClearance,
    ),
)
