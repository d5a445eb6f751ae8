"""Payloads whose mass or centre is not as stated."""

from __future__ import annotations

import cmath

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.base import (
    GRAVITY_M_PER_S2,
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    MotionState,
)

FULL_PAYLOAD_KG = 400.0
LEVER_M = 0.5
SLOSHES_S, CALMS_S, SLOSH_M_PER_S = 4.5, 15.0, 0.5  # of a pan of liquid: period, time constant, speed
FILLS_S, DRAINS_S = 150.0, 400.0  # of coolant on the platform: time constants with and without its pump
COMES_S, GOES_S, QUEUE, COUNTED = 240.0, 200.0, 4.0, 400  # of parts: mean times between two that come and two that go
# while there are any; how many have the size; comings and goings that are drawn
SOAKS_S = 3600.0  # in which a block has drawn up the whole size
BOLTS, LEFT_OVER, EXCHANGES = (0.3, 1.7), 4.0, 64  # left at an exchange, over the mean; exchanges that leave the size;
# that are drawn
EVERY, PALLET = (8, 20), 6  # of parts: motions of drives from one to the next; of them on a full pallet
LANDS = (0.4, 0.65)  # height of the platform, from 0 to 1, above which a counterweight has landed
SLIDES_S, SLIDES, FEW = 300.0, 200, 2.0  # of chips: mean time between two slides; how many are drawn; power of a number
# by chance that is the share which slides
CHIPS_S = 3600.0  # in which the whole size has gathered


