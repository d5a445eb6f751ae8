"""What forms are put together of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import Machine
from benchmarks.other_simulator.rows import Rows
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]


def logistic(x: Array) -> Array:
    """From 0 to 1 about x = 0."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -50, 50))))


def normalised(x: Array) -> Array:
    """Scaled so that its largest magnitude is 1."""
    return np.asarray(x / max(np.abs(x).max(), 1e-12))


def bump(x: Array, middle: float, width: float) -> Array:
    """A bell about `middle`, 1 at most."""
    return np.exp(-(((x - middle) / width) ** 2))


def wave(x_m: Array, period_m: float, phase: float) -> Array:
    """A sine of a coordinate."""
    return np.sin(2 * np.pi * x_m / period_m + phase)


def draw_phase(rng: np.random.Generator) -> float:
    """A phase in rad."""
    return float(rng.uniform(0, 6.3))


def draw_sign(rng: np.random.Generator) -> int:
    """-1 or 1."""
    return int(rng.choice([-1, 1]))


def draw_instant(rows: Rows, rng: np.random.Generator, earliest: float = 0.25, latest: float = 0.75) -> float:
    """Rig time between two readings, of a step within these shares of the campaign."""
    drawn = rows.t_s[0] + rng.uniform(earliest, latest) * (rows.t_s[-1] - rows.t_s[0])
    after = np.searchsorted(rows.t_s, drawn)
    return float((rows.t_s[after - 1] + rows.t_s[after]) / 2)


def draw_two_instants(
    rows: Rows, rng: np.random.Generator, first: tuple[float, float], second: tuple[float, float]
) -> tuple[float, float]:
    """Two steps, the earlier first."""
    one, other = draw_instant(rows, rng, *first), draw_instant(rows, rng, *second)
    return min(one, other), max(one, other)


def draw_direction(rng: np.random.Generator) -> Array:
    """A unit vector (3,), of any direction in the plane rather than across it."""
    out = rng.normal(size=3)
    out[2] *= 0.5
    return np.asarray(out / np.linalg.norm(out))


def since(rows: Rows, step_s: float) -> Array:
    """0 before a step, 1 after (r,)."""
    return (rows.t_s > step_s).astype(float)


def within(rows: Rows, begin: float, end: float) -> Array:
    """1 between two shares of the campaign, else 0 (r,)."""
    return ((rows.elapsed > begin) & (rows.elapsed < end)).astype(float)


def warming_up(rows: Rows, tau_h: float) -> Array:
    """From 0 towards 1 (r,)."""
    return np.asarray(1 - np.exp(-rows.hours / tau_h))


def column_height(rows: Rows, drive: int) -> Array:
    """How high a carriage stands on its column (r,); 1.3 at most."""
    return np.asarray(0.4 + 0.6 * rows.raised[:, drive] + 0.3)


def across(machine: Machine, drive: int, shift: Array) -> Array:
    """Shifts (r,) of a carriage across its slide, in the plane, as vectors (r, 3)."""
    return shift[:, None] * machine.sideways[drive]


def along(machine: Machine, drive: int, shift: Array) -> Array:
    """Shifts (r,) of a carriage along its slide, as vectors (r, 3)."""
    return shift[:, None] * machine.axes[drive]


def turned(machine: Machine, drive: int, angle: Array) -> Array:
    """Turns (r,) of a carriage in the plane, as vectors (r, 3)."""
    return angle[:, None] * machine.normals[drive]


def load_share(scene: Scene, drive: int) -> Array:
    """What a drive holds (r,), 1 or -1 at its largest."""
    load = scene.loads_n[:, drive]
    return np.asarray(load / np.abs(load).max())


def level_direction(machine: Machine) -> Array:
    """A level unit vector (3,), in the plane of a planar machine."""
    return np.cross(machine.up, [0, 0, 1.0]) if machine.planar else np.array([1.0, 0, 0])


def normal_direction(machine: Machine) -> Array:
    """The normal of a planar machine's plane (3,), upwards on others."""
    return np.array([0, 0, 1.0]) if machine.planar else machine.up


def sight_of(scene: Scene) -> tuple[Array, Array]:
    """Lines of sight: unit vectors (r, 3) of the station's frame, and distances (r,) in m."""
    distances = np.linalg.norm(scene.sights_m, axis=1)
    return scene.sights_m / distances[:, None], distances


def with_platform(scene: Scene, vectors: Array) -> Array:
    """Vectors (r, 3) of the platform's frame in the machine frame (r, 3)."""
    return np.einsum("rij,rj->ri", scene.calm.rotations, vectors)


def way_it_went(x_m: Array) -> Array:
    """Sign of the last move of a coordinate (r,) by more than 1 mm; 0 before."""
    out, sign = np.zeros(len(x_m)), 0.0
    for k in range(1, len(x_m)):
        if abs(x_m[k] - x_m[k - 1]) > 1e-3:
            sign = np.sign(x_m[k] - x_m[k - 1])
        out[k] = sign
    return out
