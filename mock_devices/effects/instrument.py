"""What the station sees differently: drift of its frame, bent light, reflectors taken off and put on again."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    StationSight,
    names_of,
)
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.walks import HOUR_S, Flicker, HeldWalk, RandomWalk

LEVER_M = 3.2
LIGHT_PER_K = -0.93e-6  # refractive index of air against temperature
RANGE = ("index_offset", "index_fixed", "index_late")
PRESSURE_K_PER_HPA = 0.27e-6 / LIGHT_PER_K  # denser air is slower, as colder air is
UPDATE_S = 2400.0
FLOOR_SENSOR = "base"
FLOOR_M = -1.2  # in the machine's frame
POWER = -1.0 / 3.0
LOWEST = 0.02  # of the station's height: so near the floor no reflector is
GIVES, CREEPS = 0.2, 0.25  # of the size at once; exponent of time
LAYER_M, LAYER_HALF_M = 0.25, 0.2  # of the layer between cool and warm air: above the station, half its thickness
EDDIES_M2_PER_S = (1.0e-4, 6.0e-4)  # how fast eddies carry heat upwards
PASSERS_S, PASSERS, FORGETS_S = 240.0, 400, 600.0  # mean time between passers-by; how many; time constant of recovery
JET_SHARE, JET_WIDE_M, JET_HALF_M = 0.5, 0.6, 0.15  # of a warm jet: share of the line before it, width, half height
JET_M = (-0.25, 0.05)  # its middle above the station
BALL_TURN_M = 80.0  # travel of all drives in which a ball turns once in its seat
SEATS_S = 900.0  # how long a reflector stays in one of two seats, in the mean
_GAUSS = (np.array([0.1127016654, 0.5, 0.8872983346]), np.array([5.0, 8.0, 5.0]) / 18.0)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_FINE = (0.5 + 0.5 * _NODES, 0.5 * _WEIGHTS)


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

    def _passed(self, elapsed_s: Array) -> Array:
        """What is left of all passages, summed (n, 6)."""
        ago = elapsed_s[:, None] - self.passed_s
        return np.asarray(np.where(ago >= 0.0, np.exp(-np.maximum(ago, 0.0) / FORGETS_S), 0.0) @ self.pushes)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Move the frame."""
        t = self.elapsed_s(state)
        if self.variant in ("random_walk", "held_back", "flicker"):
            y = self.walk.at(t)
        elif self.variant == "passers_by":
            y = self._passed(t)
        elif self.variant == "warm_up":
            y = np.outer(1.0 - np.exp(-t / 1800.0), self.weights)
        elif self.variant == "with_air":
            start = state.thermal.air_series_c(np.array([self.site.start_s]))
            y = np.outer(3.0 * (state.thermal.air_series_c(state.t_s) - start), self.weights)
        elif self.variant == "knocked":
            y = np.outer((t >= self.onset_s).astype(float), self.weights)
        else:
            y = np.outer(t / HOUR_S, self.weights)
        move_station(sight, self.size / LEVER_M / np.sqrt(2.0) * y[:, :3], self.size / np.sqrt(2.0) * y[:, 3:])


