"""Effects outside the catalogue where something touches, drags or falls in, each from a published description."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState
from mock_devices.effects.followers import Dragged
from mock_devices.effects.outside_shapes import OutsideEffect, outside_effect
from mock_devices.effects.strut_ways import platform_place

POST_AT, TOUCHES = 0.12 - 0.1j, 0.5  # point of the platform; height at which it touches, over that of the workspace
SEAT_M = 0.1  # how far a slider goes from a hose before it drags that along
TEETH_M = 0.006  # of a brake
FALLS_S, DRAWS_S = 3.0, 4.0  # rest until a brake falls in; in which it then draws the slider to its tooth


class TouchingPost(OutsideEffect):
    """Where it is low the platform touches a post of rubber that somebody left there, which pushes it up.

    A body that touches another only from a certain place on, and is never held back by it: A. Signorini, "Sopra alcune
    questioni di elastostatica" (1933). The size is the force at the lower edge of the workspace.
    """

    def setup(self) -> None:
        """Heights of the platform's origin at which it touches, and at the lower edge of the workspace."""
        super().setup()
        machine = self.site.machine
        low, high = (y - machine.tool_point.imag for y in machine.workspace_m[1])
        self.lowest_m, self.touches_m = low, low + TOUCHES * (high - low)

    def _unit(self, state: MotionState) -> Array:
        below_m = self.touches_m - platform_place(self.site.machine, state.q_m).imag
        return np.maximum(below_m, 0.0) / (self.touches_m - self.lowest_m)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Push up beside the platform's middle, which also turns it."""
        deviation.loads.append((np.full(len(state), POST_AT), np.asarray(1j * self.signal(state))))


class DraggedSeat(OutsideEffect):
    """A hose along the column is tied to a strut's seat, which lags behind its slider until that drags the hose along.

    The play of A. Visintin, "Differential Models of Hysteresis" (1994), over a decimetre either way: friction holds the
    hose, which draws the seat back in proportion to how far the slider has gone from it. The slider itself stands
    right.
    """

    def setup(self) -> None:
        """Where the hose lies, at first in the middle of the travel."""
        super().setup()
        drive = self.site.machine.struts[self.place].drive
        self._hose = Dragged(SEAT_M, self.site.drive_range_m(drive)[0])

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Let its slider drag the hose along."""
        if drive == self.site.machine.struts[self.place].drive:
            self._hose.record(leg)

    def _unit(self, state: MotionState) -> Array:
        drive = self.site.machine.struts[self.place].drive
        return np.asarray((self._hose.at(state, drive) - state.q_m[:, drive]) / SEAT_M)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the joint on its slider, along the axis."""
        axis = self.site.machine.sliders[self.site.machine.struts[self.place].drive].axis
        deviation.base_joint_m[:, self.place] += axis * self.signal(state)


class ToothedBrake(OutsideEffect):
    """At rest a toothed brake falls in and draws the slider towards the next tooth, up or down.

    Ratchets and locking teeth in F. Reuleaux, "The Constructor" (1893). The controller holds against it, so that the
    slider goes by the size where it is farthest from a tooth, and stays at a tooth.
    """

    def _unit(self, state: MotionState) -> Array:
        teeth = state.q_m[:, self.place] / TEETH_M + self.phase / (2.0 * np.pi)
        drawn = np.clip((state.since_s[:, self.place] - FALLS_S) / DRAWS_S, 0.0, 1.0)
        return np.asarray(2.0 * (np.round(teeth) - teeth) * drawn)

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "touching_post",
        "rig",
        TouchingPost,
        EffectParameter("force_n", 5.0, 1000.0, 3e4, "at the lower edge of the workspace"),
        "height, nothing above a certain one; rotation",
    ),
    outside_effect(
        "dragged_seat",
        "strut",
        DraggedSeat,
        EffectParameter("lag_m", 1e-6, 3e-5, 1e-3, "either way"),
        "former places of the drive, direction; not a slider's SMR",
    ),
    outside_effect(
        "toothed_brake",
        "drive",
        ToothedBrake,
        EffectParameter("draw_m", 1e-6, 3e-5, 1e-3, "midway between two teeth"),
        "dwell together with many drive positions off a grid",
    ),
)
