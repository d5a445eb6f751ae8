"""A screw that warms and cools along a course which no formula of the catalogue has."""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.diagnose import diagnose
from tests.calibration.diagnosis.campaigns import Arrivals, simulated

EXPANSION_PER_K, SWING_K = 12e-6, 8.0


def test_a_screw_that_warms_and_cools_is_named():
    """Over three quarters of a swing; its size is by how much a straight line through that course rises."""

    def grown(arrivals: Arrivals) -> np.ndarray:
        off, x = np.zeros_like(arrivals.drives), arrivals.drives[:, 0]
        rise_k = SWING_K * np.sin(1.5 * np.pi * np.linspace(0.0, 1.0, len(x)))
        off[:, 0] = EXPANSION_PER_K * rise_k * (x - np.mean(x))
        return off

    found = diagnose(simulated("planar4", 90, grown))
    assert found.verdict == "screw_thermal_growth"
    (place,) = found.effects[0].places
    assert place.place == "left"
    t = np.linspace(0.0, 1.0, 1000)
    rise_k = np.polyfit(t, SWING_K * np.sin(1.5 * np.pi * t), 1)[0]
    assert abs(place.size.value - rise_k) < 2.0 * place.size.u
