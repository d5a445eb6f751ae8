"""A foundation that settles: columns that sink and lean."""

from __future__ import annotations

import numpy as np
from scipy.special import exp1

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.followers import PlaceMemory
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.warming import AIR, lag_behind

FOOT_M = -1.2
CONCRETE = 0.6
SAND_M2_PER_S2, SAND_TIMES = 4.0, 10.0  # sum of squared speeds: scale of its logarithm; multiple of that at the size
TOP, CURLS_K = 0.1, 1.0  # time constant of a slab's top over that of its bottom; difference that gives the size
PUMPS = (2.0, 4.0)  # how long a well is pumped, over tau_s
WELL = 8.0  # tau_s over the time in which a well is felt at the foot
LOADINGS, HARDENS = 4.0, 0.4  # exchanges of payload after which the size is reached; exponent of their number
FOLLOWS = 0.05  # time constant in which wet soil follows its load, over tau_s
CYCLES_S, WATERED = (800.0, 1600.0), 0.3  # of sprinklers: cycle; share of it that they run
SWELLS, DRIES = 0.1, 0.3  # time constants of clay that takes up water and loses it, over tau_s
REBOUNDS, EARLY = (
    2.5,
    (0.08, 0.25),
)  # of relieved ground: part of the rise over the size; its times
FAILS, HELD = (0.4, 1.0), 0.95  # of a slope: when it would fail, over tau_s; share of that after which it is held
SEICHE_S, FADES = (600.0, 1500.0), 3.0  # of a lake: period; time constant in which it calms down, over tau_s
TRAINS_S, TRAINS, PACKS = 300.0, 200, (0.15, 0.4)  # mean time between two trains; how many are drawn; share of what is
# loose that each packs
AT_ONCE = 0.5  # share of a bowl under the other foot that follows at once
FLOW = 0.2  # even part of the creep of lead, after four times tau_s
_TERMS = 60


