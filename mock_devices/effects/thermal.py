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
from mock_devices.effects.column_growth import ColumnGrowth
from mock_devices.effects.flows import PumpedCoolant
from mock_devices.effects.followers import Fanned, PlaceMemory
from mock_devices.effects.leg_memory import LegMemory, PassMemory
from mock_devices.effects.screw_growth import DUTY_M_PER_S, ScrewGrowth
from mock_devices.effects.warming import ByTurns, Warming, set_share, warmed_by

JOINT = 0.2  # time constant of a strut's joint over that of the whole part
JOINT_M_PER_S = 0.5
HEATER_M = 0.35  # from a radiant heater to the strut before it
FANS, FANS_M_PER_S = 5.0, 0.5  # what a strut loses beyond still air, over that, at a speed of its drive
PIPE_STARTS = 0.3  # of half the travel: within which of its middle a heat pipe starts, by lot
CRITICAL_M_PER_S, TURBULENT = (0.15, 0.35), 4.0  # of coolant: speed of the drive from which its flow is turbulent; see
# `turbulent_coolant`
MAGNET_M = 0.15  # of the way past a magnet
SHADES = 0.3  # of half the travel of the next drive, either way from its middle: from where on it shades a lamp
PENUMBRA_M = 0.15  # of that: way from no shade to the whole of it
CLOUDS_S, CLOUDS = 400.0, 256  # mean time for which the sun shines or not; how many of these are drawn
SETS_S, CATALYSES = (800.0, 2400.0), (30.0, 150.0)  # of a resin: time until half of it has set; by how much faster than
# at first it would set, but for what is left, with all of it set
STOP_M_PER_S, STOP_S = 0.5, 60.0  # of stops that warm a damping layer to the size: from which speed, how often

_RISE = EffectParameter("rise_k", 0.05, 1.0, 40.0, "how much warmer than the sensor the part becomes")
_TAU = EffectParameter("tau_s", 300.0, 1500.0, 6000.0, "time constant of the part")


