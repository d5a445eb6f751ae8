"""What couples axes, and latency of the station."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.followers import Dragged
from mock_devices.effects.strut_ways import beside_m
from mock_devices.effects.warming import GRID_S, grid_from

REFERENCE_SPEED_M_PER_S = 0.5
BED_PER_M = 3.0
POLL_S = 1024.0
COUPLED_S = 6.0  # in which a following error dies out
OTHER_S, KEPT = 0.0731, 0.9  # cycle of another message; share of messages that are not given up
RESOLVER_M = 0.02  # travel of a slider in one turn of its resolver
HOUR_S = 3600.0
BY_CLOCK = (
    "clock_skew",
    "clock_ageing",
    "restarted",
    "steered_clock",
    "beating_cycles",
    "warm_quartz",
    "hot_processor",
)
BEST_K, QUARTZ_K = (-1.0, 1.0), 1.0  # of a quartz: its best temperature beyond that of the begin; off by so much it
# has the size
DRAG_M = 0.12  # half of the play with which another axis drags a chain along
RESTARTS = 32
STEERS_S, DAMPED = (900.0, 1800.0), 0.05  # of a clock's loop: period, damping
GIVES, SILK_S = 0.5, (5.0, 20.0)  # of a thread: what it gives way by in long rest of the other axis; time constant
TAUT = (-0.4, 0.2)  # of half the other axis's travel, from its middle: where a rope is taut
CROWDED_M_PER_S, FULL = (1.3, 2.0), 0.95  # of a bus: sum of all speeds that fills it; share that is not exceeded
BEATS_S = (150.0, 500.0)  # in which one cycle runs past another
LEADS_M = (0.01, 0.016, 0.02, 0.025)  # of the other axis's screw
OIL_K, ABSOLUTE_K = 10000.0, 273.15  # of an oil: viscosity is exp(OIL_K / T) at the absolute temperature T
RESONATES_M_PER_S, BROAD = (0.15, 0.4), 0.25  # speed at which a filter delays most; half width over that
POLES_M = (0.08, 0.2)  # how far beside each other the magnets of both axes run
WARM_K, WARMS_S, OF_AIR, HOT_K = 10.0, 1500.0, 6.0, (3.0, 8.0)  # of a processor: own warmth; time constant; warmth for
# each kelvin of the air; from which on it is hot
WRAPS = 0.5  # friction of a rope on its pulleys times the angle round which it lies
SHORTER, SWITCHES_M_PER_S = (0.15, 0.5), (0.15, 0.35)  # delay of a second filter, over the first one's; speed


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
    """

    def setup(self) -> None:
        """Phase between both axes' signals, and where the chain is."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.other = (self.place + 1) % len(self.site.machine.sliders)
        self.lead_m = float(self.rng.choice(LEADS_M))
        self.silk_s = float(self.rng.uniform(*SILK_S))
        self.taut_m = self.site.drive_range_m(self.other)[1] * float(self.rng.uniform(*TAUT))
        self.poles_m = float(self.rng.uniform(*POLES_M))
        self._chain = Dragged(DRAG_M, self.site.drive_range_m(self.other)[0])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the other axis drag the chain."""
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
        elif self.variant == "dragged_chain":
            y = self._chain.at(state, b) - middle
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


