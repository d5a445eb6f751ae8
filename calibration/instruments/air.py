"""The air through which a station measures."""

from __future__ import annotations

from calibration.base.arrays import Array

REFRACTIVITY = 2.818e-4  # of visible light in dry air at 15 degC and 1013.25 hPa, as stations assume it
STANDARD_K, STANDARD_HPA, ZERO_K = 288.15, 1013.25, 273.15


def refractivity(temperature_c: Array, pressure_hpa: Array | float = STANDARD_HPA) -> Array:
    """Refractive index of dry air less one, in proportion to its density (Gladstone and Dale).

    -0.93e-6 a kelvin and 0.28e-6 a hectopascal in a workshop; its moisture adds less than 0.5e-6.
    """
    return REFRACTIVITY * (pressure_hpa / STANDARD_HPA) * STANDARD_K / (ZERO_K + temperature_c)