class FoundationSettling(Effect):
    """The foot of a column sinks, and the column leans: `tilt_per_m` of angle for each metre that it sank.

    `consolidation`: water that leaves clay, the degree of consolidation of K. Terzaghi, "Theoretical Soil Mechanics"
    (1943); it begins with the root of time. tau_s is the time constant of the slowest term.
    `concrete`: creep under the first load, t^0.6 / (d + t^0.6), in D. E. Branson, M. L. Christiason, "Time-Dependent
    Concrete Properties Related to Design" (1971); after tau_s half of it is over.
    `lead_pads`: pads of lead creep with the cube root of time and then evenly: E. N. da C. Andrade, "On the Viscous
    Flow in Metals, and Allied Phenomena" (1910); the size is reached after four times tau_s.
    `shaken_sand`: the drives shake the sand under the foot and so pack it: vibration of sand in D. D. Barkan, "Dynamics
    of Bases and Foundations" (1962). The settlement goes with the logarithm of the sum of squared speeds since the
    onset.
    `pumped_well`: water is pumped from a well near by for a while, and the ground sinks with the water's level and
    comes back: the exponential integral of C. V. Theis, "The Relation Between the Lowering of the Piezometric Surface
    and the Rate and Duration of Discharge of a Well Using Ground-Water Storage" (1935). It begins late; the size is
    after four times tau_s if the pump still runs then.
    `curling_slab`: a gate is opened at the onset, and the slab's top follows the air sooner than its bottom: it curls,
    and its edges sink while the air grows warmer and rise again: H. M. Westergaard, "Analysis of Stresses in Concrete
    Pavements Due to Variations of Temperature" (1927). The size is that of CURLS_K from top to bottom.
    `repeated_loads`: every exchange of the payload loads the soil anew and leaves a little less than the one before, by
    a power of their number: C. L. Monismith, N. Ogawa, C. R. Freeme, "Permanent Deformation Characteristics of Subgrade
    Soils Due to Repeated Loading" (1975). The size is reached after LOADINGS.
    `follows_weight`: from the onset on water softens the soil, which follows what stands on it: it sinks while the
    carriage is low, so that the platform is near and its weight on this foot, and water comes back into it while the
    carriage is high: M. A. Biot, "General Theory of Three-Dimensional Consolidation" (1941). The size is that of a
    carriage that stays at its lower end.
    `neighbours_bowl`: both feet stand on the same soft ground, wet from the onset on, and the weight on the next foot,
    more of it while that one's carriage is low, presses a bowl in which this foot sinks too, partly at once and partly
    as water leaves the ground: R. D. Mindlin, "Force at a Point in the Interior of a Semi-Infinite Solid" (1936). The
    size is that of the next carriage if it stays at its lower end.
    `watered_clay`: from the onset on sprinklers run in a fixed cycle, clay under the foot takes up their water and
    swells, and dries between, more slowly, so that the foot rises and sinks: L. A. Richards, "Capillary Conduction of
    Liquids Through Porous Mediums" (1931). The size is how far clay that is always wet would lift it.
    `rebounding_ground`: ground that was relieved at the onset rises at once in a narrow bowl and sinks in the end, more
    slowly, in a wide one: N. A. Haskell, "The Motion of a Viscous Fluid Under a Surface Load" (1935). The narrow one
    comes within a share of tau_s and goes within tau_s. The size is how far it ends below where it was.
    `failing_slope`: from the onset on the ground slides ever faster, with one over what time is left until it would
    fail, and so by the logarithm of that, until rubble holds it: M. Saito, "Forecasting the Time of Occurrence of a
    Slope Failure" (1965). The size is where it is held.
    `lake_seiche`: a gust at the onset has set a lake near by swinging, whose water presses the ground as it comes and
    goes, ever less, so that the foot sinks and rises: F. A. Forel, "Le Léman" (1895). The size is the amplitude, were
    it not damped.
    `passing_trains`: from the onset on trains pass at random moments, each of which packs the same share of what is
    still loose under the foot: M. M. von Weber, "Die Stabilität des Gefüges der Eisenbahn-Gleise" (1869).
    """

    def setup(self) -> None:
        """MotionState and shares of the steps of variant `stick_slip`."""
        self.steps = np.sort(self.rng.uniform(0.0, 4.0, 5))
        self.shares = self.rng.dirichlet(np.full(5, 2.0))
        self.pumps_s = float(self.rng.uniform(*PUMPS)) * self.values["tau_s"]
        low, high = self.site.machine.sliders[self.place].travel_m
        self._pressed = PlaceMemory(lambda q_m: (high - q_m) / (high - low), FOLLOWS * self.values["tau_s"])
        self.next = (self.place + 1) % len(self.site.machine.sliders)
        self._bowl = PlaceMemory(self._weight_beside, FOLLOWS * self.values["tau_s"])
        self.cycle_s = float(self.rng.uniform(*CYCLES_S))
        self.early = float(self.rng.spawn(1)[0].uniform(*EARLY))
        self.fails_s = float(self.rng.spawn(1)[0].uniform(*FAILS)) * self.values["tau_s"]
        self.seiche_s = float(self.rng.spawn(1)[0].uniform(*SEICHE_S))
        own = self.rng.spawn(1)[0]
        self.packs = float(own.uniform(*PACKS))
        self.trains_s = np.cumsum(own.exponential(TRAINS_S, TRAINS))
        onset_s = self.site.start_s + self.values["onset_s"]
        self._shaken = [
            LegMemory(lambda way, speed, start_s: speed**2 * ((start_s >= onset_s) & (way != 0.0)))
            for _ in self.site.machine.sliders
        ]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every motion shake the sand, or the soil be pressed where its carriage stands."""
        if self.variant == "neighbours_bowl" and drive == self.next:
            self._bowl.record(leg)
        if self.variant == "follows_weight" and drive == self.place:
            self._pressed.record(leg)
        if self.variant == "shaken_sand":
            self._shaken[drive].record(leg)

    def _weight_beside(self, q_m: Array) -> Array:
        """Weight on the next foot (n,) by where its carriage stands, from 0 at its upper end to 1."""
        low, high = self.site.machine.sliders[self.next].travel_m
        return np.asarray((high - q_m) / (high - low))

    def _by_load(self, state: MotionState, after_s: Array) -> Array:
        """How far the foot has sunk (n,) by what stands, stood or passes on it or wets it, over the size."""
        courses = {"watered_clay": self._swollen, "lake_seiche": self._swung, "passing_trains": self._packed}
        if self.variant in courses:
            return courses[self.variant](after_s)
        if self.variant == "failing_slope":
            return np.asarray(np.log1p(-np.minimum(after_s / self.fails_s, HELD)) / np.log1p(-HELD))
        if self.variant == "rebounding_ground":
            slow, fast = (np.exp(-after_s / (part * self.values["tau_s"])) for part in (1.0, self.early))
            return np.asarray(1.0 - slow - REBOUNDS * (slow - fast))
        if self.variant == "repeated_loads":
            return np.asarray((state.exchanges / LOADINGS) ** HARDENS)
        softened = 1.0 - np.exp(-after_s / self.values["tau_s"])
        if self.variant == "neighbours_bowl":
            at_once = self._weight_beside(state.q_m[:, self.next])
            return np.asarray(softened * (AT_ONCE * at_once + (1.0 - AT_ONCE) * self._bowl.at(state, self.next)))
        return np.asarray(softened * self._pressed.at(state, self.place))

    def _packed(self, after_s: Array) -> Array:
        """How much of what was loose trains have packed (n,)."""
        passed = np.searchsorted(self.trains_s, after_s, side="right")
        return np.asarray(1.0 - (1.0 - self.packs) ** passed)

    def _swung(self, after_s: Array) -> Array:
        """How far the water of a lake presses the ground (n,), this way or that, over its first swing undamped."""
        left = np.exp(-after_s / (FADES * self.values["tau_s"]))
        return np.asarray(left * np.sin(2.0 * np.pi * after_s / self.seiche_s))

    def _swollen(self, after_s: Array) -> Array:
        """How far clay has swollen after sprinklers were switched on (n,), over what it would end at; negative."""
        swells_s, dries_s = (share * self.values["tau_s"] for share in (SWELLS, DRIES))
        wet_s = WATERED * self.cycle_s
        cycles, at_s = np.floor(after_s / self.cycle_s), after_s % self.cycle_s
        dried = np.exp(-(self.cycle_s - wet_s) / dries_s)  # what one cycle leaves of what has swollen in it
        kept = np.exp(-wet_s / swells_s) * dried  # and of what was before
        begins = (dried - kept) * (1.0 - kept**cycles) / (1.0 - kept)
        wet = 1.0 + (begins - 1.0) * np.exp(-np.minimum(at_s, wet_s) / swells_s)
        return np.asarray(-wet * np.exp(-np.maximum(at_s - wet_s, 0.0) / dries_s))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lower and lean the column."""
        t = state.t_s - self.site.start_s - self.values["onset_s"]
        tau, after = self.values["tau_s"], np.maximum(t, 0.0)
        if self.variant == "step":
            share = (t >= 0.0).astype(float)
        elif self.variant == "logarithmic":
            share = np.log1p(after / tau) / np.log1p(4.0)
        elif self.variant == "creep":
            share = after / (4.0 * tau)
        elif self.variant == "consolidation":
            odd = np.arange(1.0, 2.0 * _TERMS, 2.0)
            terms = np.exp(-np.outer(after / tau, odd**2)) / odd**2
            share = np.where(t >= 0.0, 1.0 - 8.0 / np.pi**2 * terms.sum(axis=1), 0.0)
        elif self.variant == "concrete":
            power = (after / tau) ** CONCRETE
            share = power / (1.0 + power)
        elif self.variant == "lead_pads":
            share = (1.0 - FLOW) * np.cbrt(after / (4.0 * tau)) + FLOW * after / (4.0 * tau)
        elif self.variant == "shaken_sand":
            shaken = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._shaken))
            share = np.log1p(shaken / SAND_M2_PER_S2) / np.log1p(SAND_TIMES)
        elif self.variant == "pumped_well":
            share = (_drawn_down(after / tau) - _drawn_down((t - self.pumps_s) / tau)) / _drawn_down(np.array([4.0]))
        elif self.variant in (
            "repeated_loads",
            "follows_weight",
            "neighbours_bowl",
            "watered_clay",
            "rebounding_ground",
            "failing_slope",
            "lake_seiche",
            "passing_trains",
        ):
            share = self._by_load(state, after)
        elif self.variant == "curling_slab":
            begins_s = self.site.start_s + self.values["onset_s"]
            top, bottom = (lag_behind(state, AIR, begins_s, part_s) for part_s in (TOP * tau, tau))
            share = (top - bottom) / CURLS_K
        elif self.variant == "stick_slip":
            share = (t[:, None] >= self.steps * tau) @ self.shares
        else:
            share = 1.0 - np.exp(-after / tau)
        a = self.place
        strut = next(s for s in self.site.machine.struts if s.drive == a)
        height = state.q_m[:, a] + strut.base_joint.imag - FOOT_M
        lean = self.values["tilt_per_m"] * self.size * share
        deviation.travel_m[:, a] -= self.size * share
        deviation.sideways_m[:, a] += lean * height
        deviation.yaw_rad[:, a] += lean


