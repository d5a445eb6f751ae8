"""A comparison of two campaigns for programs (docs/reference/comparison.schema.json)."""

from __future__ import annotations

import math
from typing import Any

from calibration.comparison.result import Comparison, FoundChange, WorkspaceChange


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """One object; a figure that is not finite is null. Pictures are added by who draws them."""
    return {
        "before": comparison.before,
        "after": comparison.after,
        "verdict": comparison.verdict,
        "place": comparison.place,
        "machine_changed": comparison.machine_changed,
        "equivalent": [{"structure": structure, "place": place} for structure, place in comparison.equivalent],
        "matters_sigma": _number(comparison.matters_sigma),
        "ranking": {name: _number(p) for name, p in by_probability(comparison)},
        "changes": [_change_json(change) for change in comparison.changes],
        "workspace": _workspace_json(comparison.workspace),
        "hidden_m": _number(comparison.hidden_m),
        "scatter": {"before": _number(comparison.scatter[0]), "after": _number(comparison.scatter[1])},
        "readings": {"before": comparison.readings[0], "after": comparison.readings[1]},
        "remarks": list(comparison.remarks),
        "pictures": {},
    }


def by_probability(comparison: Comparison) -> list[tuple[str, float]]:
    """Structures with their probability, the most probable first."""
    return sorted(comparison.ranking.items(), key=lambda item: -item[1])


def _change_json(change: FoundChange) -> dict[str, Any]:
    return {
        "structure": change.structure,
        "place": change.place,
        "of_machine": change.of_machine,
        "probability": _number(change.probability),
        "place_probability": _number(change.place_probability),
        "quantities": {
            q.name: {"value": _number(q.value), "u": _number(q.u), "unit": q.unit} for q in change.quantities
        },
        "raw_sigma": _number(change.raw_sigma),
        "visible_sigma": _number(change.visible_sigma),
        "workspace": _workspace_json(change.workspace),
    }


def _workspace_json(workspace: WorkspaceChange | None) -> dict[str, float | None] | None:
    if workspace is None:
        return None
    return {name: _number(getattr(workspace, name)) for name in ("rms_m", "u_rms_m", "max_m", "rest_rms_m")}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
