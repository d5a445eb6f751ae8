"""Effects that are in no catalogue: a diagnosis that knows only the catalogue shall call them unknown.

Each has a signal of unit size; its variants are shapes that the signal goes through.
"""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    Effect,
    EffectParameter,
    Leg,
    MotionState,
    Place,
    StatefulEffect,
)
from mock_devices.effects.outside_drives import AirBearingLift, LooseBolt, LubricationPulse, MagnetDetent, OilFilm
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect


class CableDrag(OutsideEffect):
    """A cable chain pulls the platform: by its place, and by the side that it came from."""

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(self.platform_x(state) ** 2 + 0.5 * state.direction[:, 0])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull at the platform's upper edge."""
        point = np.full(len(state), 0.05 + 0.2j)
        deviation.loads.append((point, self.signal(state).astype(np.complex128)))


class PayloadShift(StatefulEffect):
    """The payload slides in its fixture, to one side or the other as the platform was last moved far sideways."""

    def setup(self) -> None:
        """How far to move before it slides."""
        self.slip_m = float(self.rng.uniform(0.1, 0.25))

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """Which side it lies on: decided by a long motion of the first drive."""
        way = leg.to_m - leg.from_m
        return math.copysign(1.0, way) if abs(way) > self.slip_m else before

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the payload's centre of mass."""
        y = self.state_before(state, 0)
        if self.variant == "cubic":
            y = np.maximum(y, 0.0)
        elif self.variant == "saturating":
            y = y * np.tanh(self.elapsed_s(state) / 1800.0)
        elif self.variant == "with_payload":
            y = y * (0.4 + np.sin(3.0 * state.q_m[:, 0]) ** 2)  # slides further on where the platform leans most
        deviation.payload_shift_m += self.size * y


class PlatformBending(OutsideEffect):
    """A warm upper side bends the platform: reflectors and joints move with its curvature."""

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(1.0 - np.exp(-self.elapsed_s(state) / 2000.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Bend: y = curvature x^2 / 2, curvature = alpha dT / thickness."""
        alpha = self.site.machine.expansion["platform"].coefficient_per_k
        curvature = alpha * self.signal(state) / 0.1
        for i, strut in enumerate(self.site.machine.struts):
            deviation.platform_joint_m[:, i] += 0.5j * curvature * strut.platform_joint.real**2
        for i, smr in enumerate(self.site.machine.smrs):
            if smr.on == "platform":
                deviation.smr_m[:, i, 1] += 0.5 * curvature * smr.position_m[0] ** 2
                deviation.smr_m[:, i, 0] -= curvature * smr.position_m[0] * (smr.position_m[1] + 0.12)


class SpindleVibration(OutsideEffect):
    """While the spindle runs, the station averages a vibration; its rectified part is not zero, most at one place."""

    def _unit(self, state: MotionState) -> Array:
        running = np.sin(2.0 * np.pi * self.elapsed_s(state) / 1500.0 + self.phase) > 0.2
        return np.asarray(running * np.exp(-(((self.platform_x(state) - 0.2) / 0.5) ** 2)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Shift all reflectors of the platform together."""
        for i, smr in enumerate(self.site.machine.smrs):
            if smr.on == "platform":
                deviation.smr_m[:, i, 0] += self.signal(state)


class CraneTilt(OutsideEffect):
    """A crane stands here and there in the bay, and the floor leans to it: machine against station and nests."""

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(self.levels[np.searchsorted(self.moments_s, self.elapsed_s(state))])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Tilt the machine about its feet."""
        turn = self.signal(state)
        deviation.frame_turn_rad += turn
        deviation.frame_shift_m += -1j * turn * (0.4 - 1.2j)


class HumiditySwelling(OutsideEffect):
    """A strut of carbon fibre takes up moisture: slowly and in waves of the air's."""

    def _unit(self, state: MotionState) -> Array:
        t = self.elapsed_s(state)
        return np.asarray(0.5 * np.sin(2.0 * np.pi * t / 4100.0 + self.phase) + 0.5 * np.sin(t / 1370.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class HoseMoment(OutsideEffect):
    """A hydraulic hose straightens whenever the clamp has pressure, and turns the platform."""

    def _unit(self, state: MotionState) -> Array:
        clamped = np.sin(2.0 * np.pi * self.elapsed_s(state) / 900.0 + self.phase) > 0.0
        return np.asarray(clamped * (0.6 + 0.4 * self.platform_x(state)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the platform."""
        deviation.moment_nm += self.signal(state)


_FACTS: tuple[tuple[str, Place, type[Effect], EffectParameter, str], ...] = (
    ("cable_drag", "rig", CableDrag, EffectParameter("force_n", 5.0, 400.0, 9000.0, "at the edge"), "x, direction"),
    (
        "payload_shift",
        "rig",
        PayloadShift,
        EffectParameter("shift_m", 1e-4, 5e-3, 0.5, "either way"),
        "payload, former pose",
    ),
    (
        "platform_bending",
        "rig",
        PlatformBending,
        EffectParameter("gradient_k", 0.1, 3.0, 100.0, "across it"),
        "time, SMRs",
    ),
    (
        "spindle_vibration",
        "rig",
        SpindleVibration,
        EffectParameter("bias_m", 1e-6, 2e-5, 4e-4, "at most"),
        "time and place",
    ),
    ("loose_bolt", "drive", LooseBolt, EffectParameter("yaw_rad", 2e-6, 6e-5, 2e-3, "either way"), "former pose"),
    ("air_bearing_lift", "drive", AirBearingLift, EffectParameter("lift_m", 1e-6, 2e-5, 4e-4, "either way"), "time"),
    ("oil_film", "drive", OilFilm, EffectParameter("lift_m", 1e-6, 3e-5, 4e-3, "at 0.5 m/s"), "speed, dwell"),
    (
        "magnet_detent",
        "drive",
        MagnetDetent,
        EffectParameter("amplitude_m", 1e-6, 1e-5, 2e-4, "of the mean"),
        "q, side",
    ),
    (
        "crane_tilt",
        "rig",
        CraneTilt,
        EffectParameter("tilt_rad", 1e-6, 2e-5, 4e-4, "either way"),
        "time, nests stand still",
    ),
    (
        "humidity_swelling",
        "strut",
        HumiditySwelling,
        EffectParameter("swelling_m", 1e-6, 2e-5, 6e-4, "either way"),
        "time",
    ),
    (
        "hose_moment",
        "rig",
        HoseMoment,
        EffectParameter("moment_nm", 1.0, 150.0, 6000.0, "with pressure"),
        "time, rotation",
    ),
    (
        "lubrication_pulse",
        "drive",
        LubricationPulse,
        EffectParameter("lift_m", 1e-6, 4e-5, 1e-3, "after a pulse"),
        "way",
    ),
)

EFFECTS = tuple(outside_effect(*facts) for facts in _FACTS)
