"""Parts that are warmer than their sensor says: struts, columns, screws."""

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
    Place,
    StatefulEffect,
)
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.warming import ahead_of_front, conducted, cooled, cycled, lag_behind, soaked, warm_up

DUTY_M_PER_S = 0.01
FOOT_M = -1.2
FIN_M = 0.5
BEARING_FIN_M = 0.35
BEARING_M_PER_S = 0.5
CYCLES_S = (1200.0, 3600.0)  # of air that is switched
FRONT_M, HEAD_M = 0.5, 0.2  # how deep heat has gone after tau_s; from the end of the travel to the column's head
CELLS = 46  # of a screw
JOINT, PLATE = 0.2, 0.1  # time constants of a strut's joint and across a column, over that of the whole part
JOINT_M_PER_S = 0.5
START_S, START_M_PER_S, MOTOR_FIN_M = 60.0, 0.5, 0.5

_RISE = EffectParameter("rise_k", 0.05, 1.0, 40.0, "how much warmer than the sensor the part becomes")
_TAU = EffectParameter("tau_s", 300.0, 1500.0, 6000.0, "time constant of the part")


class _Warming(Effect):
    """The temperature above the sensor, by variant."""

    sensor = "struts"

    def setup(self) -> None:
        """How long a cycle of the air is."""
        self.period_s = float(self.rng.uniform(*CYCLES_S))

    def rise_k(self, state: MotionState) -> Array:
        t, tau = self.elapsed_s(state), self.values["tau_s"]
        if self.variant == "lagging":
            return self.size * lag_behind(state, self.sensor, self.site.start_s, tau)
        if self.variant == "two_stages":
            return self.size * (0.6 * warm_up(t, tau) + 0.4 * warm_up(t, 5.0 * tau))
        share = warm_up(t, tau)
        if self.variant == "conduction":
            share = conducted(t, tau)
        elif self.variant == "still_air":
            share = cooled(t, tau)
        elif self.variant == "cycling_air":
            share = cycled(t, tau, self.period_s)
        elif self.variant == "pulse":  # warmed once, cooling again: a door, a lamp
            return np.asarray(self.size * (t / tau) * np.exp(1.0 - t / tau))
        return self.size * share


