"""Zero or scale of a drive that changes during the campaign."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    ONSET,
    Array,
    Deviation,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    StatefulEffect,
)
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.refraction import weather_k
from mock_devices.effects.warming import conducted, grid_from

SLIP_K = 0.4
CREEP_WAY_M = 100.0
STEPS_M_PER_S, STEPS = 0.3, 40.0  # above which a stepping motor loses steps; motions to the size
READER_S, DUTY_M_PER_S = 900.0, 0.02  # of a reading head's holder: time constant; mean speed for the size
SLIPS_M_PER_S, SLIPS = 0.2, 15.0  # a stop from this speed slips no coupling; sum of excesses for the size
DAMP_S = (1500.0, 5000.0)  # of a scale that takes up moisture: slowest time constant
JUMPS_S, JUMPS = 900.0, 3.0  # of a belt that jumps: mean time between two jumps; jumps to the size
UP_K, BACK_K = (0.05, 0.25), (0.1, 0.25)  # of a reader's range: switched above the begin; how much cooler back
MAINS_S = (250.0, 800.0)  # in which the frequency of the mains swings
RIM_M, WHEEL_M = (5.0, 25.0), 80.0  # of a wheel: way that its hard rim lasts; way after that for the size
HELD, FULL_PAYLOAD_KG = (-0.5, 0.5), 400.0  # of a tape that bears: where it is held, over half the travel; for the size
PINNED = (-0.5, 0.5)  # of a scale that is magnetised: where it is pinned, over half the travel
RELAXES_S, HOUR_S = 60.0, 3600.0


class DriveScale(StatefulEffect):
    """Zero or scale of a drive changes during the campaign: by `shift_m`, if of the scale at the end of the travel.

    `thermal_slip`: friction holds the scale against its own expansion up to a limit, beyond which it slips: the elastic
    element in series with a slider of W. D. Iwan, "A Distributed-Element Model for Hysteresis and Its Steady-State
    Dynamic Response" (1966), moved by the temperature.
    `wavelength`: the drive goes by an interferometer whose wavelength was right at the campaign's begin; its scale
    follows the index of the air as in B. Edlén, "The Refractive Index of Air" (1966), by temperature and pressure. The
    size is that of 1 K.
    `belt_creep`: a belt that carries weight is longer on its tight side, and creeps on its wheel downwards whichever
    way it runs, so that the zero sinks with the way: O. Reynolds, "On the Efficiency of Belts or Straps as
    Communicators of Work" (1874). The size is that of CREEP_WAY_M.
    `lost_steps`: a stepping motor falls out of step where it lifts its load faster than STEPS_M_PER_S, and loses the
    same few steps each time: pull-out in T. Kenjo, "Stepping Motors and Their Microprocessor Controls" (1984). The size
    is reached after STEPS such motions.
    `relaxing_tape`: a scale of steel tape that was strained anew at the onset loses its tension with the logarithm of
    time, fast at first, and grows shorter: stress relaxation in F. Garofalo, "Fundamentals of Creep and Creep-Rupture
    in Metals" (1965). The size is that after an hour, at the end of the travel.
    `warm_reader`: the drive's motions warm the holder of its reading head, which grows and moves the zero, and cools at
    rest: heat of a machine's own in M. Weck, P. McKeown, R. Bonse, U. Herbst, "Reduction and Compensation of Thermal
    Errors in Machine Tools" (1995). The size is that at a mean of DUTY_M_PER_S.
    `damp_scale`: a scale on a body of resin lies in damp air from the onset on and takes up moisture by diffusion, at
    first with the root of time: J. Crank, "The Mathematics of Diffusion" (1956). The size is that at the end of the
    travel in the end.
    `slipping_coupling`: from the onset on every hard stop slips the coupling between drive and encoder a little, in the
    sense of its motion, by what the kinetic energy exceeds that which friction holds: F. P. Bowden, D. Tabor, "The
    Friction and Lubrication of Solids" (1950). The size is that of three stops from 0.5 m/s on one side.
    `jumping_belt`: from the onset on a worn belt with fine teeth jumps by one of them at random moments, always
    downwards as the weight pulls: events that are rare in S. D. Poisson, "Recherches sur la probabilité des jugements"
    (1837). The size is that of JUMPS.
    `switching_range`: the reader switches its range as its drive grows warmer than one temperature, and back when it is
    cooler than another, and with the range its scale: relays in A. Visintin, "Differential Models of Hysteresis"
    (1994). Both lie near the temperature of the campaign's begin.
    `wandering_mains`: from the onset on the control takes its clock from the mains, whose frequency swings slowly as
    power stations share a load, and a scale that goes by that clock swings with it: N. Cohn, "Control of Generation and
    Power Flow on Interconnected Systems" (1966). The size is the amplitude at the end of the travel.
    `worn_wheel`: a wheel that runs along the guide measures the way, and once its hard rim is through, each metre takes
    as much off it, so that it counts more and more for the same way: T. Reye, "Zur Theorie der Zapfenreibung" (1860).
    The size is that at the end of the travel WHEEL_M later.
    `loaded_tape`: from the onset on the tape of the scale bears a part of the payload, which stretches it from where it
    is held: T. Young, "A Course of Lectures on Natural Philosophy" (1807). The size is that of FULL_PAYLOAD_KG at the
    upper end of the travel.
    `neighbours_magnet`: from the onset on the field of the next drive's motor reaches the scale, which its last motion
    leaves magnetised along or across, and so longer or shorter by the direction: J. P. Joule, "On the Effects of
    Magnetism upon the Dimensions of Iron and Steel Bars" (1847). The size is that at the upper end of the travel.
    """

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The way so far."""
        return before + abs(leg.to_m - leg.from_m)

    def setup(self) -> None:
        """Offsets after each homing; the first is as large as the size."""
        rest = self.rng.standard_normal(31)
        self.offsets = np.concatenate([[0.0, float(np.sign(self.rng.standard_normal()))], rest])[:32]
        self.sign = float(self.offsets[1])
        self.damp_s = float(self.rng.uniform(*DAMP_S))
        self.jumps_s = np.concatenate([[0.0], np.cumsum(self.rng.exponential(JUMPS_S, 60))])
        self.up_k = float(self.rng.uniform(*UP_K))
        self.back_k = self.up_k - float(self.rng.uniform(*BACK_K))
        self.mains_s = float(self.rng.uniform(*MAINS_S))
        self.mains_at = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.rim_m = float(self.rng.uniform(*RIM_M))
        self.held = float(self.rng.uniform(*HELD))
        self.pinned = float(self.rng.spawn(1)[0].uniform(*PINNED))
        self._warmed = LegMemory(lambda way, _speed, _: np.abs(way) / (DUTY_M_PER_S * READER_S), READER_S)
        onset_s = self.site.start_s + self.values["onset_s"]
        self._slid = LegMemory(
            lambda way, speed, start_s: (
                np.sign(way) * np.maximum((speed / SLIPS_M_PER_S) ** 2 - 1.0, 0.0) / SLIPS * (start_s >= onset_s)
            )
        )
        self._lost = LegMemory(lambda way, speed, _: ((way > 0.0) & (speed > STEPS_M_PER_S)).astype(np.float64))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let fast upward motions lose steps, all motions warm the reading head, or hard stops slip the coupling."""
        super().record_leg(drive, leg)
        if self.variant == "lost_steps" and drive == self.place:
            self._lost.record(leg)
        elif self.variant == "warm_reader" and drive == self.place:
            self._warmed.record(leg)
        elif self.variant == "slipping_coupling" and drive == self.place:
            self._slid.record(leg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        a = self.place
        middle, half = self.site.drive_range_m(a)
        after = (state.t_s - self.site.start_s >= self.values["onset_s"]).astype(np.float64)
        from_middle = (state.q_m[:, a] - middle) / half
        if self.variant == "scale_step":
            y = self.sign * after * from_middle
        elif self.variant == "homed_at_exchanges":  # without a reference after each exchange's power-off
            y = self.offsets[state.exchanges.astype(int) % len(self.offsets)]
        elif self.variant == "wavelength":
            start = np.full(len(state), self.site.start_s)
            y = (weather_k(state, state.t_s) - weather_k(state, start)) * (from_middle + 1.0) / 2.0
        elif self.variant in ("belt_creep", "worn_wheel"):
            way = self.state_before(state, a) + np.abs(state.q_m[:, a] - state.from_m[:, a])
            creeps = self.variant == "belt_creep"
            worn = np.maximum(way - self.rim_m, 0.0) / WHEEL_M * (from_middle + 1.0) / 2.0
            y = -way / CREEP_WAY_M if creeps else -worn
        elif self.variant in ("lost_steps", "warm_reader", "slipping_coupling"):
            memory, share = {
                "lost_steps": (self._lost, -1.0 / STEPS),
                "warm_reader": (self._warmed, self.sign),
                "slipping_coupling": (self._slid, 1.0),
            }[self.variant]
            y = share * memory.at(state, a)[:, 0]
        elif self.variant == "jumping_belt":
            jumped = np.searchsorted(self.jumps_s, state.t_s - self.site.start_s - self.values["onset_s"], side="right")
            y = -jumped / JUMPS
        elif self.variant in ("relaxing_tape", "loaded_tape"):
            loaded = after * state.payload_kg / FULL_PAYLOAD_KG * (from_middle - self.held) / (1.0 - self.held)
            y = loaded if self.variant == "loaded_tape" else -self._relaxed(state) * (from_middle + 1.0) / 2.0
        elif self.variant in ("switching_range", "neighbours_magnet"):
            magnetised = after * state.direction[:, (a + 1) % len(self.site.machine.sliders)]
            along = (from_middle - self.pinned) / (1.0 - self.pinned)
            switches = self.variant == "switching_range"
            y = self.sign * self._switched(state) * from_middle if switches else magnetised * along
        elif self.variant == "wandering_mains":
            swing = np.sin(2.0 * np.pi * self.elapsed_s(state) / self.mains_s + self.mains_at)
            y = after * swing * from_middle
        elif self.variant == "damp_scale":
            damp_s = np.maximum(state.t_s - self.site.start_s - self.values["onset_s"], 0.0)
            y = after * conducted(damp_s, self.damp_s) * (from_middle + 1.0) / 2.0
        elif self.variant == "thermal_slip":
            y = self._slipped(state) * (from_middle + 1.0) / 2.0
        else:
            y = self.sign * after
        deviation.travel_m[:, a] += self.size * y

    def _relaxed(self, state: MotionState) -> Array:
        """How much shorter a tape that was strained at the onset has grown (n,), over that after an hour."""
        strained_s = np.maximum(state.t_s - self.site.start_s - self.values["onset_s"], 0.0)
        return np.asarray(np.log1p(strained_s / RELAXES_S) / np.log1p(HOUR_S / RELAXES_S))

    def _since_begin_k(self, state: MotionState) -> tuple[Array, Array]:
        """A grid of times, and by how much warmer the drives then are than at the campaign's begin."""
        grid = grid_from(self.site.start_s, state)
        sensed_c = state.thermal.part_series_c(self.site.machine.expansion["drives"].sensor, grid)
        return grid, sensed_c - sensed_c[0]

    def _switched(self, state: MotionState) -> Array:
        """Whether the reader has switched its range (n,): 1 or 0, and 0 at the campaign's begin."""
        grid, warmer_k = self._since_begin_k(state)
        switched, now = np.empty_like(grid), 0.0
        for i, k in enumerate(warmer_k.tolist()):
            now = 1.0 if k > self.up_k else 0.0 if k < self.back_k else now
            switched[i] = now
        at = np.searchsorted(grid, state.t_s, side="right") - 1
        return np.asarray(switched[np.maximum(at, 0)])

    def _slipped(self, state: MotionState) -> Array:
        """Kelvin by which the scale has slipped since the campaign's begin (n,)."""
        grid, warmer_k = self._since_begin_k(state)
        slipped, now = np.empty_like(grid), 0.0
        for i, k in enumerate(warmer_k.tolist()):
            now = min(max(now, k - SLIP_K), k + SLIP_K)
            slipped[i] = now
        return np.asarray(np.interp(state.t_s, grid, slipped))


EFFECTS = (
    EffectSpec(
        name="drive_scale",
        kind="catalogue",
        place="drive",
        size=EffectParameter("shift_m", 1e-6, 2e-5, 1e-3, "of the zero, or of the scale at the end of the travel"),
        variants=(
            "homed_anew",
            "scale_step",
            "homed_at_exchanges",
            "thermal_slip",
            "wavelength",
            "belt_creep",
            "lost_steps",
            "relaxing_tape",
            "warm_reader",
            "damp_scale",
            "slipping_coupling",
            "jumping_belt",
            "switching_range",
            "wandering_mains",
            "worn_wheel",
            "loaded_tape",
            "neighbours_magnet",
        ),
        final="neighbours_magnet",
        reveals="time or motions made, a temperature swing, by variant their speed and direction, also of the other "
        "drive, payload, drive coordinate, SMRs on the sliders",
        make=DriveScale,
        others=(ONSET,),
    ),
)
