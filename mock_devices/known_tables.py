"""Compensation tables that are kept for a machine: `known_tables` of recordings (docs/reference/mock-effects.md).

They are on record whether or not a drive uses them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import MachineFile

Array = NDArray[np.float64]

INCREMENT_M = 1.0e-8  # corrections are whole increments
NODES = 9
RMS_M = (3.0e-5, 7.0e-5)
_ORDER = 4
_SHARED = 0.6


@dataclass(frozen=True)
class KnownTable:
    """A table of one generation for one drive, in metres that are added to its command.

    own_m: rising nodes of the drive's own commanded coordinate; partner_m: of its partner's, empty without one.
    corrections_m: own index major, one number a row without a partner.
    """

    generation: int
    drive: str
    own_m: tuple[float, ...]
    corrections_m: tuple[tuple[float, ...], ...]
    partner: str = ""
    partner_m: tuple[float, ...] = ()

    def correction_m(self, own_m: Array, partner_m: Array) -> Array:
        """Corrections (n,) at commanded positions (n,): bilinear between the nodes, held at the edge beyond them."""
        values = np.array(self.corrections_m)
        i, u = _cells(self.own_m, own_m)
        if not self.partner_m:
            return np.asarray((1.0 - u) * values[i, 0] + u * values[i + 1, 0])
        j, v = _cells(self.partner_m, partner_m)
        low = (1.0 - v) * values[i, j] + v * values[i, j + 1]
        high = (1.0 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
        return np.asarray((1.0 - u) * low + u * high)

    def section(self) -> dict[str, Any]:
        """What recording.toml says of it."""
        of_partner = {"partner": self.partner, "partner_m": list(self.partner_m)} if self.partner_m else {}
        return {
            "generation": self.generation,
            "drive": self.drive,
            "own_m": list(self.own_m),
            **of_partner,
            "corrections_m": [list(row) for row in self.corrections_m],
        }


def draw_known_tables(
    machine: MachineFile, rng: np.random.Generator, *, generations: int = 3
) -> tuple[KnownTable, ...]:
    """Tables of some generations for every drive, over its travel and that of the next drive.

    Smooth curves, products of both coordinates among them; those of one drive resemble one another, as tables do that
    were identified on one machine.
    """
    names = [slider.name for slider in machine.sliders]
    nodes = [np.linspace(*slider.travel_m, NODES).round(6) for slider in machine.sliders]
    tables = []
    for a, name in enumerate(names):
        b = (a + 1) % len(names)
        common = _surface(rng)
        for generation in range(1, generations + 1):
            shape = _SHARED * common + np.sqrt(1.0 - _SHARED**2) * _surface(rng)
            rms_m = float(rng.uniform(*RMS_M))
            whole = np.round(shape / np.sqrt(np.mean(shape**2)) * rms_m / INCREMENT_M)
            rows = tuple(tuple(round(float(c) * INCREMENT_M, 8) for c in row) for row in whole)
            tables.append(
                KnownTable(generation, name, tuple(nodes[a].tolist()), rows, names[b], tuple(nodes[b].tolist()))
            )
    return tuple(tables)


def _surface(rng: np.random.Generator) -> Array:
    """A seeded smooth surface over NODES x NODES: Legendre products, weaker with their order."""
    x = np.linspace(-1.0, 1.0, NODES)
    weights = rng.standard_normal((_ORDER + 1, _ORDER + 1))
    i, j = np.indices(weights.shape)
    weights = np.where(i + j <= _ORDER, weights / (1.0 + i + j), 0.0)
    surface = np.polynomial.legendre.leggrid2d(x, x, weights)
    return np.asarray(surface / np.sqrt(np.mean(surface**2)))


def _cells(nodes: tuple[float, ...], at: Array) -> tuple[NDArray[np.intp], Array]:
    """Cell of each position and the share within it; beyond the ends that of the end."""
    grid = np.array(nodes)
    cell = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2).astype(np.intp)
    share = (at - grid[cell]) / (grid[cell + 1] - grid[cell])
    return cell, np.clip(share, 0.0, 1.0)
