"""Effects outside the catalogue in seats, feet, joints and encoders, each from a published description."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    EffectParameter,
    Leg,
    MotionState,
)
from mock_devices.effects.leg_memory import LegMemory
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect

HOLDS_M_PER_S = 0.2  # a stop from this speed does not yet move a foot
BACK = 0.5  # slip to the other side, where a cable holds it, over slip to this one
STOPS = 60.0
TRACK_M = 0.105  # distance that the finer bit stands for


class BeddingIn(OutsideEffect):
    """A strut's seat on its slider beds in: every new load presses it down half as far as the one before.

    Shakedown: repeated loads deform a contact plastically less and less, until its response is elastic only: K. L.
    Johnson, "Contact Mechanics" (1985).
    """

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(1.0 - 0.5**state.exchanges)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lower the joint on its slider, along the axis."""
        axis = self.site.machine.sliders[self.site.machine.struts[self.place].drive].axis
        deviation.base_joint_m[:, self.place] -= axis * self.signal(state)


class WalkingFeet(OutsideEffect):
    """Hard stops push the machine across its floor, more to one side than to the other: it walks away from its nests.

    Friction holds a foot until inertia exceeds it: D. C. Conrad, W. Soedel, "On the Problem of Oscillatory Walk of
    Automatic Washing Machines" (1995). The excess of a stop over what friction holds goes with the square of the speed.
    The platform moves to the right, and so pushes, when the second drive goes up and when the first one goes down.
    """

    def setup(self) -> None:
        """How far the stops of each drive have moved the feet."""
        super().setup()
        self._walked = [LegMemory(self._slip_of_first), LegMemory(self._slip)]

    def _slip(self, way_m: Array, speed: Array, _start_s: Array) -> Array:
        slip = np.maximum((speed / HOLDS_M_PER_S) ** 2 - 1.0, 0.0) / STOPS
        return np.asarray(np.where(way_m > 0.0, slip, -BACK * slip) * (way_m != 0.0))

    def _slip_of_first(self, way_m: Array, speed: Array, start_s: Array) -> Array:
        return self._slip(-way_m, speed, start_s)

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let the stops of the first two drives push."""
        if drive < len(self._walked):
            self._walked[drive].record(leg)

    def _unit(self, state: MotionState) -> Array:
        return np.asarray(sum(memory.at(state, drive)[:, 0] for drive, memory in enumerate(self._walked)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the machine; nests and station stand."""
        deviation.frame_shift_m += self.signal(state)


class JointFriction(OutsideEffect):
    """Dry friction in the joints passes a moment from every strut to the platform, in the sense of its last swing.

    Coulomb friction in the joints of a parallel machine: N. Farhat, V. Mata, A. Page, M. Díaz-Rodríguez, "Dynamic
    Simulation of a Parallel Robot: Coulomb Friction and Stick-Slip in Robot Joints" (2010). Friction is proportional to
    what the joints carry. All struts swing clockwise when the first slider goes up, and anticlockwise when the second
    one does.
    """

    def _unit(self, state: MotionState) -> Array:
        own_kg = self.site.machine.moving_mass_kg
        one, two = state.direction[:, 0], state.direction[:, 1]
        return np.asarray(0.5 * (two - one) * (own_kg + state.payload_kg) / own_kg)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Turn the platform."""
        deviation.moment_nm += self.signal(state)


class DarkTracks(OutsideEffect):
    """Two neighbouring tracks of a binary-coded encoder read dark, so that what their bits stand for is missing.

    Position encoders in A. K. Susskind (ed.), "Notes on Analog-Digital Conversion Techniques" (1957). Finer and coarser
    tracks read correctly, so that the error is a staircase that starts again with every step of the next coarser bit.
    """

    def _unit(self, state: MotionState) -> Array:
        track = (state.q_m[:, self.place] / TRACK_M + 2.0 * self.phase / np.pi) % 4.0
        return np.asarray(np.floor(track) / 3.0)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider: the drive runs on until the count is right."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "bedding_in",
        "strut",
        BeddingIn,
        EffectParameter("sinks_m", 1e-6, 3e-5, 1e-3, "in all"),
        "number of exchanges of payload",
    ),
    outside_effect(
        "walking_feet",
        "rig",
        WalkingFeet,
        EffectParameter("slip_m", 1e-6, 3e-5, 2e-3, "after 60 stops from 0.28 m/s on one side"),
        "speed of former motions, nests stand still",
    ),
    outside_effect(
        "joint_friction",
        "rig",
        JointFriction,
        EffectParameter("moment_nm", 1.0, 60.0, 6000.0, "without payload"),
        "direction of both drives, payload, rotation",
    ),
    outside_effect(
        "dark_tracks",
        "drive",
        DarkTracks,
        EffectParameter("step_m", 1e-6, 3e-5, 1e-3, "of both bits together"),
        "drive coordinate, in steps",
    ),
)
