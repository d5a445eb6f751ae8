"""Effects outside the catalogue in cables, threads, beams, beds and platforms, each from a published description."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState, StationSight
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.outside_shapes import FULL_PAYLOAD_KG, OutsideEffect, apply_variant, outside_effect
from mock_devices.effects.strut_ways import platform_place

TIED_AT = -0.1 + 0.2j  # point of the platform at which a cable is tied
HOLDER = 0.25 + 0.3j  # of the frame, which holds it: inwards from the first column; above the workspace
SLACK = 0.8  # length of the cable over the longest distance that it spans
SWING_M, SWINGS = 0.15, 100.0  # travel below which a thread sticks; longer motions that unscrew it by the size
WIRE_RAD, WIRE_AT_RAD = 0.015, (-0.06, 0.06)  # half the beam's width as seen from the station; where a wire hangs
FOOT_M, HOUR_S = -1.2, 3600.0  # height of a column's foot
NEUTRAL_M = -0.12  # height of the platform's neutral line


class ShortTether(OutsideEffect):
    """A cable between frame and platform is a little too short: it is slack here, and taut and stretched over there.

    A cable that bears no compression and is a spring once it is straight, its weight neglected: H. M. Irvine, "Cable
    Structures" (1981). Its pull goes by where the platform stands, whatever side it came from.
    """

    def setup(self) -> None:
        """Where it is held, and how long it is."""
        super().setup()
        machine = self.site.machine
        (left, right), (low, high) = machine.workspace_m
        column = next(strut for strut in machine.struts if strut.drive == 0).base_joint
        inwards = math.copysign(HOLDER.real, -column.real)
        self.holder = complex(column.real + inwards, high + HOLDER.imag)
        corners = [complex(x, y) - machine.tool_point for x in (left, right) for y in (low, high)]
        self.longest_m = max(abs(self.holder - corner - TIED_AT) for corner in corners)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull at the platform's upper edge."""
        way = self.holder - platform_place(self.site.machine, state.q_m) - TIED_AT
        stretched = (np.abs(way) / self.longest_m - SLACK) / (1.0 - SLACK)
        pull = apply_variant(np.maximum(stretched, 0.0), self.variant, state.payload_kg)
        point = np.full(len(state), TIED_AT)
        deviation.loads.append((point, np.asarray(self.size * pull * way / np.abs(way))))


class CreepingThread(OutsideEffect):
    """A strut's screwed end unscrews a little with every wide swing, and the strut grows longer by its pitch.

    Below a certain slip a thread sticks, above it each cycle turns it by the same angle: D. P. Hess, S. V.
    Sudhirkashyap, "Dynamic Loosening and Tightening of a Single-Bolt Assembly" (1997).
    """

    def setup(self) -> None:
        """How many wide swings there were."""
        super().setup()
        self._swings = LegMemory(lambda way, _speed, _start_s: (np.abs(way) > SWING_M).astype(np.float64))

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Count the wide swings by the strut's own drive."""
        if drive == self.site.machine.struts[self.place].drive:
            self._swings.record(leg)

    def _unit(self, state: MotionState) -> Array:
        return self._swings.at(state, self.site.machine.struts[self.place].drive)[:, 0] / SWINGS

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class ClippedBeam(OutsideEffect):
    """A wire hangs before the station and cuts off a part of the beam, whose centroid moves to the side that is left.

    Apertures in J. W. Goodman, "Introduction to Fourier Optics" (1968). A beam whose middle is at the wire loses as
    much on either side; it is off most where the wire is half of the beam's width beside it, and away from the wire.
    """

    def setup(self) -> None:
        """Where the wire hangs, as an angle from the station's second axis."""
        super().setup()
        self.wire_rad = float(self.rng.uniform(*WIRE_AT_RAD))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Aim beside the reflectors that are seen past the wire."""
        off = (np.arctan2(sight.points_m[..., 0], sight.points_m[..., 1]) - self.wire_rad) / WIRE_RAD
        clipped = off * np.exp(0.5 - 0.5 * off**2)
        sight.hz_rad += self.size * apply_variant(clipped, self.variant, state.payload_kg[:, None])


class SaggingPlatform(OutsideEffect):
    """The platform sags under itself and its payload between its joints, and reflectors and joints go with it.

    A beam on two supports under a force in its middle, its sections plane: S. Timoshenko, "Strength of Materials"
    (1930). Beyond the supports it is straight.
    """

    def _unit(self, state: MotionState) -> Array:
        own_kg = self.site.machine.moving_mass_kg
        return (own_kg + state.payload_kg) / (own_kg + FULL_PAYLOAD_KG)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lower the middle and turn the sections; the size is how far the middle sags."""
        machine, sag = self.site.machine, self.signal(state)
        half_m = max(abs(strut.platform_joint.real) for strut in machine.struts)
        for i, strut in enumerate(machine.struts):
            deviation.platform_joint_m[:, i] += sag * _sagged(strut.platform_joint, half_m)
        for i, smr in enumerate(machine.smrs):
            if smr.on == "platform":
                way = _sagged(complex(smr.position_m[0], smr.position_m[1]), half_m)
                deviation.smr_m[:, i, 0] += sag * way.real
                deviation.smr_m[:, i, 1] += sag * way.imag


