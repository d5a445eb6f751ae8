"""Static equilibrium of the planar over-constrained structure.

The pose at rest minimises V (docs/reference/machine.md). With planar vectors as complex numbers and a = R m:
d = p + a - s, n = d / |d|, t = k (|d| - l), and w = <n, ia> the share of a small rotation along the strut.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

_STEP_TOLERANCE_M = 1e-13
_MOST_STEPS = 40
_LONGEST_STEP = 0.05


class NoEquilibrium(RuntimeError):
    """The struts do not reach, or Newton's iteration did not settle."""


@dataclass(frozen=True)
class Member:
    """One strut as it stands: both joints in the plane, unstrained length, stiffness, side of its slider."""

    platform_joint: complex
    slider_joint: complex
    length_m: float
    stiffness_n_per_m: float


@dataclass(frozen=True)
class Weight:
    """A mass and where it sits in the platform frame."""

    mass_kg: float
    centre: complex


@dataclass(frozen=True)
class PlanarPose:
    """Platform origin p in metres and rotation in radians, positive from x to y."""

    p: complex
    rz_rad: float

    def place(self, point: complex) -> complex:
        """A point of the platform in the machine's plane."""
        return self.p + cmath.exp(1j * self.rz_rad) * point


def energy_j(pose: PlanarPose, members: list[Member], weights: list[Weight], gravity: complex) -> float:
    """V at a pose, in joules."""
    total = 0.0
    for member in members:
        length = abs(pose.place(member.platform_joint) - member.slider_joint)
        total += 0.5 * member.stiffness_n_per_m * (length - member.length_m) ** 2
    return total - sum(w.mass_kg * _dot(gravity, pose.place(w.centre)) for w in weights)


def equilibrium(members: list[Member], weights: list[Weight], gravity: complex, start: PlanarPose) -> PlanarPose:
    """The pose at rest nearest to `start`; raises NoEquilibrium."""
    p, angle = start.p, start.rz_rad
    for _ in range(_MOST_STEPS):
        gradient, hessian = _derivatives(p, angle, members, weights, gravity)
        dx, dy, turn = _solve(hessian, gradient)
        size = math.hypot(dx, dy) + abs(turn)
        if not math.isfinite(size):
            break
        shrink = min(1.0, _LONGEST_STEP / size) if size > 0.0 else 1.0
        p -= complex(dx, dy) * shrink
        angle -= turn * shrink
        if size < _STEP_TOLERANCE_M:
            return PlanarPose(p, angle)
    raise NoEquilibrium(f"no equilibrium near {start}")


def assembled_start(
    slider_a: complex, slider_b: complex, length_a: float, length_b: float, up_a: complex, branch: int
) -> complex:
    """Where two circles about the sliders meet, on the side that `branch` tells: the start for Newton.

    Arguments: places that the platform origin would have if each strut had length zero, lengths,
    axis and branch of the first slider. Raises NoEquilibrium if the circles do not meet.
    """
    apart = slider_b - slider_a
    distance = abs(apart)
    along = (distance**2 + length_a**2 - length_b**2) / (2.0 * distance) if distance else math.inf
    if abs(along) > length_a:
        raise NoEquilibrium("the struts do not reach each other")
    direction = apart / distance
    across = 1j * direction * math.sqrt(length_a**2 - along**2)
    for candidate in (slider_a + along * direction + across, slider_a + along * direction - across):
        if branch * _dot(slider_a - candidate, up_a) > 0.0:
            return candidate
    raise NoEquilibrium("no assembly on the branch of the machine file")


def _derivatives(
    p: complex, angle: float, members: list[Member], weights: list[Weight], gravity: complex
) -> tuple[tuple[float, float, float], tuple[float, float, float, float, float, float]]:
    """Gradient (x, y, rz) and Hessian (xx, xy, yy, xr, yr, rr) of V."""
    turn = cmath.exp(1j * angle)
    gx = gy = gr = hxx = hxy = hyy = hxr = hyr = hrr = 0.0
    for member in members:
        a = turn * member.platform_joint
        d = p + a - member.slider_joint
        length = abs(d)
        nx, ny = d.real / length, d.imag / length
        k = member.stiffness_n_per_m
        t = k * (length - member.length_m)
        c = t / length
        bx, by = -a.imag, a.real  # ia: how the joint moves as the platform turns
        w = nx * bx + ny * by
        gx += t * nx
        gy += t * ny
        gr += t * w
        hxx += k * nx * nx + c * (1.0 - nx * nx)
        hxy += (k - c) * nx * ny
        hyy += k * ny * ny + c * (1.0 - ny * ny)
        hxr += (k - c) * nx * w + c * bx
        hyr += (k - c) * ny * w + c * by
        hrr += (k - c) * w * w + c * (bx * bx + by * by) - t * (nx * a.real + ny * a.imag)
    for weight in weights:
        a = turn * weight.centre
        fx, fy = weight.mass_kg * gravity.real, weight.mass_kg * gravity.imag
        gx -= fx
        gy -= fy
        gr -= fy * a.real - fx * a.imag
        hrr += fx * a.real + fy * a.imag
    return (gx, gy, gr), (hxx, hxy, hyy, hxr, hyr, hrr)


def _solve(
    h: tuple[float, float, float, float, float, float], g: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Solve the symmetric 3 x 3 system by elimination."""
    hxx, hxy, hyy, hxr, hyr, hrr = h
    gx, gy, gr = g
    f = hxy / hxx
    e = hxr / hxx
    b11 = hyy - f * hxy
    b12 = hyr - f * hxr
    c1 = gy - f * gx
    b22 = hrr - e * hxr
    c2 = gr - e * gx
    m = b12 / b11
    turn = (c2 - m * c1) / (b22 - m * b12)
    y = (c1 - b12 * turn) / b11
    x = (gx - hxy * y - hxr * turn) / hxx
    return x, y, turn


def _dot(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag
