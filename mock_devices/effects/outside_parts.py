"""Effects outside the catalogue in parts of machine and station, each from a published description."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    EffectParameter,
    Leg,
    MotionState,
    StatefulEffect,
    StationSight,
    names_of,
)
from mock_devices.effects.instrument import move_points, move_station
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect

LOBES = 5
HEADS, ORDERS = 4, 4  # of a circle of the station
STROKE, POLYTROPIC = 0.4, 1.3  # share of the gas that the whole stroke takes up; exponent
WEAR_M = 100.0
GLASS = 1.515  # refractive index of a cover
BRAKE_S, RAMP_S = 6.0, 5.0  # rest until the brake is closed; in which the controller then lets go
SPINDLE_S = 1200.0


class CircleError(OutsideEffect):
    """Lines of the station's circles that are not evenly spaced: what is left when heads around a circle are averaged.

    Of several heads at equal distances only orders are left that their number divides: T. Masuda, M. Kajitani, "An
    Automatic Calibration System for Angular Encoders" (1989).
    """

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read the circles wrongly."""
        payload_kg = state.payload_kg[:, None]
        hz = apply_variant(self._left(sight.hz_rad, self.levels[:ORDERS]), self.variant, payload_kg)
        v = apply_variant(self._left(sight.v_rad, self.levels[ORDERS : 2 * ORDERS]), self.variant, payload_kg)
        sight.hz_rad += self.size * hz
        sight.v_rad += self.size * v

    def _left(self, angle_rad: Array, phases: Array) -> Array:
        """Orders HEADS, 2 HEADS ... of a circle, of equal amplitude, with phases from -1 to 1 half turns."""
        terms = [np.sin(HEADS * k * angle_rad + np.pi * phases[k - 1]) for k in range(1, ORDERS + 1)]
        return np.asarray(np.mean(terms, axis=0))


class LobedJoint(OutsideEffect):
    """A ball that is not round but has an odd number of lobes, as grinding leaves them, turns in a strut's joint.

    Harmonics of roundness: R. E. Reason, "Report on the Measurement of Roundness" (1966).
    """

    def _unit(self, state: MotionState) -> Array:
        strut = self.site.machine.struts[self.place]
        middle, _ = self.site.drive_range_m(strut.drive)
        swing = np.arcsin(np.clip((state.q_m[:, strut.drive] - middle) / strut.length_m, -1.0, 1.0))
        return np.asarray(np.cos(LOBES * swing + self.phase))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class GuideWear(StatefulEffect):
    """A lining that wears: the slider goes nearer to its guide with the way, more where it has run more.

    The depth goes with way times pressure: J. F. Archard, "Contact and Rubbing of Flat Surfaces" (1953).
    """

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The way so far."""
        return before + abs(leg.to_m - leg.from_m)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider towards its guide."""
        a = self.place
        way = self.state_before(state, a) + np.abs(state.q_m[:, a] - state.from_m[:, a])
        middle, half = self.site.drive_range_m(a)
        pressed = np.exp(-2.0 * ((state.q_m[:, a] - middle) / half) ** 2)
        y = apply_variant(way / WEAR_M * pressed, self.variant, state.payload_kg)
        deviation.sideways_m[:, a] -= self.size * y


class GasSpring(OutsideEffect):
    """A gas spring carries a part of the platform's weight, and it carries more the lower the platform is.

    Pressure times volume to a power: W. J. M. Rankine, "A Manual of the Steam Engine and Other Prime Movers" (1859).
    """

    def _unit(self, state: MotionState) -> Array:
        """Force above that in the middle of the stroke, over that of the extended spring (n,)."""
        shares = []
        for a in range(state.q_m.shape[1]):
            middle, half = self.site.drive_range_m(a)
            shares.append(0.5 - 0.5 * (state.q_m[:, a] - middle) / half)  # 1 where it is pressed together
        pressed = np.clip(np.mean(shares, axis=0), 0.0, 1.0)
        return np.asarray((1.0 - STROKE * pressed) ** -POLYTROPIC - (1.0 - 0.5 * STROKE) ** -POLYTROPIC)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Push the platform up in its middle."""
        gravity = self.site.machine.gravity
        up = -gravity / abs(gravity) if gravity else 1j
        deviation.loads.append((np.zeros(len(state), dtype=np.complex128), np.asarray(self.signal(state) * up)))


class CoverGlass(OutsideEffect):
    """A pane in front of a reflector, across the station's second axis: seen askew, it seems to lie further off.

    Parallel shift by a plane plate, in M. Born, E. Wolf, "Principles of Optics" (1959).
    """

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Shift what is seen away from the pane's normal."""
        i = [smr.name for smr in self.site.machine.smrs].index(names_of(self.site.machine, "smr")[self.place])
        line = sight.points_m[:, i] / np.linalg.norm(sight.points_m[:, i], axis=1)[:, None]
        cosine = line[:, 1]
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 1.0e-18))
        shifted = sine * (1.0 - cosine / np.sqrt(GLASS**2 - sine**2))  # over the pane's thickness
        size = self.size * apply_variant(shifted, self.variant, state.payload_kg) / sine
        moved = np.zeros_like(sight.points_m)
        moved[:, i] = size[:, None] * (cosine[:, None] * line - np.array([0.0, 1.0, 0.0]))
        move_points(sight, moved)


