"""A diagnosis for programs (docs/reference/diagnosis.schema.json); in words: diagnosis_text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from calibration.diagnosis.result import (
    KINDS,
    CampaignAddition,
    Diagnosis,
    FoundEffect,
    FoundPlace,
    GapFigures,
    Quantity,
    Share,
)
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt

MOST_SHARES = 10


def diagnosis_json(diagnosis: Diagnosis, files: Mapping[str, str | None] | None = None) -> dict[str, Any]:
    """One object; a figure that is not finite is null. files: candidate's name to its campaign file."""
    files = files or {}
    where: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
    for share in diagnosis.where:
        where.setdefault(share.kind, {})[share.name] = _numbers(share=share.share, low=share.low, high=share.high)
    return {
        "campaign": diagnosis.campaign,
        "verdict": diagnosis.verdict,
        "equivalent": list(diagnosis.equivalent),
        "matters_m": _number(diagnosis.matters_m),
        "effects": [_effect_json(effect) for effect in diagnosis.effects],
        "ranking": {name: _number(p) for name, p in ranking_by_probability(diagnosis)},
        "where": where,
        "gap": gap_json(diagnosis.gap),
        "next_measurement": [
            {
                "name": c.name,
                "adds": c.adds,
                "settles": list(c.settles),
                **_numbers(minutes=c.minutes, gain_bit=c.gain_bit, gain_bit_per_min=c.gain_bit_per_min),
                "visits": len(c.visits),
                "file": files.get(c.name),
            }
            for c in additions_by_gain(diagnosis)
        ],
        "not_tested": dict(diagnosis.not_tested),
        "hidden_m": _number(diagnosis.hidden_m),
        "inside_geometry": _numbers(**diagnosis.inside_geometry),
        "clues": [
            {"channel": c.channel, "coordinate": c.coordinate, **_numbers(share=c.share)} for c in diagnosis.clues
        ],
        "remarks": list(diagnosis.remarks),
        "left_out": [reading.as_dict() for reading in diagnosis.left_out],
        "pictures": {},
        "twin": None,
    }


def gap_json(gap: GapFigures) -> dict[str, Any]:
    """The figures on withheld data."""
    return {
        **_numbers(before_m=gap.before_m, after_m=gap.after_m, noise_floor_m=gap.noise_floor_m, shrink=gap.shrink),
        "shrink_interval": [_number(end) for end in gap.shrink_interval],
        "withheld": gap.withheld,
    }


def _effect_json(effect: FoundEffect) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        **_place_json(effect),
        "quantity": effect.size.name,
        **_numbers(probability=effect.probability, place_probability=effect.place_probability),
        "places": [
            {
                **_place_json(place),
                **_numbers(probability=place.probability),
                "at_channels": {q.name: _quantity_json(q) for q in place.at_channels},
            }
            for place in effect.places
        ],
    }


def _place_json(found: FoundEffect | FoundPlace) -> dict[str, Any]:
    return {
        "place": found.place,
        **_quantity_json(found.size),
        **_numbers(raw_sigma=found.raw_sigma, visible_sigma=found.visible_sigma),
        "parameters": {q.name: _quantity_json(q) for q in found.others},
        "differs_with": list(found.differs_with),
        "aliases_m": list(found.aliases),
    }


def _quantity_json(quantity: Quantity) -> dict[str, Any]:
    return {**_numbers(value=quantity.value, u=quantity.u), "unit": quantity.unit}


def _numbers(**values: float) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def ranking_by_probability(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Names with their probability, the most probable first."""
    return sorted(diagnosis.ranking.items(), key=lambda item: -item[1])


def largest_shares(diagnosis: Diagnosis) -> list[Share]:
    """The largest shares, largest first."""
    return sorted(diagnosis.where, key=lambda s: -s.share)[:MOST_SHARES]


def additions_by_gain(diagnosis: Diagnosis) -> list[CampaignAddition]:
    """Additions to the campaign, the largest information per minute first."""
    return sorted(diagnosis.next_measurement, key=lambda c: -c.gain_bit_per_min)


def diagnosis_attempt_json(attempt: DiagnosisAttempt) -> dict[str, Any]:
    """The diagnosis within a calibration, or why there is none."""
    return {"failure": attempt.failure} if attempt.diagnosis is None else diagnosis_json(attempt.diagnosis)
