"""Quantities of a certificate, as decimal texts with units of the D-SI: what is written is what is read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calibration.base.rounding import round_result
from pkm_rig.report.words import Language, word

MICROMETRE, MICRORADIAN = r"\micro\metre", r"\micro\radian"
PROBABILITY = "0.95"
MEASURED, OURS = "basic_measuredValue", "pkmrig_"  # marks of PTB's good practice, and what our own begin with


@dataclass(frozen=True)
class Quantity:
    """A quantity: value and expanded uncertainty as texts, unit of the D-SI, coverage factor.

    marks: what it is, for programs, whatever its name and language (`refType` of the DCC).
    """

    name: str
    value: str
    unit: str
    expanded: str | None = None
    coverage_factor: str | None = None
    marks: tuple[str, ...] = ()


def payload_quantities(data: Mapping[str, Any], language: Language) -> tuple[tuple[str, tuple[Quantity, ...]], ...]:
    """The results of each payload as found and as left, rounded by the GUM, U never down; and the noise floor."""
    k = data["coverage_factor"]
    out = []
    for payload in data["payloads"]:
        rows = [
            Quantity(
                word("payload", language), f"{payload['payload_kg']:g}", r"\kilogram", marks=(f"{OURS}payloadMass",)
            ),
            *_figures(payload["before"], word("before", language), language, k, f"{OURS}beforeAdjustment"),
            *_figures(payload["after"], word("after", language), language, k, f"{OURS}afterAdjustment"),
        ]
        if payload["limit_m"] is not None:
            limit = f"{payload['limit_m'] * 1e6:.10g}"
            rows.append(Quantity(word("limit", language), limit, MICROMETRE, marks=(f"{OURS}limit",)))
        out.append((f"{word('payload', language)}: {payload['name']}", tuple(rows)))
    floor = data["noise_floor_of_visits"]
    if floor is not None:
        name = word("noise_floor", language)
        marks = (MEASURED, f"{OURS}noiseFloor")
        out.append((name, (_with_u(name, floor["position_rms_m"], floor["u_position_rms_m"], MICROMETRE, k, marks),)))
    return tuple(out)


def _figures(
    figures: Mapping[str, float], when: str, language: Language, k: float, state: str
) -> tuple[Quantity, Quantity, Quantity]:
    position, turn = f"{word('position_error', language)}, {when}", f"{word('orientation_error', language)}, {when}"
    largest = f"{word('position_max', language)}, {when}"

    def marks(what: str) -> tuple[str, ...]:
        return MEASURED, f"{OURS}{what}", state

    return (
        _with_u(position, figures["position_rms_m"], figures["u_position_rms_m"], MICROMETRE, k, marks("positionRms")),
        Quantity(largest, f"{figures['position_max_m'] * 1e6:.1f}", MICROMETRE, marks=marks("positionMax")),
        _with_u(
            turn, figures["orientation_rms_rad"], figures["u_orientation_rms_rad"], MICRORADIAN, k, marks("rotationRms")
        ),
    )


def _with_u(name: str, value: float, u: float, unit: str, k: float, marks: tuple[str, ...]) -> Quantity:
    shown, expanded = round_result(value * 1e6, k * u * 1e6)
    return Quantity(name, shown, unit, expanded, f"{k:g}", marks)
