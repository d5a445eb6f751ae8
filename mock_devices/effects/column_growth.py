"""Columns that are warmer than their sensor says: they grow and bend."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, Leg, MotionState
from mock_devices.effects.followers import FieldMemory, PlaceMemory
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.screw_growth import DUTY_M_PER_S
from mock_devices.effects.warming import AIR, Warming, ahead_of_front, cycled, lag_behind, soaked, warm_up

FOOT_M = -1.2
FIN_M = 0.5
FRONT_M, HEAD_M = 0.5, 0.2  # how deep heat has gone after tau_s; from the end of the travel to the column's head
PLATE = 0.1  # time constant across a column over that of the whole part
SUN_BEGINS_S, SUN_LASTS_S = (300.0, 1200.0), (1500.0, 3600.0)  # of sun on a column's face
THIN_WALL = 0.15  # time constant of a column's thin wall over that of its thick one
WET_BEGINS_S, WET_LASTS_S = (300.0, 1200.0), (1500.0, 3600.0)  # of coolant on a column
WAVE_M, HALF_WAVES = (0.6, 1.2), 2.0  # depth in which a wave of heat falls by e; its period over tau_s
THROTTLED_M_PER_S = 0.5  # of the other drive, whose oil then has the pressure that gives the size
HATCH, PLUME_M = (-0.7, -0.2), 1.2  # of a hatch: place over half the travel; how far a plume begins below it
HEATS_S, HEATS, HEATER_FIN_M = (900.0, 2400.0), (0.3, 0.6), 0.5  # of a heater: cycle; share of it that it is on; height
# in which its warmth falls by e
ALONG_IT = (
    "drying", "neighbours_oil", "draughty_hatch", "heat_wave", "braking_resistor", "cycled_heater", "ceiling_layer",
    "carriages_lamp",
)  # fmt: skip
FILLS_S = (2000.0, 6000.0)  # time constant of warm air that fills the hall from above
LAMP_M, CELL_M = (0.12, 0.3), 0.02  # of a lamp: how far from it what it gives a column has fallen to 1 / e; of a cell
DRIES = 0.3  # time constant in which the last coolant goes, over tau_s


class ColumnGrowth(Warming):
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
    `neighbours_oil`: oil that moves the next drive flows back through this column, and has been warmed in a throttle by
    the pressure that it lost there, which goes with the square of the speed: J. F. Blackburn, G. Reethof, J. L.
    Shearer, "Fluid Power Control" (1960). The size is where it ends if that drive runs at THROTTLED_M_PER_S with rests
    in between, at DUTY_M_PER_S on average.
    `draughty_hatch`: a hatch in the column is open while its carriage stands above it, and a warm draught rises in the
    column from there, its warmth falling with the power 5/3 of the height as in a plume: B. R. Morton, G. I. Taylor, J.
    S. Turner, "Turbulent Gravitational Convection from Maintained and Instantaneous Sources" (1956). The size is where
    it ends right above the hatch if that stays open, which it nears with tau_s; else it cools.
    `braking_resistor`: the weight of what its carriage lowers drives the motor, and a resistor inside the column takes
    up what that gives back, by the way downwards, however fast and whatever the payload: H. Ward Leonard, "Volts
    versus Ohms: Speed Regulation of Electric Motors" (1896). The size is where it ends at DUTY_M_PER_S on average, as
    much up as down.
    `cycled_heater`: a heater inside it, somewhere along the travel, is switched on and off in a fixed cycle, from the
    begin on, and the column nears either aim with the same time constant: N. Minorsky, "Nonlinear Oscillations"
    (1962). Its warmth falls off on both sides. The size is where it ends right there if the heater stays on.
    `ceiling_layer`: warm air that gathers under the ceiling fills the hall from there, and its lower edge sinks, ever
    more slowly; only what of the column is above that edge grows: E. E. Zukoski, "Development of a Stratified Ceiling
    Layer in the Early Stages of a Closed-Room Fire" (1978). It begins at the column's head. The size is where the part
    within the layer ends, which nears that with tau_s.
    `carriages_lamp`: a lamp on the carriage warms the column right behind it, for as long as it stands there, and what
    it has left cools: B. Thompson (Count Rumford), "An Inquiry Concerning the Nature of Heat, and the Mode of Its
    Communication" (1804). The size is where the column right behind it ends if the carriage stays, with tau_s.
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
        self.next = (self.place + 1) % len(self.site.machine.sliders)
        per_m = 1.0 / (DUTY_M_PER_S * THROTTLED_M_PER_S**2 * tau)
        per_way_m = 2.0 / (DUTY_M_PER_S * tau)
        self._lowered = LegMemory(lambda way, _speed, _: per_way_m * np.maximum(-way, 0.0), tau)
        self._oil = LegMemory(lambda way, speed, _: per_m * np.abs(way) * speed**2, tau)
        fades_s = (tau, *(tau / (1.0 + k**2 / PLATE) for k in (1.0, 3.0)))
        self._heat = LegMemory(lambda way, _speed, _: np.abs(way) / (DUTY_M_PER_S * tau), *fades_s)
        middle, half = self.site.drive_range_m(self.place)
        self.hatch_m = middle + half * float(self.rng.uniform(*HATCH))
        self._draught = PlaceMemory(lambda q_m: (q_m > self.hatch_m).astype(np.float64), tau)
        own = self.rng.spawn(1)[0]
        self.cycle_s, self.heats = float(own.uniform(*HEATS_S)), float(own.uniform(*HEATS))
        self.heater_m = middle + half * float(own.uniform(-0.5, 0.5))
        self.fills_s = float(own.uniform(*FILLS_S))
        self.lamp_m = float(self.rng.spawn(1)[0].uniform(*LAMP_M))
        strut = next(s for s in self.site.machine.struts if s.drive == self.place)
        self.cells_m = np.arange(FOOT_M - strut.base_joint.imag, middle + half + CELL_M, CELL_M)  # where each begins
        self._lit = FieldMemory(self._before_lamp, len(self.cells_m), tau)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the carriage warm its rail, or the next one the oil."""
        if self.variant == "neighbours_oil" and drive == self.next:
            self._oil.record(leg)
        if self.variant == "braking_resistor" and drive == self.place:
            self._lowered.record(leg)
        if self.variant == "draughty_hatch" and drive == self.place:
            self._draught.record(leg)
        if self.variant == "carriages_lamp" and drive == self.place:
            self._lit.record(leg)
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

    def _in_plume_m(self, q_m: Array) -> Array:
        """Warmth from the hatch up to the carriage (n,) over that right above the hatch, in metres."""
        above = np.maximum(q_m - self.hatch_m, 0.0) / PLUME_M
        return np.asarray(1.5 * PLUME_M * (1.0 - (1.0 + above) ** (-2.0 / 3.0)))

    def _heated(self, elapsed_s: Array) -> Array:
        """Warmth (n,) right at a heater that is on for a share of each cycle, over where it ends if that stays on."""
        tau, heats_s = self.values["tau_s"], self.heats * self.cycle_s
        cycles, at_s = np.floor(elapsed_s / self.cycle_s), elapsed_s % self.cycle_s
        kept = np.exp(-self.cycle_s / tau)
        adds = -np.expm1(-heats_s / tau) * np.exp(-(self.cycle_s - heats_s) / tau)  # what one cycle leaves at its end
        begins = adds * (1.0 - kept**cycles) / (1.0 - kept)
        warmed = 1.0 + (begins - 1.0) * np.exp(-np.minimum(at_s, heats_s) / tau)
        return np.asarray(warmed * np.exp(-np.maximum(at_s - heats_s, 0.0) / tau))

    def _beyond_heater_m(self, at_m: Array) -> Array:
        """Metres of its whole warmth (n,) from the heater to a place of the carriage, below it negative."""
        away_m = at_m - self.heater_m
        return np.asarray(-np.sign(away_m) * HEATER_FIN_M * np.expm1(-np.abs(away_m) / HEATER_FIN_M))

    def _in_layer_m(self, elapsed_s: Array, height_m: Array, foot_m: Array) -> Array:
        """Metres of whole warmth (n,) below the carriage and above the edge of a layer that begins at the head."""
        head_m = self.site.machine.sliders[self.place].travel_m[1] + HEAD_M - foot_m
        edge_m = head_m * (1.0 + elapsed_s / self.fills_s) ** -1.5
        return warm_up(elapsed_s, self.values["tau_s"]) * np.maximum(height_m - edge_m, 0.0)

    def _before_lamp(self, q_m: Array) -> Array:
        """Where a lamp on the carriage lets each cell end (n, cells), over the size."""
        away_m = self.cells_m + 0.5 * CELL_M - q_m[:, None]
        return np.asarray(np.exp(-((away_m / self.lamp_m) ** 2)))

    def _lit_m(self, state: MotionState) -> Array:
        """Metres of whole warmth (n,) below the carriage by its lamp."""
        below_m = np.clip(state.q_m[:, [self.place]] - self.cells_m, 0.0, CELL_M)
        return np.asarray((self._lit.at(state, self.place) * below_m).sum(axis=1))

    def _warm_m(self, state: MotionState, height_m: Array) -> Array:
        """Warmth from the foot to a height (n,) over the size, in metres."""
        if self.variant == "drying":
            return -self._chilled(self.elapsed_s(state)) * height_m
        if self.variant in ("neighbours_oil", "braking_resistor"):
            oil = self.variant == "neighbours_oil"
            warm = self._oil.at(state, self.next) if oil else self._lowered.at(state, self.place)
            return np.asarray(warm[:, 0] * height_m)
        if self.variant in ("heat_wave", "carriages_lamp"):
            waves = self.variant == "heat_wave"
            return self._waved_m(self.elapsed_s(state), height_m) if waves else self._lit_m(state)
        if self.variant in ("cycled_heater", "ceiling_layer"):
            foot_m = state.q_m[:, self.place] - height_m  # by the drive's coordinate
            if self.variant == "ceiling_layer":
                return self._in_layer_m(self.elapsed_s(state), height_m, foot_m)
            up_m, down_m = (self._beyond_heater_m(at_m) for at_m in (state.q_m[:, self.place], foot_m))
            return self._heated(self.elapsed_s(state)) * (up_m - down_m)
        return self._draught.at(state, self.place) * self._in_plume_m(state.q_m[:, self.place])

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
        elif self.variant in ALONG_IT:
            deviation.travel_m[:, self.place] += alpha * self.size * self._warm_m(state, height)
        elif self.variant == "stratified":  # warmer above: the growth goes with the square of the height
            deviation.travel_m[:, self.place] += 0.5 * grown * height**2
        else:
            deviation.travel_m[:, self.place] += grown * height
