"""Effects outside the catalogue by a magnet near the platform, a weight that is set swinging and ways that are rounded.

Each is from a published description.
"""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Deviation, EffectParameter, Leg, MotionState, StatefulEffect
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect
from mock_devices.effects.strut_ways import platform_place

WITHIN, BEHIND_M = 0.4, (0.08, 0.16)  # of a magnet: how far from the middle of the workspace it may be, over half of
# that; how far behind the plane its pole lies
KEEPER_AT = 0.1 + 0.05j  # point of the platform that the magnet pulls
WEIGHT_S, CALMS_S, STOP_M_PER_S = (4.0, 9.0), (8.0, 20.0), 0.5  # of a weight in a strut: period, time constant, stop
STEP_M = (0.013, 0.037)  # of a drive's way, for which its control adds an increment


class NearMagnet(OutsideEffect):
    """A magnet was left on the frame behind the platform, and pulls that towards one point as it comes near.

    The inverse square of the distance from a pole: J. Michell, "A Treatise of Artificial Magnets" (1750). The pole lies
    behind the plane, so that nothing pulls right before it, and the pull is hardest some centimetres beside that.
    """

    def setup(self) -> None:
        """Where the platform's origin is right before the pole, and how far behind the plane that lies."""
        super().setup()
        machine, own = self.site.machine, self.rng.uniform(-WITHIN, WITHIN, 2)
        (left, right), (low, high) = machine.workspace_m
        tool = complex(0.5 * (left + right + own[0] * (right - left)), 0.5 * (low + high + own[1] * (high - low)))
        self.pole = tool - machine.tool_point
        self.behind_m = float(self.rng.uniform(*BEHIND_M))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull the platform towards the pole."""
        away = (platform_place(self.site.machine, state.q_m) - self.pole) / self.behind_m
        far = np.abs(away)
        pull = 1.5 * math.sqrt(3.0) * far / (1.0 + far**2) ** 1.5  # 1 where it is hardest
        force = self.size * apply_variant(pull, self.variant, state.payload_kg)
        deviation.loads.append(
            (np.full(len(state), KEEPER_AT), np.asarray(-force * away / np.maximum(far, 1.0e-12), dtype=np.complex128))
        )


class RungByOther(OutsideEffect):
    """A weight on a spring inside a strut is set swinging by the stops of the other drive, and calms down slowly.

    A small body that is tuned to what shakes its surroundings: J. Ormondroyd, J. P. Den Hartog, "The Theory of the
    Dynamic Vibration Absorber" (1928). The strut is longer and shorter by its pull. Stops of the strut's own drive
    are along the strut's column and do not set it swinging.
    """

    def setup(self) -> None:
        """How fast the weight swings and calms down, and which drive sets it swinging."""
        super().setup()
        self.swings_s = float(self.rng.uniform(*WEIGHT_S))
        self.calms_s = float(self.rng.uniform(*CALMS_S))
        self.other = (self.site.machine.struts[self.place].drive + 1) % len(self.site.machine.sliders)

    def _unit(self, state: MotionState) -> Array:
        b = self.other
        stopped = state.t_s >= state.leg_end_s[:, b]
        pushed = state.direction[:, b] * state.speed_m_per_s[:, b] / STOP_M_PER_S * stopped
        rested_s = state.since_s[:, b]
        turn = 2.0 * np.pi * rested_s / self.swings_s
        return np.asarray(pushed * np.exp(-rested_s / self.calms_s) * np.cos(turn))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Lengthen and shorten the strut."""
        deviation.length_m[:, self.place] += self.signal(state)


class RoundedWays(StatefulEffect):
    """A drive's control adds an increment for each step of a way, as its gear wants it, and of each way rounds down.

    Whoever moves by steps has to carry on what is left: J. E. Bresenham, "Algorithm for Computer Control of a Digital
    Plotter" (1965). This control forgets it at each stop, so that the slider lacks that part of an increment, back the
    way that it came from; what is lost goes on adding up. The size is an increment.
    """

    def setup(self) -> None:
        """The way for which there is an increment."""
        self.step_m = float(self.rng.uniform(*STEP_M))

    def _lost(self, way_m: Array) -> Array:
        """Part of an increment (n,) that a way loses, with its sign."""
        return np.asarray(np.sign(way_m) * (np.abs(way_m) / self.step_m % 1.0))

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """What all ways so far have lost."""
        return before + float(self._lost(np.array(leg.to_m - leg.from_m)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Leave the slider behind by what it has lost."""
        a = self.place
        lost = self.state_before(state, a) + self._lost(state.q_m[:, a] - state.from_m[:, a])
        deviation.travel_m[:, a] -= self.size * apply_variant(lost, self.variant, state.payload_kg)


EFFECTS = (
    outside_effect(
        "near_magnet",
        "rig",
        NearMagnet,
        EffectParameter("force_n", 5.0, 400.0, 3e4, "at most, some centimetres beside the pole"),
        "place in the workspace, near one point only and to opposite sides around it; rotation",
    ),
    outside_effect(
        "rung_by_other",
        "strut",
        RungByOther,
        EffectParameter("swing_m", 1e-6, 3e-5, 1e-3, "after a stop of the other drive from 0.5 m/s"),
        "speed, direction and dwell of the other drive, in waves; not a slider's SMR",
    ),
    outside_effect(
        "rounded_ways",
        "drive",
        RoundedWays,
        EffectParameter("increment_m", 1e-6, 3e-5, 1e-3, "of the control, for each whole step of a way"),
        "lengths of all ways, by what is left of them beyond whole steps; SMRs on the sliders",
    ),
)
