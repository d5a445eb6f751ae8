"""Latency of the station against the drives."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, MotionState
from mock_devices.effects.warming import GRID_S, grid_from

POLL_S = 1024.0
OTHER_S, KEPT = 0.0731, 0.9  # cycle of another message; share of messages that are not given up
HOUR_S = 3600.0
TYPICAL_M_PER_S = 0.25  # speed at which a delay that goes with it has the size
BEST_K, QUARTZ_K = (-1.0, 1.0), 1.0  # of a quartz: its best temperature beyond that of the begin; off by so much it
# has the size
RESTARTS = 32
STEERS_S, DAMPED = (900.0, 1800.0), 0.05  # of a clock's loop: period, damping
CROWDED_M_PER_S, FULL = (1.3, 2.0), 0.95  # of a bus: sum of all speeds that fills it; share that is not exceeded
BEATS_S = (150.0, 500.0)  # in which one cycle runs past another
RESONATES_M_PER_S, BROAD = (0.15, 0.4), 0.25  # speed at which a filter delays most; half width over that
WARM_K, WARMS_S, OF_AIR, HOT_K = 10.0, 1500.0, 6.0, (3.0, 8.0)  # of a processor: own warmth; time constant; warmth for
# each kelvin of the air; from which on it is hot
SHORTER, SWITCHES_M_PER_S = (0.15, 0.5), (0.15, 0.35)  # delay of a second filter, over the first one's; speed
FULL_PAYLOAD_KG, EMPTY = 400.0, (0.05, 0.4)  # of a window: delay without payload over that with the largest
GOOD_S, BAD_S, REPEATS, BURSTS = 400.0, 250.0, (2.5, 5.0), 256  # of a channel: mean times good and bad; delay while
# bad over that while it is good; changes that are drawn


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
    `burst_noise`: the channel is good and bad by turns, for times by chance, and while it is bad messages are lost and
    sent again: E. N. Gilbert, "Capacity of a Burst-Noise Channel" (1960). The size is the delay of the good one.
    `scheduled_window`: the window over which the station takes the mean grows with the payload that is entered, and
    with it the delay: W. J. Rugh, J. S. Shamma, "Research on Gain Scheduling" (2000). The size is that of
    FULL_PAYLOAD_KG.
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
        self.repeats = float(self.rng.uniform(*REPEATS))
        self.empty = float(self.rng.spawn(1)[0].uniform(*EMPTY))
        self.bursts_s = np.cumsum(self.rng.exponential(np.tile([GOOD_S, BAD_S], BURSTS // 2)))

    def early_s(self, state: MotionState) -> Array | float:
        """By how much the machine has gone on when the station looks."""
        if self.variant == "filtering":
            return 0.0
        shares = {
            "bus_cycles": self._by_turns,
            "queued": self._queued,
            "clock_skew": lambda m: self.elapsed_s(m) % POLL_S / POLL_S,
            "clock_ageing": lambda m: (self.elapsed_s(m) / HOUR_S) ** 2,
            "restarted": lambda m: self.restarts[m.exchanges.astype(int) % RESTARTS],
            "steered_clock": self._left_of_step,
            "beating_cycles": lambda m: 2.0 * ((self.elapsed_s(m) / self.beats_s + self.phase) % 1.0),
            "warm_quartz": self._run_slow,
            "hot_processor": lambda m: np.where(self._warm_k(m) > self.hot_k, 2.0, 1.0),
            "burst_noise": self._in_bursts,
            "scheduled_window": lambda m: self.empty + (1.0 - self.empty) * m.payload_kg / FULL_PAYLOAD_KG,
            "with_speed": lambda m: _fastest(m) / TYPICAL_M_PER_S,
            "adaptive_filter": lambda m: np.where(_fastest(m) > self.switches_m_per_s, self.shorter, 1.0),
            "group_delay": lambda m: 1.0 / (1.0 + ((_fastest(m) / self.resonates_m_per_s - 1.0) / BROAD) ** 2),
            "crowded_bus": self._crowded,
        }
        if self.variant not in shares:  # a dead time
            return self.size
        return np.asarray(self.size * shares[self.variant](state), dtype=np.float64)

    def _by_turns(self, state: MotionState) -> Array:
        """Alternately by one and by the other of two cycles of a bus (n,), over the size."""
        return np.asarray(0.6 + 0.8 * (state.leg[:, 0] % 2))

    def _queued(self, state: MotionState) -> Array:
        """By the phase of another message (n,), over the size: chance, and yet the same whenever it is asked for."""
        return np.asarray(-np.log1p(-KEPT * (self.elapsed_s(state) % OTHER_S) / OTHER_S))

    def _in_bursts(self, state: MotionState) -> Array:
        """Delay of a channel that is good and bad by turns (n,), over that while it is good."""
        bad = np.searchsorted(self.bursts_s, self.elapsed_s(state), side="right") % 2 == 1
        return np.where(bad, self.repeats, 1.0)

    def _crowded(self, state: MotionState) -> Array:
        """Delay of a bus (n,), over that of a free one."""
        busy = np.abs(state.velocity_m_per_s).sum(axis=1) / self.crowded_m_per_s
        return np.asarray(1.0 / (1.0 - np.minimum(busy, FULL)))

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

    def _left_of_step(self, state: MotionState) -> Array:
        """Error of the clock (n,) over the step."""
        swing, fades = 2.0 * np.pi * self.elapsed_s(state) / self.steers_s, DAMPED / math.sqrt(1.0 - DAMPED**2)
        return np.asarray(np.exp(-fades * swing) * (np.cos(swing) - fades * np.sin(swing)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Delay by a filter: behind by v tau while moving, decaying after the stop."""
        if self.variant == "filtering" and self.size > 0.0:
            speed = state.direction * state.speed_m_per_s
            deviation.travel_m -= self.size * speed * np.exp(-state.since_s / self.size)


def _fastest(state: MotionState) -> Array:
    """Speed of the faster drive (n,), in m/s."""
    return np.asarray(np.abs(state.velocity_m_per_s).max(axis=1))
