"""Joints of struts with play: force laws that leave a gap, and pins that move in their holes."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, Leg, MotionState
from mock_devices.effects.leg_memory import LegMemory, ways_m
from mock_devices.effects.strut_laws import (
    CONTACT_M,
    ball_bearing,
    contact_force,
    dead_zone,
    one_sided,
    spring_seated,
)
from mock_devices.effects.strut_ways import swing_rad, way_of_strut

FULL_PAYLOAD_KG = 400.0
UNWORN, WORN_RAD = 0.2, 0.15  # play of a worn hole far from where it is worn, over that there; how wide it is worn
OIL_S = (12.0, 30.0)  # time constant of a pin that sinks through its oil
SEATS_KG = 300.0  # payload whose weight seats a pin against its friction
NEW, WEARS_M = 0.1, 80.0  # play of a new joint over the size; way of its drive after which it has the size
SHRINKS_PER_K = 0.4  # of a bush's play
LOBES = (15, 30)  # of a hole, in a turn
BUSH_M = (30.0, 60.0)  # way of its drive in which an oval bush creeps once round
TAKES_UP_M = (10.0, 25.0)  # way of its drive after which a ratchet takes play up
CARRIES_M_PER_S, FILM_S = 0.15, (5.0, 15.0)  # of a film: speed that closes half of a play; time in which it goes
FITS, FITTED = (0.05, 1.0), 64  # play of a pin that was fitted anew over the size; fits that are drawn
BEATS_M_PER_S, UNBEATEN = (0.25, 0.5), 0.1  # of a hole: speed of a stop that beats it widest; play after a slow one
SPRING_N = (200.0, 1500.0)  # of the spring that seats a joint


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
    `worn_hole`: the pin has worn its hole most where the strut's force has mostly pressed it, in the middle of the
    travel, so that the play depends on the strut's angle: S. Mukras, N. H. Kim, N. A. Mauntler, T. L. Schmitz, W. G.
    Sawyer, "Analysis of Planar Multibody Systems With Revolute Joint Wear" (2010).
    `friction_held`: friction holds the pin on the side to which the last motion has pushed it, as long as it is
    stronger than weight, which seats it on one side: pins at a wall of their clearance in R. S. Haines, "Survey:
    2-Dimensional Motion and Impact at Revolute Joints" (1980).
    `wearing_pin`: pin and hole were close, and every swing wears them, so that the play grows with the way of the
    strut's drive: P. Flores, "Modeling and Simulation of Wear in Revolute Clearance Joints in Multibody Systems"
    (2009). The size is reached after WEARS_M.
    `shrinking_bush`: a bush of plastic, held outside by metal, can grow inwards only, so that its play closes as the
    strut grows warmer and is gone for good above some temperature: plastics in J. A. Williams, "Engineering Tribology"
    (1994). The size is the play at the reference temperature.
    `lobed_hole`: the tool chattered, and the hole has lobes, so that the play along the strut goes up and down as that
    turns, several times in its swing: roundness in D. J. Whitehouse, "Handbook of Surface Metrology" (1994). The size
    is the play in a lobe; between two of them there is none.
    `turning_bush`: an oval bush creeps round in its seat with every metre that its drive runs, and the play along the
    strut comes and goes twice a turn: J. Halling, "Principles of Tribology" (1975). The size is the widest play.
    `ratcheted_bush`: the bush wears with every metre that its drive runs until a ratchet takes the play up, all at
    once, and it begins anew: ratchets in F. Reuleaux, "The Kinematics of Machinery" (1876). The size is the play at
    which it is taken up.
    `carried_by_film`: a motion carries oil into the gap, and its pin runs the nearer the middle the faster it was, so
    that little play is left; at rest the film goes and the play comes back: A. Sommerfeld, "Zur hydrodynamischen
    Theorie der Schmiermittelreibung" (1904). The size is the play without a film.
    `fitted_anew`: its pin is taken out and fitted anew at every exchange of the payload, with another play each time:
    W. A. Shewhart, "Economic Control of Quality of Manufactured Product" (1931). The size is the widest play.
    `beaten_wide`: a stop of its drive beats the hole wide, by the square of its speed, and the next one sets it anew:
    J. Hopkinson, "On the Rupture of Iron Wire by a Blow" (1872). The size is the widest play.
    """

    def setup(self) -> None:
        """The spring of variant `spring_seated`, to which side it gives way, and how fast a pin sinks."""
        self.spring_n = float(self.rng.uniform(*SPRING_N)) * float(self.rng.choice([-1.0, 1.0]))
        self.sinks_s = float(self.rng.uniform(*OIL_S))
        self.lobes = int(self.rng.integers(LOBES[0], LOBES[1] + 1))
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self._ways = LegMemory(ways_m)
        self.bush_m = float(self.rng.uniform(*BUSH_M))
        self.takes_up_m = float(self.rng.uniform(*TAKES_UP_M))
        self.worn = float(self.rng.uniform(0.0, 1.0))
        self.film_s = float(self.rng.uniform(*FILM_S))
        self.fits = self.rng.uniform(*FITS, FITTED)
        self.beats_m_per_s = float(self.rng.uniform(*BEATS_M_PER_S))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the motions of the strut's own drive wear its joints or turn their bush."""
        own = drive == self.site.machine.struts[self.place].drive
        if own and self.variant in ("wearing_pin", "turning_bush", "ratcheted_bush"):
            self._ways.record(leg)

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
        if self.variant == "friction_held":
            pushed = state.direction[:, self.site.machine.struts[i].drive]
            seated = np.minimum(state.payload_kg / SEATS_KG, 1.0) * np.abs(pushed)
            deviation.length_m[:, i] += c * (pushed + (1.0 - pushed) * seated)
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
        else:
            law = dead_zone(c * self._share(state), 0.1 * c)
        if c > 0.0:
            deviation.laws.setdefault(i, []).append(law)

    def _share(self, state: MotionState) -> Array | float:
        """Play of a plain dead zone (n,) over the size."""
        i = self.place
        if self.variant == "worn_hole":
            worn = np.exp(-((swing_rad(self.site.machine, i, state.q_m) / WORN_RAD) ** 2))
            return np.asarray(UNWORN + (1.0 - UNWORN) * worn)
        if self.variant in ("wearing_pin", "ratcheted_bush"):
            way_m = self._ways.at(state, self.site.machine.struts[i].drive)[:, 0]
            worn = (way_m / self.takes_up_m + self.worn) % 1.0
            return np.asarray(NEW + (1.0 - NEW) * way_m / WEARS_M if self.variant == "wearing_pin" else worn)
        if self.variant in ("lobed_hole", "turning_bush"):
            turn = self.lobes * swing_rad(self.site.machine, i, state.q_m)
            if self.variant == "turning_bush":
                turn = 4.0 * np.pi * self._ways.at(state, self.site.machine.struts[i].drive)[:, 0] / self.bush_m
            return np.asarray(0.5 * (1.0 + np.cos(turn + self.phase)))
        if self.variant == "shrinking_bush":
            machine = self.site.machine
            above_k = state.parts_c[machine.expansion["struts"].sensor] - machine.reference_temperature_c
            return np.maximum(1.0 - SHRINKS_PER_K * above_k, 0.0)
        return self._left(state)

    def _left(self, state: MotionState) -> Array | float:
        """Play that a load, a film, a fit or a blow leaves (n,) over the size."""
        if self.variant == "load_dependent":
            return np.asarray(np.exp(-state.payload_kg / FULL_PAYLOAD_KG))
        if self.variant == "fitted_anew":
            return self.fits[state.exchanges.astype(int) % FITTED]
        if self.variant == "beaten_wide":
            speed = state.speed_m_per_s[:, self.site.machine.struts[self.place].drive]
            beaten = np.minimum((speed / self.beats_m_per_s) ** 2, 1.0)
            return np.asarray(UNBEATEN + (1.0 - UNBEATEN) * beaten)
        if self.variant == "carried_by_film":
            drive = self.site.machine.struts[self.place].drive
            speed = state.speed_m_per_s[:, drive] / CARRIES_M_PER_S
            return np.asarray(1.0 - speed / (1.0 + speed) * np.exp(-state.since_s[:, drive] / self.film_s))
        return 1.0


def _sunk(rested: Array) -> Array:
    """Eccentricity e over the clearance (n,): e / (1 - e^2)^(3/2) is the time of rest over the time constant."""
    s = 2.0 / np.sqrt(3.0) * np.sinh(np.arcsinh(1.5 * np.sqrt(3.0) * rested) / 3.0)  # solves s + s^3 = rested
    return np.asarray(s / np.sqrt(1.0 + s**2))
