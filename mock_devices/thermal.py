"""Temperatures and air of the shop as closed-form functions of rig time, and what the PLC's sensors read.

Not modelled: heat from the drives, gradients within a part, doors that open.
"""

from __future__ import annotations

import math

import numpy as np

from mock_devices.seeds import generator
from mock_devices.settings import MockSettings

SENSORS = ("struts", "columns", "base", "platform")


class SlowSignal:
    """A few sines with seeded phases: smooth, bounded by `amplitude`, the same at the same time."""

    def __init__(
        self, rng: np.random.Generator, amplitude: float, shortest_s: float, longest_s: float, *, count: int = 3
    ) -> None:
        weights = rng.uniform(0.5, 1.0, count)
        self._amplitudes = [float(amplitude * w / weights.sum()) for w in weights]
        periods = np.exp(rng.uniform(math.log(shortest_s), math.log(longest_s), count))
        self._rates = [float(2.0 * math.pi / period) for period in periods]
        self._phases = [float(phase) for phase in rng.uniform(0.0, 2.0 * math.pi, count)]

    def at(self, t_s: float) -> float:
        """Value at rig time `t_s`."""
        terms = zip(self._amplitudes, self._rates, self._phases, strict=True)
        return sum(a * math.sin(w * t_s + phase) for a, w, phase in terms)


class Thermal:
    """True temperatures of the parts (keys of SENSORS) and of the air; pressure and humidity of the air."""

    def __init__(self, settings: MockSettings) -> None:
        rng = generator(settings.seed, "thermal")
        self._tau_s = settings.warm_up_time_constant_s
        self._steady_c = {name: float(rng.uniform(20.5, 23.0)) for name in SENSORS}
        self._gap_k = {name: float(rng.uniform(0.6, 1.2)) for name in SENSORS}
        self._wander = {name: SlowSignal(rng, 0.05, 3600.0, 14400.0) for name in SENSORS}
        self._air_c = settings.air_temperature_c
        self._air_wander = SlowSignal(rng, 0.3, 1800.0, 10800.0)
        self._pressure_hpa = float(rng.uniform(960.0, 1015.0))
        self._pressure_wander = SlowSignal(rng, 0.4, 7200.0, 21600.0)
        self._humidity = float(rng.uniform(0.35, 0.55))
        noise = generator(settings.seed, "temperature sensors")
        # A sine of random phase with amplitude a has the standard deviation a / sqrt(2); three of them add up.
        amplitude = settings.temperature_sensor_sd_k * math.sqrt(2.0 * 3.0)
        self._sensor_noise = {name: SlowSignal(noise, amplitude, 40.0, 400.0) for name in (*SENSORS, "air")}

    def part_c(self, name: str, t_s: float) -> float:
        """True temperature of a part."""
        warming = self._gap_k[name] * math.exp(-max(t_s, 0.0) / self._tau_s)
        return self._steady_c[name] - warming + self._wander[name].at(t_s)

    def parts_c(self, t_s: float) -> dict[str, float]:
        """True temperatures of all parts."""
        return {name: self.part_c(name, t_s) for name in SENSORS}

    def air_c(self, t_s: float) -> float:
        """True temperature of the air."""
        return self._air_c + self._air_wander.at(t_s)

    def pressure_hpa(self, t_s: float) -> float:
        """Air pressure."""
        return self._pressure_hpa + self._pressure_wander.at(t_s)

    def humidity(self) -> float:
        """Relative humidity, 0 to 1."""
        return self._humidity

    def sensor_c(self, name: str, t_s: float) -> float:
        """What a sensor reads: `air` or one of SENSORS, with its noise."""
        true_c = self.air_c(t_s) if name == "air" else self.part_c(name, t_s)
        return true_c + self._sensor_noise[name].at(t_s)
