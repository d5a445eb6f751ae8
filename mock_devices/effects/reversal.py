"""Backlash, which depends on the side a drive came from, and the play of a follower."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    EffectParameter,
    EffectSpec,
    Leg,
    MotionState,
    Site,
    StatefulEffect,
)
from mock_devices.effects.leg_memory import LegMemory, Reversals, ways_m
from mock_devices.effects.warming import conducted

FULL_PAYLOAD_KG = 400.0
PRESLIDING_M = 2.0e-5
RISE_M = (1.0e-3, 1.0e-2)
NUT_S, NUT_M_PER_S, NUT_CLOSES = 600.0, 0.04, 0.8  # a nut's warmth: decay; mean speed at which it is one; play closed
GAP_PER_K = 0.25  # of a play, by which housing and screw change it together
NEW, WEARS_M = 0.15, 100.0  # play of a new nut over the size; way of its drive after which it has the size
BALLS, LIFE_M, LIVES, WHOLE = 8, 80.0, 2.0, 0.15  # that break: how many; scale and shape of their lives; play before
WHEEL_M = (0.03, 0.09)  # travel in one turn of an eccentric wheel
SHAKES_M_PER_S = 0.2  # of the other drive, from which it shakes a slider all the way through its play
TOGETHER_S = 1.0e-3  # two drives that stop within it stop together
BALANCED_KG, NEARLY_KG = (0.0, 400.0), 180.0  # payload that is balanced; how far off there is little play
SWELLS_S, SWOLLEN = (2000.0, 6000.0), 0.9  # of a nut: slowest time constant; share of play closed in the end
KEYED, FRETS = 0.1, (40.0, 150.0)  # of a key: first play over the last; reversals that leave 1 / e of the rest
GRIT, GRAINS = (0.05, 1.0), 4096  # of a thread: play that grit leaves, over the size; motions until chance repeats it
CARRIES_M_PER_S = 0.25  # speed from which a slider runs on through its whole play
OPENED = (
    "wearing",
    "breaking_balls",
    "eccentric_wheel",
    "counterpoised",
    "swollen_nut",
    "fretted_key",
    "grit_in_thread",
)

TAU = EffectParameter("tau_s", 1.0, 4.0, 20.0, "time constant at rest")


class Play(StatefulEffect):
    """Remembers where, inside its play, a drive's follower stands: an offset in [-half, half] of `half_m`."""

    half_m = PRESLIDING_M

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The follower's offset after a leg: it stays where it is until the play is used up."""
        return min(max(before - (leg.to_m - leg.from_m), -self.half_m), self.half_m)

    def side(self, state: MotionState, drive: int) -> Array:
        """Where the follower is in its play (n,): -1 after motion in +, +1 after motion in -."""
        moved = state.q_m[:, drive] - state.from_m[:, drive]
        return np.clip(self.state_before(state, drive) - moved, -self.half_m, self.half_m) / self.half_m


