"""What the controls leave: crosstalk between axes, latency of the station, settling after a motion."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import erfcx

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.followers import Dragged
from mock_devices.effects.leg_memory import LegMemory

REFERENCE_SPEED_M_PER_S = 0.5
BED_PER_M = 3.0
POLL_S = 1024.0
COUPLED_S = 6.0  # in which a following error dies out
OTHER_S, KEPT = 0.0731, 0.9  # cycle of another message; share of messages that are not given up
RESOLVER_M = 0.02  # travel of a slider in one turn of its resolver
HOUR_S = 3600.0
DRAG_M = 0.12  # half of the play with which another axis drags a chain along
RESTARTS = 32
STEERS_S, DAMPED = (900.0, 1800.0), 0.05  # of a clock's loop: period, damping
BEATS_S = (150.0, 500.0)  # in which one cycle runs past another
LEADS_M = (0.01, 0.016, 0.02, 0.025)  # of the other axis's screw
SWINGS, CALMS = 3.0, 0.5  # of a load: rate and decay, over tau_s
LONG, AFTER_M = 6.0, 0.5  # slow time constant of an after-effect over tau_s; travel that leaves the size
WRAPS = 0.5  # friction of a rope on its pulleys times the angle round which it lies
SHORTER, SWITCHES_M_PER_S = (0.15, 0.5), (0.15, 0.35)  # delay of a second filter, over the first one's; speed
UNWINDS = 3.0  # time constant of an integral part that unwinds, over tau_s
WOUND_M, UNWOUND_M = 0.25, 0.04  # ways of which an integral part is wound up to its limit, or not at all
STICKS = 0.15  # friction over the force of the first swing


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
    """

    def setup(self) -> None:
        """Phase between both axes' signals, and where the chain is."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.other = (self.place + 1) % len(self.site.machine.sliders)
        self.lead_m = float(self.rng.choice(LEADS_M))
        self._chain = Dragged(DRAG_M, self.site.drive_range_m(self.other)[0])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the other axis drag the chain."""
        if self.variant == "dragged_chain" and drive == self.other:
            self._chain.record(leg)

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
        elif self.variant == "loaded_bridge":
            y = x * (1.0 + state.payload_kg / self.site.machine.moving_mass_kg)
        elif self.variant == "shared_rope":
            y = x * np.exp(WRAPS * state.direction[:, b])
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
    """

    def setup(self) -> None:
        """Phases after every restart; how fast the loop of a clock swings."""
        self.restarts = np.concatenate([[1.0], self.rng.uniform(0.0, 2.0, RESTARTS - 1)])
        self.steers_s = float(self.rng.uniform(*STEERS_S))
        self.beats_s = float(self.rng.uniform(*BEATS_S))
        self.phase = float(self.rng.uniform(0.0, 1.0))
        self.shorter = float(self.rng.uniform(*SHORTER))
        self.switches_m_per_s = float(self.rng.uniform(*SWITCHES_M_PER_S))

    def early_s(self, state: MotionState) -> Array | float:
        """By how much the machine has gone on when the station looks."""
        if self.variant == "filtering":
            return 0.0
        if self.variant == "bus_cycles":  # alternates between two cycles of a bus
            return np.asarray(self.size * (0.6 + 0.8 * (state.leg[:, 0] % 2)), dtype=np.float64)
        if self.variant == "queued":  # the phase of another message is the chance: the same whenever it is asked for
            return np.asarray(-self.size * np.log1p(-KEPT * (self.elapsed_s(state) % OTHER_S) / OTHER_S))
        if self.variant in ("clock_skew", "clock_ageing", "restarted", "steered_clock", "beating_cycles"):
            t = self.elapsed_s(state)
            share = t % POLL_S / POLL_S if self.variant == "clock_skew" else (t / HOUR_S) ** 2
            if self.variant == "restarted":
                share = self.restarts[state.exchanges.astype(int) % RESTARTS]
            elif self.variant == "beating_cycles":
                share = 2.0 * ((t / self.beats_s + self.phase) % 1.0)
            elif self.variant == "steered_clock":
                share = self._left_of_step(t)
            return np.asarray(self.size * share)
        if self.variant in ("adaptive_filter", "with_speed"):
            speed = np.abs(state.velocity_m_per_s).max(axis=1)
            share = np.where(speed > self.switches_m_per_s, self.shorter, 1.0)
            return np.asarray(self.size * (share if self.variant == "adaptive_filter" else speed / 0.25))
        return self.size

    def _left_of_step(self, t: Array) -> Array:
        """Error of the clock (n,) over the step."""
        swing, fades = 2.0 * np.pi * t / self.steers_s, DAMPED / math.sqrt(1.0 - DAMPED**2)
        return np.asarray(np.exp(-fades * swing) * (np.cos(swing) - fades * np.sin(swing)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Delay by a filter: behind by v tau while moving, decaying after the stop."""
        if self.variant == "filtering" and self.size > 0.0:
            speed = state.direction * state.speed_m_per_s
            deviation.travel_m -= self.size * speed * np.exp(-state.since_s / self.size)


