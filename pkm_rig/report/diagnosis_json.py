"""A diagnosis for programs (docs/reference/diagnosis.schema.json); in words: diagnosis_text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from calibration.diagnosis.result import KINDS, Candidate, Diagnosis, FoundEffect, GapFigures, Quantity, Share
from pkm_rig.results.attempt import Attempt

MOST_SHARES = 10


def diagnosis_json(found: Diagnosis, files: Mapping[str, str | None] | None = None) -> dict[str, Any]:
    """One object; a figure that is not finite is null. files: candidate's name to its campaign file."""
    files = files or {}
    where: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
    for share in found.where:
        where.setdefault(share.kind, {})[share.name] = _numbers(share=share.share, low=share.low, high=share.high)
    return {
        "campaign": found.campaign,
        "verdict": found.verdict,
        "equivalent": list(found.equivalent),
        "matters_m": _number(found.matters_m),
        "effects": [_effect_json(effect) for effect in found.effects],
        "ranking": {name: _number(p) for name, p in ranked(found)},
        "where": where,
        "gap": gap_json(found.gap),
        "next_measurement": [
            {
                "name": c.name,
                "adds": c.adds,
                "settles": list(c.settles),
                **_numbers(minutes=c.minutes, gain_bit=c.gain_bit, gain_bit_per_min=c.gain_bit_per_min),
                "visits": len(c.visits),
                "file": files.get(c.name),
            }
            for c in by_gain(found)
        ],
        "not_tested": dict(found.not_tested),
        "hidden_m": _number(found.hidden_m),
        "inside_geometry": _numbers(**found.inside_geometry),
        "clues": [{"channel": c.channel, "coordinate": c.coordinate, **_numbers(share=c.share)} for c in found.clues],
        "remarks": list(found.remarks),
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
        "place": effect.place,
        "quantity": effect.size.name,
        **_quantity_json(effect.size),
        **_numbers(
            probability=effect.probability,
            place_probability=effect.place_probability,
            raw_sigma=effect.raw_sigma,
            visible_sigma=effect.visible_sigma,
        ),
        "parameters": {q.name: _quantity_json(q) for q in effect.others},
    }


def _quantity_json(quantity: Quantity) -> dict[str, Any]:
    return {**_numbers(value=quantity.value, u=quantity.u), "unit": quantity.unit}


def _numbers(**values: float) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def ranked(found: Diagnosis) -> list[tuple[str, float]]:
    """Names with their probability, the most probable first."""
    return sorted(found.ranking.items(), key=lambda item: -item[1])


def strongest_shares(found: Diagnosis) -> list[Share]:
    """The largest shares, largest first."""
    return sorted(found.where, key=lambda s: -s.share)[:MOST_SHARES]


def by_gain(found: Diagnosis) -> list[Candidate]:
    """Candidates, the most telling a minute first."""
    return sorted(found.next_measurement, key=lambda c: -c.gain_bit_per_min)


def attempt_json(attempt: Attempt) -> dict[str, Any]:
    """The diagnosis within a calibration, or why there is none."""
    return {"failure": attempt.failure} if attempt.diagnosis is None else diagnosis_json(attempt.diagnosis)
