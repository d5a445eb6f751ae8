"""What the station sees differently: drift of its frame, bent light."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    StationSight,
)
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.refraction import Refraction
from mock_devices.effects.walks import HOUR_S, Flicker, HeldWalk, RandomWalk
from mock_devices.effects.warming import grid_from

LEVER_M = 3.2
SWAYS_S = ((600.0, 1300.0), (1800.0, 3300.0))  # periods of a building that sways
SHAKEN_M2_PER_S2 = 40.0  # sum of squared speeds that moves a stand by the size
PASSERS_S, PASSERS, FORGETS_S = 240.0, 400, 600.0  # mean time between passers-by; how many; time constant of recovery
HOLDS_K, DRAGGED = (0.1, 0.4), 3.0  # of feet: kelvin that friction holds; see `dragged_feet`
SETTLES_S = 60.0  # from which on legs settle with the logarithm of time
LEVEL_S, GROWS_S, STARTS = (300.0, 900.0), (400.0, 1200.0), 0.05  # of a level: period; growth by e; swing at first
TRUCK_S, CROSSES_S, STANDS = (600.0, 1500.0), (900.0, 2400.0), (0.3, 0.7)  # of a truck: when it comes; how long it
# takes; where along its way the station stands
FANS_S, RUNS, SWITCHES = (600.0, 1500.0), (0.3, 0.6), 0.5  # of a fan: cycle; share of it that it runs; see _switched
FULL_PAYLOAD_KG = 400.0
TRACKS_M_PER_S, COOLS_S = 0.04, 900.0  # of a station that follows motions: mean of their speeds for the size; cooling


def move_station(sight: StationSight, turn_rad: Array, shift_m: Array) -> None:
    """Small rotation (n, 3) and shift (n, 3) of all points in the frame of the station; angles and distances follow."""
    move_points(sight, np.cross(turn_rad[:, None, :], sight.points_m) + shift_m[:, None, :])


def move_points(sight: StationSight, moved: Array) -> None:
    """Small shifts (n, smrs, 3) of the points in the frame of the station; angles and distances follow."""
    e, n, h = np.moveaxis(sight.points_m, 2, 0)
    de, dn, dh = np.moveaxis(moved, 2, 0)
    level = np.hypot(e, n)
    distance = np.hypot(level, h)
    sight.hz_rad += (n * de - e * dn) / level**2
    sight.v_rad += ((e * de + n * dn) * h / level - dh * level) / distance**2
    sight.distance_m += (e * de + n * dn + h * dh) / distance


class StationDrift(Effect):
    """The station's frame moves: `drift_m` in one hour at its distance of 3 m, by rotation and by shift.

    `held_back`: it is jostled and drawn back, with the time constant RETURN_S: G. E. Uhlenbeck, L. S. Ornstein, "On the
    Theory of the Brownian Motion" (1930). The size is its standard deviation once it has forgotten where it began.
    `flicker`: many things in it relax in times from short to long, which together drift as 1/f: M. S. Keshner, "1/f
    Noise" (1982). The size is the standard deviation over long times.
    `passers_by`: the floor gives way when somebody passes with a load, at random times, and recovers slowly, like the
    shots of N. Campbell, "The Study of Discontinuous Phenomena" (1909). The size is the standard deviation.
    `shaken_stand`: its stand creeps away under what it is pressed by, a little whenever a motion of the machine shakes
    the floor: vibrational displacement in I. I. Blekhman, "Vibrational Mechanics" (2000). It goes with the energy of
    the motions, and the size is reached at a sum of squared speeds.
    `settling_legs`: the legs of its tripod settle after it was set up, fast at first and then ever more slowly, with
    the logarithm of time: drift of tripods in D. Nindl, M. Wiebking, "Surveying Tripods: Characteristics and
    Influences" (2010).
    `thermostat`: a fan in its base is switched between two temperatures, which it nears and leaves exponentially, over
    and over: B. van der Pol, "On Relaxation-Oscillations" (1926). The size is the whole swing.
    `tracking_heat`: its motors turn it after the machine's motions and warm its base, which cools while the machine
    rests: internal sources of heat in J. B. Bryan, "International Status of Thermal Error Research" (1990). The size is
    reached where both drives together move at a mean of TRACKS_M_PER_S.
    `swaying_building`: sun, wind and lifts sway the building in two slow waves of unrelated periods, each in a
    direction of its own, like the tides of a sea: G. H. Darwin, "The Tides" (1898). The size is the amplitude of
    either.
    `carriages_weight`: the floor dips under the columns, and the station stands in the hollow of each, which is as deep
    as the weight on it: a linear body under single loads in J. Boussinesq, "Application des potentiels à l'étude de
    l'équilibre et du mouvement des solides élastiques" (1885). A column bears more the lower its carriage stands. The
    size is that of one carriage at its lower end without payload.
    `dragged_feet`: its plate grows with the air's temperature, and friction holds its feet until that has strained them
    enough, so that they follow late and stay where they are as the air turns: H. Blok, "Fundamental Mechanical Aspects
    of Boundary Friction" (1940). A kelvin beyond what friction holds moves it by DRAGGED times the size.
    `hunting_level`: a compensator levels it by a motor that is governed too sharply, so that it swings up by itself
    from hardly anything until the limits of the motor hold the swings: J. C. Maxwell, "On Governors" (1868). The
    size is the amplitude in the end.
    `crossing_truck`: a heavy truck is led at a crawl across the span of floor on which the station stands, once, and
    the floor dips there by the line of influence of a beam: E. Winkler, "Vortrag über die Berechnung von Brücken"
    (1868). The size is that of the truck right beside the station.
    `stored_payloads`: what of the payloads is not on the platform stands on the floor beside the station, which leans
    by its weight: H. M. Westergaard, "Stresses in Concrete Pavements Computed by Theoretical Analysis" (1926). The size
    is that of all of them, FULL_PAYLOAD_KG.
    """

    def setup(self) -> None:
        """Draw the direction of the drift and its walk."""
        weights = self.rng.standard_normal(6)
        self.weights = weights / np.linalg.norm(weights) * np.sqrt(3.0)
        self.walk: RandomWalk | Flicker = RandomWalk(self.rng, 6)
        if self.variant == "flicker":
            self.walk = Flicker(self.rng, 6)
        elif self.variant == "held_back":
            self.walk = HeldWalk(self.rng, 6)
        self.onset_s = float(self.rng.uniform(900.0, 3600.0))
        if self.variant == "passers_by":
            self.passed_s = np.cumsum(self.rng.exponential(PASSERS_S, PASSERS))
            self.pushes = self.rng.standard_normal((PASSERS, 6)) * math.sqrt(2.0 * PASSERS_S / FORGETS_S)
        self._shaken = [LegMemory(lambda way, speed, _: speed**2 * (way != 0.0)) for _ in self.site.machine.sliders]
        self._tracked = [
            LegMemory(lambda way, _speed, _: np.abs(way) / (TRACKS_M_PER_S * COOLS_S), COOLS_S)
            for _ in self.site.machine.sliders
        ]
        own = self.rng.spawn(1)[0]  # a walk goes on drawing from the other one
        self.cycle_s = float(own.uniform(*FANS_S))
        self.runs = float(own.uniform(*RUNS))
        self.sways_s = np.array([float(own.uniform(*period_s)) for period_s in SWAYS_S])
        sways = own.standard_normal((2, 6))
        self.sways = sways / np.linalg.norm(sways, axis=1)[:, None] * np.sqrt(3.0)
        hollows = own.standard_normal((len(self.site.machine.sliders), 6))
        self.hollows = hollows / np.linalg.norm(hollows, axis=1)[:, None] * np.sqrt(3.0)
        self.holds_k = float(own.uniform(*HOLDS_K))
        self.level_s, self.grows_s = float(own.uniform(*LEVEL_S)), float(own.uniform(*GROWS_S))
        self.truck_s, self.crosses_s = float(own.uniform(*TRUCK_S)), float(own.uniform(*CROSSES_S))
        self.stands = float(own.uniform(*STANDS))

    def _switched(self, elapsed_s: Array) -> Array:
        """Warmth (n,) from 0, where the fan stops, to 1, where it starts; SWITCHES is the time constant of either part
        over how long that lasts."""
        at, warms = elapsed_s / self.cycle_s % 1.0, 1.0 - self.runs
        rest, run = np.minimum(at / warms, 1.0), np.maximum(at - warms, 0.0) / self.runs
        most = -math.expm1(-1.0 / SWITCHES)
        return np.asarray(
            np.where(at < warms, -np.expm1(-rest / SWITCHES), np.exp(-run / SWITCHES) - 1.0 + most) / most
        )

    def _hunted(self, elapsed_s: Array) -> Array:
        """Swing (n,) whose amplitude grows until it is limited: da/dt = a (1 - a^2) / grows_s."""
        swing = 1.0 / np.sqrt(1.0 + (STARTS**-2 - 1.0) * np.exp(-2.0 * elapsed_s / self.grows_s))
        return np.asarray(swing * np.sin(2.0 * np.pi * elapsed_s / self.level_s))

    def _dipped(self, elapsed_s: Array) -> Array:
        """How far the floor has dipped under the station (n,) by where a truck is, over that right beside it."""
        truck = np.clip((elapsed_s - self.truck_s) / self.crosses_s, 0.0, 1.0)
        near, far = np.minimum(truck, self.stands), 1.0 - np.maximum(truck, self.stands)
        return np.asarray(near * far * (1.0 - near**2 - far**2) / (2.0 * (self.stands * (1.0 - self.stands)) ** 2))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every motion shake the stand, or warm what follows it."""
        if self.variant == "tracking_heat":
            self._tracked[drive].record(leg)
        if self.variant == "shaken_stand":
            self._shaken[drive].record(leg)

    def _passed(self, elapsed_s: Array) -> Array:
        """What is left of all passages, summed (n, 6)."""
        ago = elapsed_s[:, None] - self.passed_s
        return np.asarray(np.where(ago >= 0.0, np.exp(-np.maximum(ago, 0.0) / FORGETS_S), 0.0) @ self.pushes)

    def _weighs(self, state: MotionState) -> Array:
        """Weight on each column (n, drives) over that of a carriage at its lower end without payload."""
        low, high = np.array([slider.travel_m for slider in self.site.machine.sliders]).T
        own_kg = self.site.machine.moving_mass_kg
        return np.asarray((high - state.q_m) / (high - low) * ((own_kg + state.payload_kg) / own_kg)[:, None])

    def _by_air_k(self, state: MotionState) -> Array:
        """Change of the air's temperature since the begin (n,), or what of it the feet have followed."""
        start_s = self.site.start_s
        if self.variant == "with_air":
            return state.thermal.air_series_c(state.t_s) - state.thermal.air_series_c(np.array([start_s]))
        grid = grid_from(start_s, state)
        air_c = state.thermal.air_series_c(grid)
        followed, now = np.empty_like(grid), 0.0
        for k, warmer_k in enumerate((air_c - air_c[0]).tolist()):
            now = min(max(now, warmer_k - self.holds_k), warmer_k + self.holds_k)
            followed[k] = now
        return np.asarray(np.interp(state.t_s, grid, followed))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Move the frame."""
        t = self.elapsed_s(state)
        if self.variant in ("random_walk", "held_back", "flicker"):
            y = self.walk.at(t)
        elif self.variant == "passers_by":
            y = self._passed(t)
        elif self.variant == "shaken_stand":
            shaken = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._shaken))
            y = np.outer(shaken / SHAKEN_M2_PER_S2, self.weights)
        elif self.variant == "tracking_heat":
            heat = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._tracked))
            y = np.outer(heat, self.weights)
        elif self.variant == "swaying_building":
            y = np.sin(2.0 * np.pi * t[:, None] / self.sways_s) @ self.sways
        elif self.variant in ("carriages_weight", "stored_payloads"):
            stored = np.outer(1.0 - state.payload_kg / FULL_PAYLOAD_KG, self.weights)
            y = stored if self.variant == "stored_payloads" else self._weighs(state) @ self.hollows
        elif self.variant == "settling_legs":
            y = np.outer(np.log1p(t / SETTLES_S) / np.log1p(HOUR_S / SETTLES_S), self.weights)
        elif self.variant in ("thermostat", "hunting_level", "crossing_truck"):
            courses = {"thermostat": self._switched, "hunting_level": self._hunted, "crossing_truck": self._dipped}
            y = np.outer(courses[self.variant](t), self.weights)
        elif self.variant == "warm_up":
            y = np.outer(1.0 - np.exp(-t / 1800.0), self.weights)
        elif self.variant in ("with_air", "dragged_feet"):
            y = np.outer(DRAGGED * self._by_air_k(state), self.weights)
        elif self.variant == "knocked":
            y = np.outer((t >= self.onset_s).astype(float), self.weights)
        else:
            y = np.outer(t / HOUR_S, self.weights)
        move_station(sight, self.size / LEVER_M / np.sqrt(2.0) * y[:, :3], self.size / np.sqrt(2.0) * y[:, 3:])


EFFECTS = (
    EffectSpec(
        name="tracker_drift",
        kind="catalogue",
        place="rig",
        size=EffectParameter("drift_m", 1e-6, 4e-5, 1e-3, "at 3 m after one hour"),
        variants=(
            "linear",
            "random_walk",
            "warm_up",
            "with_air",
            "knocked",
            "held_back",
            "flicker",
            "passers_by",
            "shaken_stand",
            "settling_legs",
            "thermostat",
            "tracking_heat",
            "swaying_building",
            "carriages_weight",
            "dragged_feet",
            "hunting_level",
            "crossing_truck",
            "stored_payloads",
        ),
        final="stored_payloads",
        reveals="time or motions made, by variant both drives' coordinates, payload and a temperature swing, floor "
        "nests",
        make=StationDrift,
    ),
    EffectSpec(
        name="refraction",
        kind="catalogue",
        place="rig",
        size=EffectParameter("gradient_k_per_m", 0.1, 3.0, 150.0, "of the air's temperature"),
        variants=(
            "uniform",
            "stratified",
            "warming",
            "sideways",
            "plume",
            "index_offset",
            "index_fixed",
            "index_late",
            "power_law",
            "two_layers",
            "cold_floor",
            "warm_jet",
            "filling_box",
            "cold_walls",
            "stirred",
            "sun_patch",
            "warm_puffs",
            "heaving_layers",
            "convection_cells",
            "tilting_layer",
            "warm_workpiece",
            "gas_lens",
        ),
        final="gas_lens",
        reveals="angles, or ranges, against height and distance, by variant time, payload, motions made, all SMRs "
        "and nests alike",
        make=Refraction,
    ),
)
