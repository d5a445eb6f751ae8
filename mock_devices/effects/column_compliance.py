"""Columns and carriages that give way to the struts' force."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, MotionState
from mock_devices.effects.reversal import above_reference_k

LEVER_M = 0.25
PORTAL_M = 0.3
BOLTS_M, AT_BOLTS = 0.24, 0.2  # spacing on a rail; its compliance at a bolt over that midway between two
AT_ONCE, BED_S = 0.4, (6.0, 20.0)  # of a rail on resin: share of its compliance at once; time constant of the rest
FOOT_M = -1.2
PRESSED, FLOATS_M_PER_S, FILM_S = 0.25, 0.5, (4.0, 12.0)  # of a carriage on oil: compliance without a film over the
# size; speed of a stop that gives the size; time in which the film is pressed out to 1 / sqrt(2)
CLOSED, OPENS_KG = 0.15, (60.0, 180.0)  # of a joint: compliance while closed, over the size; what opens it
EXCESS_KG = 250.0  # payload beyond that which opens a joint, for the size
GRIPS_S, GRIPPED = (3.0, 10.0), 0.2  # of a clamp: rest after which it grips; compliance from then on, over the size
SINKS_M_PER_S, RECOVERS_S, PRESSURE = 0.3, (6.0, 20.0), 0.15  # of oil for both carriages: stop of the next one for the
# size; time constant; compliance at full pressure over the size
BALLS_M, MORE = (0.03, 0.06), 0.3  # of balls under load: travel from one to the next; compliance with one more of them
TENSE, SINKS_IN = 0.15, (1.5, 5.0)  # of bolts: compliance while they are tense, over the size; exchanges of payload
# that leave 1 / e of their tension
CHAINS, CHAINS_K = 8.86, 101.6  # of a resin fifty kelvin above its glass transition
BY_STATE = (
    "resin_bed", "warm_resin", "swaying_frame", "floating_carriage", "opening_joint", "clamped_at_rest",
    "balls_in_turn", "shared_pressure", "embedding_bolts",
)  # fmt: skip
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
    `clamped_at_rest`: some seconds after each stop a clamp draws the carriage onto its rail, and joints that are
    pressed are stiffer from then on, at once: F. Koenigsberger, J. Tlusty, "Machine Tool Structures" (1970). The size
    is that without the clamp.
    `balls_in_turn`: as the carriage goes on, balls come under its load and leave it, so that one more of them carries
    in one half of the way from ball to ball than in the other: C. S. Sunnersjö, "Varying Compliance Vibrations of
    Rolling Bearings" (1978). The size is that with fewer of them.
    `shared_pressure`: one pump feeds the oil under both carriages, and a motion of the next drive takes from its
    pressure by the speed, so that this carriage gives way further until the pressure has recovered: E. Lewis, H. Stern,
    "Design of Hydraulic Control Systems" (1962). The size is that when the next drive stops from SINKS_M_PER_S.
    `embedding_bolts`: every exchange of the payload lets the bolts of the carriage sink into what they press by a share
    of their tension, and the joint gives way further: A. Thum, F. Debus, "Vorspannung und Dauerhaltbarkeit von
    Schraubenverbindungen" (1936). The size is that without tension.
    """

    def setup(self) -> None:
        """Where the bolts are, and how fast resin creeps and oil is pressed out."""
        self.first_m = float(self.rng.uniform(0.0, BOLTS_M))
        self.creeps_s = float(self.rng.uniform(*BED_S))
        self.film_s = float(self.rng.uniform(*FILM_S))
        self.opens_kg = float(self.rng.uniform(*OPENS_KG))
        self.grips_s = float(self.rng.uniform(*GRIPS_S))
        self.balls_m = float(self.rng.uniform(*BALLS_M))
        self.balls_at = float(self.rng.uniform(0.0, 1.0))
        self.recovers_s = float(self.rng.uniform(*RECOVERS_S))
        self.sinks_in = float(self.rng.uniform(*SINKS_IN))

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
        elif self.variant in BY_STATE:
            shares = {
                "clamped_at_rest": self._clamped,
                "balls_in_turn": self._carried,
                "shared_pressure": self._unpressed,
                "swaying_frame": self._swayed,
                "floating_carriage": self._floated,
                "opening_joint": self._opened,
                "embedding_bolts": self._embedded,
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

    def _clamped(self, state: MotionState) -> Array:
        """Compliance of a carriage (n,) over the size, by whether its clamp has gripped."""
        return np.where(state.since_s[:, self.place] >= self.grips_s, GRIPPED, 1.0)

    def _carried(self, state: MotionState) -> Array:
        """Compliance of the balls under load (n,) over the size, by where the carriage stands."""
        at = (state.q_m[:, self.place] / self.balls_m + self.balls_at) % 1.0
        return np.where(at < 0.5, 1.0, MORE)

    def _unpressed(self, state: MotionState) -> Array:
        """Compliance of a carriage on oil (n,) over the size, by what the next drive's last motion took."""
        b = (self.place + 1) % len(self.site.machine.sliders)
        taken = state.speed_m_per_s[:, b] / SINKS_M_PER_S * np.exp(-state.since_s[:, b] / self.recovers_s)
        return np.asarray(PRESSURE + (1.0 - PRESSURE) * taken)

    def _opened(self, state: MotionState) -> Array:
        """Compliance of a joint (n,) over the size, by the payload beyond that which opens it."""
        beyond = np.maximum(state.payload_kg - self.opens_kg, 0.0) / EXCESS_KG
        return np.asarray(CLOSED + (1.0 - CLOSED) * beyond)

    def _embedded(self, state: MotionState) -> Array:
        """Compliance of a joint (n,) over the size, by the tension that exchanges of payload have left its bolts."""
        return np.asarray(1.0 - (1.0 - TENSE) * np.exp(-state.exchanges / self.sinks_in))

    def _resin(self, state: MotionState) -> Array:
        """Compliance of the resin under the rail (n,) over the size."""
        if self.variant == "warm_resin":
            warmer_k = above_reference_k(self.site, state)
            return np.asarray(10.0 ** (CHAINS * warmer_k / (CHAINS_K + warmer_k)))
        crept = 1.0 - np.exp(-state.since_s[:, self.place] / self.creeps_s)
        return np.asarray(AT_ONCE + (1.0 - AT_ONCE) * crept)
