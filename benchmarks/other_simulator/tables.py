"""Compensation tables that a recording states as known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import Machine
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KnownTable:
    """A table of one drive, its largest correction 1; partner: a drive that it depends on as well, None for none.

    own_m (a,), partner_m (b,), nodes; corrections (a, b), with b = 1 without a partner.
    """

    generation: int
    drive: int
    own_m: Array
    partner: int | None
    partner_m: Array
    corrections: Array

    def at(self, rows: Rows) -> Array:
        """Corrections at the readings (r,): bilinear between nodes, held at the edge beyond them."""
        values = self.corrections
        a, w = _between(self.own_m, rows.commanded_m[:, self.drive])
        if self.partner is None:
            return np.asarray((1 - w) * values[a, 0] + w * values[a + 1, 0])
        b, v = _between(self.partner_m, rows.commanded_m[:, self.partner])
        return np.asarray(
            (1 - w) * (1 - v) * values[a, b]
            + w * (1 - v) * values[a + 1, b]
            + (1 - w) * v * values[a, b + 1]
            + w * v * values[a + 1, b + 1]
        )

    def stated(self, machine: Machine, largest_m: float) -> dict[str, Any]:
        """The table as a recording's header states it."""
        partner: dict[str, Any] = {}
        if self.partner is not None:
            partner = {"partner": machine.drives[self.partner], "partner_m": self.partner_m.tolist()}
        corrections = [[round(float(value), 9) for value in row] for row in self.corrections * largest_m]
        return {
            "generation": self.generation, "drive": machine.drives[self.drive], "own_m": self.own_m.tolist(),
            **partner, "corrections_m": corrections,
        }  # fmt: skip


def draw_tables(machine: Machine, rng: np.random.Generator) -> list[KnownTable]:
    """One or two generations with a table a drive, of one or of two coordinates; smooth with some noise."""
    out = []
    for generation in range(1, int(rng.integers(2, 4))):
        with_partner = rng.random() < 0.5
        for drive in range(len(machine.drives)):
            own_m = _nodes(machine, drive, int(rng.integers(6, 11)))
            x, c, y = np.linspace(-1, 1, len(own_m)), rng.normal(size=4), np.zeros(1)
            partner, partner_m = None, np.zeros(0)
            if with_partner:
                partner = (drive + 1) % len(machine.drives)
                partner_m = _nodes(machine, partner, int(rng.integers(3, 6)))
                y = np.linspace(-1, 1, len(partner_m))
            own, other = np.meshgrid(x, y, indexing="ij")
            values = (
                c[0] * own**2 + c[1] * 0.6 * np.sin(2.5 * own + c[2]) + c[3] * (own * other + 0.5 * other**2)
                + 0.15 * rng.normal(size=own.shape)
            )  # fmt: skip
            values = values - values.mean()
            out.append(KnownTable(generation, drive, own_m, partner, partner_m, values / np.abs(values).max()))
    return out


def newest(tables: Sequence[KnownTable]) -> list[KnownTable]:
    """The tables of the last generation."""
    last = max(table.generation for table in tables)
    return [table for table in tables if table.generation == last]


def oldest(tables: Sequence[KnownTable]) -> list[KnownTable]:
    """The tables of the first generation."""
    return [table for table in tables if table.generation == 1]


def corrections_of(tables: Sequence[KnownTable], rows: Rows) -> Array:
    """What tables add to the drives (r, d)."""
    out = np.zeros_like(rows.commanded_m)
    for table in tables:
        out[:, table.drive] += table.at(rows)
    return out


def _nodes(machine: Machine, drive: int, count: int) -> Array:
    low, high = machine.travel_m[drive]
    return np.round(np.linspace(float(low), float(high), count), 4)


def _between(nodes: Array, x: Array) -> tuple[NDArray[np.intp], Array]:
    """The node below x (r,) and the share of the way to the next one."""
    held = np.clip(x, nodes[0], nodes[-1])
    below = np.clip(np.searchsorted(nodes, held, "right") - 1, 0, len(nodes) - 2)
    return below, (held - nodes[below]) / (nodes[below + 1] - nodes[below])
