"""Sliders that settle after a motion."""

from __future__ import annotations

import numpy as np
from scipy.special import erfcx

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, Leg, MotionState
from mock_devices.effects.leg_memory import LegMemory, motions

REFERENCE_SPEED_M_PER_S = 0.5
SWINGS, CALMS = 3.0, 0.5  # of a load: rate and decay, over tau_s
LONG, AFTER_M = 6.0, 0.5  # slow time constant of an after-effect over tau_s; travel that leaves the size
UNWINDS = 3.0  # time constant of an integral part that unwinds, over tau_s
WOUND_M, UNWOUND_M = 0.25, 0.04  # ways of which an integral part is wound up to its limit, or not at all
LEARNS = 150.0  # motions in which a controller has learnt all but 1 / e
TWICE_SWINGS, TWICE_CALMS = 8.0, 0.15  # of a load that start and stop make swing: rate and decay, over tau_s
BRAKED, QUICKER, SLOWER = 0.35, 0.5, 4.0  # of a magnet beside the guide: half its stretch over half the travel; time
# constant within it and elsewhere, over tau_s
PULLEY_M, ROPE_SWINGS, ROPE_CALMS = (0.1, 0.5), 2.5, 0.3  # of a weight on a rope: how far above the travel its pulley
# is; rate in the middle of the travel and decay, over tau_s
FULLY_ON = (0.02, 0.06)  # of an amplifier: what is behind from which on it is fully on, over the size
STICKS = 0.15  # friction over the force of the first swing


