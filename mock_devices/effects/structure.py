"""Elastic effects, which act inside the equilibrium: columns, struts, clearance; and what is inside the geometry.

Force laws give force and its derivative for a strut's elongation and its linear stiffness.
"""

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
    Law,
    MotionState,
    names_of,
)

LEVER_M = 0.25
FULL_PAYLOAD_KG = 400.0
HERTZ_N, PRELOAD_N = 1000.0, 50.0
CONTACT_M = 1.0e-5  # penetration at which a contact is as stiff as its strut
_ALONG, _ACROSS, _YAW = 0, 1, 2
_MOST_NEWTON = 60
_SLACK = 1.0e-3  # of the strut's stiffness: what a joint's seal holds within its play


class ColumnCompliance(Effect):
    """The column or the carriage on it gives way to the struts' force.

    `held_at_both_ends`: the screw between two axial bearings, softest in the middle of the travel, of K. K. Varanasi,
    S. A. Nayfeh, "The Dynamics of Lead-Screw Drives: Low-Order Modeling and Experiments" (2004).
    """

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Add compliance at the carriage."""
        a, c = self.place, self.size
        middle, half = self.site.drive_range_m(a)
        height = 1.0 + 0.6 * (state.q_m[:, a] - middle) / half  # 1 in the middle of the travel
        if self.variant == "cantilever":
            deviation.carriage_compliance[:, a, _ACROSS] += c * height**3
        elif self.variant == "yaw":
            deviation.carriage_compliance[:, a, _YAW] += c / LEVER_M**2
        elif self.variant == "hardening":
            deviation.carriage_compliance[:, a, _ACROSS] += c
            if c:
                deviation.carriage_hardening[:, a, _ACROSS] += 1.0 / c / 1.5e-5**2
        elif self.variant == "held_at_both_ends":
            low, high = self.site.machine.sliders[a].travel_m
            share = (state.q_m[:, a] - low) / (high - low)
            deviation.carriage_compliance[:, a, _ALONG] += c * 4.0 * share * (1.0 - share)
        elif self.variant == "screw_length":  # a screw that is held above: soft where the nut is low
            deviation.carriage_compliance[:, a, _ALONG] += c * (2.0 - height)
        else:
            deviation.carriage_compliance[:, a, _ACROSS] += c


class LinkStiffness(Effect):
    """One strut is softer than the others, by exp(-size).

    `hertz`: its joints' contacts give way with the power 2/3 of the force, as H. Hertz, "Über die Berührung fester
    elastischer Körper" (1881) has it of points; exp(-size) is then the ratio of stiffness from rest to HERTZ_N.
    """

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Change the strut's stiffness or its law."""
        i, x = self.place, self.size
        if self.variant == "joint_angle":  # a joint that is stiff only in its middle position
            strut = self.site.machine.struts[i]
            swing = (state.q_m[:, strut.drive] - self.site.drive_range_m(strut.drive)[0]) / strut.length_m
            deviation.ln_stiffness[:, i] -= x * (0.4 + 8.0 * swing**2)
        elif self.variant == "soft_in_compression":
            deviation.laws.setdefault(i, []).append(_soft_in_compression(float(np.exp(-x))))
        elif self.variant == "hertz":
            deviation.laws.setdefault(i, []).append(_hertz_contact(float(np.expm1(x))))
        elif self.variant == "yielding":
            deviation.laws.setdefault(i, []).append(_yielding(x / 1.0e-4))
        elif self.variant == "softens_with_load":
            deviation.ln_stiffness[:, i] -= x * (0.3 + 0.7 * state.payload_kg / FULL_PAYLOAD_KG)
        else:
            deviation.ln_stiffness[:, i] -= x


class JointClearance(Effect):
    """The joints of a strut have play: `clearance_m` each way before any force arises.

    `contact_force`: then it grows with the power 3/2 of the penetration, as in H. M. Lankarani, P. E. Nikravesh, "A
    Contact Force Model With Hysteresis Damping for Impact Analysis of Multibody Systems" (1990), until the contact is
    as stiff as the strut.
    """

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Put a dead zone into the strut's law, or seat the pin."""
        i, c = self.place, self.size
        if self.variant == "gravity_seated":  # the pin lies on one side of its hole: a length that goes with the angle
            strut = self.site.machine.struts[i]
            drop = state.q_m[:, strut.drive] - self.site.drive_range_m(strut.drive)[0]
            deviation.length_m[:, i] += c * np.sin(4.0 * drop / strut.length_m)
            return
        if self.variant == "soft_contact":
            law = _dead_zone(c, 0.5 * c)
        elif self.variant == "one_sided":
            law = _one_sided(c, 0.1 * c)
        elif self.variant == "contact_force":
            law = _contact_force(c, CONTACT_M)
        elif self.variant == "load_dependent":
            law = _dead_zone(c * np.exp(-state.payload_kg / FULL_PAYLOAD_KG), 0.1 * c)
        else:
            law = _dead_zone(c, 0.1 * c)
        if c > 0.0:
            deviation.laws.setdefault(i, []).append(law)


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


