"""The air's effect on a distance in parts per million, by the formula in the stations' manuals (658 nm)."""

from __future__ import annotations

import math

_ABSOLUTE_ZERO_C = -273.15
_PSYCHROMETER_PER_K = 6.62e-4


def ppm(dry_c: float, pressure_hpa: float, *, humidity: float | None = None, wet_c: float | None = None) -> float:
    """Correction in ppm for dry temperature, pressure and either relative humidity (0 to 1) or wet bulb."""
    if humidity is None:
        humidity = 0.6 if wet_c is None else _humidity(dry_c, wet_c, pressure_hpa)
    expand = 1.0 - dry_c / _ABSOLUTE_ZERO_C
    vapour = 4.126e-4 * 100.0 * humidity * 10.0 ** (7.5 * dry_c / (237.3 + dry_c) + 0.7857)
    return 286.338 - (0.29535 * pressure_hpa - vapour) / expand


def _humidity(dry_c: float, wet_c: float, pressure_hpa: float) -> float:
    vapour_hpa = _saturation_hpa(wet_c) - _PSYCHROMETER_PER_K * pressure_hpa * (dry_c - wet_c)
    return min(max(vapour_hpa / _saturation_hpa(dry_c), 0.0), 1.0)


def _saturation_hpa(temperature_c: float) -> float:
    return 6.112 * math.exp(17.62 * temperature_c / (243.12 + temperature_c))
