"""Coefficients of expansion that are not as stated."""

from __future__ import annotations

import cmath

import numpy as np

from mock_devices.effects.base import Array, Complex, Deviation, Effect, EffectParameter, EffectSpec, MotionState
from mock_devices.effects.warming import grid_from, lag_behind

NICKEL_K = 5.0  # by how much warmer the part with the square of the temperature is as large as the straight one
LATE_S = 2400.0
LIGHT_METAL = 4.0  # how far light metal is off from steel, over one steel from another
FEET_K = (0.06, 0.2)  # by how much warmer a frame pushes its feet on
TURNS_K, TURNS_BACK_K, TURNS_OVER_K = (0.05, 0.25), (0.1, 0.25), 0.1  # see `martensite`: above the begin; loop; width
CURIE_K = (-0.1, 0.3)  # where an alloy loses its magnetism, above the temperature of the begin
RATE_S, LOOKS_BACK_S = 1800.0, 120.0  # time in which one kelvin gives the growth of one; over which a rate is taken
OF_STRUTS = (
    "nickel_steel", "late_growth", "martensite", "curie_kink", "stressed_alloy", "strained_by_rate", "grows_for_good",
    "ratcheting_metal",
)  # fmt: skip
FOR_GOOD_K = (0.0, 0.2)  # by how much warmer than at the begin iron grows for good
RATCHETS_K = (0.02, 0.15)  # swing of the temperature up to which a metal ratchets by nothing
ALLOY_K = 2.0  # growth without a change of phase that is as large as the change
FULL_PAYLOAD_KG = 400.0


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
    `curie_kink`: the struts' alloy is magnetic when it is cool and then grows as stated; above the temperature at which
    it loses its magnetism it grows more, by the size: R. M. Bozorth, "Ferromagnetism" (1951). The kink lies near the
    temperature of the campaign's begin.
    `stressed_alloy`: the coefficient of the struts changes with the stress in them, here with the payload, and is as
    stated without any: A. R. Rosenfield, B. L. Averbach, "Effect of Stress on the Expansion Coefficient" (1956). The
    size is that with FULL_PAYLOAD_KG.
    `graded_screw`: the screws were drawn from graded steel, whose coefficient is as stated at the lower end and grows
    evenly to the upper one, so that the error goes with the square of the place: S. Suresh, A. Mortensen,
    "Fundamentals of Functionally Graded Materials" (1998). The size is that at the upper end.
    `strained_by_rate`: the struts' skin is warmer than their core while they are warmed, and grows them, beyond what is
    stated, in proportion to how fast that goes; nothing is left once it is over: J. M. C. Duhamel, "Second mémoire sur
    les phénomènes thermo-mécaniques" (1838). The size is for one kelvin in RATE_S.
    `grows_for_good`: the struts are of grey iron, which besides what is stated grows by the highest temperature that it
    has had since the campaign's begin, from somewhat above that of the begin on, and keeps that: H. F. Rugan, H. C. H.
    Carpenter, "The Growth of Cast Irons After Repeated Heatings" (1909).
    `ratcheting_metal`: besides what is stated, the struts grow with every warming, beyond a small one, and keep that as
    they cool, so that each next swing of the temperature adds its own: J. Bree, "Elastic-Plastic Behaviour of Thin
    Tubes Subjected to Internal Pressure and Intermittent High-Heat Fluxes" (1967).
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
        self.kink_k = float(self.rng.uniform(*CURIE_K))
        self.for_good_k = float(self.rng.uniform(*FOR_GOOD_K))
        self.ratchets_k = float(self.rng.uniform(*RATCHETS_K))

    def warmth_k(self, state: MotionState, part: str) -> Array:
        """Recorded temperature of a part above the machine file's reference (n,)."""
        machine = self.site.machine
        return state.parts_c[machine.expansion[part].sensor] - machine.reference_temperature_c

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Grow the frame, the screws or both, or bend the columns."""
        if self.variant in OF_STRUTS:
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
        if self.variant not in ("screws", "graded_screw"):
            frame_k = self.warmth_k(state, "base")
            if self.variant == "mean_of_sensors":  # the sensor hangs at one end of a part that goes through the room
                frame_k = 0.5 * (frame_k + self.warmth_k(state, "drives"))
            self._grow_frame(self.size * frame_k, deviation)
        if self.variant != "mean_of_sensors":
            grown_m = self._graded_m(state.q_m) if self.variant == "graded_screw" else state.q_m
            deviation.travel_m += self.size * self.warmth_k(state, "drives")[:, None] * grown_m

    def _graded_m(self, q_m: Array) -> Array:
        """Length of each screw (n, drives) up to its nut, each part of it by its coefficient over the size."""
        low, high = np.array([slider.travel_m for slider in self.site.machine.sliders]).T
        return np.asarray(0.5 * (q_m - low) ** 2 / (high - low))

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
        if self.variant in ("martensite", "grows_for_good", "ratcheting_metal"):
            kept_k = self._kept_k if self.variant == "grows_for_good" else self._ratcheted_k
            return ALLOY_K * self._turned(state) if self.variant == "martensite" else kept_k(state)
        if self.variant == "strained_by_rate":
            sensor, start_s = self.site.machine.expansion["struts"].sensor, self.site.start_s
            then_s = np.maximum(state.t_s - LOOKS_BACK_S, start_s)
            now_c, then_c = (state.thermal.part_series_c(sensor, at_s) for at_s in (state.t_s, then_s))
            return np.asarray(RATE_S / LOOKS_BACK_S * (now_c - then_c))
        if self.variant == "curie_kink":
            sensor = self.site.machine.expansion["struts"].sensor
            sensed_c = state.thermal.part_series_c(sensor, np.concatenate([[self.site.start_s], state.t_s]))
            return np.maximum(sensed_c[1:] - sensed_c[0] - self.kink_k, 0.0)
        warmer_k = self.warmth_k(state, "struts")
        if self.variant == "stressed_alloy":
            return warmer_k * state.payload_kg / FULL_PAYLOAD_KG
        return warmer_k * (1.0 + warmer_k / NICKEL_K)

    def _late_k(self, state: MotionState) -> Array:
        """The part of the temperature's change since the beginning that the creep has followed (n,), in kelvin."""
        sensor = self.site.machine.expansion["struts"].sensor
        ends_s = np.concatenate([[self.site.start_s], state.t_s])
        sensed = state.thermal.part_series_c(sensor, ends_s)
        return lag_behind(state, sensor, self.site.start_s, LATE_S) + sensed[1:] - sensed[0]

    def _since_begin_k(self, state: MotionState, part: str) -> tuple[Array, Array]:
        """A grid of times, and by how much warmer a part then is than at the campaign's begin."""
        grid = grid_from(self.site.start_s, state)
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

    def _kept_k(self, state: MotionState) -> Array:
        """By how much the struts' highest temperature so far (n,) is above that from which on iron grows for good."""
        grid, warmer_k = self._since_begin_k(state, "struts")
        kept_k = np.maximum.accumulate(np.maximum(warmer_k - self.for_good_k, 0.0))
        return np.asarray(np.interp(state.t_s, grid, kept_k))

    def _ratcheted_k(self, state: MotionState) -> Array:
        """By how many kelvin all warmings so far (n,) have gone beyond what a metal bears."""
        grid, warmer_k = self._since_begin_k(state, "struts")
        follows, now = np.empty_like(grid), 0.0
        for i, k in enumerate(warmer_k.tolist()):
            now = min(max(now, k - 0.5 * self.ratchets_k), k + 0.5 * self.ratchets_k)
            follows[i] = now
        grown_k = np.cumsum(np.maximum(np.diff(follows, prepend=0.0), 0.0))
        return np.asarray(np.interp(state.t_s, grid, grown_k))

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
            "curie_kink",
            "stressed_alloy",
            "graded_screw",
            "strained_by_rate",
            "grows_for_good",
            "ratcheting_metal",
        ),
        final="ratcheting_metal",
        reveals="recorded temperatures of the parts, by variant how fast they change, their highest so far, "
        "all their warmings or the payload, SMRs on the sliders",
        make=ExpansionCoefficient,
    ),
)