class Backlash(Play):
    """The slider follows only when the play of its screw is used up; `width_m` is the whole play.

    `nested_plays`: plays of several widths, some wider than a usual approach, each with its own share: the operator in
    K. Kuhnen, "Modeling, Identification and Compensation of Complex Hysteretic Nonlinearities: A Modified
    Prandtl-Ishlinskii Approach" (2003). Each remembers a reversal of its own, so that minor loops lie inside the loop.
    `bouc_wen`: the equation of Y.-K. Wen, "Method for Random Vibration of Hysteretic Systems" (1976), with n = 1 and
    beta = gamma: a reversal is straight until the force has changed its sign, and then nears the other side by an
    exponential. Over a way of `rise_m` the straight part goes from side to middle.
    `squeeze_film`: oil between the flanks keeps them apart on arrival and is pressed out by what the drive carries, the
    slower the thinner it is: its thickness in J. Stefan, "Versuche über die scheinbare Adhäsion" (1874), falls with one
    over the root of time.
    `warm_nut`: a nut that its balls have warmed has less play, like the clearance of bearings whose rings are unequally
    warm in T. A. Harris, "Rolling Bearing Analysis" (1966). Its warmth comes from the travel of about the last NUT_S.
    `runs_on`: when its drive stops, the slider's inertia carries it on through the play, as far as its kinetic energy
    lasts: motion within clearances in S. Dubowsky, F. Freudenstein, "Dynamic Analysis of Mechanical Systems With
    Clearances" (1971). It stays behind after a slow approach, and from CARRIES_M_PER_S on it lies at the other flank.
    `temperature_gap`: housing and screw are of different metals, and the play between them opens or closes, by lot,
    with the drive's temperature: clearance and temperature in A. H. Slocum, "Precision Machine Design" (1992). The size
    is that at the reference temperature.
    `wearing`: a nut that was new wears with the way that it runs under its load, and its play grows as evenly: I. V.
    Kragelsky, "Friction and Wear" (1965). The size is the play after WEARS_M.
    `shaken_down`: friction holds the slider where its own motion has left it in its play, but the next drive, if it
    still moves when this one stops, shakes that friction off, so that the slider slides down to the lower flank, with
    the square of the other one's speed: J. J. Thomsen, "Using Fast Vibrations to Quench Friction-Induced Oscillations"
    (1999).
    `breaking_balls`: the weakest balls of the nut break one after the other, each after a way that is drawn from the
    distribution of W. Weibull, "A Statistical Theory of the Strength of Materials" (1939), and each widens the play by
    the same. The size is the play when all of them have broken.
    `eccentric_wheel`: a wheel between motor and screw sits off its axis, so that its teeth mesh deeply in one half of a
    turn and hardly in the other, and play opens and closes with the place: D. W. Dudley, "Practical Gear Design"
    (1954). The size is the widest play; at the deepest there is none.
    `counterpoised`: a counterweight bears what the drive would carry with one payload, and then nothing holds the nut
    on a flank; with any other payload, either the weight or the counterweight holds it on one flank, whichever way it
    moves: P. Varignon, "Nouvelle mécanique ou statique" (1725). Friction of the guides makes that gradual. The size is
    the play with the payload that is balanced.
    `swollen_nut`: a nut of plastic takes up oil from the campaign's begin on and swells, which closes its play, at
    first with the root of time: A. Fick, "Ueber Diffusion" (1855). The size is the play of the dry nut.
    `fretted_key`: the key between motor and screw rocks in its groove with every reversal and frets that wider, by less
    and less: R. B. Waterhouse, "Fretting Corrosion" (1972). Ways wear nothing. The size is the play in the end.
    `grit_in_thread`: every motion carries other grains of grit between the flanks, which take up a part of the play by
    chance: F. Galton, "Natural Inheritance" (1889). The size is the play of a clean thread.
    """

    nested_half_m = (5.0e-4, 4.0e-3, 1.6e-2, 6.4e-2)
    nested_share = (0.4, 0.3, 0.2, 0.1)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let every play of the variant `nested_plays` remember for itself."""
        super().record_leg(drive, leg)
        if self.variant == "warm_nut" and drive == self.place:
            self._nut.record(leg)
        if self.variant in ("wearing", "breaking_balls") and drive == self.place:
            self._worn.record(leg)
        if self.variant == "fretted_key" and drive == self.place:
            self._reversed.record(leg)
        if self.variant == "nested_plays":
            states = self._nested[drive]
            moved = states[-1] - (leg.to_m - leg.from_m)
            states.append(np.clip(moved, -np.array(self.nested_half_m), self.nested_half_m))

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The follower's offset, or the hysteretic force of the variant `bouc_wen`, after a leg."""
        if self.variant == "bouc_wen":
            return float(self._wen_after(np.array(leg.to_m - leg.from_m), np.array(before)))
        return super().state_after(drive, before, leg)

    def _wen_after(self, way_m: Array, before: Array) -> Array:
        """Solution of dz/dx = 1 - |z| (1 + sign(z dx)) / 2 after a way from `before`, x in `rise_m`."""
        side, way = np.sign(way_m), np.abs(way_m) / self.rise_m
        start = before * side  # negative while it is still on the other side
        straight = np.maximum(-start, 0.0)
        beyond = np.maximum(way - straight, 0.0)
        bent = 1.0 - (1.0 - np.maximum(start, 0.0)) * np.exp(-beyond)
        return np.asarray(np.where(side == 0.0, before, side * np.where(way < straight, start + way, bent)))

    def _nested_side(self, state: MotionState, drive: int) -> Array:
        """Weighted mean of where the followers of all plays are (n,), from -1 to 1."""
        half_m = np.array(self.nested_half_m)
        before = np.array(self._nested[drive])[state.leg[:, drive]]
        moved = (state.q_m[:, drive] - state.from_m[:, drive])[:, None]
        return np.asarray(np.clip(before - moved, -half_m, half_m) / half_m @ np.array(self.nested_share))

    def setup(self) -> None:
        """The play that is used up on a reversal; the variants change what is seen of it."""
        self.half_m = max(0.5 * self.size, 1e-12)
        self._nut = LegMemory(ways_m, NUT_S)
        self._worn = LegMemory(ways_m)
        self._nested = [[np.zeros(len(self.nested_half_m))] for _ in self.site.machine.sliders]
        if self.variant == "soft":  # balls and grooves give way: a gradual loop, wider than the usual approach
            self.half_m += 8.0e-3
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.rise_m = float(np.exp(self.rng.uniform(*np.log(RISE_M))))
        self.opens_per_k = GAP_PER_K * float(self.rng.choice([-1.0, 1.0]))
        self.wheel_m = float(self.rng.spawn(1)[0].uniform(*WHEEL_M))
        self.balanced_kg = float(self.rng.spawn(1)[0].uniform(*BALANCED_KG))
        self.swells_s = float(self.rng.spawn(1)[0].uniform(*SWELLS_S))
        self.frets = float(self.rng.spawn(1)[0].uniform(*FRETS))
        self._reversed = Reversals()
        self.grit = self.rng.spawn(1)[0].uniform(*GRIT, GRAINS)
        self.breaks_m = np.sort(LIFE_M * self.rng.weibull(LIVES, BALLS))

    def _opened(self, state: MotionState) -> Array:
        """How wide wear, broken balls, a wheel, balance, oil, fretting or grit make the play (n,), over the size."""
        if self.variant == "counterpoised":
            return np.asarray(np.exp(-(((state.payload_kg - self.balanced_kg) / NEARLY_KG) ** 2)))
        if self.variant in ("swollen_nut", "grit_in_thread"):
            swollen = 1.0 - SWOLLEN * conducted(self.elapsed_s(state), self.swells_s)
            grit = self.grit[state.leg[:, self.place] % GRAINS]
            return np.asarray(swollen if self.variant == "swollen_nut" else grit)
        if self.variant == "fretted_key":
            return np.asarray(1.0 - (1.0 - KEYED) * np.exp(-self._reversed.at(state, self.place) / self.frets))
        if self.variant == "eccentric_wheel":
            turn = 2.0 * np.pi * state.q_m[:, self.place] / self.wheel_m
            return np.asarray(0.5 + 0.5 * np.cos(turn + self.phase))
        way_m = self._worn.at(state, self.place)[:, 0]
        if self.variant == "breaking_balls":
            broken = np.searchsorted(self.breaks_m, way_m, side="right")
            return np.asarray(WHOLE + (1.0 - WHOLE) * broken / BALLS)
        return np.asarray(NEW + (1.0 - NEW) * way_m / WEARS_M)

    def _shaken(self, state: MotionState) -> Array:
        """How far through its play the next drive has shaken the slider (n,), from 0 to 1."""
        a, b = self.place, (self.place + 1) % len(self.site.machine.sliders)
        together = (state.leg_end_s[:, b] >= state.leg_end_s[:, a] - TOGETHER_S) & (state.speed_m_per_s[:, b] > 0.0)
        return np.where(together, 1.0, 0.0) * np.minimum((state.speed_m_per_s[:, b] / SHAKES_M_PER_S) ** 2, 1.0)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Let the slider stay behind."""
        a = self.place
        offset = 0.5 * self.size * self.side(state, a)
        if self.variant == "position_width":
            middle, half = self.site.drive_range_m(a)
            offset = offset * (1.0 + 0.7 * np.sin(2.0 * np.pi * (state.q_m[:, a] - middle) / (1.5 * half) + self.phase))
        elif self.variant == "load_width":  # weight presses the nut to one flank
            offset = offset * (1.0 - 0.6 * np.minimum(state.payload_kg / FULL_PAYLOAD_KG, 1.0))
        elif self.variant == "closing":  # an oil film is squeezed out while the axis stands
            offset = offset * (0.35 + 0.65 * np.exp(-state.since_s[:, a] / self.values["tau_s"]))
        elif self.variant == "squeeze_film":
            own_kg = self.site.machine.moving_mass_kg
            pressed = state.since_s[:, a] / self.values["tau_s"] * (own_kg + state.payload_kg) / own_kg
            offset = offset / np.sqrt(1.0 + pressed)
        elif self.variant == "warm_nut":
            warm = self._nut.at(state, a)[:, 0] / (NUT_S * NUT_M_PER_S)
            offset = offset * (1.0 - NUT_CLOSES * (1.0 - np.exp(-warm)))
        elif self.variant in OPENED:
            offset = offset * self._opened(state)
        elif self.variant == "shaken_down":
            offset = offset - self._shaken(state) * (offset + 0.5 * self.size)
        elif self.variant == "temperature_gap":
            offset = offset * np.maximum(1.0 + self.opens_per_k * above_reference_k(self.site, state), 0.0)
        elif self.variant == "runs_on":
            energy = (state.speed_m_per_s[:, a] / CARRIES_M_PER_S) ** 2
            offset = offset * (1.0 - 2.0 * np.minimum(energy, 1.0))
        elif self.variant == "nested_plays":
            offset = 0.5 * self.size * self._nested_side(state, a)
        elif self.variant == "bouc_wen":
            moved = state.q_m[:, a] - state.from_m[:, a]
            offset = -0.5 * self.size * self._wen_after(moved, self.state_before(state, a))
        elif self.variant == "soft":
            offset = offset * (1.0 - 0.5 * np.abs(self.side(state, a)) + 0.5 * self.side(state, a) ** 2)
        deviation.travel_m[:, a] += offset


def above_reference_k(site: Site, state: MotionState, part: str = "drives") -> Array:
    """Temperature that a part's sensor shows above the machine's reference (n,)."""
    return state.parts_c[site.machine.expansion[part].sensor] - site.machine.reference_temperature_c


EFFECTS = (
    EffectSpec(
        name="backlash",
        kind="catalogue",
        place="drive",
        size=EffectParameter("width_m", 1e-6, 1e-5, 6e-4, "whole play of the drive"),
        variants=(
            "play",
            "position_width",
            "load_width",
            "closing",
            "soft",
            "nested_plays",
            "bouc_wen",
            "squeeze_film",
            "warm_nut",
            "runs_on",
            "temperature_gap",
            "wearing",
            "shaken_down",
            "breaking_balls",
            "eccentric_wheel",
            "counterpoised",
            "swollen_nut",
            "fretted_key",
            "grit_in_thread",
        ),
        final="grit_in_thread",
        reveals="both directions of approach; by variant drive coordinate, payload, dwell, speed, also of the other "
        "drive, time, temperature, earlier motions, also by chance, and reversals",
        make=Backlash,
        others=(TAU,),
    ),
)
