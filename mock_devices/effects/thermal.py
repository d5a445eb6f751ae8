"""Parts that are warmer than their sensor says: struts, columns, screws."""

from __future__ import annotations

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
)
from mock_devices.effects.followers import Fanned, PlaceMemory
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.screw_growth import DUTY_M_PER_S, ScrewGrowth
from mock_devices.effects.warming import AIR, ahead_of_front, conducted, cooled, cycled, lag_behind, soaked, warm_up

FOOT_M = -1.2
FIN_M = 0.5
CYCLES_S = (1200.0, 3600.0)  # of air that is switched
FRONT_M, HEAD_M = 0.5, 0.2  # how deep heat has gone after tau_s; from the end of the travel to the column's head
JOINT, PLATE = 0.2, 0.1  # time constants of a strut's joint and across a column, over that of the whole part
JOINT_M_PER_S = 0.5
HEATER_M = 0.35  # from a radiant heater to the strut before it
SUN_BEGINS_S, SUN_LASTS_S = (300.0, 1200.0), (1500.0, 3600.0)  # of sun on a column's face
THIN_WALL = 0.15  # time constant of a column's thin wall over that of its thick one
FANS, FANS_M_PER_S = 5.0, 0.5  # what a strut loses beyond still air, over that, at a speed of its drive
WET_BEGINS_S, WET_LASTS_S = (300.0, 1200.0), (1500.0, 3600.0)  # of coolant on a column
STOP_M_PER_S, STOP_S = 0.5, 60.0  # of stops that warm a damping layer to the size: from which speed, how often
WAVE_M, HALF_WAVES = (0.6, 1.2), 2.0  # depth in which a wave of heat falls by e; its period over tau_s
DRIES = 0.3  # time constant in which the last coolant goes, over tau_s

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
    `radiant_heater`: a heater beside the column shines on the strut when its drive stands before it; what falls on the
    strut goes with the cosine over the square of the distance: J. H. Lambert, "Photometria" (1760). `rise_k` is where
    it ends right before the heater, which it nears with tau_s; away from there it cools.
    `rubbing_joint`: its joint runs dry, and the heat of its friction goes with the way alone, however fast: C. A.
    Coulomb, "Théorie des machines simples" (1785). `rise_k` is where it ends at a mean of 0.01 m/s of its drive.
    `fanned`: a lamp warms it evenly, and whenever its drive moves it through the air it cools faster, by the root of
    the speed: L. V. King, "On the Convection of Heat from Small Cylinders in a Stream of Fluid" (1914). `rise_k` is
    where it ends at rest, which it nears with tau_s.
    `damping_layer`: a damping layer inside it takes up the kinetic energy of every stop, however short the way was, and
    passes the heat on: L. Cremer, M. Heckl, "Structure-Borne Sound" (1973). `rise_k` is where it ends with a stop from
    STOP_M_PER_S every STOP_S.
    """

    def setup(self) -> None:
        """The heat of the joint: at first in it alone, then in the strut."""
        super().setup()
        tau = self.values["tau_s"]
        per_m = 1.0 / (DUTY_M_PER_S * JOINT_M_PER_S * tau)
        self._heat = LegMemory(lambda way, speed, _: per_m * np.abs(way) * speed, tau, JOINT * tau)
        self._rubbed = LegMemory(lambda way, _speed, _: np.abs(way) / (DUTY_M_PER_S * tau), tau, JOINT * tau)
        per_stop = STOP_S / STOP_M_PER_S**2 / tau
        self._stopped = LegMemory(lambda way, speed, _: per_stop * speed**2 * (way != 0.0), tau, JOINT * tau)
        middle, half = self.site.drive_range_m(self.site.machine.struts[self.place].drive)
        self.heater_m = middle + half * float(self.rng.uniform(-0.5, 0.5))
        self._shone_on = PlaceMemory(self.shines, tau)
        self._fanned = Fanned(lambda speed: 1.0 + FANS * np.sqrt(np.maximum(speed, 0.0) / FANS_M_PER_S), tau)

    def shines(self, q_m: Array) -> Array:
        """What falls on the strut when its drive stands at q_m (n,), over that right before the heater."""
        return np.asarray((1.0 + ((q_m - self.heater_m) / HEATER_M) ** 2) ** -1.5)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the joint be warmed by its own drive, or the strut where that stands or as fast as it moves."""
        if drive != self.site.machine.struts[self.place].drive:
            return
        if self.variant == "joint_heat":
            self._heat.record(leg)
        elif self.variant == "rubbing_joint":
            self._rubbed.record(leg)
        elif self.variant == "radiant_heater":
            self._shone_on.record(leg)
        elif self.variant == "fanned":
            self._fanned.record(leg)
        elif self.variant == "damping_layer":
            self._stopped.record(leg)

    def rise_k(self, state: MotionState) -> Array:
        """The temperature above the sensor (n,)."""
        if self.variant == "radiant_heater":
            return self.size * self._shone_on.at(state, self.site.machine.struts[self.place].drive)
        if self.variant == "fanned":
            return self.size * self._fanned.at(state, self.site.machine.struts[self.place].drive)
        sources = {"joint_heat": self._heat, "rubbing_joint": self._rubbed, "damping_layer": self._stopped}
        if self.variant not in sources:
            return super().rise_k(state)
        memory = sources[self.variant]
        whole, joint = memory.at(state, self.site.machine.struts[self.place].drive).T
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
    `two_walls`: its thin wall follows the air sooner than its thick one, so that it bends after every change of the
    air, one way and back: M. Weck, P. McKeown, R. Bonse, U. Herbst, "Reduction and Compensation of Thermal Errors in
    Machine Tools" (1995). The thick wall has tau_s; 1 is a size at which the difference of both walls acts as it is.
    `sun_on_face`: the sun comes through a window and wanders over one face, which is warmer than the other until it has
    cooled again: among the influences of the surroundings in J. Mayr et al., "Thermal Issues in Machine Tools" (2012).
    `drying`: spilt coolant cools it, at first at a constant rate and then, while the last of it goes, by less and less:
    both periods of drying in T. K. Sherwood, "The Drying of Solids" (1929). The size is how much cooler it would end.
    `heat_wave`: heat has come and gone at its foot for long, and runs up it as a wave that is weaker and later the
    higher it comes: A. J. Ångström, "Neue Methode, das Wärmeleitungsvermögen der Körper zu bestimmen" (1861). Its
    period is HALF_WAVES times tau_s, and the size is its amplitude at the foot.
    """

    sensor = "columns"
    width_m = 0.4

    def setup(self) -> None:
        """The heat of the rail: averaged over the column, and in what bends it."""
        super().setup()
        tau = self.values["tau_s"]
        self.sun_begins_s = float(self.rng.uniform(*SUN_BEGINS_S))
        self.sun_lasts_s = float(self.rng.uniform(*SUN_LASTS_S))
        self.wet_begins_s = float(self.rng.uniform(*WET_BEGINS_S))
        self.wet_lasts_s = float(self.rng.uniform(*WET_LASTS_S))
        self.wave_m = float(self.rng.uniform(*WAVE_M))
        fades_s = (tau, *(tau / (1.0 + k**2 / PLATE) for k in (1.0, 3.0)))
        self._heat = LegMemory(lambda way, _speed, _: np.abs(way) / (DUTY_M_PER_S * tau), *fades_s)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the carriage warm its rail."""
        if self.variant == "rail_heat" and drive == self.place:
            self._heat.record(leg)

    def _shone_on(self, elapsed_s: Array) -> Array:
        """Warmth (n,) of a face under a half sine of sunshine, and as it cools after that."""
        tau, lasts_s = self.values["tau_s"], self.sun_lasts_s
        under_s = np.clip(elapsed_s - self.sun_begins_s, 0.0, lasts_s)
        after_s = np.maximum(elapsed_s - self.sun_begins_s - lasts_s, 0.0)
        return cycled(under_s, tau, 2.0 * lasts_s) * np.exp(-after_s / tau)

    def _chilled(self, elapsed_s: Array) -> Array:
        """How cool (n,) a wet column is, over what coolant that stays would end at."""
        tau, dries_s = self.values["tau_s"], DRIES * self.values["tau_s"]
        wet_s = np.clip(elapsed_s - self.wet_begins_s, 0.0, self.wet_lasts_s)
        after_s = np.maximum(elapsed_s - self.wet_begins_s - self.wet_lasts_s, 0.0)
        left, goes = np.exp(-after_s / tau), np.exp(-after_s / dries_s)
        return warm_up(wet_s, tau) * left + (wet_s >= self.wet_lasts_s) * DRIES / (1.0 - DRIES) * (left - goes)

    def _waved_m(self, elapsed_s: Array, height_m: Array) -> Array:
        """Warmth of a wave from the foot to a height (n,), over its amplitude at the foot."""
        turn = 2.0 * np.pi * elapsed_s / (HALF_WAVES * self.values["tau_s"])
        falls = (1.0 + 1.0j) / self.wave_m
        return np.asarray((np.exp(1j * turn) * -np.expm1(-falls * height_m) / falls).imag)

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
        elif self.variant == "sun_on_face":
            warmer = alpha * self.size * self._shone_on(self.elapsed_s(state))
            deviation.travel_m[:, self.place] += 0.5 * warmer * height
            deviation.sideways_m[:, self.place] += 0.5 * warmer / self.width_m * height**2
            deviation.yaw_rad[:, self.place] += warmer / self.width_m * height
        elif self.variant == "two_walls":
            start_s, tau = self.site.start_s, self.values["tau_s"]
            thin, thick = (lag_behind(state, AIR, start_s, part_s) for part_s in (THIN_WALL * tau, tau))
            slope = alpha * self.size * (thin - thick) / self.width_m
            deviation.sideways_m[:, self.place] += 0.5 * slope * height**2
            deviation.yaw_rad[:, self.place] += slope * height
        elif self.variant == "motor_above":
            head = self.site.machine.sliders[self.place].travel_m[1] + strut.base_joint.imag - FOOT_M + HEAD_M
            deep = FRONT_M * np.sqrt(np.maximum(self.elapsed_s(state) / self.values["tau_s"], 1.0e-12))
            warm_m = ahead_of_front(head - height, deep) - ahead_of_front(np.full_like(height, head), deep)
            deviation.travel_m[:, self.place] += alpha * self.size * warm_m
        elif self.variant == "fin":
            deviation.travel_m[:, self.place] += grown * FIN_M * (1.0 - np.exp(-height / FIN_M))
        elif self.variant == "drying":
            deviation.travel_m[:, self.place] -= alpha * self.size * self._chilled(self.elapsed_s(state)) * height
        elif self.variant == "heat_wave":
            waved_m = self._waved_m(self.elapsed_s(state), height)
            deviation.travel_m[:, self.place] += alpha * self.size * waved_m
        elif self.variant == "stratified":  # warmer above: the growth goes with the square of the height
            deviation.travel_m[:, self.place] += 0.5 * grown * height**2
        else:
            deviation.travel_m[:, self.place] += grown * height


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
        (
            "warm_up",
            "lagging",
            "two_stages",
            "pulse",
            "conduction",
            "still_air",
            "cycling_air",
            "joint_heat",
            "radiant_heater",
            "rubbing_joint",
            "fanned",
            "damping_layer",
        ),
        "damping_layer",
        "time, a temperature swing; by variant travel, speed, stops and place",
        LinkGrowth,
    ),
    _spec(
        "column_thermal_growth",
        "drive",
        (
            "warm_up",
            "bending",
            "lagging",
            "stratified",
            "fin",
            "soaking",
            "motor_above",
            "rail_heat",
            "two_walls",
            "sun_on_face",
            "drying",
            "heat_wave",
        ),
        "heat_wave",
        "time or distance moved, a temperature swing, SMRs on the sliders",
        ColumnGrowth,
    ),
    _spec(
        "screw_thermal_growth",
        "drive",
        (
            "free_end",
            "pretensioned",
            "both_ends",
            "nut_local",
            "fixed_bearing",
            "where_it_ran",
            "motor_starts",
            "chilled",
            "nut_then_screw",
            "lifting",
            "holding",
        ),
        "holding",
        "time and distance moved, by variant direction, speed and dwell, drive coordinate, SMRs on the sliders",
        ScrewGrowth,
    ),
)
