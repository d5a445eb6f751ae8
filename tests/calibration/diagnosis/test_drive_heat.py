"""A screw that its drive heats: by friction at the torque that it had on its way, or by the losses of its motor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose
from tests.calibration.diagnosis.campaigns import Arrivals, changed, simulated

EXPANSION_PER_K, RISE_K, TAU_S = 12e-6, 24.0, 450.0
WORK = np.repeat([0.1, 0.7, 0.1, 0.6, 0.2, 0.8, 0.1, 0.7], [9, 7, 14, 8, 12, 9, 16, 15])  # torque at each visit


def friction(torque: np.ndarray, arrivals: Arrivals, lasted_s: np.ndarray) -> np.ndarray:
    return np.abs(torque) * arrivals.travelled_m[:, 0] / lasted_s


def losses(torque: np.ndarray, arrivals: Arrivals, lasted_s: np.ndarray) -> np.ndarray:
    return torque**2


@pytest.mark.parametrize("power", [friction, losses])
def test_a_screw_that_is_heated_by_its_drive_s_torque_is_named(power: Callable[..., np.ndarray]):
    """It warms and cools several times, as no function of time or way does that the catalogue has."""

    def grown(arrivals: Arrivals) -> np.ndarray:
        off, x = np.zeros_like(arrivals.drives), arrivals.drives[:, 0]
        lasted_s = arrivals.dwell_s + 20.0
        warm, course = 0.0, []
        for heat, seconds in zip(power(WORK, arrivals, lasted_s).tolist(), lasted_s.tolist(), strict=True):
            warm = heat + (warm - heat) * np.exp(-seconds / TAU_S)
            course.append(warm)
        off[:, 0] = EXPANSION_PER_K * RISE_K * (x - np.mean(x)) * np.array(course) / np.ptp(course)
        return off

    recording = simulated("planar4", len(WORK), grown)
    recording = changed(recording, left_torque_ratio=WORK[recording["visit"].astype(int)])
    found = diagnose(recording)
    assert found.verdict == "screw_thermal_growth"
    (place,) = found.effects[0].places
    assert place.place == "left"
    assert abs(place.size.value - RISE_K) < 0.4 * RISE_K
    assert found.gap.shrink > 0.6
