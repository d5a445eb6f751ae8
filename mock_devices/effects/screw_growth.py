"""Growth of screws that are warm: by their own motion, their bearings or their motors."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mock_devices.effects.base import Array, Deviation, Leg, MotionState, StatefulEffect
from mock_devices.effects.flows import ThinnedOil
from mock_devices.effects.followers import Fanned, HeldWarm
from mock_devices.effects.leg_memory import Leaves, LegMemory, PassMemory

DUTY_M_PER_S = 0.01
BEARING_FIN_M = 0.35
BEARING_M_PER_S = 0.5
CELLS = 46  # of a screw
START_S, START_M_PER_S, MOTOR_FIN_M = 60.0, 0.5, 0.5
LIFTS, HOIST_FIN_M = 0.01, 0.6  # share of its time for which a drive lifts to end at the size; see MOTOR_FIN_M
CABINET_FIN_M = 0.9  # see MOTOR_FIN_M
HOLD_FANS, HOLD_FIN_M = 4.0, 0.8  # how much faster a moving motor cools than one at rest; see MOTOR_FIN_M
STRETCH_M, STRETCH_FIN_M = 0.15, 0.4  # of a starved stretch: its length; see MOTOR_FIN_M
THINS, OIL_M_PER_S = 1.5, 0.25  # of oil: how much thinner it is by the size, as a logarithm; speed for the size
BUBBLES_M_PER_S = (0.15, 0.3)  # speed from which oil bubbles
SHORT_M, SHORT_M_PER_S = (0.1, 0.25), 0.002  # ways shorter than which run dry; mean speed of such ways for the size
FANS, FANS_M_PER_S = (4.0, 12.0), 0.5  # what a fan takes away beyond still air, over that, at a speed of its drive
NUT = 0.4  # time constant of a nut over that of its screw
CHILLS_AT, CHILLED_TO, CHILLS = (
    0.4,
    0.25,
    20.0,
)  # where a chiller starts, over where motion alone would end at the duty;
# where it stops, over that; how much faster it cools than air


class ScrewGrowth(StatefulEffect):
    """A screw that its own motion heats: every metre leaves heat, which decays with the time constant.

    `rise_k` is where its temperature ends at a mean speed of 0.01 m/s. What is remembered is its temperature.
    `fixed_bearing`: the bearing that holds the screw at its lower end warms it, and the screw is a fin with a free tip:
    F. P. Incropera, D. P. DeWitt, "Fundamentals of Heat and Mass Transfer" (1985). The bearing's friction, and so its
    heat a metre, goes with the speed to the power 2/3, as that of a lubricated bearing in A. Palmgren, "Ball and Roller
    Bearing Engineering" (1959); the reference is BEARING_M_PER_S.
    `where_it_ran`: the nut warms the screw where it runs, so that its profile follows from all ways: U. Heisel, G.
    Koscsák, T. Stehle, "Thermography-Based Investigation into Thermally Induced Positioning Errors of Feed Drives by
    Example of a Ball Screw" (2006). Remembered is the warmth of every cell.
    `motor_starts`: the current of every start warms the motor at the upper end, where the screw is held; losses go with
    the speed reached and not with the travel: W. Leonhard, "Control of Electrical Drives" (1985). The size is reached
    with a start to START_M_PER_S every START_S.
    `chilled`: motion warms it, and a chiller sends coolant through its bore once it is too warm until it is cool, so
    that its length goes up and down like the level under a two-point controller in W. Oppelt, "Kleines Handbuch
    technischer Regelvorgänge" (1954). The size is the warmth at which the chiller starts.
    `nut_then_screw`: friction warms the nut, and the nut warms the screw, which goes on growing after a motion: the nut
    as a source of heat in S. K. Kim, D. W. Cho, "Real-Time Estimation of Temperature Distribution in a Ball-Screw
    System" (1997), here with one temperature each.
    `lifting`: the current that lifts the load warms the motor as long as it goes up; what comes down brakes into
    resistors elsewhere, and a brake holds it at rest: H. Gross, J. Hamann, G. Wiegärtner, "Electrical Feed Drives in
    Automation" (2001). The motor warms the upper end of a screw that is held below. A slow lift takes longer and so
    warms it more. The size is reached by lifting for LIFTS of the time.
    `holding`: the current that holds the load at rest warms the motor, by its square: J. P. Joule, "On the Heat Evolved
    by Metallic Conductors of Electricity" (1841). While the drive moves, a fan on its shaft cools it. The motor sits at
    the screw's lower end, where that is held. The size is reached in long rest.
    `starved_stretch`: one stretch has lost its grease and rubs dryly, so that every pass of the nut warms it, and the
    warmth falls off along the screw on both sides: starved contacts in A. Cameron, "The Principles of Lubrication"
    (1966). The size is that of the stretch if the drive runs evenly all over its travel, at DUTY_M_PER_S on average.
    `thinning_oil`: the nut shears oil, whose heat a metre goes with the speed, and which is thinner the warmer the
    screw is, so that it heats less and less: R. Nahme, "Beiträge zur hydrodynamischen Theorie der Lagerreibung" (1940).
    The size is where it ends at DUTY_M_PER_S on average with motions at OIL_M_PER_S.
    `neighbours_motor`: motor and cabinet of the next drive stand at this screw's upper end and are warmed by the ways
    of that drive; the screw, held below, conducts their heat as a fin: F. Kreith, "Principles of Heat Transfer" (1958).
    The size is that of the upper end if that drive runs at DUTY_M_PER_S on average.
    `bubbling_oil`: motions above one speed tear the oil in the nut, and its bubbles heat the screw as they collapse, by
    the way; slower motions leave it cold: Lord Rayleigh, "On the Pressure Developed in a Liquid During the Collapse of
    a Spherical Cavity" (1917). The screw is held above and grows downwards. The size is where it ends at DUTY_M_PER_S
    of such motions on average.
    `short_strokes`: ways shorter than what a ball needs to come to fresh grease run dryly and heat the screw, and
    longer ones do not: P. M. Lugt, "Grease Lubrication in Rolling Bearings" (2013). The size is where it ends at
    SHORT_M_PER_S of such ways on average.
    `neighbours_fan`: a lamp warms it evenly, and a fan on the shaft of the next drive blows at it while that moves, by
    the root of the speed: J. Boussinesq, "Calcul du pouvoir refroidissant des courants fluides" (1905). The size is
    where it ends while the next drive rests.
    """

    def setup(self) -> None:
        """Cells of the screw, all cold."""
        low, high = self.site.machine.sliders[self.place].travel_m
        self._edges = np.linspace(low, high, CELLS + 1)
        self._cells = [np.zeros(CELLS)]
        share = START_S / self.values["tau_s"] / START_M_PER_S
        self._chilled = ChilledMemory(self.values["tau_s"])
        per_m = 1.0 / (DUTY_M_PER_S * self.values["tau_s"])
        fades_s = (self.values["tau_s"], NUT * self.values["tau_s"])
        self._through_nut = LegMemory(lambda way, _speed, _: per_m * np.abs(way), *fades_s)
        self._lifts = LegMemory(_lifting(LIFTS * self.values["tau_s"]), self.values["tau_s"])
        self.next = (self.place + 1) % len(self.site.machine.sliders)
        self._beside = LegMemory(lambda way, _speed, _: per_m * np.abs(way), self.values["tau_s"])
        self._held = HeldWarm(HOLD_FANS, self.values["tau_s"])
        starved = 0.5 * (low + high) + 0.5 * (high - low) * float(self.rng.uniform(-0.5, 0.5))
        self.starved_m = starved
        self._passed = PassMemory(starved - 0.5 * STRETCH_M, starved + 0.5 * STRETCH_M, self.values["tau_s"])
        self._thinned = ThinnedOil(_shearing(DUTY_M_PER_S * self.values["tau_s"]), THINS, self.values["tau_s"])
        self.bubbles_m_per_s = float(self.rng.spawn(1)[0].uniform(*BUBBLES_M_PER_S))
        self._bubbles = LegMemory(
            lambda way, speed, _: per_m * np.abs(way) * (speed > self.bubbles_m_per_s), self.values["tau_s"]
        )
        self.short_m = float(self.rng.spawn(1)[0].uniform(*SHORT_M))
        per_short_m = 1.0 / (SHORT_M_PER_S * self.values["tau_s"])
        self._short = LegMemory(
            lambda way, _speed, _: per_short_m * np.abs(way) * (np.abs(way) < self.short_m), self.values["tau_s"]
        )
        self.fans = float(self.rng.spawn(1)[0].uniform(*FANS))
        self._fanned = Fanned(
            lambda speed: 1.0 + self.fans * np.sqrt(np.maximum(speed, 0.0) / FANS_M_PER_S), self.values["tau_s"]
        )
        self._starts = LegMemory(lambda way, speed, _: share * speed * (way != 0.0), self.values["tau_s"])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every cell of the variant `where_it_ran` remember its warmth."""
        super().record_leg(drive, leg)
        if self.variant == "where_it_ran" and drive == self.place:
            ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.from_m, leg.to_m))
            self._cells.append(self._warmed(self._cells[-1][None], *ends)[0])
        if self.variant == "motor_starts" and drive == self.place:
            self._starts.record(leg)
        if self.variant == "neighbours_motor" and drive == self.next:
            self._beside.record(leg)
        if self.variant == "neighbours_fan" and drive == self.next:
            self._fanned.record(leg)
        if self.variant == "short_strokes" and drive == self.place:
            self._short.record(leg)
        if self.variant == "bubbling_oil" and drive == self.place:
            self._bubbles.record(leg)
        if self.variant == "chilled" and drive == self.place:
            self._chilled.record(leg)
        if self.variant == "nut_then_screw" and drive == self.place:
            self._through_nut.record(leg)
        if self.variant == "lifting" and drive == self.place:
            self._lifts.record(leg)
        if self.variant == "starved_stretch" and drive == self.place:
            self._passed.record(leg)
        if self.variant == "holding" and drive == self.place:
            self._held.record(leg)
        if self.variant == "thinning_oil" and drive == self.place:
            self._thinned.record(leg)

    def _warmed(self, before: Array, start_s: Array, end_s: Array, t_s: Array, from_m: Array, to_m: Array) -> Array:
        """Warmth (n, cells) at t_s; each pass of a cell leaves in it what it would leave in a screw run all over."""
        tau, width = self.values["tau_s"], self._edges[1] - self._edges[0]
        low, high = (end[:, None] for end in (np.minimum(from_m, to_m), np.maximum(from_m, to_m)))
        passed = np.clip(np.minimum(high, self._edges[1:]) - np.maximum(low, self._edges[:-1]), 0.0, width) / width
        heat = self.size * (self._edges[-1] - self._edges[0]) / (DUTY_M_PER_S * tau)
        middle_s = np.minimum(0.5 * (start_s + end_s), t_s)
        kept, left = np.exp(-(t_s - start_s) / tau), np.exp(-(t_s - middle_s) / tau)
        return np.asarray(before * kept[:, None] + heat * passed * left[:, None])

    def _warm_m(self, state: MotionState) -> Array:
        """Warmth integrated from the screw's lower end to its nut (n,), in kelvin metres."""
        a, q = self.place, state.q_m[:, self.place]
        before = np.stack([self._cells[k] for k in state.leg[:, a].tolist()])
        cells = self._warmed(before, state.leg_start_s[:, a], state.leg_end_s[:, a], state.t_s, state.from_m[:, a], q)
        below = np.clip(q[:, None] - self._edges[:-1], 0.0, self._edges[1] - self._edges[0])
        return np.asarray((cells * below).sum(axis=1))

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """Heat of the leg, set free in its middle, decayed until its rest ends."""
        way = abs(leg.to_m - leg.from_m) * float(self._friction(np.array(leg.speed_m_per_s)))
        return self._temperature(before, leg.start_s, leg.end_s, way, leg.until_s)

    def _friction(self, speed_m_per_s: Array) -> Array:
        """Friction over that at the reference speed."""
        if self.variant != "fixed_bearing":
            return np.ones_like(speed_m_per_s)
        return np.asarray((speed_m_per_s / BEARING_M_PER_S) ** (2.0 / 3.0))

    def _temperature(self, before: float, start_s: float, end_s: float, way_m: float, t_s: float) -> float:
        tau = self.values["tau_s"]
        heat = self.size * way_m / (DUTY_M_PER_S * tau)
        middle_s = min(0.5 * (start_s + end_s), t_s)
        return before * math.exp(-(t_s - start_s) / tau) + heat * math.exp(-(t_s - middle_s) / tau)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider with its screw."""
        a, tau = self.place, self.values["tau_s"]
        alpha = self.site.machine.expansion["drives"].coefficient_per_k
        if self.variant == "where_it_ran":
            deviation.travel_m[:, a] += alpha * self._warm_m(state)
            return
        if self.variant == "motor_starts":
            up_m = self.site.machine.sliders[a].travel_m[1] - state.q_m[:, a]
            warm = self.size * self._starts.at(state, a)[:, 0]
            deviation.travel_m[:, a] -= alpha * warm * MOTOR_FIN_M * (1.0 - np.exp(-up_m / MOTOR_FIN_M))
            return
        if self.variant in ("chilled", "thinning_oil"):
            way_m = state.q_m[:, a] - self.site.machine.sliders[a].travel_m[0]
            warmth = self._chilled if self.variant == "chilled" else self._thinned
            deviation.travel_m[:, a] += alpha * self.size * warmth.at(state, a) * way_m
            return
        if self.variant in ("lifting", "neighbours_motor"):
            low, high = self.site.machine.sliders[a].travel_m
            lifts = self.variant == "lifting"
            by_motor, fin_m = (self._lifts.at(state, a), HOIST_FIN_M) if lifts else (
                self._beside.at(state, self.next), CABINET_FIN_M
            )  # fmt: skip
            warm_m = fin_m * (np.exp((state.q_m[:, a] - high) / fin_m) - math.exp((low - high) / fin_m))
            deviation.travel_m[:, a] += alpha * self.size * by_motor[:, 0] * warm_m
            return
        if self.variant in ("holding", "starved_stretch", "bubbling_oil", "short_strokes", "neighbours_fan"):
            deviation.travel_m[:, a] += alpha * self.size * self._from_source_m(state)
            return
        if self.variant == "nut_then_screw":
            way_m = state.q_m[:, a] - self.site.machine.sliders[a].travel_m[0]
            screw, nut = self._through_nut.at(state, a).T
            deviation.travel_m[:, a] += alpha * self.size * (screw - nut) / (1.0 - NUT) * way_m
            return
        way = np.abs(state.q_m[:, a] - state.from_m[:, a]) * self._friction(state.speed_m_per_s[:, a])
        age = state.t_s - state.leg_start_s[:, a]
        middle = np.maximum(state.t_s - 0.5 * (state.leg_start_s[:, a] + state.leg_end_s[:, a]), 0.0)
        warm = self.state_before(state, a) * np.exp(-age / tau)
        warm = warm + self.size * way / (DUTY_M_PER_S * tau) * np.exp(-middle / tau)
        low, high = self.site.machine.sliders[a].travel_m
        x = state.q_m[:, a] - low
        length = high - low
        if self.variant == "pretensioned":  # stretching the screw at assembly takes up the first third
            warm, way_m = np.maximum(warm - 0.3 * self.size, 0.0), x
        elif self.variant == "both_ends":
            way_m = 4.0 * x * (length - x) / length * (x / length - 0.5)
        elif self.variant == "fixed_bearing":
            tip = length / BEARING_FIN_M
            way_m = BEARING_FIN_M * (np.tanh(tip) - np.sinh(tip - x / BEARING_FIN_M) / np.cosh(tip))
        elif self.variant == "nut_local":  # warm only where the nut runs most: the middle of the travel
            way_m = 0.2 * (1.0 + np.tanh((x - 0.5 * length) / 0.2))
        else:
            way_m = x
        deviation.travel_m[:, a] += alpha * warm * way_m

    def _from_source_m(self, state: MotionState) -> Array:
        """Warmth (n,) from the screw's lower end to its nut over the size, in metres, of what warms it at one place; of
        a screw that is held above from its nut to there, and negative."""
        low, high = self.site.machine.sliders[self.place].travel_m
        q_m = state.q_m[:, self.place]
        if self.variant == "holding":
            held = self._held.at(state, self.place)
            return np.asarray(held * HOLD_FIN_M * (1.0 - np.exp(-(q_m - low) / HOLD_FIN_M)))
        if self.variant == "neighbours_fan":
            return np.asarray(self._fanned.at(state, self.next) * (q_m - low))
        if self.variant == "short_strokes":
            return np.asarray(self._short.at(state, self.place)[:, 0] * (q_m - low))
        if self.variant == "bubbling_oil":
            return np.asarray(self._bubbles.at(state, self.place)[:, 0] * (q_m - high))
        evenly_m = STRETCH_M / (high - low) * DUTY_M_PER_S * self.values["tau_s"]
        along_m = self._beyond_stretch_m(q_m) - self._beyond_stretch_m(np.array([low]))
        return np.asarray(self._passed.at(state, self.place) / evenly_m * along_m)

    def _beyond_stretch_m(self, at_m: Array) -> Array:
        """Metres of its whole warmth (n,) from the middle of the starved stretch to a place, below it negative."""
        away_m = at_m - self.starved_m
        return np.asarray(-np.sign(away_m) * STRETCH_FIN_M * np.expm1(-np.abs(away_m) / STRETCH_FIN_M))


def _lifting(whole_s: float) -> Leaves:
    """Time for which a leg lifts, over a whole."""
    return lambda way, speed, _: np.maximum(way, 0.0) / np.maximum(speed, 1.0e-6) / whole_s


def _shearing(whole_m: float) -> Callable[[Array, Array], Array]:
    """Heat of a way through oil of the size's warmth, over what the whole way leaves at OIL_M_PER_S."""
    return lambda way, speed: np.abs(way) * speed / (OIL_M_PER_S * whole_m)


