"""Air along the line of sight: it bends light, and a correction for other air stretches ranges."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Effect, Leg, MotionState, StationSight
from mock_devices.effects.followers import Stirred
from mock_devices.effects.warming import AIR, lag_behind

LIGHT_PER_K = -0.93e-6  # refractive index of air against temperature
RANGE = ("index_offset", "index_fixed", "index_late")
PRESSURE_K_PER_HPA = 0.27e-6 / LIGHT_PER_K  # denser air is slower, as colder air is
UPDATE_S = 2400.0
FLOOR_SENSOR = "base"
FLOOR_M = -1.2  # in the machine's frame
POWER = -1.0 / 3.0
LOWEST = 0.02  # of the station's height: so near the floor no reflector is
LAYER_M, LAYER_HALF_M = 0.25, 0.2  # of the layer between cool and warm air: above the station, half its thickness
EDDIES_M2_PER_S = (1.0e-4, 6.0e-4)  # how fast eddies carry heat upwards
FRONT_M, FRONT_HALF_M = (2.5, -1.5), 0.25  # ceiling and floor against the station; half of a front's thickness
FILLS_S = (600.0, 2500.0)  # time constant of warm air that fills a room
ABOVE = 0.3  # gradient above the front, over that in it
WALLS_S, WALLS_K = (3000.0, 8000.0), 1.5  # time constant of walls; what they lag behind by for the whole gradient
STIRS_M, FORMS_S = 15.0, (500.0, 1500.0)  # way in which a drive mixes the air to 1 / e; in which layers form anew
JET_SHARE, JET_WIDE_M, JET_HALF_M = 0.5, 0.6, 0.15  # of a warm jet: share of the line before it, width, half height
JET_M = (-0.25, 0.05)  # its middle above the station
PATCH_S, PATCH_FROM_M, PATCH_HALF_M = (3500.0, 7000.0), 0.35, 0.18  # of a sunny patch: time to cross; begin; width
PATCH_UP_M = 0.5  # height over the station's in which what rises from the patch has mixed to 1 / e
HEAVES_S, HEAVES_M = (100.0, 300.0), 0.25  # of a layer that heaves: period, height either way
TILTS, TILTS_S = 0.8, (150.0, 600.0)  # of a layer that swings: slope to either side; period
ROLLS_M, WANDERS_S = (0.15, 0.3), (2500.0, 6000.0)  # of rolls of air: width of two; time to wander that far
WARM_KG, ASIDE_RAD = 400.0, (-0.9, 0.9)  # of warm workpieces: mass for the size; how far aside of upright the air
# over them is warmer
PUFFS_S, PUFFS = 60.0, 200  # of warm air: mean time between two; how many are drawn
PUFF_M, PUFF_FROM_M, PUFF_M_PER_S, PUFF_PASSES_S = 0.15, 0.35, 0.1, 20.0  # half width; farthest from the middle; speed;
# time in which half of one passes
TUBE_M, TUBE_ACROSS_M, TUBE_UP_M = 0.18, (-0.25, 0.25), (-0.2, 0.3)  # of a warm tube: radius; its middle halfway to the
# machine, by the station
_GAUSS = (np.array([0.1127016654, 0.5, 0.8872983346]), np.array([5.0, 8.0, 5.0]) / 18.0)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_FINE = (0.5 + 0.5 * _NODES, 0.5 * _WEIGHTS)


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
    `filling_box`: warm air that has risen from a machine gathers under the ceiling and fills the room from there; its
    lower front sinks as (1 + t / T)^(-3/2) from ceiling to floor: W. D. Baines, J. S. Turner, "Turbulent Buoyant
    Convection From a Source in a Confined Region" (1969). The gradient is that in the front; it is less above it.
    `cold_walls`: walls of the hall on one side lag behind its air, and the air is cooler towards them while it grows
    warmer, the other way round while it cools: gradients to the side in W. T. Estler, K. L. Edmundson, G. N. Peggs, D.
    H. Parker, "Large-Scale Metrology: An Update" (2002). The gradient is that of walls which lag behind by WALLS_K.
    `stirred`: the machine's motions mix the layers of the hall, which form anew while it rests: P. F. Linden, "Mixing
    in Stratified Fluids" (1979). Each drive stirs its part. The gradient is that of layers at rest.
    `sun_patch`: the sun warms a patch of the floor halfway to the machine, which wanders to the other side; the air
    over it is warmer below, less so higher up, and bends lines upwards, so that all behind it seems lower: A. B.
    Fraser, W. H. Mach, "Mirages" (1976). The gradient is that over its middle at the height of the station.
    `warm_puffs`: puffs of warm air rise halfway to the machine at random moments, here and there, and pass the lower
    lines first; lines beside its middle bend around it, sideways: J. S. Turner, "Buoyant Vortex Rings" (1957).
    The gradient is the largest one in a puff.
    `heaving_layers`: the layer between cool air and warm heaves up and down as buoyancy draws it back: D. Brunt, "The
    Period of Simple Vertical Oscillations in the Atmosphere" (1927). The gradient is that in the middle of the layer.
    `convection_cells`: over a warm floor air rises and sinks side by side in rolls that stand across the lines and
    wander slowly, warmer and cooler by turns: H. Bénard, "Les tourbillons cellulaires dans une nappe liquide" (1900).
    Lines bend sideways, this way and that. The gradient is the largest one between two of them.
    `tilting_layer`: the layer between cool air and warm swings across the hall like water in a trough, up on one side
    and down on the other by turns: J. R. Merian, "Ueber die Bewegung tropfbarer Flüssigkeiten in Gefässen" (1828). The
    gradient is that in the middle of the layer.
    `warm_workpiece`: payloads come warm from the store, and the air that they warm beside the lines of sight bends
    these up and aside, in proportion to their mass and not at all without: A. Toepler, "Beobachtungen nach einer neuen
    optischen Methode" (1864). The gradient is that of WARM_KG.
    `gas_lens`: a tube of warm air lies along the lines halfway to the machine, and lines beside its middle bend
    outwards to all sides, as through a lens: D. W. Berreman, "A Lens or Light Guide Using Convectively Distorted
    Thermal Gradients in Gases" (1964). The gradient is the largest one in the tube.
    """

    def setup(self) -> None:
        """How fast the cold of variant `cold_floor` rises, how high the jet blows, and how fast a room is filled."""
        self.eddies = float(np.exp(self.rng.uniform(*np.log(EDDIES_M2_PER_S))))
        self.jet_m = float(self.rng.uniform(*JET_M))
        self.fills_s = float(self.rng.uniform(*FILLS_S))
        self.walls_s = float(self.rng.uniform(*WALLS_S))
        self.forms_s = float(self.rng.uniform(*FORMS_S))
        self.crosses_s = float(self.rng.uniform(*PATCH_S))
        self.wanders = float(self.rng.choice([-1.0, 1.0]))
        self.puffs_s = np.cumsum(self.rng.exponential(PUFFS_S, PUFFS))
        self.puffs_m = self.rng.uniform(-PUFF_FROM_M, PUFF_FROM_M, PUFFS)
        self.heaves_s = float(self.rng.uniform(*HEAVES_S))
        self.heaves_at = float(self.rng.uniform(0.0, 2.0 * np.pi))
        own = self.rng.spawn(1)[0]
        self.rolls_m, self.wanders_s = float(own.uniform(*ROLLS_M)), float(own.uniform(*WANDERS_S))
        self.rolls_at = float(own.uniform(0.0, 2.0 * np.pi))
        self.tilts_s, self.tilts_at = float(own.uniform(*TILTS_S)), float(own.uniform(0.0, 2.0 * np.pi))
        self.aside_rad = float(own.uniform(*ASIDE_RAD))
        self.tube_m = (float(own.uniform(*TUBE_ACROSS_M)), float(own.uniform(*TUBE_UP_M)))
        self._stirred = [Stirred(STIRS_M, self.forms_s) for _ in self.site.machine.sliders]

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every motion mix the layers."""
        if self.variant == "stirred":
            self._stirred[drive].record(leg)

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
        height = self._over_tilted_m(state, sight) if self.variant == "tilting_layer" else sight.points_m[..., 2]
        if self.variant in ("cold_floor", "filling_box", "two_layers", "stirred", "heaving_layers", "tilting_layer"):
            sight.v_rad += bend * self._gradient(state, height) * np.sin(sight.v_rad)
        elif self.variant == "warm_jet":
            off = (height * JET_SHARE - self.jet_m) / JET_HALF_M
            slope = -math.sqrt(2.0 * math.e) * off * np.exp(-(off**2))
            sight.v_rad += LIGHT_PER_K * self.size * JET_WIDE_M * (1.0 - JET_SHARE) * slope * np.sin(sight.v_rad)
        elif self.variant in ("warm_puffs", "convection_cells"):
            aside = self._puffed if self.variant == "warm_puffs" else self._rolled
            sight.hz_rad += bend * aside(state, sight)
        elif self.variant in ("warm_workpiece", "gas_lens"):
            workpiece = self.variant == "warm_workpiece"
            across, up = self._over_workpiece(state) if workpiece else self._through_tube(sight)
            sight.hz_rad -= bend * across
            sight.v_rad += bend * up * np.sin(sight.v_rad)
        elif self.variant == "sun_patch":
            sight.v_rad -= bend * self._over_patch(state, sight) * np.sin(sight.v_rad)
        elif self.variant == "stratified":  # the gradient grows towards the ceiling
            sight.v_rad += bend * (1.0 + 1.5 * height)
        elif self.variant == "warming":
            sight.v_rad += bend * (1.0 - np.exp(-self.elapsed_s(state) / 2400.0))[:, None]
        elif self.variant in ("cold_walls", "sideways"):  # warmer on one side of the room
            walls = self.variant == "cold_walls"
            colder_k = (
                -lag_behind(state, AIR, self.site.start_s, self.walls_s) if walls else np.full(len(state), WALLS_K)
            )
            sight.hz_rad -= bend * colder_k[:, None] / WALLS_K
        elif self.variant == "plume":  # warm air rises in front of the right column
            across = sight.points_m[..., 0]
            sight.hz_rad -= 1.5 * bend * np.exp(-(((across - 0.6) / 0.5) ** 2)) * (1.0 + height)
        else:
            sight.v_rad += bend * np.sin(sight.v_rad)

    def _over_patch(self, state: MotionState, sight: StationSight) -> Array:
        """Gradient halfway along each line (n, smrs) over that in the middle of the patch."""
        at_m = self.wanders * PATCH_FROM_M * (2.0 * self.elapsed_s(state)[:, None] / self.crosses_s - 1.0)
        off = (0.5 * sight.points_m[..., 0] - at_m) / PATCH_HALF_M
        return np.asarray(np.exp(-(off**2) - 0.5 * sight.points_m[..., 2] / PATCH_UP_M))

    def _through_tube(self, sight: StationSight) -> tuple[Array, Array]:
        """Gradient across and up halfway along each line (n, smrs), over the largest; warm air is in the middle."""
        across, up = (
            (0.5 * sight.points_m[..., axis] - at_m) / TUBE_M for axis, at_m in zip((0, 2), self.tube_m, strict=True)
        )
        falls = math.sqrt(2.0 * math.e) * np.exp(-(across**2) - up**2)
        return np.asarray(-across * falls), np.asarray(-up * falls)

    def _over_workpiece(self, state: MotionState) -> tuple[Array, Array]:
        """Gradient across and up (n, 1) by the mass of a warm payload, over that of WARM_KG."""
        warm = state.payload_kg[:, None] / WARM_KG
        return warm * math.sin(self.aside_rad), warm * math.cos(self.aside_rad)

    def _over_tilted_m(self, state: MotionState, sight: StationSight) -> Array:
        """Heights (n, smrs) over a slope through the station that swings, along which each line rises as evenly."""
        turn = 2.0 * np.pi * self.elapsed_s(state)[:, None] / self.tilts_s + self.tilts_at
        return np.asarray(sight.points_m[..., 2] - TILTS * np.sin(turn) * sight.points_m[..., 0])

    def _rolled(self, state: MotionState, sight: StationSight) -> Array:
        """Gradient to the left halfway along each line (n, smrs) over the largest one between two rolls."""
        wandered = 2.0 * np.pi * self.elapsed_s(state)[:, None] / self.wanders_s + self.rolls_at
        return np.asarray(-np.cos(2.0 * np.pi * 0.5 * sight.points_m[..., 0] / self.rolls_m + wandered))

    def _puffed(self, state: MotionState, sight: StationSight) -> Array:
        """Gradient outwards halfway along each line (n, smrs) over the largest one in a puff, summed over all puffs."""
        across_m, up_m = 0.5 * sight.points_m[..., 0], 0.5 * sight.points_m[..., 2]
        after_s = self.elapsed_s(state)[:, None] - up_m / PUFF_M_PER_S
        total = np.zeros_like(across_m)
        for began_s, at_m in zip(self.puffs_s.tolist(), self.puffs_m.tolist(), strict=True):
            off, passed = (across_m - at_m) / PUFF_M, (after_s - began_s) / PUFF_PASSES_S
            total += math.sqrt(2.0 * math.e) * off * np.exp(-(off**2) - passed**2)
        return total

    def _index_off(self, state: MotionState) -> Array:
        """By how many kelvin for each of the gradient the index of the ranges is off (n,)."""
        if self.variant == "index_offset":
            return np.ones(len(state))
        start = np.full(len(state), self.site.start_s)
        if self.variant == "index_late":  # entered by hand, now and then
            start = start + np.floor(self.elapsed_s(state) / UPDATE_S) * UPDATE_S
        return weather_k(state, state.t_s) - weather_k(state, start)

    def _gradient(self, state: MotionState, height_m: Array) -> Array:
        """Mean gradient over a line to a height, weighted towards the station, over the size."""
        if self.variant == "cold_floor":
            return self._cold_gradient(state, height_m)
        if self.variant == "filling_box":
            return self._front_gradient(state, height_m)
        if self.variant == "stirred":
            return np.mean([part.at(state, drive) for drive, part in enumerate(self._stirred)], axis=0)[:, None]
        if self.variant == "heaving_layers":
            turn = 2.0 * np.pi * self.elapsed_s(state)[:, None] / self.heaves_s + self.heaves_at
            return self._mean_gradient(height_m, HEAVES_M * np.sin(turn))
        return self._mean_gradient(height_m)

    def _mean_gradient(self, height_m: Array, lifted_m: Array | float = 0.0) -> Array:
        """Mean gradient over a line to a height, weighted towards the station, over that in the layer's middle."""
        total = np.zeros_like(height_m)
        for node, weight in zip(*_FINE, strict=True):
            total += 2.0 * weight * (1.0 - node) / np.cosh((height_m * node - LAYER_M - lifted_m) / LAYER_HALF_M) ** 2
        return total

    def _front_gradient(self, state: MotionState, height_m: Array) -> Array:
        """Mean gradient over a line to a height, weighted towards the station, over that in the sinking front."""
        ceiling, floor = FRONT_M
        front_m = floor + (ceiling - floor) * (1.0 + self.elapsed_s(state)[:, None] / self.fills_s) ** -1.5
        total = np.zeros_like(height_m)
        for node, weight in zip(*_FINE, strict=True):
            above = (height_m * node - front_m) / FRONT_HALF_M
            total += 2.0 * weight * (1.0 - node) * (1.0 / np.cosh(above) ** 2 + 0.5 * ABOVE * (1.0 + np.tanh(above)))
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
