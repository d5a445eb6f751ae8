"""Shapes and draws that all effects outside the catalogue share."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array, Effect, EffectParameter, EffectSpec, MotionState, Place

FULL_PAYLOAD_KG = 400.0
VARIANTS = ("plain", "saturating", "with_payload", "cubic")
PLAIN, CUBIC = VARIANTS[0], VARIANTS[-1]


def apply_variant(y: Array, variant: str, payload_kg: Array) -> Array:
    """A unit signal (n,) through one of VARIANTS."""
    if variant == "saturating":
        return np.asarray(np.tanh(2.0 * y) / math.tanh(2.0))
    if variant == "with_payload":
        return y * (0.5 + payload_kg / FULL_PAYLOAD_KG)
    if variant == "cubic":
        return np.asarray(1.3 * y**3)
    return y


class OutsideEffect(Effect):
    """Draws what all of them may want."""

    def setup(self) -> None:
        """A phase and some moments of the campaign."""
        self.phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        self.moments_s = np.cumsum(self.rng.uniform(400.0, 1200.0, 40))
        self.levels = self.rng.uniform(-1.0, 1.0, 41)

    def _unit(self, state: MotionState) -> Array:
        """The signal of unit size (n,)."""
        raise NotImplementedError

    def signal(self, state: MotionState) -> Array:
        """The signal through the variant's shape (n,), in the size's unit."""
        return self.size * apply_variant(self._unit(state), self.variant, state.payload_kg)

    def platform_x(self, state: MotionState) -> Array:
        """Where the platform is across the machine, roughly, from -1 to 1."""
        return np.clip((state.q_m[:, 0] - state.q_m[:, 1]) / 0.9, -1.5, 1.5)


def outside_effect(
    name: str, place: Place, make: type[Effect], size: EffectParameter, reveals: str, *, final_only: bool = False
) -> EffectSpec:
    """Its entry. Of an effect that final scorings use alone, the plain variant is what was published."""
    return EffectSpec(
        name=name,
        kind="outside",
        place=place,
        size=size,
        variants=VARIANTS,
        final=PLAIN if final_only else CUBIC,
        reveals=reveals,
        make=make,
        final_only=final_only,
    )
