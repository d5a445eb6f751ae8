"""Friction that is left in a drive after a stop and winds up its screw."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import GRAVITY_M_PER_S2, Array, Deviation, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.leg_memory import LegMemory, ways_m
from mock_devices.effects.reversal import TAU, Play, above_reference_k
from mock_devices.effects.strut_ways import beside_m, way_of_strut

FULL_PAYLOAD_KG = 400.0
LEAD_ANGLE_RAD = math.radians(5.0)
REFERENCE_SPEED_M_PER_S = 0.5
REBUILT_S, SHEARED_M, LEAST = 40.0, 0.4, 0.25  # of a grease: rest, travel; share of friction without structure
VOGEL_K, VOGEL_C = 1000.0, -95.0  # of an oil for gears, at 20 degrees
LIPS, LIPS_DOWN = 0.35, 0.45  # friction of seals: share that no speed changes; downwards over upwards
LASTS, RUNS_IN_M = 0.25, 40.0  # friction of a screw that is run in over that of a new one; way in which it falls by e
TIGHT, FREE = 0.3, 0.15  # of a bent guide: half the stretch that binds over half the travel; friction outside it
SQUARE, JAMS_M = 0.2, (0.6, 1.0)  # of a drawer: friction while it is square, over the size; how far askew it has that
OILED, OILS_S = 0.25, (700.0, 1800.0)  # friction right after a pulse of oil, over the size; cycle of a lubricator
CLEAR, TOUCHES_KG = (0.1, 0.4), (60.0, 300.0)  # of a shoe: friction while it is clear, over the size; payload from
# which it touches
SHARED = (0.35, 0.7)  # of a belt: part of its friction that goes by the other drive's last motion
PINCHES_K, PINCHED_K, LOOSELY = (-0.4, 0.4), 1.0, 0.25  # of bearings: when they begin to pinch, above the reference; by
# how much warmer they rub by the size; what they rub before that, over it
UNPRESSED = 0.3  # share of a guide's friction that no strut presses, of that in the middle of the travel
GREASE_PER_K, GREASE_K, GREASE_S = 0.05, 25.0, 1500.0  # viscosity against temperature; how warm grease gets, and when


class FrictionWindup(Play):
    """The screw is wound up by its load and by the friction that is left in it after a stop.

    `palmgren`: friction of rolling contacts in two parts, one with speed to the power 2/3, one with the load: A.
    Palmgren, "Ball and Roller Bearing Engineering" (1959).
    `flanks`: dry flanks of a thread, whose friction goes with the load on the nut and is larger upwards than downwards:
    load tan(lead + friction) up, load tan(lead - friction) down, over tan(lead): J. E. Shigley, "Mechanical Engineering
    Design" (1963). `friction_n` is that upwards without payload.
    `warming_grease`: friction of a grease that grows warm after the campaign's begin, whose viscosity falls
    exponentially with its temperature: O. Reynolds, "On the Theory of Lubrication" (1886).
    `thixotropic`: a grease whose structure travel breaks down and rest builds up again, at the rates of F. Moore, "The
    Rheology of Ceramic Slips and Bodies" (1959): friction is what the motions and rests so far have left.
    `guide_pressed`: dry friction of the guide, which goes with what the struts press the carriage against it, by their
    angle and the payload: friction and pressure in C. A. Coulomb, "Théorie des machines simples" (1785). `friction_n`
    is that in the middle of all travels without payload.
    `ambient_viscosity`: oil that is as warm as the drive's sensor says rubs by its viscosity: H. Vogel, "Das
    Temperaturabhängigkeitsgesetz der Viskosität von Flüssigkeiten" (1921). `friction_n` is that at the reference.
    `seal_lips`: the lips of its seals rub on a film that grows with the root of the speed, and being cut aslant on one
    side they rub less downwards than upwards: H. K. Müller, B. S. Nau, "Fluid Sealing Technology" (1998). `friction_n`
    is that upwards at the reference speed.
    `running_in`: a new screw runs in, and its friction falls with its way towards what lasts: P. J. Blau, "Friction and
    Wear Transitions of Materials" (1989). `friction_n` is that of the new one.
    `tight_stretch`: a guide that is bent binds within one stretch of the travel, with edges, and is nearly free outside
    it: bearings out of line in F. T. Barwell, "Bearing Systems: Principles and Practice" (1979). `friction_n` is that
    within the stretch.
    `jammed_drawer`: the next carriage pulls the frame askew by how far it stands above or below this one, and this
    guide jams like a drawer, whose own friction presses it, with one over what is left to self-locking: G. Niemann,
    "Maschinenelemente" (1950). `friction_n` is that of the farthest apart, from where on stops hold the frame.
    `oiled_anew`: a lubricator gives oil in a fixed cycle, which is pressed out of the guide as evenly, so that friction
    rises until the next pulse: A. G. M. Michell, "Lubrication: Its Principles and Practice" (1950). `friction_n` is
    that right before a pulse.
    `overloaded_shoe`: beyond one payload the carriage sinks onto a shoe, whose dry friction comes in at once with its
    whole force: A. Morin, "Nouvelles expériences sur le frottement" (1832). `friction_n` is that beyond it.
    `shared_belt`: one belt runs over both drives and rubs on either, so that what is left goes by the last motion of
    this one and, in part, by that of the next: J. T. Desaguliers, "A Course of Experimental Philosophy" (1734).
    `friction_n` is that after both went the same way.
    `pinched_by_warmth`: above one temperature the drive's bearings have no clearance left and pinch, the more the
    warmer: R. A. Burton, H. E. Staph, "Thermally Activated Seizure of Angular Contact Bearings" (1967). `friction_n` is
    that PINCHED_K above.
    """

    def setup(self) -> None:
        """Phase of friction along the screw; structure of the grease before every leg, intact at first."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self._structure = [[1.0] for _ in self.site.machine.sliders]
        middle, half = self.site.drive_range_m(self.place)
        self.binds_m = middle + half * float(self.rng.uniform(-0.4, 0.4))
        self._run = LegMemory(ways_m)
        self.jams_m = float(self.rng.uniform(*JAMS_M))
        self.oils_s = float(self.rng.uniform(*OILS_S))
        self.oiled = float(self.rng.uniform(0.0, 1.0))
        self.touches_kg, self.clear = float(self.rng.uniform(*TOUCHES_KG)), float(self.rng.uniform(*CLEAR))
        self.shared = float(self.rng.uniform(*SHARED))
        self.pinches_k = float(self.rng.uniform(*PINCHES_K))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the grease remember, too."""
        super().record_leg(drive, leg)
        if self.variant == "running_in" and drive == self.place:
            self._run.record(leg)
        if self.variant == "thixotropic":
            left = self._structure[drive][-1] * math.exp(-abs(leg.to_m - leg.from_m) / SHEARED_M)
            self._structure[drive].append(1.0 - (1.0 - left) * math.exp(-(leg.until_s - leg.end_s) / REBUILT_S))

    def load_n(self, state: MotionState) -> Array:
        """What the drive carries (n,)."""
        drives = len(self.site.machine.sliders)
        if state.loads_n is not None:
            return np.asarray(state.loads_n[:, self.place])
        return np.asarray((self.site.machine.moving_mass_kg + state.payload_kg) * GRAVITY_M_PER_S2 / drives)

    def _flanks_n(self, state: MotionState) -> Array:
        """Friction of the thread's flanks, with the sign of the last motion (n,)."""
        load, moved = self.load_n(state), -self.side(state, self.place)
        lead = math.tan(LEAD_ANGLE_RAD)
        own_n = self.site.machine.moving_mass_kg * GRAVITY_M_PER_S2 / len(self.site.machine.sliders)
        angle = math.atan(lead * (1.0 + self.values["friction_n"] / own_n)) - LEAD_ANGLE_RAD
        up, down = math.tan(LEAD_ANGLE_RAD + angle) / lead - 1.0, 1.0 - math.tan(LEAD_ANGLE_RAD - angle) / lead
        return np.asarray(moved * np.abs(load) * np.where(moved * load > 0.0, up, down))

    def friction_n(self, state: MotionState) -> Array:
        """What is left in the drive (n,)."""
        a, values = self.place, self.values
        if self.variant == "flanks":
            return self._flanks_n(state)
        friction = -values["friction_n"] * self._sides(state)
        if self.variant == "stribeck":
            friction = friction * (0.5 + np.exp(-state.speed_m_per_s[:, a] / 0.25))
        elif self.variant == "relaxing":
            friction = friction * (0.3 + 0.7 * np.exp(-state.since_s[:, a] / values["tau_s"]))
        elif self.variant in ("warming_grease", "oiled_anew"):
            friction = friction * self._lasted(self.elapsed_s(state))
        elif self.variant == "thixotropic":
            before = np.array([self._structure[a][k] for k in state.leg[:, a].tolist()])
            left = before * np.exp(-np.abs(state.q_m[:, a] - state.from_m[:, a]) / SHEARED_M)
            friction = friction * (LEAST + (1.0 - LEAST) * left)
        elif self.variant in ("ambient_viscosity", "pinched_by_warmth"):
            friction = friction * self._by_warmth(above_reference_k(self.site, state))
        elif self.variant == "seal_lips":
            film = np.sqrt(state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S)
            friction = friction * (LIPS + (1.0 - LIPS) * film) * np.where(friction > 0.0, 1.0, LIPS_DOWN)
        elif self.variant == "running_in":
            friction = friction * (LASTS + (1.0 - LASTS) * np.exp(-self._run.at(state, a)[:, 0] / RUNS_IN_M))
        elif self.variant == "tight_stretch":
            _, half = self.site.drive_range_m(a)
            friction = friction * np.where(np.abs(state.q_m[:, a] - self.binds_m) < TIGHT * half, 1.0, FREE)
        elif self.variant in ("guide_pressed", "jammed_drawer", "overloaded_shoe"):
            friction = friction * self._pressed(state)
        elif self.variant == "palmgren":
            viscous = (state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S) ** (2.0 / 3.0)
            friction = friction * (0.6 * viscous + 0.4 + 0.6 * state.payload_kg / FULL_PAYLOAD_KG)
        elif self.variant == "position_friction":
            friction = friction * (1.0 + 0.6 * np.sin(2.0 * np.pi * state.q_m[:, a] / 0.31 + self.phase))
        return np.asarray(friction)

    def _sides(self, state: MotionState) -> Array:
        """From which side the drive came (n,), or both that a belt shares."""
        own = self.side(state, self.place)
        if self.variant != "shared_belt":
            return own
        others = self.side(state, (self.place + 1) % len(self.site.machine.sliders))
        return np.asarray((1.0 - self.shared) * own + self.shared * others)

    def _lasted(self, elapsed_s: Array) -> Array:
        """Friction by time alone (n,), over the size: of a grease that grows warm, or since the last pulse of oil."""
        if self.variant == "warming_grease":
            return np.asarray(np.exp(-GREASE_PER_K * GREASE_K * (1.0 - np.exp(-elapsed_s / GREASE_S))))
        return np.asarray(OILED + (1.0 - OILED) * ((elapsed_s / self.oils_s + self.oiled) % 1.0))

    def _by_warmth(self, above_k: Array) -> Array:
        """Friction by the drive's temperature above the reference (n,), over the size: of oil, or of bearings."""
        if self.variant == "pinched_by_warmth":
            return np.asarray(LOOSELY + (1.0 - LOOSELY) * np.maximum(above_k - self.pinches_k, 0.0) / PINCHED_K)
        reference_c = self.site.machine.reference_temperature_c
        now_c = reference_c + above_k
        return np.asarray(np.exp(VOGEL_K / (now_c - VOGEL_C) - VOGEL_K / (reference_c - VOGEL_C)))

    def _pressed(self, state: MotionState) -> Array:
        """Friction of a guide (n,) by what presses it: the struts, a frame askew or a shoe; over the size."""
        if self.variant == "overloaded_shoe":
            return np.where(state.payload_kg > self.touches_kg, 1.0, self.clear)
        if self.variant == "jammed_drawer":
            askew = np.minimum(np.abs(beside_m(self.site, state, self.place)) / self.jams_m, 1.0)
            return np.asarray(SQUARE / (1.0 - (1.0 - SQUARE) * askew))
        own_kg = self.site.machine.moving_mass_kg
        pressed = self._across(state.q_m) * (own_kg + state.payload_kg) / own_kg
        return np.asarray(UNPRESSED + (1.0 - UNPRESSED) * pressed)

    def _across(self, q_m: Array) -> Array:
        """Force of the drive's struts across its guide (n,) over that in the middle of all travels."""
        machine = self.site.machine
        mine = next(i for i, strut in enumerate(machine.struts) if strut.drive == self.place)
        middle_m = np.array([[self.site.drive_range_m(a)[0] for a in range(q_m.shape[1])]])
        now, then = (
            way_of_strut(machine, mine, at_m) * machine.sliders[self.place].axis.conjugate() for at_m in (q_m, middle_m)
        )
        return np.abs(now.imag / now.real) / np.abs(then.imag / then.real)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn force into displacement; the torque shows the friction too."""
        a, friction = self.place, self.friction_n(state)
        force = self.load_n(state) + friction
        softness = 1.0 / np.sqrt(1.0 + (force / 1500.0) ** 2) if self.variant == "hardening" else 1.0
        deviation.travel_m[:, a] -= self.size * force * softness
        if self.size:
            deviation.force_n[:, a] += friction


FRICTION_VARIANTS = ("coulomb", "stribeck", "relaxing", "hardening", "position_friction")
FRICTION_PARAMETERS = (EffectParameter("friction_n", 50.0, 300.0, 900.0, "friction left in the screw"), TAU)

EFFECTS = (
    EffectSpec(
        name="friction_windup",
        kind="catalogue",
        place="drive",
        size=EffectParameter("windup_m_per_n", 1e-9, 1e-8, 2e-7, "axial displacement a force, screw and coupling"),
        variants=(
            *FRICTION_VARIANTS,
            "palmgren",
            "flanks",
            "warming_grease",
            "thixotropic",
            "guide_pressed",
            "ambient_viscosity",
            "seal_lips",
            "running_in",
            "tight_stretch",
            "jammed_drawer",
            "oiled_anew",
            "overloaded_shoe",
            "shared_belt",
            "pinched_by_warmth",
        ),
        final="pinched_by_warmth",
        reveals="torque: both directions, also of the other drive, and payloads; by variant speed, dwell, pose, "
        "temperature, time, earlier motions",
        make=FrictionWindup,
        others=FRICTION_PARAMETERS,
    ),
)