class Refraction(Effect):
    """Air that is warmer above bends the light towards the floor, so that everything seems higher.

    Curvature = (dn/dT)(dT/dh); the angle at the station is half of it times the distance. Forms in RANGE bend nothing:
    the index that ranges are corrected with is that of air one metre off, warmer or colder by the gradient times what
    the weather does, so that the scale of ranges follows the weather whatever the recorded correction says.
    `power_law`: the profile T = a + b h^c with c = -1/3 of T. J. Kukkamäki, "Über die nivellitische Refraktion" (1938);
    b goes with the air's temperature above that of the machine's base, which stands for the floor's.
    `two_layers`: cool air below, warm air above, as inlets low down and outlets under the ceiling leave it in P. F.
    Linden, G. F. Lane-Serff, D. A. Smeed, "Emptying filling boxes: the fluid mechanics of natural ventilation" (1990),
    with a layer between them that has the profile tanh; the gradient is that in the middle of the layer.
    `cold_floor`: cold air has come in over the floor at the campaign's begin, and eddies carry the cold upwards as
    conduction would, so that the gradient is a bell over the floor that widens with the root of time: G. I. Taylor,
    "Eddy Motion in the Atmosphere" (1915). The cold is that of the gradient over the station's height.
    `warm_jet`: a heater blows warm air across the lines of sight halfway along them, with the bell-shaped profile over
    height that jets have in G. N. Abramovich, "The Theory of Turbulent Jets" (1963): lines bend away from its middle on
    either side. The gradient is the largest one in the jet.
    """

    def setup(self) -> None:
        """How fast the cold of variant `cold_floor` rises, and how high the jet blows."""
        self.eddies = float(np.exp(self.rng.uniform(*np.log(EDDIES_M2_PER_S))))
        self.jet_m = float(self.rng.uniform(*JET_M))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Bend the line of sight, or stretch it."""
        if self.variant in RANGE:
            sight.distance_m *= 1.0 + LIGHT_PER_K * self.size * self._index_off(state)[:, None]
            return
        if self.variant == "power_law":
            above_k = state.thermal.air_series_c(state.t_s) - state.parts_c[FLOOR_SENSOR]
            sight.v_rad += self._bend_over_floor(sight) * above_k[:, None]
            return
        bend = 0.5 * LIGHT_PER_K * self.size * sight.distance_m
        height = sight.points_m[..., 2]
        if self.variant == "cold_floor":
            sight.v_rad += bend * self._cold_gradient(state, height) * np.sin(sight.v_rad)
        elif self.variant == "warm_jet":
            off = (height * JET_SHARE - self.jet_m) / JET_HALF_M
            slope = -math.sqrt(2.0 * math.e) * off * np.exp(-(off**2))
            sight.v_rad += LIGHT_PER_K * self.size * JET_WIDE_M * (1.0 - JET_SHARE) * slope * np.sin(sight.v_rad)
        elif self.variant == "two_layers":
            sight.v_rad += bend * self._mean_gradient(height) * np.sin(sight.v_rad)
        elif self.variant == "stratified":  # the gradient grows towards the ceiling
            sight.v_rad += bend * (1.0 + 1.5 * height)
        elif self.variant == "warming":
            sight.v_rad += bend * (1.0 - np.exp(-self.elapsed_s(state) / 2400.0))[:, None]
        elif self.variant == "sideways":  # warmer on one side of the room
            sight.hz_rad -= bend
        elif self.variant == "plume":  # warm air rises in front of the right column
            across = sight.points_m[..., 0]
            sight.hz_rad -= 1.5 * bend * np.exp(-(((across - 0.6) / 0.5) ** 2)) * (1.0 + height)
        else:
            sight.v_rad += bend * np.sin(sight.v_rad)

    def _index_off(self, state: MotionState) -> Array:
        """By how many kelvin for each of the gradient the index of the ranges is off (n,)."""
        if self.variant == "index_offset":
            return np.ones(len(state))
        start = np.full(len(state), self.site.start_s)
        if self.variant == "index_late":  # entered by hand, now and then
            start = start + np.floor(self.elapsed_s(state) / UPDATE_S) * UPDATE_S
        return weather_k(state, state.t_s) - weather_k(state, start)

    def _mean_gradient(self, height_m: Array) -> Array:
        """Mean gradient over a line to a height, weighted towards the station, over that in the layer's middle."""
        total = np.zeros_like(height_m)
        for node, weight in zip(*_FINE, strict=True):
            total += 2.0 * weight * (1.0 - node) / np.cosh((height_m * node - LAYER_M) / LAYER_HALF_M) ** 2
        return total

    def _cold_gradient(self, state: MotionState, height_m: Array) -> Array:
        """Mean gradient over a line to a height, weighted towards the station, over cold by the station's height."""
        station_m = self.site.station_m[1] - FLOOR_M
        up_m = np.sqrt(np.maximum(4.0 * self.eddies * self.elapsed_s(state), 1.0e-4))[:, None]
        total = np.zeros_like(height_m)
        for node, weight in zip(*_FINE, strict=True):
            over_floor = (height_m * node + station_m) / up_m
            total += 2.0 * weight * (1.0 - node) * np.exp(-(over_floor**2))
        return total * 2.0 / math.sqrt(math.pi) * station_m / up_m

    def _bend_over_floor(self, sight: StationSight) -> Array:
        """Angles (n, smrs) at the station: the mean of the curvature over the line, weighted towards the station.

        The gradient is `size` at the height of the station for air that is 1 K warmer than the floor.
        """
        low_m = FLOOR_M - self.site.station_m[1]
        total = np.zeros_like(sight.distance_m)
        for node, weight in zip(*_GAUSS, strict=True):
            height = np.maximum((sight.points_m[..., 2] * node - low_m) / -low_m, LOWEST)
            total += weight * (1.0 - node) * height ** (POWER - 1.0)
        return LIGHT_PER_K * self.size * total * sight.distance_m * np.sin(sight.v_rad)


def weather_k(state: MotionState, t_s: Array) -> Array:
    """Weather (n,) as the temperature that has the same effect on the index."""
    return state.thermal.air_series_c(t_s) + PRESSURE_K_PER_HPA * state.thermal.pressure_series_hpa(t_s)


