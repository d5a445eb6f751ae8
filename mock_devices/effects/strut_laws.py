"""Force laws of struts: force and its derivative for a strut's elongation and its linear stiffness."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array, Law

HERTZ_N, PRELOAD_N = 1000.0, 50.0
CONTACT_M = 1.0e-5  # penetration at which a contact is as stiff as its strut
BALLS = 12
_MOST_NEWTON = 60
_SLACK = 1.0e-3  # of the strut's stiffness: what a joint's seal holds within its play
_SEPARATES_M = 2.0e-6


def dead_zone(c: Array | float, w: float) -> Law:
    """No force within c either way; w rounds the corners."""

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up, down = (e - c) / w, (-e - c) / w
        return k * w * (np.logaddexp(0.0, up) - np.logaddexp(0.0, down)), k * (_step(up) + _step(down))

    return law


def one_sided(c: float, w: float) -> Law:
    """No force from zero to c; w rounds the corners."""

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up, down = (e - c) / w, -e / w
        return k * w * (np.logaddexp(0.0, up) - np.logaddexp(0.0, down)), k * (_step(up) + _step(down))

    return law


def soft_in_compression(ratio: float) -> Law:
    """`ratio` as stiff where the strut is pressed."""

    w = 2.0e-6

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        up = e / w
        return k * (ratio * e + (1.0 - ratio) * w * np.logaddexp(0.0, up)), k * (ratio + (1.0 - ratio) * _step(up))

    return law


def hertz_contact(ratio: float) -> Law:
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


def bowed(ratio: float, buckles_n: float) -> Law:
    """Elongation = F / k + ratio P / (2 k) (1 - (1 + F / P)^-2): a bow of a half sine that the force F straightens.

    P is the force at which it would buckle; the bow's height goes with 1 / (1 + F / P) and its ends come nearer with
    the square of that. Solved by Newton's iteration, which a concave curve leads to the solution from below; steps
    beyond buckling are halved.
    """

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        force, slope = np.zeros_like(e), np.ones_like(e)
        for _ in range(_MOST_NEWTON):
            straight = 1.0 + force / buckles_n
            given = force + 0.5 * ratio * buckles_n * (1.0 - straight**-2)
            slope = 1.0 + ratio * straight**-3
            step = np.maximum((k * e - given) / slope, -0.5 * (force + buckles_n))
            force = force + step
            if float(np.max(np.abs(step), initial=0.0)) < 1.0e-9:
                break
        return force, k / slope

    return law


def contact_force(c: float, w: float) -> Law:
    """Power 3/2 of what is beyond the play c, until the contact is as stiff as the strut at w."""

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        deep = np.maximum(np.abs(e) - c, 0.0)
        share = np.minimum(deep / w, 1.0)
        force = np.sign(e) * k * (2.0 / 3.0 * w * share**1.5 + np.maximum(deep - w, 0.0)) + _SLACK * k * e
        return force, k * (np.sqrt(share) + _SLACK)

    return law


def yielding(per_m: float) -> Law:
    """A force that nears a limit."""

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        root = np.sqrt(1.0 + (per_m * e) ** 2)
        return k * e / root, k / root**3

    return law


def joint_separates(ratio: float, preload_n: float) -> Law:
    """Stiff while its faces are pressed together; beyond the preload the bolt alone holds, `ratio` as stiff."""

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        apart = (e - preload_n / k) / _SEPARATES_M
        force = k * (e - (1.0 - ratio) * _SEPARATES_M * np.logaddexp(0.0, apart))
        return force, k * (1.0 - (1.0 - ratio) * _step(apart))

    return law


def ball_bearing(c: float, w: float) -> Law:
    """A bearing of BALLS balls with radial play c in series with the strut, the load towards a ball.

    Shifted by d the bearing presses the ball at the angle psi by d cos(psi) - c, and each ball carries that to the
    power 3/2. A single ball is as stiff as the strut when it is pressed by w. Solved by Newton's iteration from above,
    which never oversteps: the sum is convex.
    """
    toward = np.cos(2.0 * np.pi * np.arange(BALLS) / BALLS)
    toward = toward[toward > 1.0e-9]

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        whole = np.abs(e)
        shift = whole.copy()
        carried, slope = np.zeros_like(e), np.zeros_like(e)
        for _ in range(_MOST_NEWTON):
            deep = np.maximum(shift[:, None] * toward - c, 0.0)
            carried = deep**1.5 @ toward / (1.5 * np.sqrt(w))  # force over the strut's stiffness
            slope = np.sqrt(deep) @ toward**2 / np.sqrt(w)
            step = (shift + carried - whole) / (1.0 + slope)
            shift = shift - step
            if float(np.max(np.abs(step), initial=0.0)) < 1.0e-16:
                break
        return k * (np.sign(e) * carried + _SLACK * e), k * (slope / (1.0 + slope) + _SLACK)

    return law


def spring_seated(c: float, w: float, spring_n: float) -> Law:
    """Play of 2 c that is only felt beyond the force of a spring, on the side of its sign; w rounds the corners."""
    side = 1.0 if spring_n > 0.0 else -1.0

    def law(e: Array, k: Array) -> tuple[Array, Array]:
        begins = (side * e - abs(spring_n) / k) / w
        ends = begins - 2.0 * c / w
        gone = w * (np.logaddexp(0.0, begins) - np.logaddexp(0.0, ends))
        inside = _step(begins) - _step(ends)
        return k * (e - side * (1.0 - _SLACK) * gone), k * (1.0 - (1.0 - _SLACK) * inside)

    return law


def _step(x: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))