class Latency(Effect):
    """The station's reading is of a later moment than the drives': it shows while an axis moves.

    `filtering` is a first-order filter in the tracking instead of a dead time, which is still felt after a stop.
    `clock_skew`: two clocks that are set by messages every POLL_S and run apart in between, as in D. L. Mills,
    "Internet Time Synchronization: The Network Time Protocol" (1991): the size is how far just before they are set.
    `queued`: messages wait for others, by times that are spread as an exponential whose mean is the size, as in a queue
    of L. Kleinrock, "Queueing Systems" (1975); the latest tenth is given up and asked for anew.
    `clock_ageing`: the error of a clock that was set once and whose rate drifts grows with the square of time: D. W.
    Allan, "Time and Frequency (Time-Domain) Characterization, Estimation, and Prediction of Precision Clocks and
    Oscillators" (1987). The size is the error after one hour.
    `restarted`: cycles that nothing synchronises begin anew at every exchange of the payload, when the machine is
    switched off, each time in another phase: H. Kopetz, "Real-Time Systems: Design Principles for Distributed Embedded
    Applications" (1997). The size is that before the first exchange, and the mean of all.
    `steered_clock`: a loop steers the station's clock after the other one and swings about it after a step of the
    phase, as the loop of second order does that is damped too little in F. M. Gardner, "Phaselock Techniques" (1966).
    The size is the step, at the campaign's begin.
    `beating_cycles`: the station asks in a cycle of its own for what the drives give out in another one, of nearly the
    same length, so that a value is older and older until the cycles have run past one another: B. Wittenmark, J.
    Nilsson, M. Törngren, "Timing Problems in Real-Time Control Systems" (1995). The size is the mean.
    `adaptive_filter`: above a certain speed the station filters with a shorter window, which lags behind less: filters
    that adapt to what they see in B. Widrow, S. D. Stearns, "Adaptive Signal Processing" (1985). The size is the delay
    of the longer one.
    `group_delay`: a filter that is tuned to a vibration delays most what changes at one rate, here at one speed of the
    machine, and less above and below: E. A. Guillemin, "Communication Networks" (1935). The size is the longest delay.
    `crowded_bus`: every drive sends messages as fast as it moves, and what asks for the station waits behind all of
    them, with one over what is free of the bus: K. Tindell, A. Burns, A. J. Wellings, "Calculating Controller Area
    Network (CAN) Message Response Times" (1995). The size is the delay of a free bus.
    `warm_quartz`: the station's clock was set at the campaign's begin, and its quartz runs slow by the square of how
    far the air's temperature is from its best, so that its error adds up: W. G. Cady, "Piezoelectricity" (1946). The
    size is the error after one hour QUARTZ_K off.
    `hot_processor`: the processor between both warms by itself and with the air, and while it is too hot it runs at
    half its clock, so that everything takes twice as long: J. Gray, "Why Do Computers Stop and What Can Be Done
    About It?" (1985). The size is the delay of a cool one.
    """

    def setup(self) -> None:
        """Phases after every restart; how fast the loop of a clock swings."""
        self.restarts = np.concatenate([[1.0], self.rng.uniform(0.0, 2.0, RESTARTS - 1)])
        self.steers_s = float(self.rng.uniform(*STEERS_S))
        self.beats_s = float(self.rng.uniform(*BEATS_S))
        self.phase = float(self.rng.uniform(0.0, 1.0))
        self.shorter = float(self.rng.uniform(*SHORTER))
        self.switches_m_per_s = float(self.rng.uniform(*SWITCHES_M_PER_S))
        self.resonates_m_per_s = float(self.rng.uniform(*RESONATES_M_PER_S))
        self.crowded_m_per_s = float(self.rng.uniform(*CROWDED_M_PER_S))
        self.best_k = float(self.rng.uniform(*BEST_K))
        self.hot_k = float(self.rng.uniform(*HOT_K))

    def early_s(self, state: MotionState) -> Array | float:
        """By how much the machine has gone on when the station looks."""
        if self.variant == "filtering":
            return 0.0
        if self.variant == "bus_cycles":  # alternates between two cycles of a bus
            return np.asarray(self.size * (0.6 + 0.8 * (state.leg[:, 0] % 2)), dtype=np.float64)
        if self.variant == "queued":  # the phase of another message is the chance: the same whenever it is asked for
            return np.asarray(-self.size * np.log1p(-KEPT * (self.elapsed_s(state) % OTHER_S) / OTHER_S))
        if self.variant in BY_CLOCK:
            t = self.elapsed_s(state)
            share = t % POLL_S / POLL_S if self.variant == "clock_skew" else (t / HOUR_S) ** 2
            if self.variant == "restarted":
                share = self.restarts[state.exchanges.astype(int) % RESTARTS]
            elif self.variant == "beating_cycles":
                share = 2.0 * ((t / self.beats_s + self.phase) % 1.0)
            elif self.variant in ("warm_quartz", "hot_processor"):
                quartz = self.variant == "warm_quartz"
                share = self._run_slow(state) if quartz else np.where(self._warm_k(state) > self.hot_k, 2.0, 1.0)
            elif self.variant == "steered_clock":
                share = self._left_of_step(t)
            return np.asarray(self.size * share)
        if self.variant in ("adaptive_filter", "with_speed", "group_delay", "crowded_bus"):
            speed = np.abs(state.velocity_m_per_s).max(axis=1)
            share = speed / 0.25
            if self.variant == "adaptive_filter":
                share = np.where(speed > self.switches_m_per_s, self.shorter, 1.0)
            elif self.variant == "crowded_bus":
                busy = np.abs(state.velocity_m_per_s).sum(axis=1) / self.crowded_m_per_s
                share = 1.0 / (1.0 - np.minimum(busy, FULL))
            elif self.variant == "group_delay":
                share = 1.0 / (1.0 + ((speed / self.resonates_m_per_s - 1.0) / BROAD) ** 2)
            return np.asarray(self.size * share)
        return self.size

    def _warm_k(self, state: MotionState) -> Array:
        """By how much warmer a processor is than at the begin (n,)."""
        of_air_k = state.thermal.air_series_c(state.t_s) - state.thermal.air_series_c(np.array([self.site.start_s]))
        return np.asarray(-WARM_K * np.expm1(-self.elapsed_s(state) / WARMS_S) + OF_AIR * of_air_k)

    def _run_slow(self, state: MotionState) -> Array:
        """What a clock has lost since it was set (n,), over that of an hour QUARTZ_K off."""
        grid = grid_from(self.site.start_s, state)
        air_c = state.thermal.air_series_c(grid)
        rate = ((air_c - air_c[0] - self.best_k) / QUARTZ_K) ** 2
        lost = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * GRID_S / HOUR_S
        return np.asarray(np.interp(state.t_s, grid, lost))

    def _left_of_step(self, t: Array) -> Array:
        """Error of the clock (n,) over the step."""
        swing, fades = 2.0 * np.pi * t / self.steers_s, DAMPED / math.sqrt(1.0 - DAMPED**2)
        return np.asarray(np.exp(-fades * swing) * (np.cos(swing) - fades * np.sin(swing)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Delay by a filter: behind by v tau while moving, decaying after the stop."""
        if self.variant == "filtering" and self.size > 0.0:
            speed = state.direction * state.speed_m_per_s
            deviation.travel_m -= self.size * speed * np.exp(-state.since_s / self.size)


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
        ),
        final="drawn_together",
        reveals="the other drive's coordinate or motion, by variant payload, direction, dwell, temperature, SMRs on "
        "the sliders",
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
        ),
        final="hot_processor",
        reveals="readings on the fly at several speeds, or short dwell, by variant time and a temperature swing",
        make=Latency,
    ),
)
