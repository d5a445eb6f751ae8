"""A diagnosis as plain data, and back as far as it is scored."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from calibration.diagnosis.result import Diagnosis

MOST_VISITS = 60
_ELSEWHERE = ("withheld", "visits", "spectra", "next_measurement")


def to_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain data; arrays go elsewhere. Of the proposals only the best one with visits has them written out."""
    fields = {f.name: getattr(diagnosis, f.name) for f in dataclasses.fields(diagnosis) if f.name not in _ELSEWHERE}
    out = {name: _plain(value) for name, value in fields.items()}
    ranked = sorted(diagnosis.next_measurement, key=lambda c: -c.gain_bit_per_min)
    first = next((k for k, c in enumerate(ranked) if c.visits), None)
    out["next_measurement"] = [
        {
            **_plain(dataclasses.replace(candidate, visits=())),
            "visits": [_plain(v) for v in candidate.visits[:MOST_VISITS]] if k == first else [],
        }
        for k, candidate in enumerate(ranked)
    ]
    return out


def proposed_visits(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """The visits of the best proposal that has any."""
    return next((c["visits"] for c in answer.get("next_measurement", []) if c["visits"]), [])


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "items"):
        return {str(k): _plain(v) for k, v in value.items()}
    return value
