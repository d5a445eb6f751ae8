"""Figures of a campaign that was made for the formulae of a standard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from calibration.reduction.standard_figures import AxisFigures, PoseFigures


@dataclass(frozen=True)
class AxisResult:
    """Along one virtual axis with the formulae of ISO 230-2."""

    axis: str
    span_m: tuple[float, float]
    payload_kg: float
    figures: AxisFigures

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "standard": "ISO 230-2",
            "axis": self.axis,
            "from_m": self.span_m[0],
            "to_m": self.span_m[1],
            "payload_kg": self.payload_kg,
            **self.figures.as_dict(),
        }


@dataclass(frozen=True)
class PosesResult:
    """At several poses with the formulae of ISO 9283: the pose's target in m, and its figures."""

    payload_kg: float
    poses: tuple[tuple[tuple[float, float, float], PoseFigures], ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "standard": "ISO 9283",
            "payload_kg": self.payload_kg,
            "poses": [{"target_m": list(target), **figures.as_dict()} for target, figures in self.poses],
        }


StandardResult = AxisResult | PosesResult
