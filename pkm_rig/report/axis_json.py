"""The diagnosis of one axis for programs (docs/reference/axis-diagnosis.schema.json)."""

from __future__ import annotations

import math
from typing import Any

from calibration.axis.result import AxisDiagnosis, AxisEffectFound
from calibration.diagnosis.result import Quantity


def axis_json(diagnosis: AxisDiagnosis) -> dict[str, Any]:
    """One object; a figure that is not finite is null."""
    gap = diagnosis.gap
    delay = diagnosis.following_delay
    return {
        "recording": diagnosis.recording,
        "simulated": diagnosis.simulated,
        "unit": diagnosis.unit,
        "verdict": diagnosis.verdict,
        "equivalent": list(diagnosis.equivalent),
        "matters": _number(diagnosis.matters),
        "effects": [_effect_json(effect) for effect in diagnosis.effects],
        "ranking": dict(sorted(diagnosis.ranking.items(), key=lambda item: -item[1])),
        "gap": {
            "before": _number(gap.before),
            "after": _number(gap.after),
            "noise_floor": _number(gap.noise_floor),
            "shrink": _number(gap.shrink),
            "shrink_interval": [_number(end) for end in gap.shrink_interval],
            "withheld": gap.withheld,
        },
        "not_tested": dict(diagnosis.not_tested),
        "hidden": _number(diagnosis.hidden),
        "clues": [{"coordinate": name, "share": _number(share)} for name, share in diagnosis.clues.items()],
        "following_delay": None if delay is None else _quantity_json(delay),
        "noise": {
            "frequency_hz": [_number(float(x)) for x in diagnosis.frequency_hz],
            "density_per_sqrt_hz": [_number(float(x)) for x in diagnosis.noise],
        },
        "remarks": list(diagnosis.remarks),
        "left_out": [
            {
                "time_s": _number(wrong.time_s),
                "samples": wrong.count,
                "position": "motor" if wrong.of_motor else "second",
                "off": _number(wrong.off),
            }
            for wrong in diagnosis.left_out
        ],
    }


def _effect_json(effect: AxisEffectFound) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        "quantity": effect.size.name,
        **_quantity_json(effect.size),
        "probability": _number(effect.probability),
        "contribution": _number(effect.contribution),
        "parameters": {q.name: _quantity_json(q) for q in effect.others},
    }


def _quantity_json(quantity: Quantity) -> dict[str, Any]:
    return {"value": _number(quantity.value), "u": _number(quantity.u), "unit": quantity.unit}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
