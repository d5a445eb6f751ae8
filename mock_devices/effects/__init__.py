"""Physics that a calibrated model leaves out, for the mock plant (docs/reference/mock-effects.md).

Written apart from any catalogue that a diagnosis uses: forms differ on purpose.
"""

from mock_devices.effects.base import EffectChoice, EffectParameter, EffectSpec
from mock_devices.effects.catalogue import (
    CATALOGUE,
    GEOMETRY,
    OUTSIDE,
    OUTSIDE_FINAL,
    SPECS,
    EffectError,
    draw,
    parse,
)

__all__ = [
    "CATALOGUE",
    "GEOMETRY",
    "OUTSIDE",
    "OUTSIDE_FINAL",
    "SPECS",
    "EffectChoice",
    "EffectError",
    "EffectParameter",
    "EffectSpec",
    "draw",
    "parse",
]