def _drawn_down(pumped: Array) -> Array:
    """Fall of a well's water (n,) after a time of pumping, over its time constant: no more than nothing before."""
    return np.asarray(exp1(1.0 / (WELL * np.maximum(pumped, 1.0e-4))))


EFFECTS = (
    EffectSpec(
        name="foundation_settling",
        kind="catalogue",
        place="drive",
        size=EffectParameter("settled_m", 1e-6, 2e-5, 8e-4, "how far the foot sinks"),
        variants=(
            "exponential",
            "step",
            "logarithmic",
            "creep",
            "stick_slip",
            "consolidation",
            "concrete",
            "lead_pads",
            "shaken_sand",
            "pumped_well",
            "curling_slab",
            "repeated_loads",
            "follows_weight",
            "neighbours_bowl",
            "watered_clay",
            "rebounding_ground",
            "failing_slope",
            "lake_seiche",
            "passing_trains",
        ),
        final="passing_trains",
        reveals="time, also by chance, motions or exchanges of payload made, by variant places, also of the other "
        "drive, a temperature swing, SMRs on the sliders against the floor nests",
        make=FoundationSettling,
        others=(
            EffectParameter("onset_s", 0.0, 1800.0, 7200.0, "after the campaign's begin"),
            EffectParameter("tau_s", 300.0, 1200.0, 7200.0, "time constant"),
            EffectParameter("tilt_per_m", 0.0, 0.3, 1.0, "lean of the column, radians a metre sunk"),
        ),
    ),
)
