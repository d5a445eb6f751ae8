"""Further effects outside the catalogue, each from a published description."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import (
    Array,
    Deviation,
    EffectParameter,
    Leg,
    MotionState,
    StatefulEffect,
)
from mock_devices.effects.outside_shapes import OutsideEffect, apply_variant, outside_effect

TURN_M, TOOTH_M = 0.16, 0.010  # travel of one turn of the wheel and of one of its teeth
CLAMP_M_PER_S = 0.2
HUNTING_S = 3.7


class DamagedTooth(OutsideEffect):
    """One broken tooth of a wheel: a short pulse once a turn, where the other teeth are whole.

    R. B. Randall, "A New Method of Modeling Gear Faults" (1982).
    """

    def _unit(self, state: MotionState) -> Array:
        q = state.q_m[:, self.place] - self.phase / (2.0 * np.pi) * TURN_M
        off = (q / TURN_M + 0.5) % 1.0 - 0.5
        inside = np.abs(off) < TOOTH_M / TURN_M
        return np.asarray(np.where(inside, np.cos(0.5 * np.pi * off * TURN_M / TOOTH_M) ** 2, 0.0))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Let the slider drop into the gap."""
        deviation.travel_m[:, self.place] -= self.signal(state)


class DryCableDrag(StatefulEffect):
    """A cable drags dryly along its trough: its force rises over a way, and a reversal begins from where it was.

    P. R. Dahl, "A Solid Friction Model" (1968), with exponent one; remembered is the force over its limit.
    """

    rise_m = 0.12

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The force when a leg ends."""
        way = leg.to_m - leg.from_m
        return float(self._after(np.array([way]), np.array([before]))[0])

    def _after(self, way_m: Array, before: Array) -> Array:
        limit = -np.sign(way_m)
        return np.asarray(
            np.where(way_m == 0.0, before, limit + (before - limit) * np.exp(-np.abs(way_m) / self.rise_m))
        )

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Pull at the platform's upper edge, as the first drive moved."""
        y = self._after(state.q_m[:, 0] - state.from_m[:, 0], self.state_before(state, 0))
        force = self.size * apply_variant(y, self.variant, state.payload_kg)
        deviation.loads.append((np.full(len(state), -0.15 + 0.2j), force.astype(np.complex128)))


class SnappingClamp(StatefulEffect):
    """A clamp with two places, which only a hard stop throws from one into the other; slow motions leave it.

    Two stable places of a shallow truss: R. von Mises, "Über die Stabilitätsprobleme der Elastizitätstheorie" (1923).
    """

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """Where the last fast motion has thrown it."""
        fast = leg.speed_m_per_s > CLAMP_M_PER_S and leg.to_m != leg.from_m
        return math.copysign(1.0, leg.to_m - leg.from_m) if fast else before

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Shift the strut's joint on the platform upwards or downwards."""
        drive = self.site.machine.struts[self.place].drive
        moved = state.q_m[:, drive] - state.from_m[:, drive]
        fast = (state.speed_m_per_s[:, drive] > CLAMP_M_PER_S) & (moved != 0.0) & (state.since_s[:, drive] > 0.0)
        y = np.where(fast, np.sign(moved), self.state_before(state, drive))
        if self.variant == "cubic":
            y = np.maximum(y, 0.0)
        elif self.variant == "saturating":
            y = y * np.tanh(self.elapsed_s(state) / 1800.0)
        else:
            y = apply_variant(y, self.variant, state.payload_kg)
        deviation.platform_joint_m[:, self.place] += 1j * self.size * y


class Hunting(OutsideEffect):
    """A drive that hunts at standstill: friction and the controller's integral part take turns, stick and slip.

    R. H. A. Hensen, M. J. G. van de Molengraft, M. Steinbuch, "Friction Induced Hunting Limit Cycles: A Comparison
    Between the LuGre and Switch Friction Model" (2003): between jumps the slider stands, first short of its target.
    """

    def _unit(self, state: MotionState) -> Array:
        halves = np.floor(state.since_s[:, self.place] / HUNTING_S)
        side = np.where(halves % 2.0 == 0.0, -1.0, 1.0) * (1.0 + 0.3 * np.minimum(halves, 3.0)) / 1.9
        return np.asarray(side * state.direction[:, self.place])

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the slider."""
        deviation.travel_m[:, self.place] += self.signal(state)


EFFECTS = (
    outside_effect(
        "damaged_tooth",
        "drive",
        DamagedTooth,
        EffectParameter("depth_m", 1e-6, 4e-5, 2e-3, "of the gap"),
        "drive coordinate, once a turn",
    ),
    outside_effect(
        "dry_cable_drag",
        "rig",
        DryCableDrag,
        EffectParameter("force_n", 5.0, 400.0, 9000.0, "at the edge"),
        "ways moved, direction",
    ),
    outside_effect(
        "snapping_clamp",
        "strut",
        SnappingClamp,
        EffectParameter("snap_m", 1e-6, 3e-5, 1e-3, "either way"),
        "speed of former motions, direction",
    ),
    outside_effect(
        "hunting",
        "drive",
        Hunting,
        EffectParameter("amplitude_m", 1e-6, 2e-5, 6e-4, "of the later jumps, either way"),
        "dwell",
    ),
)
