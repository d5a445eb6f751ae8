"""What a campaign is to do: payloads, and where the platform goes in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from benchmarks.other_simulator.machine import Machine

Array = NDArray[np.float64]

RANDOMISED, BIDIRECTIONAL, ONE_WAY = "randomised", "bidirectional", "oneway"
GRIDS = [(7, 6), (8, 5), (6, 6), (9, 5), (8, 6)]
GRID_SHARE = 0.95  # of the workspace
SPEEDS_M_PER_S, DWELLS_S = [0.03, 0.05, 0.1, 0.2], [2.0, 4.0, 6.0, 8.0]  # of one-way and bidirectional campaigns
MOST_VISITS = 200
WORKSPACE_KEYS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Payload:
    """What is stated of a payload; its mass and centre are drawn around that."""

    name: str
    mass_kg: float
    u_mass_kg: float
    centre_m: tuple[float, float, float]
    u_centre_m: float


@dataclass(frozen=True)
class Visit:
    """A place to go to: pose (6,) of the tool point, its number, and how.

    side: that all drives come from, +1 from below, None for the side that the former place happens to lie on.
    """

    tool_pose: Array
    number: int
    side: int | None
    speed_m_per_s: float
    dwell_s: float
    on_the_fly: bool = False


def workspace_of(machine: Machine) -> Array:
    """Lowest and highest coordinates (6, 2) of the tool point; what the file leaves out stays at zero."""
    box = machine.description["workspace"]
    return np.array([box.get(key, [0, 0]) for key in WORKSPACE_KEYS], float)


def draw_payloads(machine: Machine, style: str, rng: np.random.Generator) -> list[Payload]:
    """No payload and up to two others."""
    count = int(rng.integers(2, 4)) if style == RANDOMISED else int(rng.integers(1, 3))
    if machine.planar:
        masses = np.sort(rng.uniform(25, 160, count - 1))
    else:
        masses = np.sort(rng.uniform(0.3, 1.6, count - 1) * machine.moving_mass_kg)
    out = [Payload("none", 0.0, 0.0, (0.0, 0.0, 0.0), 0.0)]
    for number, mass in enumerate(masses.round(1).tolist(), 1):
        centre = rng.uniform(-1, 1, 3) * [0.05, 0.05, 0] + [0, -0.15, 0]
        if not machine.planar:
            centre = np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(-0.1, 0.2)])
        x, y, z = centre.round(3).tolist()
        out.append(Payload(f"mass{number}", mass, round(mass * 0.002, 3), (x, y, z), 0.001))
    return out


def draw_visits(machine: Machine, style: str, rng: np.random.Generator) -> list[Visit]:
    """Visits in their order."""
    box = workspace_of(machine)
    if style == RANDOMISED:
        return [_draw_visit(box, number, rng) for number in range(int(rng.integers(135, 181)))]
    places = _draw_grid(machine, box, rng)
    speed, dwell = float(rng.choice(SPEEDS_M_PER_S)), float(rng.choice(DWELLS_S))
    there_and_back = style == BIDIRECTIONAL
    rounds = int(np.ceil(rng.uniform(120, 165) / len(places) / (2 if there_and_back else 1) - 0.25))
    shuffled = rng.random() < 0.5
    out = []
    for _ in range(max(rounds, 1)):
        order = rng.permutation(len(places)) if shuffled else np.arange(len(places))
        out += [Visit(places[k], int(k), 1, speed, dwell) for k in order]
        if there_and_back:
            out += [Visit(places[k], int(k), -1, speed, dwell) for k in order[::-1]]
    return out[:MOST_VISITS]


def draw_payload_of_visits(payloads: Sequence[Payload], visits: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Number of the payload of each visit: each in turn, then perhaps some once more."""
    count = len(payloads)
    blocks = count + (int(rng.integers(0, 3)) if count > 1 else 0)
    order = list(range(count)) + [int(rng.integers(count)) for _ in range(blocks - count)]
    begins = np.linspace(0, visits, blocks + 1).astype(int)
    return np.repeat(order, np.diff(begins))


def _draw_visit(box: Array, number: int, rng: np.random.Generator) -> Visit:
    place = rng.uniform(box[:, 0], box[:, 1])
    speed = float(np.exp(rng.uniform(np.log(0.02), np.log(0.3))))
    dwell = float(np.exp(rng.uniform(np.log(0.5), np.log(12))))
    return Visit(place, number, None, speed, dwell, rng.random() < 0.13)


def _draw_grid(machine: Machine, box: Array, rng: np.random.Generator) -> Array:
    """Poses (k, 6) of the tool point: a grid in the plane, a Halton sequence in space."""
    middle, half = box.mean(1), (box[:, 1] - box[:, 0]) / 2
    if machine.planar:
        columns, rows = GRIDS[rng.integers(len(GRIDS))]
        x, y = np.meshgrid(
            np.linspace(-GRID_SHARE, GRID_SHARE, columns), np.linspace(-GRID_SHARE, GRID_SHARE, rows)
        )  # fmt: skip
        unit = np.zeros((x.size, 6))
        unit[:, 0], unit[:, 1] = x.ravel(), y.ravel()
        return np.asarray(middle + half * unit)
    count = int(rng.integers(38, 46))
    sequence = qmc.Halton(6, seed=int(rng.integers(1 << 30))).random(count)
    return np.asarray(middle + half * (2 * sequence - 1) * GRID_SHARE)
