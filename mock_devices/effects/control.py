"""What couples axes."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.followers import Dragged, PlaceMemory
from mock_devices.effects.latency import Latency
from mock_devices.effects.leg_memory import LegMemory, ways_m
from mock_devices.effects.strut_ways import beside_m

REFERENCE_SPEED_M_PER_S = 0.5
BED_PER_M = 3.0
COUPLED_S = 6.0  # in which a following error dies out
RESOLVER_M = 0.02  # travel of a slider in one turn of its resolver
DRAG_M = 0.12  # half of the play with which another axis drags a chain along
GIVES, SILK_S = 0.5, (5.0, 20.0)  # of a thread: what it gives way by in long rest of the other axis; time constant
TAUT = (-0.4, 0.2)  # of half the other axis's travel, from its middle: where a rope is taut
LEADS_M = (0.01, 0.016, 0.02, 0.025)  # of the other axis's screw
OIL_K, ABSOLUTE_K = 10000.0, 273.15  # of an oil: viscosity is exp(OIL_K / T) at the absolute temperature T
POLES_M = (0.08, 0.2)  # how far beside each other the magnets of both axes run
DASHPOT_S = (20.0, 80.0)  # time constant in which a dashpot lets go
LEAKS_S = (60.0, 300.0)  # time constant in which oil leaks away from under an axis
WRAPS = 0.5  # friction of a rope on its pulleys times the angle round which it lies


class AxisCoupling(Effect):
    """Where the other axis stands moves this one: a cross beam, a shared reading head, a cable chain.

    `shared_beam`: both axes ride on one simply supported beam; the weight of the other bends it under this one, as in
    R. J. Roark, "Formulas for Stress and Strain" (1938).
    `elastic_bed`: both stand on one bed on soft ground, which dips under the other axis and rises a little further off,
    as a long beam under one force in M. Hetényi, "Beams on Elastic Foundation" (1946).
    `cross_coupled`: a controller that gives a part of one axis's following error to the other, for the contour's sake:
    Y. Koren, "Cross-Coupled Biaxial Computer Control for Manufacturing Systems" (1980). It dies out at rest.
    `crosstalk`: signals of the other axis couple into the cable of this one's resolver, as in H. W. Ott, "Noise
    Reduction Techniques in Electronic Systems" (1976). They add a small signal of the other phase to the axis's own, so
    that the error goes with the sine of the difference in phase.
    `dragged_chain`: a chain that hangs on this axis follows the other one, but only once its own play is used up, so
    that the error has a loop over the other's place: the play of M. A. Krasnosel'skii, A. V. Pokrovskii, "Systems with
    Hysteresis" (1989).
    `turn_of_other`: the other axis's screw runs out of true and pushes the beam that both hang on once a turn: runout
    of screws in A. H. Slocum, "Precision Machine Design" (1992).
    `loaded_bridge`: both axes hang on one bridge, which gives way the further the other one goes out on it and the more
    the platform carries: W. J. M. Rankine, "A Manual of Applied Mechanics" (1858). The ratio is that without payload.
    `shared_rope`: a rope over pulleys ties both axes, and friction on the pulleys makes its pull larger or smaller by
    which way the other one went last, by an exponential of the angle round which the rope lies: L. Euler, "Remarques
    sur l'effet du frottement dans l'équilibre" (1762). The ratio is that without friction.
    `oily_link`: a link full of viscous oil ties both axes and passes the more on the stiffer that is, by the
    exponential of E. N. da C. Andrade, "The Viscosity of Liquids" (1930), at the temperature of the drives. The ratio
    is that at the reference temperature.
    `silk_after_effect`: a thread ties both axes, gives way under each pull while the other one rests, and is tight
    again with its next motion: W. Weber, "Ueber die Elasticität der Seidenfäden" (1835). The ratio is that of a thread
    that has not given way yet.
    `taut_rope`: a rope ties both axes and is slack until the other one has gone far enough; from there on it pulls, in
    proportion to how much farther that goes: S. Stevin, "De Beghinselen der Weeghconst" (1586). There it passes on
    twice the ratio.
    `drawn_together`: a magnet on each axis draws the other one by the inverse square of the distance, and along the
    axis most at one distance and not at all abreast: C. A. Coulomb, "Premier mémoire sur l'électricité et le
    magnétisme" (1785). A quarter of the ratio in metres is the largest displacement.
    `relaxing_dashpot`: a spring and a dashpot in a row tie both axes, so that each motion of the other one pulls at
    this one, and its rest lets go until nothing is left, wherever it stands: J. C. Maxwell, "On the Dynamical Theory of
    Gases" (1867).
    `pumped_jack`: every way of the other one, up or down, pumps oil under this one and lifts it, and the oil leaks away
    in time: B. Pascal, "Traités de l'équilibre des liqueurs" (1663). The ratio is that before any has leaked.
    """

    def setup(self) -> None:
        """Phase between both axes' signals, and where the chain is."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.other = (self.place + 1) % len(self.site.machine.sliders)
        self.lead_m = float(self.rng.choice(LEADS_M))
        self.silk_s = float(self.rng.uniform(*SILK_S))
        self.taut_m = self.site.drive_range_m(self.other)[1] * float(self.rng.uniform(*TAUT))
        self.poles_m = float(self.rng.uniform(*POLES_M))
        self.dashpot_s = float(self.rng.uniform(*DASHPOT_S))
        self._middle_m = self.site.drive_range_m(self.other)[0]
        self._piston = PlaceMemory(lambda q_m: q_m - self._middle_m, self.dashpot_s)
        self.leaks_s = float(self.rng.uniform(*LEAKS_S))
        self._pumped = LegMemory(ways_m, self.leaks_s)
        self._chain = Dragged(DRAG_M, self.site.drive_range_m(self.other)[0])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the other axis drag the chain or the piston, or pump."""
        if self.variant == "pumped_jack" and drive == self.other:
            self._pumped.record(leg)
        if self.variant == "relaxing_dashpot" and drive == self.other:
            self._piston.record(leg)
        if self.variant == "dragged_chain" and drive == self.other:
            self._chain.record(leg)

    def _passes(self, state: MotionState) -> Array:
        """What a bridge, a link, a thread or a rope passes on (n,), over the ratio."""
        machine = self.site.machine
        if self.variant == "oily_link":
            now_k = ABSOLUTE_K + state.parts_c[machine.expansion["drives"].sensor]
            return np.asarray(np.exp(OIL_K / now_k - OIL_K / (ABSOLUTE_K + machine.reference_temperature_c)))
        if self.variant == "silk_after_effect":
            return np.asarray(1.0 + GIVES * np.expm1(-state.since_s[:, self.other] / self.silk_s))
        if self.variant == "shared_rope":
            return np.asarray(np.exp(WRAPS * state.direction[:, self.other]))
        return np.asarray(1.0 + state.payload_kg / machine.moving_mass_kg)

    def _drawn(self, state: MotionState) -> Array:
        """How far the magnets of both axes draw this one towards the other (n,), over the ratio."""
        apart = beside_m(self.site, state, self.place) / self.poles_m
        return np.asarray(0.25 * 1.5 * math.sqrt(3.0) * apart / (1.0 + apart**2) ** 1.5)

    def _moved_by(self, state: MotionState, x: Array) -> Array:
        """What the other axis's motions have dragged, pulled or pumped (n,), over the ratio; x is where it stands."""
        b = self.other
        if self.variant == "pumped_jack":
            return np.asarray(self._pumped.at(state, b)[:, 0])
        dashpot = self.variant == "relaxing_dashpot"
        return np.asarray(x - self._piston.at(state, b) if dashpot else self._chain.at(state, b) - self._middle_m)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider; one metre of the other axis gives `ratio`."""
        a, b = self.place, self.other
        (mine, my_half), (middle, half) = self.site.drive_range_m(a), self.site.drive_range_m(b)
        x = state.q_m[:, b] - middle
        if self.variant == "quadratic":
            y = 2.0 * x * np.abs(x) / half
        elif self.variant == "saturating":
            y = 0.25 * np.tanh(x / 0.12)
        elif self.variant in ("by_approach", "cross_coupled"):  # the other axis pushes while it comes: this one sticks
            behind = state.direction[:, b] * state.speed_m_per_s[:, b] / REFERENCE_SPEED_M_PER_S
            forgets_s = COUPLED_S if self.variant == "cross_coupled" else np.inf
            y = 0.25 * behind * np.exp(-state.since_s[:, b] / forgets_s)
        elif self.variant == "crosstalk":
            y = 0.25 * np.sin(2.0 * np.pi * (state.q_m[:, b] - state.q_m[:, a]) / RESOLVER_M + self.phase)
        elif self.variant == "turn_of_other":
            y = 0.25 * np.sin(2.0 * np.pi * state.q_m[:, b] / self.lead_m + self.phase)
        elif self.variant in ("loaded_bridge", "oily_link", "shared_rope", "silk_after_effect"):
            y = x * self._passes(state)
        elif self.variant in ("taut_rope", "drawn_together"):
            y = 2.0 * np.maximum(x - self.taut_m, 0.0) if self.variant == "taut_rope" else self._drawn(state)
        elif self.variant in ("relaxing_dashpot", "dragged_chain", "pumped_jack"):
            y = self._moved_by(state, x)
        elif self.variant == "elastic_bed":
            away = BED_PER_M * np.abs(state.q_m[:, a] - mine - x)
            y = -0.25 * np.exp(-away) * (np.cos(away) + np.sin(away))
        elif self.variant == "shared_beam":
            y = -0.5 * _beam_bends((state.q_m[:, a] - mine) / my_half, x / half)
        elif self.variant == "product":
            y = x * (state.q_m[:, a] - mine) / my_half * 2.0
        else:
            y = x
        deviation.travel_m[:, a] += self.size * y


def _beam_bends(at: Array, load: Array) -> Array:
    """Deflection (n,) of a simply supported beam at `at` under one force at `load`, both from -1 to 1 within the middle
    nine tenths of the beam; 1 is that of a force in the middle, under it."""
    x, a = 0.5 + 0.45 * np.clip(at, -1.0, 1.0), 0.5 + 0.45 * np.clip(load, -1.0, 1.0)
    near, far = np.minimum(x, a), np.maximum(x, a)
    return np.asarray(8.0 * near * (1.0 - far) * (1.0 - near**2 - (1.0 - far) ** 2))


EFFECTS = (
    EffectSpec(
        name="axis_coupling",
        kind="catalogue",
        place="drive",
        size=EffectParameter("ratio", 1e-6, 3e-5, 2e-3, "metres a metre of the other axis"),
        variants=(
            "linear",
            "quadratic",
            "saturating",
            "by_approach",
            "product",
            "shared_beam",
            "elastic_bed",
            "cross_coupled",
            "crosstalk",
            "dragged_chain",
            "turn_of_other",
            "loaded_bridge",
            "shared_rope",
            "oily_link",
            "silk_after_effect",
            "taut_rope",
            "drawn_together",
            "relaxing_dashpot",
            "pumped_jack",
        ),
        final="pumped_jack",
        reveals="the other drive's coordinate or motion, by variant payload, direction, dwell, way, temperature, SMRs "
        "on the sliders",
        make=AxisCoupling,
    ),
    EffectSpec(
        name="latency",
        kind="catalogue",
        place="rig",
        size=EffectParameter("latency_s", 1e-5, 5e-4, 5.0, "dead time or time constant"),
        variants=(
            "dead_time",
            "filtering",
            "with_speed",
            "bus_cycles",
            "clock_skew",
            "queued",
            "clock_ageing",
            "restarted",
            "steered_clock",
            "beating_cycles",
            "adaptive_filter",
            "group_delay",
            "crowded_bus",
            "warm_quartz",
            "hot_processor",
            "burst_noise",
            "scheduled_window",
        ),
        final="scheduled_window",
        reveals="readings on the fly at several speeds, or short dwell, by variant time, also by chance, payload "
        "and a temperature swing",
        make=Latency,
    ),
)