def _sagged(place: complex, half_m: float) -> complex:
    """Where a place of the platform goes, over the sag of its middle."""
    x, side = abs(place.real) / half_m, math.copysign(1.0, place.real)
    inside = min(x, 1.0)
    down = 1.0 - 1.5 * inside**2 + 0.5 * inside**3 - 1.5 * (x - inside)
    slope = side * (3.0 * inside - 1.5 * inside**2) / half_m  # of the line, upwards
    return complex(-slope * (place.imag - NEUTRAL_M), -down)


class DampGranite(OutsideEffect):
    """Water was spilt on a bed of granite: its upper face swells, the bed bows and its columns lean outwards.

    Stone takes up water with the root of time: C. Hall, W. D. Hoff, "Water Transport in Brick, Stone and Concrete"
    (2002). The size is the lean of a column after an hour.
    """

    def _unit(self, state: MotionState) -> Array:
        return np.sqrt(np.maximum(self.elapsed_s(state) - self.moments_s[0], 0.0) / HOUR_S)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lean all columns about their feet, away from the middle."""
        lean = self.signal(state)
        for a in range(len(self.site.machine.sliders)):
            joint = next(strut.base_joint for strut in self.site.machine.struts if strut.drive == a)
            outwards = math.copysign(1.0, -joint.real) * lean
            deviation.sideways_m[:, a] += outwards * (state.q_m[:, a] + joint.imag - FOOT_M)
            deviation.yaw_rad[:, a] += outwards


EFFECTS = (
    outside_effect(
        "short_tether",
        "rig",
        ShortTether,
        EffectParameter("force_n", 5.0, 1000.0, 3e4, "at the farthest corner"),
        "place in the workspace, whatever side it came from",
    ),
    outside_effect(
        "creeping_thread",
        "strut",
        CreepingThread,
        EffectParameter("grown_m", 1e-6, 4e-5, 1e-3, "after 100 wide swings"),
        "number of long motions",
    ),
    outside_effect(
        "clipped_beam",
        "rig",
        ClippedBeam,
        EffectParameter("error_rad", 1e-6, 2e-5, 1e-3, "at most"),
        "horizontal angle, all SMRs and nests alike",
    ),
    outside_effect(
        "sagging_platform",
        "rig",
        SaggingPlatform,
        EffectParameter("sag_m", 1e-6, 4e-5, 1e-3, "under itself and 400 kg"),
        "payload, distances between SMRs of the platform",
    ),
    outside_effect(
        "damp_granite",
        "rig",
        DampGranite,
        EffectParameter("lean_rad", 1e-6, 2e-5, 1e-3, "after an hour"),
        "time, both columns at once, SMRs on the sliders against the floor nests",
    ),
)