class Payload(Effect):
    """What is on the platform is not what is stated: `mass_kg` more at the largest payload, or beside its place.

    `tool_left_on`: a body of its own mass and first moment of mass beside the payload, the four of ten numbers of a
    load that weight depends on in C. Atkeson, C. An, J. Hollerbach, "Estimation of Inertial Parameters of Manipulator
    Loads and Links" (1986).
    `draining`: a hollow block was mounted full and runs empty through a leak, the height of the liquid as in E.
    Torricelli, "De motu aquarum" (1644): the root of it falls evenly. The size is its mass at the campaign's begin.
    `hourglass`: shot trickles from one chamber of the block into another, evenly however much is left: W. A. Beverloo,
    H. A. Leniger, J. van de Velde, "The Flow of Granular Solids Through Orifices" (1961). The mass is right, and the
    centre is off by the whole size once all has run through.
    `sloshing`: liquid in a flat pan on the block swings to and fro after every sideways motion and calms down at rest:
    H. N. Abramson, "The Dynamic Behavior of Liquids in Moving Containers" (1966). The mass is right, and the centre is
    off by the whole size when a motion at SLOSH_M_PER_S stops.
    `hanging_chain`: a chain that was left on the block lies on the floor, but for what the platform has lifted, and
    that goes with its height: A. Cayley, "On a Class of Dynamical Problems" (1857). The size is the mass lifted in
    the middle of all travels.
    `gathering_chips`: chips that fall onto the platform stay there, with any payload or none, evenly from the
    campaign's begin: chips that remain in a machine in K. Weinert, I. Inasaki, J. W. Sutherland, T. Wakabayashi, "Dry
    Machining and Minimum Quantity Lubrication" (2004). The size is that after CHIPS_S.
    `coolant_pool`: coolant stands on the platform, with any payload or none, as high as its edge while the pump runs,
    and drains when that is switched off: outflow in H. Rouse, "Elementary Mechanics of Fluids" (1946), here with a time
    constant for either. The size is the mass up to the edge.
    `soaking_block`: a porous block draws up the coolant that it stands in, with the root of time: E. W. Washburn, "The
    Dynamics of Capillary Flow" (1921). It stands in it from the campaign's begin on, and the size is what it has drawn
    up after SOAKS_S.
    `rope_of_counterweight`: a counterweight hangs on a rope over pulleys, whose friction takes a part of its pull on
    the way up and adds it on the way down, in proportion to what hangs on it: J. A. Eytelwein, "Handbuch der Statik
    fester Körper" (1808). The size is that part without payload, when all drives went the same way.
    `waiting_parts`: somebody puts parts onto the platform at random moments and a robot takes them away one by one at
    others, whatever the payload, so that their number is that of a queue: A. K. Erlang, "The Theory of Probabilities
    and Telephone Conversations" (1909). The size is the mass of QUEUE parts.
    `forgotten_bolts`: at every exchange somebody leaves clamps and bolts of the block before on the platform, a few or
    many: H. W. Heinrich, "Industrial Accident Prevention" (1931). The size is what they weigh after LEFT_OVER exchanges
    on average.
    `stacked_parts`: after every so many motions of the drives a part is put onto a pallet on the platform, whatever the
    payload, and the full pallet is exchanged for an empty one: T. Ohno, "Toyota Production System" (1978). The size is
    the mass right before that.
    `landed_counterweight`: a counterweight on a rope hangs beside the machine and lands on the floor as the platform
    comes above one height, from where on it lifts nothing: J. Leupold, "Theatrum machinarum" (1724). The size is what
    it lifts below, which is taken for granted.
    `sandpile`: chips fall evenly onto a heap on the platform, with any payload or none, from which a part slides off at
    random moments, mostly a few and now and then nearly all: P. Bak, C. Tang, K. Wiesenfeld, "Self-Organized
    Criticality: An Explanation of 1/f Noise" (1987). The size is what falls in CHIPS_S.
    """

    def setup(self) -> None:
        """Which way the centre is off, and at which exchange a wrong block was mounted."""
        self.turn = cmath.exp(1j * float(self.rng.uniform(0.0, 2.0 * np.pi)))
        self.exchange = 1 + 2 * int(self.rng.integers(2))
        self.empty_s = float(self.rng.uniform(3600.0, 9000.0))
        self.pump_s = np.concatenate([[0.0], np.cumsum(self.rng.uniform(400.0, 1200.0, 40))])  # off, on, off ...
        self.pool = [0.0]
        for k, lasts_s in enumerate(np.diff(self.pump_s).tolist()):
            self.pool.append(float(_pooled(np.array(self.pool[-1]), np.array(k), np.array(lasts_s))))
        self.changes_s, self.waiting = _queue(self.rng)
        left = self.rng.uniform(*BOLTS, EXCHANGES) / LEFT_OVER
        self.bolts = np.concatenate([[0.0], np.cumsum(left)])
        own = self.rng.spawn(1)[0]
        self.every, self.stacked = int(own.integers(EVERY[0], EVERY[1] + 1)), int(own.integers(PALLET))
        self.lands = float(own.uniform(*LANDS))
        own = self.rng.spawn(1)[0]
        self.slides_s = np.concatenate([[0.0], np.cumsum(own.exponential(SLIDES_S, SLIDES))])
        self.stays = 1.0 - own.uniform(0.0, 1.0, SLIDES) ** FEW
        self.heap = [0.0]  # right after each slide, in seconds of falling chips
        for stays, lasts_s in zip(self.stays.tolist(), np.diff(self.slides_s).tolist(), strict=True):
            self.heap.append(stays * (self.heap[-1] + lasts_s))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Add mass, which the drives' torque shows, or move the centre, which it does not."""
        mounted = (state.payload_kg > 0.0).astype(np.float64)
        extra_kg = np.zeros(len(state))
        if self.variant == "centre":
            deviation.payload_shift_m += mounted * self.turn * self.size * LEVER_M / FULL_PAYLOAD_KG
        elif self.variant == "hourglass":
            through = np.minimum(self.elapsed_s(state) / self.empty_s, 1.0)
            deviation.payload_shift_m += mounted * through * self.turn * self.size * LEVER_M / FULL_PAYLOAD_KG
        elif self.variant == "sloshing":
            off_m = self.size * LEVER_M / FULL_PAYLOAD_KG * _sloshed(state)
            deviation.payload_shift_m += mounted * off_m
        elif self.variant == "swapped":
            extra_kg = self.size * mounted * (state.exchanges % 4 == self.exchange)
        elif self.variant == "hanging_chain":
            extra_kg = 2.0 * self.size * mounted * self._lifted(state)
        elif self.variant in ("gathering_chips", "coolant_pool", "waiting_parts", "sandpile"):
            extra_kg = self.size * self._lying(self.elapsed_s(state))
        elif self.variant in ("forgotten_bolts", "stacked_parts", "landed_counterweight"):
            extra_kg = self.size * self._left_there(state)
        elif self.variant == "soaking_block":
            extra_kg = self.size * mounted * np.sqrt(self.elapsed_s(state) / SOAKS_S)
        elif self.variant == "rope_of_counterweight":
            own_kg = self.site.machine.moving_mass_kg
            extra_kg = self.size * (own_kg + state.payload_kg) / own_kg * state.direction.mean(axis=1)
        elif self.variant == "draining":
            extra_kg = self.size * mounted * np.maximum(1.0 - self.elapsed_s(state) / self.empty_s, 0.0) ** 2
        elif self.variant == "tool_left_on":
            extra_kg = self.size * mounted
            all_kg = np.maximum(state.payload_kg + extra_kg, 1.0e-9)
            deviation.payload_shift_m += self.turn * LEVER_M * extra_kg / all_kg
        else:
            extra_kg = self.size * state.payload_kg / FULL_PAYLOAD_KG
        deviation.payload_mass_kg += extra_kg
        deviation.force_n += extra_kg[:, None] * GRAVITY_M_PER_S2 / len(self.site.machine.sliders)

    def _lying(self, t: Array) -> Array:
        """What lies on the platform with any payload or none (n,), over the size."""
        if self.variant == "gathering_chips":
            return np.asarray(t / CHIPS_S)
        if self.variant == "sandpile":
            k = np.searchsorted(self.slides_s, t, side="right") - 1
            return np.asarray((np.array(self.heap)[k] + t - self.slides_s[k]) / CHIPS_S)
        if self.variant == "waiting_parts":
            return np.asarray(self.waiting[np.searchsorted(self.changes_s, t, side="right")] / QUEUE)
        k = np.searchsorted(self.pump_s, t, side="right") - 1
        return _pooled(np.array(self.pool)[k], k, t - self.pump_s[k])

    def _left_there(self, state: MotionState) -> Array:
        """What exchanges or motions have left on the platform, or a counterweight does (n,), over the size."""
        if self.variant == "landed_counterweight":
            return (self._lifted(state) > self.lands).astype(np.float64)
        if self.variant == "forgotten_bolts":
            return np.asarray(self.bolts[np.minimum(state.exchanges.astype(int), EXCHANGES)])
        return np.asarray((state.leg.sum(axis=1) // self.every + self.stacked) % PALLET / (PALLET - 1.0))

    def _lifted(self, state: MotionState) -> Array:
        """Height of the platform (n,) by its drives, from 0 to 1."""
        ends = np.array([slider.travel_m for slider in self.site.machine.sliders])
        return np.asarray(((state.q_m - ends[:, 0]) / (ends[:, 1] - ends[:, 0])).mean(axis=1))


def _pooled(begins: Array, number: NDArray[np.intp], lasts_s: Array) -> Array:
    """How full a platform is (n,) some time after its pump was switched for the k-th time: on for odd numbers."""
    runs = number % 2 == 1
    return np.asarray(runs + (begins - runs) * np.exp(-lasts_s / np.where(runs, FILLS_S, DRAINS_S)))


def _queue(rng: np.random.Generator) -> tuple[Array, Array]:
    """Moments at which parts come or go, and how many there are before the first and after each; none at first."""
    now_s, count = 0.0, 0
    changes_s, waiting = [], [0.0]
    for _ in range(COUNTED):
        goes = 1.0 / GOES_S if count else 0.0
        rate = 1.0 / COMES_S + goes
        now_s += float(rng.exponential(1.0 / rate))
        count += -1 if float(rng.uniform()) < goes / rate else 1
        changes_s.append(now_s)
        waiting.append(float(count))
    return np.array(changes_s), np.array(waiting)


def _sloshed(state: MotionState) -> Array:
    """Where the liquid is (n,): ahead in the platform's direction when the last of its first two drives stops."""
    sideways = 0.5 * (state.direction[:, :2] * state.speed_m_per_s[:, :2]) @ np.array([-1.0, 1.0]) / SLOSH_M_PER_S
    rested_s = state.since_s[:, :2].min(axis=1)
    return np.asarray(sideways * np.exp(-rested_s / CALMS_S) * np.cos(2.0 * np.pi * rested_s / SLOSHES_S))


EFFECTS = (
    EffectSpec(
        name="payload",
        kind="catalogue",
        place="rig",
        size=EffectParameter("mass_kg", 0.5, 20.0, 8000.0, "beyond the stated one, or 0.5 m beside it"),
        variants=(
            "mass",
            "centre",
            "swapped",
            "tool_left_on",
            "draining",
            "hourglass",
            "sloshing",
            "hanging_chain",
            "gathering_chips",
            "coolant_pool",
            "soaking_block",
            "rope_of_counterweight",
            "waiting_parts",
            "forgotten_bolts",
            "stacked_parts",
            "landed_counterweight",
            "sandpile",
        ),
        final="sandpile",
        reveals="payloads, torque; by variant time, also by chance, exchanges, number of motions, dwell, height, "
        "direction",
        make=Payload,
    ),
)
