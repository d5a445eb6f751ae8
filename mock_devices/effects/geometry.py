"""What is inside the geometry, no cause: reflectors, joints and weights of struts that are not as drawn."""

from __future__ import annotations

import cmath

import numpy as np

from mock_devices.effects.base import (
    GRAVITY_M_PER_S2,
    Array,
    Deviation,
    Effect,
    EffectParameter,
    EffectSpec,
    MotionState,
    names_of,
)

FULL_PAYLOAD_KG = 400.0


class SmrOffset(Effect):
    """A reflector sits beside its place."""

    def setup(self) -> None:
        """Which way: seeded."""
        self.turn = cmath.exp(1j * float(self.rng.uniform(0.0, 2.0 * np.pi)))

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the reflector in its own frame."""
        share: Array = np.ones(len(state))
        if self.variant == "with_payload":
            share = 0.5 + state.payload_kg / FULL_PAYLOAD_KG
        elif self.variant == "with_temperature":
            share = 1.0 + 0.2 * (state.parts_c["platform"] - self.site.machine.reference_temperature_c)
        deviation.smr_m[:, self.smr_index(), 0] += self.size * self.turn.real * share
        deviation.smr_m[:, self.smr_index(), 1] += self.size * self.turn.imag * share

    def smr_index(self) -> int:
        """Index among all reflectors."""
        name = names_of(self.site.machine, "smr")[self.place]
        return [smr.name for smr in self.site.machine.smrs].index(name)


class JointSpacing(Effect):
    """A joint sits further along its strut's parallelogram than the drawing says."""

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Move the joint on the platform, on the slider or on both, along the slider's axis."""
        i = self.place
        strut = self.site.machine.struts[i]
        shift = self.size * self.site.machine.sliders[strut.drive].axis
        if self.variant != "slider":
            deviation.platform_joint_m[:, i] += shift
        if self.variant == "both":
            deviation.base_joint_m[:, i] -= shift
        if self.variant == "slider":
            deviation.base_joint_m[:, i] += shift


class LinkSelfWeight(Effect):
    """Half of a strut's weight hangs at its platform joint; its mass is not in the machine file."""

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Load the platform; a long strut also sags and becomes shorter between its joints."""
        i, mass = self.place, self.size
        strut = self.site.machine.struts[i]
        share = {"uneven": 0.65, "quarter": 0.25}.get(self.variant, 0.5)
        force = np.full(len(state), share * mass * self.site.machine.gravity)
        deviation.loads.append((np.full(len(state), strut.platform_joint), force))
        if self.variant == "sagging":
            sag_m = 5.0 * mass * GRAVITY_M_PER_S2 * strut.length_m**3 / (384.0 * 2.1e11 * 2.8e-7)
            deviation.length_m[:, i] -= 8.0 / 3.0 * sag_m**2 / strut.length_m


EFFECTS = (
    EffectSpec(
        name="smr_offset",
        kind="geometry",
        place="smr",
        size=EffectParameter("offset_m", 1e-6, 1e-4, 2e-3, "from its place"),
        variants=("fixed", "with_payload", "with_temperature"),
        final="with_temperature",
        reveals="absorbed by mounting",
        make=SmrOffset,
    ),
    EffectSpec(
        name="joint_spacing",
        kind="geometry",
        place="strut",
        size=EffectParameter("spacing_m", 1e-6, 5e-5, 1e-3, "beyond the drawing"),
        variants=("platform", "slider", "both"),
        final="both",
        reveals="everything; absorbed by geometry",
        make=JointSpacing,
    ),
    EffectSpec(
        name="link_self_weight",
        kind="geometry",
        place="strut",
        size=EffectParameter("mass_kg", 0.5, 12.0, 1200.0, "of the strut"),
        variants=("half", "uneven", "quarter", "sagging"),
        final="sagging",
        reveals="constant load; absorbed by mass and geometry",
        make=LinkSelfWeight,
    ),
)
