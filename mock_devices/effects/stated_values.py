"""What is stated of the rig and not so: expansion, payloads, and that its tables are off."""

from __future__ import annotations

import cmath

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.base import (
    GRAVITY_M_PER_S2,
    Array,
    Complex,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    MotionState,
)
from mock_devices.effects.tables_left_on import TablesLeftOn
from mock_devices.effects.warming import lag_behind

FULL_PAYLOAD_KG = 400.0
LEVER_M = 0.5
NICKEL_K = 5.0  # by how much warmer the part with the square of the temperature is as large as the straight one
LATE_S = 2400.0
SLOSHES_S, CALMS_S, SLOSH_M_PER_S = 4.5, 15.0, 0.5  # of a pan of liquid: period, time constant, speed
LIGHT_METAL = 4.0  # how far light metal is off from steel, over one steel from another
FEET_K = (0.06, 0.2)  # by how much warmer a frame pushes its feet on
FILLS_S, DRAINS_S = 150.0, 400.0  # of coolant on the platform: time constants with and without its pump
SOAKS_S = 3600.0  # in which a block has drawn up the whole size
TURNS_K, TURNS_BACK_K, TURNS_OVER_K = (0.05, 0.25), (0.1, 0.25), 0.1  # see `martensite`: above the begin; loop; width
ALLOY_K = 2.0  # growth without a change of phase that is as large as the change
CHIPS_S = 3600.0  # in which the whole size has gathered
_GRID_S = 30.0


