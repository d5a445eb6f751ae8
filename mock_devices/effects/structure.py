"""Elastic effects, which act inside the equilibrium: columns, struts, clearance."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Complex,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
)
from mock_devices.effects.leg_memory import LegMemory, motions
from mock_devices.effects.strut_laws import (
    CONTACT_M,
    ball_bearing,
    contact_force,
    dead_zone,
    hertz_contact,
    joint_separates,
    one_sided,
    soft_in_compression,
    spring_seated,
    yielding,
)
from mock_devices.machine_file import MachineFile

LEVER_M = 0.25
PORTAL_M = 0.3
LOOSE_N = (1000.0, 6000.0)  # preload of a joint that separates
BOLTS_M, AT_BOLTS = 0.24, 0.2  # spacing on a rail; its compliance at a bolt over that midway between two
LOOSENS = 200.0  # motions after which a bolt has lost 1 - 1 / e of its hold
OIL_S = (12.0, 30.0)  # time constant of a pin that sinks through its oil
SPRING_N = (200.0, 1500.0)  # of the spring that seats a joint
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
    """

    def setup(self) -> None:
        """Where the bolts are."""
        self.first_m = float(self.rng.uniform(0.0, BOLTS_M))

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
        elif self.variant == "portal":
            share = 0.5 + 0.5 * (state.q_m[:, a] - middle) / (half + PORTAL_M)
            deviation.carriage_compliance[:, a, _ACROSS] += c * (4.0 * share * (1.0 - share)) ** 3
        elif self.variant == "screw_length":  # a screw that is held above: soft where the nut is low
            deviation.carriage_compliance[:, a, _ALONG] += c * (2.0 - height)
        else:
            deviation.carriage_compliance[:, a, _ACROSS] += c


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
    """

    def setup(self) -> None:
        """How little the joint of variant `joint_separates` is preloaded."""
        self.preload_n = float(self.rng.uniform(*LOOSE_N))
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
        elif self.variant == "fork_bearing":
            deviation.ln_stiffness[:, i] -= np.log1p(np.expm1(x) * np.sin(self._swing_rad(state)) ** 2)
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

    def _swing_rad(self, state: MotionState) -> Array:
        """The strut's angle (n,) from that in the middle of all travels, where the nominal struts meet."""
        middle_m = np.array([[self.site.drive_range_m(a)[0] for a in range(state.q_m.shape[1])]])
        now, then = (way_of_strut(self.site.machine, self.place, q_m) for q_m in (state.q_m, middle_m))
        return np.angle(now * then.conjugate())


def way_of_strut(machine: MachineFile, place: int, q_m: Array) -> Complex:
    """From a strut's joint on the slider to that on the platform (n,), if the platform does not turn."""
    mine = machine.struts[place]
    other = next(strut for strut in machine.struts if strut.drive != mine.drive)
    here, there = (
        strut.base_joint - strut.platform_joint + machine.sliders[strut.drive].axis * q_m[:, strut.drive]
        for strut in (mine, other)
    )
    apart = np.abs(there - here)
    along = (apart**2 + mine.length_m**2 - other.length_m**2) / (2.0 * apart)
    across = 1j * np.sqrt(np.maximum(mine.length_m**2 - along**2, 0.0))
    slider = machine.sliders[mine.drive]
    one, two = (np.asarray((along + side * across) * (there - here) / apart) for side in (1.0, -1.0))
    above = slider.branch * ((one - two) * slider.axis.conjugate()).real > 0.0  # branch 1: it hangs below
    return np.where(above, two, one)


class JointClearance(Effect):
    """The joints of a strut have play: `clearance_m` each way before any force arises.

    `contact_force`: then it grows with the power 3/2 of the penetration, as in H. M. Lankarani, P. E. Nikravesh, "A
    Contact Force Model With Hysteresis Damping for Impact Analysis of Multibody Systems" (1990), until the contact is
    as stiff as the strut. `ball_bearing`: the joint is a rolling bearing, whose balls share the force by how far each
    is pressed, the more of them the larger it is: R. Stribeck, "Kugellager für beliebige Belastungen" (1901).
    `spring_seated`: a spring presses the joint into its seat, and no play is felt until a force overcomes the spring,
    to one side only: preload in A. H. Slocum, "Precision Machine Design" (1992).
    `oil_journal`: motion centres the bore on its pin in oil; at rest the strut sinks through the oil by its weight, so
    that it reaches further down the steeper it stands and the more time it has rested: a squeezed film without rotation
    in J. F. Booker, "Squeeze Films and Bearing Dynamics", CRC Handbook of Lubrication (1983), here that of a short
    bearing.
    """

    def setup(self) -> None:
        """The spring of variant `spring_seated`, to which side it gives way, and how fast a pin sinks."""
        self.spring_n = float(self.rng.uniform(*SPRING_N)) * float(self.rng.choice([-1.0, 1.0]))
        self.sinks_s = float(self.rng.uniform(*OIL_S))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Put a dead zone into the strut's law, or seat the pin."""
        i, c = self.place, self.size
        if self.variant == "gravity_seated":  # the pin lies on one side of its hole: a length that goes with the angle
            strut = self.site.machine.struts[i]
            drop = state.q_m[:, strut.drive] - self.site.drive_range_m(strut.drive)[0]
            deviation.length_m[:, i] += c * np.sin(4.0 * drop / strut.length_m)
            return
        if self.variant == "oil_journal":
            machine = self.site.machine
            down = machine.gravity / abs(machine.gravity) if machine.gravity else -1j
            steep = (way_of_strut(machine, i, state.q_m) * down.conjugate()).real / machine.struts[i].length_m
            rested_s = state.since_s[:, machine.struts[i].drive]
            deviation.length_m[:, i] += c * steep * _sunk(rested_s / self.sinks_s)
            return
        if self.variant == "soft_contact":
            law = dead_zone(c, 0.5 * c)
        elif self.variant == "one_sided":
            law = one_sided(c, 0.1 * c)
        elif self.variant == "contact_force":
            law = contact_force(c, CONTACT_M)
        elif self.variant == "spring_seated":
            law = spring_seated(c, 0.1 * c, self.spring_n)
        elif self.variant == "ball_bearing":
            law = ball_bearing(c, CONTACT_M)
        elif self.variant == "load_dependent":
            law = dead_zone(c * np.exp(-state.payload_kg / FULL_PAYLOAD_KG), 0.1 * c)
        else:
            law = dead_zone(c, 0.1 * c)
        if c > 0.0:
            deviation.laws.setdefault(i, []).append(law)


def _sunk(rested: Array) -> Array:
    """Eccentricity e over the clearance (n,): e / (1 - e^2)^(3/2) is the time of rest over the time constant."""
    s = 2.0 / np.sqrt(3.0) * np.sinh(np.arcsinh(1.5 * np.sqrt(3.0) * rested) / 3.0)  # solves s + s^3 = rested
    return np.asarray(s / np.sqrt(1.0 + s**2))


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
        ),
        final="rail_between_bolts",
        reveals="payload, SMRs on the sliders, height",
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
        ),
        final="loosening",
        reveals="payload, pose; by variant the number of motions",
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
        ),
        final="oil_journal",
        reveals="poses where the strut's force changes its sign, payload; by variant dwell",
        make=JointClearance,
    ),
)