class ChilledMemory:
    """Warmth of a screw over the size: every metre warms it, air cools it, and so does a chiller that is switched."""

    def __init__(self, tau_s: float) -> None:
        self._tau_s = tau_s
        self._before = [(0.0, False)]

    def record(self, leg: Leg) -> None:
        """A leg and the rest after it have ended."""
        way_m = abs(leg.to_m - leg.from_m)
        self._before.append(self._after(self._before[-1], leg.start_s, leg.end_s, way_m, leg.until_s))

    def at(self, state: MotionState, drive: int) -> Array:
        """Warmth at the moments of a state (n,)."""
        way_m = np.abs(state.q_m[:, drive] - state.from_m[:, drive])
        columns = (state.leg[:, drive], state.leg_start_s[:, drive], state.leg_end_s[:, drive], way_m, state.t_s)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return np.array([self._after(self._before[k], start, end, way, t)[0] for k, start, end, way, t in rows])

    def _after(
        self, before: tuple[float, bool], start_s: float, end_s: float, way_m: float, t_s: float
    ) -> tuple[float, bool]:
        """Warmth, and whether the chiller runs, at t_s; the heat of a leg is set free in its middle."""
        middle_s = min(0.5 * (start_s + end_s), t_s)
        warm, runs = self._cooled(*before, middle_s - start_s)
        warm += way_m / (CHILLS_AT * DUTY_M_PER_S * self._tau_s)
        return self._cooled(warm, runs or warm >= 1.0, t_s - middle_s)

    def _cooled(self, warm: float, runs: bool, lasts_s: float) -> tuple[float, bool]:
        if runs:
            ends_s = self._tau_s / CHILLS * math.log(max(warm / CHILLED_TO, 1.0))
            if lasts_s < ends_s:
                return warm * math.exp(-CHILLS * lasts_s / self._tau_s), True
            warm, lasts_s = min(warm, CHILLED_TO), lasts_s - ends_s
        return warm * math.exp(-lasts_s / self._tau_s), False
