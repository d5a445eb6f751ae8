"""Guides that are not straight, and a foundation that settles: sliders beside their ideal place."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, EffectParameter, EffectSpec, MotionState, smooth_curve

FULL_PAYLOAD_KG = 400.0
FOOT_M = -1.2
RAIL_PER_M = 12.0
STEEPEST = math.exp(-0.25 * math.pi) * math.sqrt(0.5)
_TERMS = 60


class _Guide(Effect):
    """A curve along the travel.

    `loose_bolt_of_rail`: a rail that lies on an elastic base and is pressed off it at one place dips as in M. Hetényi,
    "Beams on Elastic Foundation" (1946); the guide's angle is the slope of that line.
    """

    slope = False

    def setup(self) -> None:
        """Draw phase, curve and the place of a step."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.curve = smooth_curve(self.rng, 6)
        self.joint = float(self.rng.uniform(-0.4, 0.4))

    def error(self, state: MotionState) -> Array:
        q = state.q_m[:, self.place]
        middle, half = self.site.drive_range_m(self.place)
        x = (q - middle) / half
        if self.variant == "bow":
            y = 2.0 * x**2 - 1.0
        elif self.variant == "irregular":
            y = self.curve(x)
        elif self.variant == "with_load":
            y = np.sin(2.0 * np.pi * q / self.values["wavelength_m"] + self.phase)
            y = y * (0.6 + 0.8 * state.payload_kg / FULL_PAYLOAD_KG)
        elif self.variant == "loose_bolt_of_rail":
            away = RAIL_PER_M * np.abs(q - middle - self.joint * half)
            dip = np.exp(-away)
            y = 2.0 * dip * (np.cos(away) + np.sin(away))
            if self.slope:  # over its largest value
                y = -2.0 * np.sign(q - middle - self.joint * half) * dip * np.sin(away) / STEEPEST
        elif self.variant == "rail_joint":  # two rails meet
            y = np.tanh((x - self.joint) / 0.04)
        else:
            y = np.sin(2.0 * np.pi * q / self.values["wavelength_m"] + self.phase)
        return self.size * np.asarray(y)


class Straightness(_Guide):
    """The guide bends sideways; the slider follows it without turning."""

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider across its axis."""
        deviation.sideways_m[:, self.place] += self.error(state)


class Angular(_Guide):
    """The slider turns in the plane along its way; its joints and its reflector go by their lever arms."""

    slope = True

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the slider."""
        deviation.yaw_rad[:, self.place] += self.error(state)


class FoundationSettling(Effect):
    """The foot of a column sinks, and the column leans: `tilt_per_m` of angle for each metre that it sank.

    `consolidation`: water that leaves clay, the degree of consolidation of K. Terzaghi, "Theoretical Soil Mechanics"
    (1943); it begins with the root of time. tau_s is the time constant of the slowest term.
    """

    def setup(self) -> None:
        """MotionState and shares of the steps of variant `stick_slip`."""
        self.steps = np.sort(self.rng.uniform(0.0, 4.0, 5))
        self.shares = self.rng.dirichlet(np.full(5, 2.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lower and lean the column."""
        t = state.t_s - self.site.start_s - self.values["onset_s"]
        tau, after = self.values["tau_s"], np.maximum(t, 0.0)
        if self.variant == "step":
            share = (t >= 0.0).astype(float)
        elif self.variant == "logarithmic":
            share = np.log1p(after / tau) / np.log1p(4.0)
        elif self.variant == "creep":
            share = after / (4.0 * tau)
        elif self.variant == "consolidation":
            odd = np.arange(1.0, 2.0 * _TERMS, 2.0)
            terms = np.exp(-np.outer(after / tau, odd**2)) / odd**2
            share = np.where(t >= 0.0, 1.0 - 8.0 / np.pi**2 * terms.sum(axis=1), 0.0)
        elif self.variant == "stick_slip":
            share = (t[:, None] >= self.steps * tau) @ self.shares
        else:
            share = 1.0 - np.exp(-after / tau)
        a = self.place
        strut = next(s for s in self.site.machine.struts if s.drive == a)
        height = state.q_m[:, a] + strut.base_joint.imag - FOOT_M
        lean = self.values["tilt_per_m"] * self.size * share
        deviation.travel_m[:, a] -= self.size * share
        deviation.sideways_m[:, a] += lean * height
        deviation.yaw_rad[:, a] += lean


_WAVE = (EffectParameter("wavelength_m", 0.15, 0.6, 1.5, "of the sine"),)
_VARIANTS = ("sine", "bow", "irregular", "with_load", "rail_joint", "loose_bolt_of_rail")

EFFECTS = (
    EffectSpec(
        name="guide_straightness",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 1e-5, 4e-4, "sideways"),
        variants=_VARIANTS,
        final="loose_bolt_of_rail",
        reveals="drive coordinate, SMRs on the sliders",
        make=Straightness,
        others=_WAVE,
    ),
    EffectSpec(
        name="guide_angular",
        kind="catalogue",
        place="drive",
        size=EffectParameter("amplitude_rad", 2e-6, 3e-5, 4e-3, "rotation in the plane"),
        variants=_VARIANTS,
        final="loose_bolt_of_rail",
        reveals="drive coordinate, platform rotation; not a slider's SMR",
        make=Angular,
        others=_WAVE,
    ),
    EffectSpec(
        name="foundation_settling",
        kind="catalogue",
        place="drive",
        size=EffectParameter("settled_m", 1e-6, 2e-5, 8e-4, "how far the foot sinks"),
        variants=("exponential", "step", "logarithmic", "creep", "stick_slip", "consolidation"),
        final="consolidation",
        reveals="time, SMRs on the sliders against the floor nests",
        make=FoundationSettling,
        others=(
            EffectParameter("onset_s", 0.0, 1800.0, 7200.0, "after the campaign's begin"),
            EffectParameter("tau_s", 300.0, 1200.0, 7200.0, "time constant"),
            EffectParameter("tilt_per_m", 0.0, 0.3, 1.0, "lean of the column, radians a metre sunk"),
        ),
    ),
)
