"""Effects outside the catalogue in the station itself, each from a published description."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, EffectParameter, MotionState, StationSight
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect

OVAL = 0.4  # twice a turn, over once a turn
UNIT_M = (0.03, 0.12)  # range in which the phase of a stray reflex turns once
BEAM = (0.3, 0.8)  # tilt of the beam over that of the axis
BESIDE, LEVELS_M = (0.35, 0.75), 0.25  # of a switched gain: how far beside the middle of the workspace a reflector is
# there, over half its diagonal; distance in which the step of ranges falls by e


class ReferenceRange(OutsideEffect):
    """The station counts ranges from its home position, which it finds a little differently after every loss of beam.

    Somebody who exchanges the payload stands in the beam. The reference of an interferometer in ASME B89.4.19,
    "Performance Evaluation of Laser-Based Spherical Coordinate Measurement Systems" (2006).
    """

    def setup(self) -> None:
        """The range at home each time, at first as large as the size."""
        super().setup()
        self.levels[0] = math.copysign(1.0, self.levels[0])

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Count all ranges from another place."""
        off = self.levels[state.exchanges.astype(int) % len(self.levels)]
        sight.distance_m += self.size * apply_variant(off, self.variant, state.payload_kg)[:, None]


class CircleEccentricity(OutsideEffect):
    """The station's circles sit beside their axes and are not quite round, and one head reads each.

    Errors once and twice a turn: R. Loser, S. Kyle, "Alignment and Field Check Procedures for the Leica Laser Tracker
    LTD 500" (1999).
    """

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read the circles wrongly."""
        sight.hz_rad += self._off(sight.hz_rad, self.levels[:2], state.payload_kg[:, None])
        sight.v_rad += self._off(sight.v_rad, self.levels[2:4], state.payload_kg[:, None])

    def _off(self, angle_rad: Array, phases: Array, payload_kg: Array) -> Array:
        """Error of one circle (n, smrs), with phases from -1 to 1 half turns."""
        y = np.sin(angle_rad + np.pi * phases[0]) + OVAL * np.sin(2.0 * angle_rad + np.pi * phases[1])
        return self.size * apply_variant(y, self.variant, payload_kg)


class TiltedAxis(OutsideEffect):
    """The station's transit axis is not square to its standing axis, nor the beam to the transit axis.

    The horizontal circle is off by the cotangent of the zenith angle, and by one over its sine: B. Muralikrishnan, D.
    Sawyer, C. Blackburn, S. Phillips, B. Borchardt, W. T. Estler, "ASME B89.4.19 Performance Evaluation Tests and
    Geometric Misalignments in Laser Trackers" (2009). The size is the tilt of the axis.
    """

    def setup(self) -> None:
        """Tilt of the beam over that of the axis."""
        super().setup()
        self.beam = float(self.rng.uniform(*BEAM)) * float(self.rng.choice([-1.0, 1.0]))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Aim beside all that is not level with the station."""
        off = (np.cos(sight.v_rad) + self.beam) / np.sin(sight.v_rad)
        sight.hz_rad += self.size * apply_variant(off, self.variant, state.payload_kg[:, None])


class CyclicRange(OutsideEffect):
    """A stray reflex inside the station mixes with the beam, and ranges err periodically with the range.

    The cyclic error of instruments that go by a phase: J. M. Rüeger, "Electronic Distance Measurement" (1990).
    """

    def setup(self) -> None:
        """How long the period is."""
        super().setup()
        self.unit_m = float(self.rng.uniform(*UNIT_M))

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read ranges wrongly."""
        y = np.sin(2.0 * np.pi * sight.distance_m / self.unit_m + self.phase)
        sight.distance_m += self.size * apply_variant(y, self.variant, state.payload_kg[:, None])


class StuckBits(OutsideEffect):
    """The last bits of both circles are stuck, so that the station's angles go in coarse steps.

    B. Widrow, "A Study of Rough Amplitude Quantization by Means of Nyquist Sampling Theory" (1956). The size is a step;
    within it an angle is wrong by up to half of that, either way.
    """

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read angles in steps."""
        if self.size == 0.0:
            return
        sight.hz_rad += self._off(sight.hz_rad, state.payload_kg[:, None])
        sight.v_rad += self._off(sight.v_rad, state.payload_kg[:, None])

    def _off(self, angle_rad: Array, payload_kg: Array) -> Array:
        """Error of one circle (n, smrs): from the angle to the middle of its step."""
        within = angle_rad / self.size % 1.0
        return 0.5 * self.size * apply_variant(1.0 - 2.0 * within, self.variant, payload_kg)


class SwitchedGain(OutsideEffect):
    """Beyond one range the returning light is so weak that the station's amplifier switches to more gain.

    Its stages have offsets that only feedback holds down, the less the higher the gain: H. S. Black, "Stabilized
    Feedback Amplifiers" (1934). Ranges jump by the size there, and farther away, where gain is used up by weaker light,
    the step falls off. Nearer than that they are right.
    """

    def setup(self) -> None:
        """At which range of the platform's reflectors it switches."""
        super().setup()
        (left, right), (low, high) = self.site.machine.workspace_m
        x_m, y_m, z_m = self.site.station_m
        before_m = float(np.mean([smr.position_m[2] for smr in self.site.machine.smrs if smr.on == "platform"]))
        ahead_m = math.hypot(0.5 * (left + right) - x_m, 0.5 * (low + high) - y_m, z_m - before_m)
        beside_m = 0.5 * math.hypot(right - left, high - low) * float(self.rng.uniform(*BESIDE))
        self.switches_m = math.hypot(ahead_m, beside_m)

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Read ranges wrongly beyond the switch."""
        beyond_m = sight.distance_m - self.switches_m
        step = np.where(beyond_m > 0.0, np.exp(-np.maximum(beyond_m, 0.0) / LEVELS_M), 0.0)
        sight.distance_m += self.size * apply_variant(step, self.variant, state.payload_kg[:, None])


EFFECTS = (
    outside_effect(
        "reference_range",
        "rig",
        ReferenceRange,
        EffectParameter("offset_m", 1e-6, 4e-5, 2e-3, "of the range before the first exchange"),
        "ranges against exchanges of payload, all SMRs and nests alike",
    ),
    outside_effect(
        "circle_eccentricity",
        "rig",
        CircleEccentricity,
        EffectParameter("error_rad", 1e-6, 1e-4, 2e-3, "once a turn, of both angles"),
        "angles, all SMRs and nests alike",
    ),
    outside_effect(
        "tilted_axis",
        "rig",
        TiltedAxis,
        EffectParameter("tilt_rad", 1e-6, 2e-4, 5e-3, "of the transit axis"),
        "height, all SMRs and nests alike",
    ),
    outside_effect(
        "cyclic_range",
        "rig",
        CyclicRange,
        EffectParameter("error_m", 1e-6, 2e-5, 2e-3, "of ranges, either way"),
        "ranges, in short waves of the range, all SMRs and nests alike",
    ),
    outside_effect(
        "stuck_bits",
        "rig",
        StuckBits,
        EffectParameter("step_rad", 1e-6, 2e-5, 2e-3, "of both circles"),
        "angles, in a saw whose teeth are as wide as high, all SMRs and nests alike",
    ),
    outside_effect(
        "switched_gain",
        "rig",
        SwitchedGain,
        EffectParameter("step_m", 1e-6, 4e-5, 2e-3, "of ranges, where the gain is switched"),
        "ranges, by a step at one of them, all SMRs and nests alike",
    ),
)