class ExpansionCoefficient(Effect):
    """Parts expand by `coefficient_per_k` more than the machine file states.

    `bimetal`: the guide's rails expand otherwise than the columns that they are bolted to, and the columns bend, as in
    S. Timoshenko, "Analysis of Bi-Metal Thermostats" (1925), for layers of equal thickness and stiffness.
    `fibres`: a frame of fibres in resin grows across the fibres and hardly along them, by a tensor of expansion: R. A.
    Schapery, "Thermal Expansion Coefficients of Composite Materials Based on Energy Principles" (1968).
    `nickel_steel`: the struts are of another steel, which has a part with the square of the temperature, as Ch. É.
    Guillaume found in alloys with nickel: "Invar and Elinvar" (1920).
    `late_growth`: the struts grow as stated and then creep further, as glassy materials do after a change of
    temperature in S. F. Jacobs, "Dimensional Stability of Materials Useful in Optical Engineering" (1986). The size is
    the coefficient of this later growth, which follows the change of temperature since the campaign began with the time
    constant LATE_S.
    `two_batches`: every other strut, drawn by lot, is of another batch of steel, whose coefficient differs, as those of
    gauge blocks do in T. Doiron, J. Beers, "The Gauge Block Handbook" (1995). The others grow as stated.
    `platform_metal`: the platform is of light metal, with a coefficient that is LIGHT_METAL times the size beyond the
    stated one of steel, and grows with its joints and reflectors: A. H. Slocum, "Precision Machine Design" (1992).
    `jumping_feet`: friction holds the feet of the frame, which grows beyond what is stated by jumps: not until its
    growth since the campaign's begin has strained it enough does it push its feet on, all the way: M. Weck, "Handbook
    of Machine Tools", vol. 4 (1984).
    `martensite`: the struts' alloy changes its phase and with it its length over a small range of temperatures, which
    lies lower while it cools than while it grows warmer: L. Kaufman, M. Cohen, "Thermodynamics and Kinetics of
    Martensitic Transformations" (1958). The change is the growth beyond what is stated by ALLOY_K.
    """

    thickness_m = 0.2  # of column and rail together

    def setup(self) -> None:
        """Which way a frame of fibres grows, which struts are of another batch, and when feet jump: seeded."""
        angle = float(self.rng.uniform(-0.5 * np.pi, 0.5 * np.pi))
        self.across = cmath.exp(1j * angle) if self.variant == "fibres" else None
        struts = len(self.site.machine.struts)
        self.batch = np.isin(np.arange(struts), self.rng.permutation(struts)[: struts // 2]).astype(np.float64)
        self.turns_k = float(self.rng.uniform(*TURNS_K))
        self.turns_back_k = self.turns_k - float(self.rng.uniform(*TURNS_BACK_K))
        self.feet_k = float(self.rng.uniform(*FEET_K))

    def warmth_k(self, state: MotionState, part: str) -> Array:
        """Recorded temperature of a part above the machine file's reference (n,)."""
        machine = self.site.machine
        return state.parts_c[machine.expansion[part].sensor] - machine.reference_temperature_c

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Grow the frame, the screws or both, or bend the columns."""
        if self.variant in ("nickel_steel", "late_growth", "martensite"):
            strain = self.size * self._struts_k(state)
            deviation.length_m += np.outer(strain, [strut.length_m for strut in self.site.machine.struts])
            return
        if self.variant == "two_batches":
            strain = self.size * self.warmth_k(state, "struts")
            lengths_m = np.array([strut.length_m for strut in self.site.machine.struts])
            deviation.length_m += np.outer(strain, self.batch * lengths_m)
            return
        if self.variant == "platform_metal":
            self._grow_platform(LIGHT_METAL * self.size * self.warmth_k(state, "platform"), deviation)
            return
        if self.variant == "jumping_feet":
            self._grow_frame(self.size * self._jumped_k(state), deviation)
            return
        if self.variant == "bimetal":
            self._bend(state, deviation)
            return
        if self.across is not None:
            self._grow_frame(self.size * self.warmth_k(state, "base"), deviation)
            for a, slider in enumerate(self.site.machine.sliders):  # columns, and what they carry along their axes
                share = (self.across * slider.axis.conjugate()).real ** 2
                deviation.travel_m[:, a] += self.size * share * self.warmth_k(state, "drives") * state.q_m[:, a]
            return
        if self.variant != "screws":
            frame_k = self.warmth_k(state, "base")
            if self.variant == "mean_of_sensors":  # the sensor hangs at one end of a part that goes through the room
                frame_k = 0.5 * (frame_k + self.warmth_k(state, "drives"))
            self._grow_frame(self.size * frame_k, deviation)
        if self.variant != "mean_of_sensors":
            deviation.travel_m += self.size * self.warmth_k(state, "drives")[:, None] * state.q_m

    def _grown(self, strain: Array, place: complex) -> Complex:
        """How far a place of the frame goes (n,): with the frame, or across its fibres alone."""
        if self.across is None:
            return np.asarray(strain * place)
        return np.asarray(strain * (place * self.across.conjugate()).real * self.across)

    def _grow_frame(self, strain: Array, deviation: Deviation) -> None:
        machine = self.site.machine
        for a, slider in enumerate(machine.sliders):
            mine = [i for i, strut in enumerate(machine.struts) if strut.drive == a]
            middle = complex(np.mean([machine.struts[i].base_joint for i in mine]))
            shift = self._grown(strain, middle) * slider.axis.conjugate()
            deviation.travel_m[:, a] += shift.real
            deviation.sideways_m[:, a] += shift.imag
            for i in mine:
                deviation.base_joint_m[:, i] += self._grown(strain, machine.struts[i].base_joint - middle)
            for i, smr in enumerate(machine.smrs):
                if smr.on == slider.name:
                    arm = self._grown(strain, complex(smr.position_m[0], smr.position_m[1]) - middle)
                    deviation.smr_m[:, i, 0] += arm.real
                    deviation.smr_m[:, i, 1] += arm.imag

    def _grow_platform(self, strain: Array, deviation: Deviation) -> None:
        for i, strut in enumerate(self.site.machine.struts):
            deviation.platform_joint_m[:, i] += strain * strut.platform_joint
        for i, smr in enumerate(self.site.machine.smrs):
            if smr.on == "platform":
                deviation.smr_m[:, i] += np.outer(strain, smr.position_m)

    def _struts_k(self, state: MotionState) -> Array:
        """What all struts grow by (n,), over the size, in kelvin."""
        if self.variant == "late_growth":
            return self._late_k(state)
        if self.variant == "martensite":
            return ALLOY_K * self._turned(state)
        warmer_k = self.warmth_k(state, "struts")
        return warmer_k * (1.0 + warmer_k / NICKEL_K)

    def _late_k(self, state: MotionState) -> Array:
        """The part of the temperature's change since the beginning that the creep has followed (n,), in kelvin."""
        sensor = self.site.machine.expansion["struts"].sensor
        ends_s = np.concatenate([[self.site.start_s], state.t_s])
        sensed = state.thermal.part_series_c(sensor, ends_s)
        return lag_behind(state, sensor, self.site.start_s, LATE_S) + sensed[1:] - sensed[0]

    def _since_begin_k(self, state: MotionState, part: str) -> tuple[Array, Array]:
        """A grid of times, and by how much warmer a part then is than at the campaign's begin."""
        grid = np.arange(self.site.start_s, max(float(state.t_s.max()), self.site.start_s) + 2.0 * _GRID_S, _GRID_S)
        sensed_c = state.thermal.part_series_c(self.site.machine.expansion[part].sensor, grid)
        return grid, sensed_c - sensed_c[0]

    def _turned(self, state: MotionState) -> Array:
        """Share of the alloy that has turned (n,), none at the campaign's begin."""
        grid, warmer_k = self._since_begin_k(state, "struts")
        shares, now = np.empty_like(grid), 0.0
        for i, k in enumerate(warmer_k.tolist()):
            at_least, at_most = (min(max((k - x) / TURNS_OVER_K, 0.0), 1.0) for x in (self.turns_k, self.turns_back_k))
            now = min(max(now, at_least), at_most)
            shares[i] = now
        return np.asarray(np.interp(state.t_s, grid, shares))

    def _jumped_k(self, state: MotionState) -> Array:
        """By how much warmer the frame was when its feet last jumped than at the campaign's begin (n,)."""
        grid, warmer_k = self._since_begin_k(state, "base")
        jumped, held = np.empty_like(grid), 0.0
        for i, now in enumerate(warmer_k.tolist()):
            held = now if abs(now - held) > self.feet_k else held
            jumped[i] = held
        at = np.searchsorted(grid, state.t_s, side="right") - 1
        return np.asarray(jumped[np.maximum(at, 0)])

    def _bend(self, state: MotionState, deviation: Deviation) -> None:
        curvature = 1.5 * self.size * self.warmth_k(state, "drives") / self.thickness_m
        for a, slider in enumerate(self.site.machine.sliders):
            low, _ = slider.travel_m
            way = state.q_m[:, a] - low
            deviation.sideways_m[:, a] += 0.5 * curvature * way**2
            deviation.yaw_rad[:, a] += curvature * way


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
        elif self.variant == "gathering_chips":
            extra_kg = self.size * self.elapsed_s(state) / CHIPS_S
        elif self.variant == "coolant_pool":
            t = self.elapsed_s(state)
            k = np.searchsorted(self.pump_s, t, side="right") - 1
            extra_kg = self.size * _pooled(np.array(self.pool)[k], k, t - self.pump_s[k])
        elif self.variant == "soaking_block":
            extra_kg = self.size * mounted * np.sqrt(self.elapsed_s(state) / SOAKS_S)
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

    def _lifted(self, state: MotionState) -> Array:
        """Height of the platform (n,) by its drives, from 0 to 1."""
        ends = np.array([slider.travel_m for slider in self.site.machine.sliders])
        return np.asarray(((state.q_m - ends[:, 0]) / (ends[:, 1] - ends[:, 0])).mean(axis=1))


def _pooled(begins: Array, number: NDArray[np.intp], lasts_s: Array) -> Array:
    """How full a platform is (n,) some time after its pump was switched for the k-th time: on for odd numbers."""
    runs = number % 2 == 1
    return np.asarray(runs + (begins - runs) * np.exp(-lasts_s / np.where(runs, FILLS_S, DRAINS_S)))


def _sloshed(state: MotionState) -> Array:
    """Where the liquid is (n,): ahead in the platform's direction when the last of its first two drives stops."""
    sideways = 0.5 * (state.direction[:, :2] * state.speed_m_per_s[:, :2]) @ np.array([-1.0, 1.0]) / SLOSH_M_PER_S
    rested_s = state.since_s[:, :2].min(axis=1)
    return np.asarray(sideways * np.exp(-rested_s / CALMS_S) * np.cos(2.0 * np.pi * rested_s / SLOSHES_S))


ONSET = EffectParameter("onset_s", 0.0, 2400.0, 7200.0, "after the campaign's begin")

EFFECTS = (
    EffectSpec(
        name="expansion_coefficient",
        kind="catalogue",
        place="rig",
        size=EffectParameter("coefficient_per_k", 1e-7, 5e-6, 3e-4, "beyond the stated coefficient of expansion"),
        variants=(
            "frame",
            "mean_of_sensors",
            "screws",
            "bimetal",
            "fibres",
            "nickel_steel",
            "late_growth",
            "two_batches",
            "platform_metal",
            "jumping_feet",
            "martensite",
        ),
        final="martensite",
        reveals="recorded temperatures of the parts, SMRs on the sliders",
        make=ExpansionCoefficient,
    ),
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
        ),
        final="soaking_block",
        reveals="payloads, torque; by variant time, dwell, height",
        make=Payload,
    ),
    EffectSpec(
        name="tables_left_on",
        kind="catalogue",
        place="rig",
        size=EffectParameter("weight_ratio", 0.02, 1.0, 10.0, "weight of the tables, 1 is the whole correction"),
        variants=(
            "whole",
            "one_drive",
            "switched",
            "bidirectional",
            "pulses",
            "by_temperature",
            "multiplied",
            "moved_zero",
            "both_generations",
            "ramped",
            "counted_from_above",
        ),
        final="counted_from_above",
        reveals="both drives' coordinates, known tables, by variant dwell, SMRs on the sliders",
        make=TablesLeftOn,
        others=(ONSET,),
    ),
)
