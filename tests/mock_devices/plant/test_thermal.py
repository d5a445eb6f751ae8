"""Temperatures, air and slow signals."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.plant.atmosphere import ppm
from mock_devices.plant.thermal import SENSORS, SlowSignal, Thermal
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings


def test_parts_start_cold_and_come_to_their_steady_values():
    for seed in range(10):
        thermal = Thermal(MockSettings(seed=seed))
        for name in SENSORS:
            start_c, late_c = thermal.part_c(name, 0.0), thermal.part_c(name, 6 * 900.0)
            assert 0.4 < late_c - start_c < 1.4
            assert 20.3 < late_c < 23.2


def test_sensors_are_off_by_some_five_millikelvin_and_read_the_same_at_the_same_time():
    thermal = Thermal(MockSettings(seed=2))
    times_s = np.linspace(0.0, 4000.0, 800)
    errors_k = [thermal.sensor_c("struts", t) - thermal.part_c("struts", t) for t in times_s]
    assert np.std(errors_k) == pytest.approx(0.005, rel=0.4)
    assert thermal.sensor_c("air", 10.0) == Thermal(MockSettings(seed=2)).sensor_c("air", 10.0)


def test_a_slow_signal_is_smooth_and_bounded():
    signal = SlowSignal(generator(1, "test"), 2.0, 100.0, 1000.0)
    values = np.array([signal.at(t) for t in np.arange(0.0, 5000.0)])
    assert np.abs(values).max() <= 2.0
    assert np.abs(np.diff(values)).max() <= 2.0 * 2.0 * np.pi / 100.0


def test_the_ppm_is_zero_in_the_reference_air_and_grows_a_part_per_kelvin():
    assert ppm(12.0, 1013.25, humidity=0.6) == pytest.approx(0.0, abs=0.3)
    assert ppm(21.0, 1013.25, humidity=0.6) - ppm(20.0, 1013.25, humidity=0.6) == pytest.approx(0.95, abs=0.1)
    assert ppm(20.0, 1000.0, wet_c=20.0) == pytest.approx(ppm(20.0, 1000.0, humidity=1.0), abs=1e-9)
