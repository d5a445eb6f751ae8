"""The uncertainty budget of a figure: what its standard uncertainty consists of (GUM, JCGM 100:2008, clause 8)."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from calibration.reduction.figures import figure_axes, rms_and_u, scale_part, setup_part
from calibration.reduction.reduction import Reduction


@dataclass(frozen=True)
class BudgetEntry:
    """One input quantity: estimate and standard uncertainty u in `unit`, sensitivity, and what it adds to the result.

    degrees_of_freedom None: infinitely many. contribution_m: |sensitivity| times u; share: of the result's variance.
    """

    quantity: Literal["scatter", "scale", "setups"]
    estimate: float
    u: float
    unit: str
    distribution: Literal["normal"]
    type: Literal["A", "B"]
    degrees_of_freedom: int | None
    sensitivity: float
    contribution_m: float
    share: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Budget:
    """The parts of the standard uncertainty u_m of an RMS position error, and its effective degrees of freedom.

    effective_degrees_of_freedom by Welch and Satterthwaite (GUM, G.4.1); None: infinitely many.
    """

    entries: tuple[BudgetEntry, ...]
    u_m: float
    effective_degrees_of_freedom: float | None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "entries": [entry.as_dict() for entry in self.entries],
            "u_m": self.u_m,
            "effective_degrees_of_freedom": self.effective_degrees_of_freedom,
        }


def position_budget(reduction: Reduction, phase: str, payload: int) -> Budget:
    """The budget of the RMS position error of one phase at one payload; the same parts as in `figures.visit_figures`.

    The poses' scatter (noise, and which poses were drawn) is of type A, n - 1 degrees of freedom; the station's scale,
    by its certificate and the certified length, and what is not known of the motions between set-ups, by the stated
    accuracy of their common points, are of type B. Raises ValueError where nothing was measured.
    """
    rows = reduction.rows(phase, payload)
    if not np.any(rows):
        raise ValueError(f"no pose of {phase} at payload {payload}")
    moves, _ = figure_axes(reduction.recording.machine)
    rms, u_rms = rms_and_u(np.sum(reduction.errors(rows)[0][:, moves] ** 2, axis=1))
    scale_u, reach_m = scale_part(reduction, rows)
    parts = [
        ("scatter", rms, u_rms, "m", "A", int(np.count_nonzero(rows)) - 1, 1.0),
        ("scale", 0.0, scale_u, "1", "B", None, reach_m),
    ]
    if len(reduction.setups) > 1:
        parts.append(("setups", 0.0, setup_part(reduction, rows), "m", "B", None, 1.0))
    variance = sum((part[2] * part[6]) ** 2 for part in parts)
    entries = tuple(
        BudgetEntry(
            quantity=quantity,  # type: ignore[arg-type]
            estimate=estimate,
            u=u,
            unit=unit,
            distribution="normal",
            type=kind,  # type: ignore[arg-type]
            degrees_of_freedom=freedom,
            sensitivity=sensitivity,
            contribution_m=u * sensitivity,
            share=(u * sensitivity) ** 2 / variance if variance > 0.0 else 0.0,
        )
        for quantity, estimate, u, unit, kind, freedom, sensitivity in parts
    )
    return Budget(entries, math.sqrt(variance), _effective_degrees(entries, variance))


def _effective_degrees(entries: tuple[BudgetEntry, ...], variance: float) -> float | None:
    by_parts = sum(e.contribution_m**4 / e.degrees_of_freedom for e in entries if e.degrees_of_freedom)
    return variance**2 / by_parts if by_parts > 0.0 else None
