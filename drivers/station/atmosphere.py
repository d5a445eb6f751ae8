"""Refraction of air as a total station corrects it."""

from __future__ import annotations

import math

_REFERENCE_PPM = 286.338  # group refractivity of the reference atmosphere, carrier 658 nm
_PRESSURE_FACTOR = 0.29535
_VAPOUR_FACTOR = 4.126e-4
_PSYCHROMETER_PER_K = 6.62e-4


def atmospheric_ppm(temperature_c: float, pressure_hpa: float, humidity: float) -> float:
    """Correction in ppm that the station adds to a distance; `humidity` is relative, 0 to 1.

    The formula of the instruments' manuals for a visible carrier of 658 nm; 0 at about 12 degC and 1013 hPa.
    """
    warming = 1.0 + temperature_c / 273.15
    exponent = 7.5 * temperature_c / (237.3 + temperature_c) + 0.7857
    dry = _PRESSURE_FACTOR * pressure_hpa / warming
    wet = _VAPOUR_FACTOR * 100.0 * humidity / warming * 10.0**exponent
    return float(_REFERENCE_PPM - (dry - wet))


def vapour_pressure_hpa(temperature_c: float) -> float:
    """Saturation pressure of water vapour in hPa (Magnus)."""
    return 6.112 * math.exp(17.62 * temperature_c / (243.12 + temperature_c))


def wet_bulb_c(temperature_c: float, pressure_hpa: float, humidity: float) -> float:
    """Wet-bulb temperature in degC by bisection of the psychrometer equation; `humidity` 0 to 1."""
    vapour_hpa = humidity * vapour_pressure_hpa(temperature_c)
    low_c, high_c = temperature_c - 60.0, temperature_c
    for _ in range(60):
        middle_c = 0.5 * (low_c + high_c)
        cooling_hpa = _PSYCHROMETER_PER_K * pressure_hpa * (temperature_c - middle_c)
        if vapour_pressure_hpa(middle_c) - cooling_hpa < vapour_hpa:
            low_c = middle_c
        else:
            high_c = middle_c
    return 0.5 * (low_c + high_c)