class LinkGrowth(Warming):
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
    `heat_pipe`: a heat pipe inside it begins where the strut is warm, and works only while its fluid runs back by its
    weight, so while its drive stands above a certain place: T. P. Cotter, "Theory of Heat Pipes" (1965). `rise_k` is
    where it ends if the pipe works on, which it nears with tau_s; else it cools.
    `turbulent_coolant`: a lamp warms it evenly, and coolant is pumped along it as fast as its drive last moved. Beyond
    a critical speed the flow is turbulent and takes away 1 + TURBULENT times the heat, and more with the power 0.8 of
    the speed: O. Reynolds, "An Experimental Investigation of the Circumstances Which Determine Whether the Motion of
    Water Shall Be Direct or Sinuous" (1883). `rise_k` is where it ends in laminar flow, which it nears with tau_s.
    `eddy_magnet`: a magnet stands beside the column at one place, and eddy currents heat the strut as its drive takes
    it past, by the square of the speed for as long as it is there, and so by way times speed: L. Foucault, "De la
    chaleur produite par l'influence de l'aimant sur les corps en mouvement" (1855). `rise_k` is where it ends if its
    drive runs at JOINT_M_PER_S evenly all over its travel, with rests in between, at 0.01 m/s on average.
    `neighbours_shade`: a lamp warms it evenly, but the next carriage, while it stands above a certain place, is in the
    way of the light, and the strut cools in its shade, less so in the penumbra: P. Bouguer, "Essai d'optique sur
    la gradation de la lumière" (1729). `rise_k` is where it ends if it is never shaded, which it nears with tau_s.
    `drifting_clouds`: the sun shines on it between clouds, which come and go at random moments, and in their shade it
    cools: A. Ångström, "Solar and Terrestrial Radiation" (1924). It begins to shine with the campaign. `rise_k` is
    where it ends if it shines on, which it nears with tau_s.
    `setting_resin`: resin was poured into it at the campaign's begin and gives off heat as it sets, which it does the
    faster the more of it has, until little is left: M. R. Kamal, S. Sourour, "Kinetics and Thermal Characterization of
    Thermoset Cure" (1973). `rise_k` is where it would end if it lost none of that heat, which fades with tau_s.
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
        self.starts_m = middle + half * float(self.rng.uniform(-PIPE_STARTS, PIPE_STARTS))
        self._piped = PlaceMemory(lambda q_m: (q_m > self.starts_m).astype(np.float64), tau)
        self._fanned = Fanned(lambda speed: 1.0 + FANS * np.sqrt(np.maximum(speed, 0.0) / FANS_M_PER_S), tau)

        own = self.rng.spawn(1)[0]
        self.critical_m_per_s = float(own.uniform(*CRITICAL_M_PER_S))
        self._cooled = PumpedCoolant(self.takes, tau)
        self.magnet_m = middle + half * float(self.rng.spawn(1)[0].uniform(-0.5, 0.5))
        ends_m = (self.magnet_m - 0.5 * MAGNET_M, self.magnet_m + 0.5 * MAGNET_M)
        past_magnet = 2.0 * half / (MAGNET_M * DUTY_M_PER_S * tau)
        self._eddies = PassMemory(*ends_m, tau, lambda speed: past_magnet * speed / JOINT_M_PER_S)
        self.next = (self.site.machine.struts[self.place].drive + 1) % len(self.site.machine.sliders)
        middle, half = self.site.drive_range_m(self.next)
        self.shades_m = middle + half * float(self.rng.spawn(1)[0].uniform(-SHADES, SHADES))
        self._lit = PlaceMemory(lambda q_m: np.clip(0.5 - (q_m - self.shades_m) / PENUMBRA_M, 0.0, 1.0), tau)
        self.clouds_s = np.cumsum(self.rng.spawn(1)[0].exponential(CLOUDS_S, CLOUDS))
        self._sunned = ByTurns(self.clouds_s, tau)
        own = self.rng.spawn(1)[0]
        self.sets_s, self.catalyses = float(own.uniform(*SETS_S)), float(own.uniform(*CATALYSES))

    def takes(self, speed: Array) -> Array:
        """Heat that coolant takes away (n,) over that in laminar flow."""
        over = np.maximum(speed / self.critical_m_per_s, 0.0)
        return np.where(over > 1.0, 1.0 + TURBULENT * over**0.8, 1.0)

    def shines(self, q_m: Array) -> Array:
        """What falls on the strut when its drive stands at q_m (n,), over that right before the heater."""
        return np.asarray((1.0 + ((q_m - self.heater_m) / HEATER_M) ** 2) ** -1.5)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the joint be warmed by its own drive, or the strut where that stands or as fast as it moves."""
        if self.variant == "neighbours_shade" and drive == self.next:
            self._lit.record(leg)
        if drive != self.site.machine.struts[self.place].drive:
            return
        if self.variant == "joint_heat":
            self._heat.record(leg)
        elif self.variant == "rubbing_joint":
            self._rubbed.record(leg)
        elif self.variant == "radiant_heater":
            self._shone_on.record(leg)
        elif self.variant == "heat_pipe":
            self._piped.record(leg)
        elif self.variant == "fanned":
            self._fanned.record(leg)
        elif self.variant == "turbulent_coolant":
            self._cooled.record(leg)
        elif self.variant == "eddy_magnet":
            self._eddies.record(leg)
        elif self.variant == "damping_layer":
            self._stopped.record(leg)

    def rise_k(self, state: MotionState) -> Array:
        """The temperature above the sensor (n,)."""
        if self.variant == "drifting_clouds":
            return self.size * self._sunned.at(self.elapsed_s(state))
        if self.variant == "setting_resin":
            tau, start_s = self.values["tau_s"], self.site.start_s
            return self.size * warmed_by(state, lambda t: set_share(t, self.sets_s, self.catalyses), start_s, tau)
        if self.variant == "neighbours_shade":
            return self.size * self._lit.at(state, self.next)
        followers: dict[str, PlaceMemory | Fanned | PumpedCoolant | PassMemory] = {
            "radiant_heater": self._shone_on,
            "heat_pipe": self._piped,
            "fanned": self._fanned,
            "turbulent_coolant": self._cooled,
            "eddy_magnet": self._eddies,
        }
        if self.variant in followers:
            return self.size * followers[self.variant].at(state, self.site.machine.struts[self.place].drive)
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
            "heat_pipe",
            "turbulent_coolant",
            "eddy_magnet",
            "neighbours_shade",
            "drifting_clouds",
            "setting_resin",
        ),
        "setting_resin",
        "time, also by chance, a temperature swing; by variant travel, speed, stops and place, also of the other drive",
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
            "neighbours_oil",
            "draughty_hatch",
            "braking_resistor",
            "cycled_heater",
            "ceiling_layer",
            "carriages_lamp",
        ),
        "carriages_lamp",
        "time, place, direction or distance moved, also by the other drive, a temperature swing, SMRs on the sliders",
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
            "starved_stretch",
            "thinning_oil",
            "neighbours_motor",
            "bubbling_oil",
            "short_strokes",
            "neighbours_fan",
        ),
        "neighbours_fan",
        "time and distance moved, also by the other drive, by variant direction, speed, dwell and length of ways, "
        "drive coordinate, SMRs on the sliders",
        ScrewGrowth,
    ),
)