def _dead_zone(c: Array | float, w: float) -> Law:
    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up, down = (e - c) / w, (-e - c) / w
        return k * w * (np.logaddexp(0.0, up) - np.logaddexp(0.0, down)), k * (_step(up) + _step(down))

    return law


def _one_sided(c: float, w: float) -> Law:
    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up, down = (e - c) / w, -e / w
        return k * w * (np.logaddexp(0.0, up) - np.logaddexp(0.0, down)), k * (_step(up) + _step(down))

    return law


def _soft_in_compression(ratio: float) -> Law:
    w = 2.0e-6

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up = e / w
        return k * (ratio * e + (1.0 - ratio) * w * np.logaddexp(0.0, up)), k * (ratio + (1.0 - ratio) * _step(up))

    return law


def _hertz_contact(ratio: float) -> Law:
    """Elongation = F / k + ratio g(F), where g is that of a preloaded contact and g(HERTZ_N) = HERTZ_N / k.

    Solved by Newton's iteration from no force, which never oversteps: a contact grows stiffer.
    """
    scale = HERTZ_N / ((HERTZ_N + PRELOAD_N) ** (2.0 / 3.0) - PRELOAD_N ** (2.0 / 3.0))

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        force = np.zeros_like(e)
        slope = np.ones_like(e)
        for _ in range(_MOST_NEWTON):
            size = np.abs(force) + PRELOAD_N
            given = force + ratio * scale * np.sign(force) * (size ** (2.0 / 3.0) - PRELOAD_N ** (2.0 / 3.0))
            slope = 1.0 + ratio * scale * 2.0 / 3.0 * size ** (-1.0 / 3.0)
            step = (k * e - given) / slope
            force = force + step
            if float(np.max(np.abs(step), initial=0.0)) < 1.0e-9:
                break
        return force, k / slope

    return law


def _contact_force(c: float, w: float) -> Law:
    def law(e: Array, k: Array) -> tuple[Array, Array]:
        deep = np.maximum(np.abs(e) - c, 0.0)
        share = np.minimum(deep / w, 1.0)
        force = np.sign(e) * k * (2.0 / 3.0 * w * share**1.5 + np.maximum(deep - w, 0.0)) + _SLACK * k * e
        return force, k * (np.sqrt(share) + _SLACK)

    return law


def _yielding(per_m: float) -> Law:
    def law(e: Array, k: Array) -> tuple[Array, Array]:
        root = np.sqrt(1.0 + (per_m * e) ** 2)
        return k * e / root, k / root**3

    return law


def _step(x: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


_PER_N = EffectParameter(
    "compliance_m_per_n", 5e-10, 1e-8, 2e-6, "of the carriage, at mid travel, at 0.25 m lever if in yaw"
)

EFFECTS = (
    EffectSpec(
        name="column_compliance",
        kind="catalogue",
        place="drive",
        size=_PER_N,
        variants=("lateral", "cantilever", "yaw", "hardening", "screw_length", "held_at_both_ends"),
        final="held_at_both_ends",
        reveals="payload, SMRs on the sliders, height",
        make=ColumnCompliance,
    ),
    EffectSpec(
        name="link_stiffness",
        kind="catalogue",
        place="strut",
        size=EffectParameter("ln_ratio", 0.05, 0.7, 6.0, "logarithm of nominal over true"),
        variants=("softer", "soft_in_compression", "yielding", "joint_angle", "softens_with_load", "hertz"),
        final="hertz",
        reveals="payload",
        make=LinkStiffness,
    ),
    EffectSpec(
        name="joint_clearance",
        kind="catalogue",
        place="strut",
        size=EffectParameter("clearance_m", 1e-6, 1.5e-5, 4e-4, "play each way"),
        variants=("dead_zone", "soft_contact", "one_sided", "load_dependent", "gravity_seated", "contact_force"),
        final="contact_force",
        reveals="poses where the strut's force changes its sign, payload",
        make=JointClearance,
    ),
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
