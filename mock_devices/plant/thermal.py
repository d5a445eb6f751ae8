"""Temperatures and air of the shop as closed-form functions of rig time, and what the PLC's sensors read.

Not modelled: heat from the drives, gradients within a part, doors that open.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mock_devices.seeds import generator
from mock_devices.settings import MockSettings

SENSORS = ("struts", "columns", "base", "platform")
_FOLLOW_S = {"struts": 900.0, "columns": 2400.0, "base": 5400.0, "platform": 1500.0, "air": 60.0}
_GRID_S = 30.0


class SlowSignal:
    """A few sines with seeded phases: smooth, bounded by `amplitude`, the same at the same time."""

    def __init__(
        self, rng: np.random.Generator, amplitude: float, shortest_s: float, longest_s: float, *, count: int = 3
    ) -> None:
        weights = rng.uniform(0.5, 1.0, count)
        amplitudes = [float(amplitude * w / weights.sum()) for w in weights]
        periods = np.exp(rng.uniform(math.log(shortest_s), math.log(longest_s), count))
        rates = [float(2.0 * math.pi / period) for period in periods]
        phases = [float(phase) for phase in rng.uniform(0.0, 2.0 * math.pi, count)]
        self._terms = tuple(zip(amplitudes, rates, phases, strict=True))

    def at(self, t_s: float) -> float:
        """Value at rig time `t_s`."""
        value = 0.0
        for amplitude, rate, phase in self._terms:
            value += amplitude * math.sin(rate * t_s + phase)
        return value

    def series(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at several times (n,)."""
        return np.asarray(sum(a * np.sin(w * t_s + phase) for a, w, phase in self._terms))


class Thermal:
    """True temperatures of the parts (keys of SENSORS) and of the air; pressure and humidity of the air."""

    def __init__(self, settings: MockSettings) -> None:
        rng = generator(settings.seed, "thermal")
        varies = 0.0 if settings.steady_temperatures else 1.0
        self._tau_s = settings.warm_up_time_constant_s
        self._steady_c = {name: float(rng.uniform(20.5, 23.0)) for name in SENSORS}
        self._gap_k = {name: varies * float(rng.uniform(0.6, 1.2)) for name in SENSORS}
        self._wander = {name: SlowSignal(rng, varies * 0.05, 3600.0, 14400.0) for name in SENSORS}
        self._air_c = settings.air_temperature_c
        self._air_wander = SlowSignal(rng, varies * 0.3, 1800.0, 10800.0)
        self._pressure_hpa = float(rng.uniform(960.0, 1015.0))
        self._pressure_wander = SlowSignal(rng, varies * 0.4, 7200.0, 21600.0)
        self._humidity = float(rng.uniform(0.35, 0.55))
        noise = generator(settings.seed, "temperature sensors")
        # A sine of random phase with amplitude a has the standard deviation a / sqrt(2); three of them add up.
        amplitude = varies * settings.temperature_sensor_sd_k * math.sqrt(2.0 * 3.0)
        self._sensor_noise = {name: SlowSignal(noise, amplitude, 40.0, 400.0) for name in (*SENSORS, "air")}
        bias = generator(settings.seed, "temperature sensor bias")
        self._bias_k = {
            name: settings.temperature_sensor_bias_k * float(bias.standard_normal()) for name in (*SENSORS, "air")
        }
        self._programme = _Programme(settings.temperature_programme) if settings.temperature_programme else None
        self._heated_k = dict.fromkeys((*SENSORS, "air"), 0.0)

    def heat(self, name: str, by_k: float) -> None:
        """Make the air or a part warmer from now on, at once; its sensor shows it. Raises ValueError without such."""
        if name not in self._heated_k:
            raise ValueError(f"there is no '{name}'; there are {', '.join(self._heated_k)}")
        self._heated_k[name] += by_k

    def part_c(self, name: str, t_s: float) -> float:
        """True temperature of a part."""
        warming = self._gap_k[name] * math.exp(-max(t_s, 0.0) / self._tau_s)
        ordinary_c = self._steady_c[name] - warming + self._wander[name].at(t_s) + self._heated_k[name]
        return ordinary_c if self._programme is None else ordinary_c + self._programme.at(name, t_s)

    def part_series_c(self, name: str, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """True temperature of a part at several times (n,)."""
        warming = self._gap_k[name] * np.exp(-np.maximum(t_s, 0.0) / self._tau_s)
        ordinary_c = self._steady_c[name] - warming + self._wander[name].series(t_s) + self._heated_k[name]
        return ordinary_c if self._programme is None else ordinary_c + self._programme.series(name, t_s)

    def parts_c(self, t_s: float) -> dict[str, float]:
        """True temperatures of all parts."""
        return {name: self.part_c(name, t_s) for name in SENSORS}

    def air_c(self, t_s: float) -> float:
        """True temperature of the air."""
        ordinary_c = self._air_c + self._air_wander.at(t_s) + self._heated_k["air"]
        return ordinary_c if self._programme is None else ordinary_c + self._programme.at("air", t_s)

    def air_series_c(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """True temperature of the air at several times (n,)."""
        ordinary_c = self._air_c + self._air_wander.series(t_s) + self._heated_k["air"]
        return ordinary_c if self._programme is None else ordinary_c + self._programme.series("air", t_s)

    def pressure_hpa(self, t_s: float) -> float:
        """Air pressure."""
        return self._pressure_hpa + self._pressure_wander.at(t_s)

    def humidity(self) -> float:
        """Relative humidity, 0 to 1."""
        return self._humidity

    def sensor_c(self, name: str, t_s: float) -> float:
        """What a sensor reads: `air` or one of SENSORS, with its noise."""
        true_c = self.air_c(t_s) if name == "air" else self.part_c(name, t_s)
        return true_c + self._sensor_noise[name].at(t_s) + self._bias_k[name]

    def sensor_series_c(self, name: str, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """What a sensor reads at several times (n,)."""
        true_c = self.air_series_c(t_s) if name == "air" else self.part_series_c(name, t_s)
        return true_c + self._sensor_noise[name].series(t_s) + self._bias_k[name]

    def pressure_series_hpa(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Air pressure at several times (n,)."""
        return self._pressure_hpa + self._pressure_wander.series(t_s)


class _Programme:
    """A swing of the shop's temperature, straight between its corners, that parts follow with their time constants."""

    def __init__(self, corners: tuple[tuple[float, float], ...]) -> None:
        times, values = (np.array(column, dtype=np.float64) for column in zip(*corners, strict=True))
        self._times = np.arange(times[0], times[-1] + 8.0 * 3600.0, _GRID_S)
        shop = np.interp(self._times, times, values)
        self._parts = {}
        for name, tau_s in _FOLLOW_S.items():
            keep = math.exp(-_GRID_S / tau_s)
            part, value = np.empty_like(shop), shop[0]
            for i, now in enumerate(shop.tolist()):
                value = now + (value - now) * keep
                part[i] = value
            self._parts[name] = part

    def at(self, name: str, t_s: float) -> float:
        return float(np.interp(t_s, self._times, self._parts[name]))

    def series(self, name: str, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(t_s, self._times, self._parts[name]))