class LinkGrowth(_Warming):
    """A strut grows by alpha l dT.

    `joint_heat`: oil between the faces of its joint warms the joint, which warms the strut. Friction goes with speed,
    and so heat with travel times speed: N. P. Petrov, "Friction in Machines and the Effect of the Lubricant" (1883).
    `rise_k` is where it ends if its drive runs at JOINT_M_PER_S with rests in between, at 0.01 m/s on average.
    """

    def setup(self) -> None:
        """The heat of the joint: at first in it alone, then in the strut."""
        super().setup()
        tau = self.values["tau_s"]
        per_m = 1.0 / (DUTY_M_PER_S * JOINT_M_PER_S * tau)
        self._heat = LegMemory(lambda way, speed, _: per_m * np.abs(way) * speed, tau, JOINT * tau)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the joint be warmed by its own drive."""
        if self.variant == "joint_heat" and drive == self.site.machine.struts[self.place].drive:
            self._heat.record(leg)

    def rise_k(self, state: MotionState) -> Array:
        """The temperature above the sensor (n,)."""
        if self.variant != "joint_heat":
            return super().rise_k(state)
        whole, joint = self._heat.at(state, self.site.machine.struts[self.place].drive).T
        return np.asarray(self.size * (whole - joint) / (1.0 - JOINT))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        strut = self.site.machine.struts[self.place]
        alpha = self.site.machine.expansion["struts"].coefficient_per_k
        deviation.length_m[:, self.place] += alpha * strut.length_m * self.rise_k(state)


class ColumnGrowth(_Warming):
    """A column grows from its foot, or bends where one side is warmer; its rail goes with it.

    `fin`: warmed at its foot, it is the long fin of J. Fourier, "Théorie analytique de la chaleur" (1822), whose warmth
    falls off exponentially, by e in FIN_M. `soaking`: warmed on one side, it bends first and has only grown in the end.
    `motor_above`: the motor at its head warms it from there, and the heat goes down it as into a long bar.
    `rail_heat`: the carriage's friction warms the face that carries the rail, so that the column bends with every
    motion until the heat has spread through it: heat from a machine's own motions in R. Venugopal, M. Barash, "Thermal
    Effects on the Accuracy of Numerically Controlled Machine Tools" (1986). Two terms of a plate's series.
    """

    sensor = "columns"
    width_m = 0.4

    def setup(self) -> None:
        """The heat of the rail: averaged over the column, and in what bends it."""
        super().setup()
        tau = self.values["tau_s"]
        fades_s = (tau, *(tau / (1.0 + k**2 / PLATE) for k in (1.0, 3.0)))
        self._heat = LegMemory(lambda way, _speed, _: np.abs(way) / (DUTY_M_PER_S * tau), *fades_s)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the carriage warm its rail."""
        if self.variant == "rail_heat" and drive == self.place:
            self._heat.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider with the column."""
        strut = next(s for s in self.site.machine.struts if s.drive == self.place)
        height = state.q_m[:, self.place] + strut.base_joint.imag - FOOT_M
        alpha = self.site.machine.expansion["base"].coefficient_per_k
        grown = alpha * self.rise_k(state)
        if self.variant == "bending":
            deviation.sideways_m[:, self.place] += 0.5 * grown / self.width_m * height**2
            deviation.yaw_rad[:, self.place] += grown / self.width_m * height
        elif self.variant == "soaking":
            t, tau = self.elapsed_s(state), self.values["tau_s"]
            mean, slope = (alpha * self.size * share for share in soaked(t, tau))
            deviation.travel_m[:, self.place] += mean * height
            deviation.sideways_m[:, self.place] += 0.5 * slope / self.width_m * height**2
            deviation.yaw_rad[:, self.place] += slope / self.width_m * height
        elif self.variant == "rail_heat":
            left = alpha * self.size * self._heat.at(state, self.place)
            slope = 48.0 / np.pi**2 * (left[:, 1] + left[:, 2] / 9.0)
            deviation.travel_m[:, self.place] += left[:, 0] * height
            deviation.sideways_m[:, self.place] += 0.5 * slope / self.width_m * height**2
            deviation.yaw_rad[:, self.place] += slope / self.width_m * height
        elif self.variant == "motor_above":
            head = self.site.machine.sliders[self.place].travel_m[1] + strut.base_joint.imag - FOOT_M + HEAD_M
            deep = FRONT_M * np.sqrt(np.maximum(self.elapsed_s(state) / self.values["tau_s"], 1.0e-12))
            warm_m = ahead_of_front(head - height, deep) - ahead_of_front(np.full_like(height, head), deep)
            deviation.travel_m[:, self.place] += alpha * self.size * warm_m
        elif self.variant == "fin":
            deviation.travel_m[:, self.place] += grown * FIN_M * (1.0 - np.exp(-height / FIN_M))
        elif self.variant == "stratified":  # warmer above: the growth goes with the square of the height
            deviation.travel_m[:, self.place] += 0.5 * grown * height**2
        else:
            deviation.travel_m[:, self.place] += grown * height


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
    """

    def setup(self) -> None:
        """Cells of the screw, all cold."""
        low, high = self.site.machine.sliders[self.place].travel_m
        self._edges = np.linspace(low, high, CELLS + 1)
        self._cells = [np.zeros(CELLS)]
        share = START_S / self.values["tau_s"] / START_M_PER_S
        self._starts = LegMemory(lambda way, speed, _: share * speed * (way != 0.0), self.values["tau_s"])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every cell of the variant `where_it_ran` remember its warmth."""
        super().record_leg(drive, leg)
        if self.variant == "where_it_ran" and drive == self.place:
            ends = (np.array([x]) for x in (leg.start_s, leg.end_s, leg.until_s, leg.from_m, leg.to_m))
            self._cells.append(self._warmed(self._cells[-1][None], *ends)[0])
        if self.variant == "motor_starts" and drive == self.place:
            self._starts.record(leg)

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


def _spec(
    name: str, place: Place, variants: tuple[str, ...], final: str, reveals: str, make: type[Effect]
) -> EffectSpec:
    return EffectSpec(
        name=name,
        kind="catalogue",
        place=place,
        size=_RISE,
        variants=variants,
        final=final,
        reveals=reveals,
        make=make,
        others=(_TAU,),
    )


EFFECTS = (
    _spec(
        "link_thermal_growth",
        "strut",
        ("warm_up", "lagging", "two_stages", "pulse", "conduction", "still_air", "cycling_air", "joint_heat"),
        "joint_heat",
        "time, a temperature swing; by variant travel and speed",
        LinkGrowth,
    ),
    _spec(
        "column_thermal_growth",
        "drive",
        ("warm_up", "bending", "lagging", "stratified", "fin", "soaking", "motor_above", "rail_heat"),
        "rail_heat",
        "time or distance moved, a temperature swing, SMRs on the sliders",
        ColumnGrowth,
    ),
    _spec(
        "screw_thermal_growth",
        "drive",
        ("free_end", "pretensioned", "both_ends", "nut_local", "fixed_bearing", "where_it_ran", "motor_starts"),
        "motor_starts",
        "time and distance moved, drive coordinate, SMRs on the sliders",
        ScrewGrowth,
    ),
)