class ServoSettling(Effect):
    """The slider comes to rest late: `amplitude_m` behind its target on arrival at 0.5 m/s.

    `stretched`: exp(-sqrt(t / tau)), the relaxation in R. Kohlrausch, "Theorie des elektrischen Rückstandes in der
    Leidener Flasche" (1854): fast at first and long after still on its way.
    `critically_damped`: (1 + t / tau) exp(-t / tau), the loop of second order with damping one of K. Ogata, "Modern
    Control Engineering" (1970), that has come to rest for the moment when its target stops.
    `dry_friction`: swings that dry friction shortens by the same way each, until it holds the slider beside its target:
    J. P. Den Hartog, "Mechanical Vibrations" (1934). Half a swing takes tau_s.
    `after_effect`: a belt forgets no motion at once, so that all earlier motions act together, the latest ones most: L.
    Boltzmann, "Zur Theorie der elastischen Nachwirkung" (1874), here with two time constants. A motion by AFTER_M
    leaves the size.
    `integrator_reset`: the controller's integral part, which holds the weight, is cleared with every motion and builds
    up again at rest, so that the slider arrives below its target from either side and rises: K. J. Åström, T. Hägglund,
    "PID Controllers: Theory, Design, and Tuning" (1995). The size is that without payload, at any speed.
    `swinging_load`: what hangs on the slider swings on beyond its target, the further and the more slowly the heavier
    it is: N. C. Singer, W. P. Seering, "Preshaping Command Inputs to Reduce System Vibration" (1990). The size is the
    swing without payload, were it not damped.
    `half_order`: a rubber element relaxes by a derivative of the order one half, as if it had all time constants, with
    a long tail of one over the root of time: exp(t) erfc(sqrt(t)), t over tau_s, in M. Caputo, F. Mainardi, "A New
    Dissipation Model Based on Memory Mechanism" (1971).
    `wound_up`: the integral part winds up over every long way, up to its limit, and carries the slider beyond until it
    has unwound: K. J. Åström, L. Rundqwist, "Integrator Windup and How to Avoid It" (1989). A short approach leaves
    what the long way before it has wound up. The size is what the limit gives, at any speed.
    """

    def setup(self) -> None:
        """What the belt has not yet forgotten."""
        tau = self.values["tau_s"]
        self._ways = LegMemory(lambda way, _speed, _: way / AFTER_M, tau, LONG * tau)
        self._wound = LegMemory(_winds, UNWINDS * tau)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the belt of this drive remember."""
        if self.variant == "after_effect" and drive == self.place:
            self._ways.record(leg)
        elif self.variant == "wound_up" and drive == self.place:
            self._wound.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Hold the slider back."""
        a, tau = self.place, self.values["tau_s"]
        if self.variant == "after_effect":
            deviation.travel_m[:, a] -= self.size * self._ways.at(state, a).mean(axis=1)
            return
        if self.variant == "wound_up":
            deviation.travel_m[:, a] += self.size * self._wound.at(state, a)[:, 0]
            return
        t = state.since_s[:, a] / tau
        share = np.exp(-t)
        if self.variant == "integrator_reset":
            own_kg = self.site.machine.moving_mass_kg
            weight = (state.speed_m_per_s[:, a] > 0.0) * (own_kg + state.payload_kg) / own_kg
            deviation.travel_m[:, a] -= self.size * weight * share
            return
        if self.variant == "swinging_load":
            own_kg = self.site.machine.moving_mass_kg
            slower = np.sqrt((own_kg + state.payload_kg) / own_kg)
            share = -slower * np.exp(-CALMS * t) * np.sin(SWINGS * t / slower)
        elif self.variant == "ringing":
            share = np.exp(-0.5 * t) * np.cos(2.5 * t)
        elif self.variant == "logarithmic":
            share = np.maximum(1.0 - np.log1p(t) / np.log(8.0), 0.0)
        elif self.variant == "integrator":
            share = np.maximum(1.0 - 0.5 * t, 0.0)
        elif self.variant == "half_order":
            share = erfcx(np.sqrt(t))
        elif self.variant == "stretched":
            share = np.exp(-np.sqrt(t))
        elif self.variant == "dry_friction":
            share = _swings(t)
        elif self.variant == "critically_damped":
            share = (1.0 + t) * np.exp(-t)
        elif self.variant == "two_stages":
            share = 0.6 * np.exp(-2.0 * t) + 0.4 * np.exp(-0.4 * t)
        behind = state.direction[:, a] * state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S
        deviation.travel_m[:, a] -= self.size * behind * share


def _winds(way_m: Array, _speed: Array, _start_s: Array) -> Array:
    """What a way winds up (n,), over the limit."""
    return np.sign(way_m) * np.clip((np.abs(way_m) - UNWOUND_M) / (WOUND_M - UNWOUND_M), 0.0, 1.0)


def _swings(halves: Array) -> Array:
    """Place (n,) after some half swings, from 1: each about a middle that friction shifts to where it came from."""
    last = int(np.ceil((1.0 / STICKS - 1.0) / 2.0))  # the half swing that would begin where friction holds
    n = np.minimum(np.floor(halves), last)
    sign = np.where(n % 2.0 == 0.0, 1.0, -1.0)
    swing = np.cos(np.pi * np.where(n < last, halves - n, 0.0))
    begins = 1.0 - 2.0 * STICKS * n
    return np.asarray(sign * np.where(n < last, STICKS + (begins - STICKS) * swing, begins))


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
        ),
        final="shared_rope",
        reveals="the other drive's coordinate or motion, by variant payload, direction, SMRs on the sliders",
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
        ),
        final="adaptive_filter",
        reveals="readings on the fly at several speeds, or short dwell",
        make=Latency,
    ),
    EffectSpec(
        name="servo_settling",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 4e-5, 4e-3, "short on arrival"),
        variants=(
            "creep",
            "ringing",
            "logarithmic",
            "integrator",
            "two_stages",
            "stretched",
            "critically_damped",
            "dry_friction",
            "after_effect",
            "integrator_reset",
            "swinging_load",
            "half_order",
            "wound_up",
        ),
        final="wound_up",
        reveals="varied dwell and speed, by variant payload or earlier motions, SMRs on the sliders",
        make=ServoSettling,
        others=(EffectParameter("tau_s", 0.5, 3.0, 15.0, "time constant"),),
    ),
)