class LeaningBlock(OutsideEffect):
    """Machine, nests and station stand on one block that leans under what moves; the station's own axis stays plumb.

    A rigid block on soil turns by the moment over its rocking stiffness: G. Gazetas, "Formulas and Charts for
    Impedances of Surface and Embedded Foundations" (1991).
    """

    def _unit(self, state: MotionState) -> Array:
        own_kg = self.site.machine.moving_mass_kg
        return np.asarray(self.platform_x(state) * (own_kg + state.payload_kg) / own_kg)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Turn all that the station sees about its own second axis."""
        turn = np.outer(self.signal(state), [0.0, 1.0, 0.0])
        move_station(sight, turn, np.zeros_like(turn))


class SpindleHeat(OutsideEffect):
    """A spindle that runs now and then warms the platform, which grows with its joints and reflectors.

    Heat of a motor in a housing, that goes to what is around it: B. Bossmanns, J. F. Tu, "A Thermal Model for High
    Speed Motorized Spindles" (1999). The size is where the platform would end if it ran on.
    """

    def setup(self) -> None:
        """The warmth at every moment at which the spindle is switched, first on."""
        super().setup()
        self.switched_s = np.concatenate([[0.0], self.moments_s])
        warm = [0.0]
        for k, lasts_s in enumerate(np.diff(self.switched_s).tolist()):
            aim = float(k % 2 == 0)
            warm.append(aim + (warm[-1] - aim) * float(np.exp(-lasts_s / SPINDLE_S)))
        self.warm = np.array(warm)

    def _unit(self, state: MotionState) -> Array:
        t = self.elapsed_s(state)
        k = np.searchsorted(self.switched_s, t, side="right") - 1
        aim = (k % 2 == 0).astype(np.float64)
        return np.asarray(aim + (self.warm[k] - aim) * np.exp(-(t - self.switched_s[k]) / SPINDLE_S))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Grow from the platform's origin."""
        machine = self.site.machine
        strain = machine.expansion["platform"].coefficient_per_k * self.signal(state)
        for i, strut in enumerate(machine.struts):
            deviation.platform_joint_m[:, i] += strain * strut.platform_joint
        for i, smr in enumerate(machine.smrs):
            if smr.on == "platform":
                deviation.smr_m[:, i] += np.outer(strain, smr.position_m)


class BrakeDrop(OutsideEffect):
    """A holding brake closes at rest, the controller lets go, and the axis drops through the brake's play.

    Holding brakes of hanging axes in H. Gross, J. Hamann, G. Wiegärtner, "Electrical Feed Drives in Automation" (2001).
    """

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(-np.clip((state.since_s[:, self.place] - BRAKE_S) / RAMP_S, 0.0, 1.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lower the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "circle_error",
        "rig",
        CircleError,
        EffectParameter("error_rad", 1e-6, 1e-5, 1e-3, "of both angles"),
        "angles, all SMRs and nests alike",
    ),
    outside_effect(
        "lobed_joint",
        "strut",
        LobedJoint,
        EffectParameter("lobe_m", 1e-6, 2e-5, 6e-4, "either way"),
        "the joint's angle",
    ),
    outside_effect(
        "guide_wear",
        "drive",
        GuideWear,
        EffectParameter("depth_m", 1e-6, 4e-5, 1e-3, "after 100 m, where it is pressed most"),
        "way, drive coordinate",
    ),
    outside_effect(
        "gas_spring",
        "rig",
        GasSpring,
        EffectParameter("force_n", 50.0, 1500.0, 6e4, "of the extended spring"),
        "height",
    ),
    outside_effect(
        "cover_glass",
        "smr",
        CoverGlass,
        EffectParameter("thickness_m", 1e-4, 2e-3, 2e-2, "of the pane"),
        "place in the workspace, one SMR against the others",
    ),
    outside_effect(
        "leaning_block",
        "rig",
        LeaningBlock,
        EffectParameter("tilt_rad", 1e-6, 2e-5, 1e-3, "at the edge, without payload"),
        "x and payload, all SMRs and nests alike",
    ),
    outside_effect(
        "spindle_heat",
        "rig",
        SpindleHeat,
        EffectParameter("rise_k", 0.1, 5.0, 100.0, "of the platform, if it ran on"),
        "time, distances between SMRs of the platform",
    ),
    outside_effect(
        "brake_drop",
        "drive",
        BrakeDrop,
        EffectParameter("drop_m", 1e-6, 3e-5, 1e-3, "play of the brake"),
        "dwell, one way from either side",
    ),
)