class Reseat(Effect):
    """A reflector that was taken off and does not sit where it sat.

    `adhesive_tape`: its mount gives at once and creeps on with a power of time, as plastics do in W. N. Findley, "Creep
    Characteristics of Plastics" (1944); the size is reached after an hour.
    `chip_in_seat`: put on again upon a chip, it sits in one of two places and jumps by chance: the random telegraph
    signal of S. O. Rice, "Mathematical Analysis of Random Noise" (1944).
    `turning_ball`: the machine's motions turn the ball in its seat, and the vertex of its mirrors, which is off the
    ball's centre, goes round: runout in R. E. Bridges, "Method for Measuring 3D Coordinates of a Spherically Mounted
    Retroreflector from Multiple Stations" (US patent 9,074,869, 2015). The size is the circle's diameter.
    """

    def setup(self) -> None:
        """Directions of the shifts, in the plane."""
        angles = self.rng.uniform(0.0, 2.0 * np.pi, 64)
        lengths = np.concatenate([[1.0], self.rng.uniform(0.3, 1.2, 63)])
        self.shifts = np.stack([lengths * np.cos(angles), lengths * np.sin(angles)], axis=1)
        self.jumps_s = np.cumsum(self.rng.exponential(SEATS_S, 256))
        onset_s = self.site.start_s + self.values["onset_s"]
        self._ways = [
            LegMemory(lambda way, _speed, start_s: np.abs(way) * (start_s >= onset_s))
            for _ in self.site.machine.sliders
        ]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let all travel after the onset turn the ball."""
        if self.variant == "turning_ball":
            self._ways[drive].record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the reflector."""
        t = state.t_s - self.site.start_s - self.values["onset_s"]
        after = t >= 0.0
        if self.variant == "each_exchange":  # taken off whenever the payload is exchanged
            number = state.exchanges.astype(int) % 64
            y = np.where((number > 0)[:, None], self.shifts[number], 0.0)
        elif self.variant == "glue":
            y = np.outer(1.0 - np.exp(-np.maximum(t, 0.0) / 900.0), self.shifts[0])
        elif self.variant == "loose":  # a little further every few minutes
            number = np.floor(np.maximum(t, 0.0) / 600.0).astype(int) % 64
            y = np.where(after[:, None], self.shifts[number], 0.0)
        elif self.variant == "chip_in_seat":
            jumped = np.searchsorted(self.jumps_s, np.maximum(t, 0.0), side="right")
            y = np.where((after & (jumped % 2 == 0))[:, None], self.shifts[0], 0.0)
        elif self.variant == "adhesive_tape":
            crept = GIVES + (1.0 - GIVES) * (np.maximum(t, 0.0) / HOUR_S) ** CREEPS
            y = np.where(after[:, None], np.outer(crept, self.shifts[0]), 0.0)
        elif self.variant == "turning_ball":
            way_m = sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._ways))
            corner = complex(*self.shifts[0]) * 0.5 * np.expm1(2j * np.pi * way_m / BALL_TURN_M)
            y = np.stack([corner.real, corner.imag], axis=1)
        elif self.variant == "put_back":
            y = np.where((after & (t < 1500.0))[:, None], self.shifts[0], 0.0)
        else:
            y = np.where(after[:, None], self.shifts[0], 0.0)
        names = [smr.name for smr in self.site.machine.smrs]
        index = names.index(names_of(self.site.machine, "smr")[self.place])
        deviation.smr_m[:, index, :2] += self.size * y


EFFECTS = (
    EffectSpec(
        name="tracker_drift",
        kind="catalogue",
        place="rig",
        size=EffectParameter("drift_m", 1e-6, 4e-5, 1e-3, "at 3 m after one hour"),
        variants=("linear", "random_walk", "warm_up", "with_air", "knocked", "held_back", "flicker", "passers_by"),
        final="passers_by",
        reveals="time, floor nests",
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
        ),
        final="warm_jet",
        reveals="angles, or ranges, against height and distance, all SMRs and nests alike",
        make=Refraction,
    ),
    EffectSpec(
        name="smr_reseat",
        kind="catalogue",
        place="smr",
        size=EffectParameter("shift_m", 1e-6, 2e-5, 4e-4, "of one reflector"),
        variants=(
            "step",
            "each_exchange",
            "glue",
            "loose",
            "put_back",
            "adhesive_tape",
            "chip_in_seat",
            "turning_ball",
        ),
        final="turning_ball",
        reveals="time or distance moved, one SMR against the others",
        make=Reseat,
        others=(EffectParameter("onset_s", 0.0, 2400.0, 7200.0, "after the campaign's begin"),),
    ),
)