class ServoSettling(Effect):
    """The slider comes to rest late: `amplitude_m` behind its target on arrival at 0.5 m/s.

    `stretched`: exp(-sqrt(t / tau)), the relaxation in R. Kohlrausch, "Theorie des elektrischen Rückstandes in der
    Leidener Flasche" (1854): fast at first and long after still on its way.
    `critically_damped`: (1 + t / tau) exp(-t / tau), the loop of second order with damping one of K. Ogata, "Modern
    Control Engineering" (1970), that has come to rest for the moment when its target stops.
    `dry_friction`: swings that dry friction shortens by the same way each, until it holds the slider beside its target:
    J. P. Den Hartog, "Mechanical Vibrations" (1934). Half a swing takes tau_s.
    `after_effect`: a belt forgets no motion at once, so that all earlier motions act together, the latest ones most: L.
    Boltzmann, "Zur Theorie der elastischen Nachwirkung" (1874), here with two time constants. A motion by AFTER_M
    leaves the size.
    `integrator_reset`: the controller's integral part, which holds the weight, is cleared with every motion and builds
    up again at rest, so that the slider arrives below its target from either side and rises: K. J. Åström, T. Hägglund,
    "PID Controllers: Theory, Design, and Tuning" (1995). The size is that without payload, at any speed.
    `swinging_load`: what hangs on the slider swings on beyond its target, the further and the more slowly the heavier
    it is: N. C. Singer, W. P. Seering, "Preshaping Command Inputs to Reduce System Vibration" (1990). The size is the
    swing without payload, were it not damped.
    `half_order`: a rubber element relaxes by a derivative of the order one half, as if it had all time constants, with
    a long tail of one over the root of time: exp(t) erfc(sqrt(t)), t over tau_s, in M. Caputo, F. Mainardi, "A New
    Dissipation Model Based on Memory Mechanism" (1971).
    `wound_up`: the integral part winds up over every long way, up to its limit, and carries the slider beyond until it
    has unwound: K. J. Åström, L. Rundqwist, "Integrator Windup and How to Avoid It" (1989). A short approach leaves
    what the long way before it has wound up. The size is what the limit gives, at any speed.
    `learning`: the controller learns from every motion, so that each arrival is behind by a constant share less than
    the one before: S. Arimoto, S. Kawamura, F. Miyazaki, "Bettering Operation of Robots by Learning" (1984). What is
    left goes as an integral part takes it up. The size is that of one which has learnt nothing yet.
    `half_swings`: start and stop of a motion each make the load swing, and what is left goes by how long the motion
    lasted, nothing after whole swings and most after half ones: O. J. M. Smith, "Posicast Control of Damped Oscillatory
    Systems" (1957). Its period and decay go with tau_s. The size is that of both together, were they not damped.
    `sampled_loop`: its loop looks at the slider only once in a cycle of its own and then takes away half of what is
    left, so that it arrives by steps, whenever these come after the stop: E. I. Jury, "Sampled-Data Control Systems"
    (1958). A cycle lasts tau_s.
    `eddy_brake`: within one stretch of its travel the slider runs past a magnet, whose eddy currents damp what is left
    of its motion quickly; elsewhere it dies out slowly: E. Lenz, "Über die Bestimmung der Richtung der durch
    elektrodynamische Vertheilung erregten galvanischen Ströme" (1834).
    `pendulum_rope`: a weight hangs from a pulley above the travel on a rope that its drive pays out, and swings after
    each stop, with the root of the rope's length the more slowly: C. Huygens, "Horologium oscillatorium" (1673).
    `saturated_amplifier`: an amplifier that is fully on takes away what is far behind evenly, and only the rest by an
    exponential: A. I. Lur'e, "Some Nonlinear Problems in the Theory of Automatic Control" (1951).
    """

    def setup(self) -> None:
        """What the belt has not yet forgotten."""
        tau = self.values["tau_s"]
        self._ways = LegMemory(lambda way, _speed, _: way / AFTER_M, tau, LONG * tau)
        self.looks = float(self.rng.uniform(0.0, 1.0))
        middle, half = self.site.drive_range_m(self.place)
        self.braked_m = middle + half * float(self.rng.uniform(-0.4, 0.4))
        self.pulley_m = float(self.rng.spawn(1)[0].uniform(*PULLEY_M))
        self.fully_on = float(self.rng.spawn(1)[0].uniform(*FULLY_ON))
        self._learnt = LegMemory(motions)
        self._wound = LegMemory(_winds, UNWINDS * tau)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the belt of this drive remember."""
        if self.variant == "after_effect" and drive == self.place:
            self._ways.record(leg)
        elif self.variant == "learning" and drive == self.place:
            self._learnt.record(leg)
        elif self.variant == "wound_up" and drive == self.place:
            self._wound.record(leg)

    def _remembered(self, state: MotionState) -> Array:
        """How far beyond its target earlier motions let the slider stand (n,), over the size."""
        a = self.place
        if self.variant == "wound_up":
            return self._wound.at(state, a)[:, 0]
        if self.variant == "after_effect":
            return -self._ways.at(state, a).mean(axis=1)
        behind = state.direction[:, a] * state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S
        left = np.exp(-state.since_s[:, a] / (UNWINDS * self.values["tau_s"]))
        return np.asarray(-behind * left * np.exp(-self._learnt.at(state, a)[:, 0] / LEARNS))

    def _slower(self, state: MotionState) -> Array | float:
        """Time constant of a plain decay (n,) over tau_s: by where a magnet brakes."""
        if self.variant != "eddy_brake":
            return 1.0
        _, half = self.site.drive_range_m(self.place)
        return np.where(np.abs(state.q_m[:, self.place] - self.braked_m) < BRAKED * half, QUICKER, SLOWER)

    def _looked(self, state: MotionState) -> Array:
        """How often a loop has looked since the stop (n,)."""
        cycle_s, stops_s = self.values["tau_s"], state.leg_end_s[:, self.place]
        now, then = (
            np.floor((at_s - self.site.start_s) / cycle_s + self.looks)
            for at_s in (stops_s + state.since_s[:, self.place], stops_s)
        )
        return np.asarray(now - then)

    def _left(self, state: MotionState, t: Array) -> Array:
        """What is left some time over tau_s after a motion (n,), by how long that lasted, looks of a loop or a rope."""
        a = self.place
        if self.variant == "sampled_loop":
            return np.asarray(0.5 ** self._looked(state))
        if self.variant == "pendulum_rope":
            slider, half = self.site.machine.sliders[a], self.site.drive_range_m(a)[1]
            rope_m = np.maximum(slider.travel_m[1] + self.pulley_m - state.q_m[:, a], 0.5 * self.pulley_m)
            slower = np.sqrt(rope_m / (half + self.pulley_m))
            return np.asarray(np.exp(-ROPE_CALMS * t) * np.cos(ROPE_SWINGS * t / slower))
        moved = np.maximum(state.leg_end_s[:, a] - state.leg_start_s[:, a], 0.0) / self.values["tau_s"]
        return np.asarray(0.5 * (_swing(t) - _swing(t + moved)))

    def _amplified(self, first: Array, t: Array) -> Array:
        """What is left of what was behind at first (n,), over the size, some time over tau_s after the stop."""
        evenly = np.maximum(first / self.fully_on - 1.0, 0.0)  # how long the amplifier is fully on, over tau_s
        rest = np.minimum(first, self.fully_on) * np.exp(-np.maximum(t - evenly, 0.0))
        return np.where(t < evenly, first - self.fully_on * t, rest)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Hold the slider back."""
        a, tau = self.place, self.values["tau_s"]
        if self.variant in ("after_effect", "wound_up", "learning"):
            deviation.travel_m[:, a] += self.size * self._remembered(state)
            return
        t = state.since_s[:, a] / tau
        share = np.exp(-t / self._slower(state))
        if self.variant in ("half_swings", "sampled_loop", "pendulum_rope"):
            share = self._left(state, t)
        if self.variant in ("integrator_reset", "saturated_amplifier"):
            amplified = state.direction[:, a] * self._amplified(state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S, t)
            own_kg = self.site.machine.moving_mass_kg
            weight = (state.speed_m_per_s[:, a] > 0.0) * (own_kg + state.payload_kg) / own_kg
            deviation.travel_m[:, a] -= self.size * (
                weight * share if self.variant == "integrator_reset" else amplified
            )
            return
        if self.variant == "swinging_load":
            own_kg = self.site.machine.moving_mass_kg
            slower = np.sqrt((own_kg + state.payload_kg) / own_kg)
            share = -slower * np.exp(-CALMS * t) * np.sin(SWINGS * t / slower)
        elif self.variant == "ringing":
            share = np.exp(-0.5 * t) * np.cos(2.5 * t)
        elif self.variant == "logarithmic":
            share = np.maximum(1.0 - np.log1p(t) / np.log(8.0), 0.0)
        elif self.variant == "integrator":
            share = np.maximum(1.0 - 0.5 * t, 0.0)
        elif self.variant == "half_order":
            share = erfcx(np.sqrt(t))
        elif self.variant == "stretched":
            share = np.exp(-np.sqrt(t))
        elif self.variant == "dry_friction":
            share = _swings(t)
        elif self.variant == "critically_damped":
            share = (1.0 + t) * np.exp(-t)
        elif self.variant == "two_stages":
            share = 0.6 * np.exp(-2.0 * t) + 0.4 * np.exp(-0.4 * t)
        behind = state.direction[:, a] * state.speed_m_per_s[:, a] / REFERENCE_SPEED_M_PER_S
        deviation.travel_m[:, a] -= self.size * behind * share


def _winds(way_m: Array, _speed: Array, _start_s: Array) -> Array:
    """What a way winds up (n,), over the limit."""
    return np.sign(way_m) * np.clip((np.abs(way_m) - UNWOUND_M) / (WOUND_M - UNWOUND_M), 0.0, 1.0)


def _swing(t: Array) -> Array:
    """A damped swing (n,) some time after a start or a stop, over tau_s."""
    return np.asarray(np.exp(-TWICE_CALMS * t) * np.sin(TWICE_SWINGS * t))


def _swings(halves: Array) -> Array:
    """Place (n,) after some half swings, from 1: each about a middle that friction shifts to where it came from."""
    last = int(np.ceil((1.0 / STICKS - 1.0) / 2.0))  # the half swing that would begin where friction holds
    n = np.minimum(np.floor(halves), last)
    sign = np.where(n % 2.0 == 0.0, 1.0, -1.0)
    swing = np.cos(np.pi * np.where(n < last, halves - n, 0.0))
    begins = 1.0 - 2.0 * STICKS * n
    return np.asarray(sign * np.where(n < last, STICKS + (begins - STICKS) * swing, begins))


EFFECTS = (
    EffectSpec(
        name="servo_settling",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 4e-5, 4e-3, "short on arrival"),
        variants=(
            "creep",
            "ringing",
            "logarithmic",
            "integrator",
            "two_stages",
            "stretched",
            "critically_damped",
            "dry_friction",
            "after_effect",
            "integrator_reset",
            "swinging_load",
            "half_order",
            "wound_up",
            "learning",
            "half_swings",
            "sampled_loop",
            "eddy_brake",
            "pendulum_rope",
            "saturated_amplifier",
        ),
        final="saturated_amplifier",
        reveals="varied dwell and speed, by variant length of the motion, drive coordinate, payload or earlier "
        "motions, SMRs on the sliders",
        make=ServoSettling,
        others=(EffectParameter("tau_s", 0.5, 3.0, 15.0, "time constant"),),
    ),
)
