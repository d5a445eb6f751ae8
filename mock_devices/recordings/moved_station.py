"""A station that is set up anew during a recording: another place and direction, levelled anew, drifting anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mock_devices.effects.base import Array
from mock_devices.plant.optics import StationView, rotation
from mock_devices.plant.thermal import SlowSignal
from mock_devices.recordings.design import StationMove
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings

_LEVEL_HALF_WIDTH_RAD = 20.0e-6


class MovedStation(StationView):
    """The station of a seed, and where it stands after each of its moves; constant and scale of its ranges stay."""

    def __init__(self, settings: MockSettings, moved_s: Sequence[float], moves: Sequence[StationMove]) -> None:
        super().__init__(settings)
        self._moved_s = np.array(moved_s)
        self._frames = [(self.rotation, self.translation_m)]
        self._drifts: list[list[_DriftSince]] = []
        wobble = settings.instrument
        amplitudes = [wobble.drift_of_level_rad] * 2 + [wobble.drift_about_vertical_rad] + [wobble.drift_m] * 3
        for number, (at_s, move) in enumerate(zip(moved_s, moves, strict=True)):
            turn, origin = self._frames[-1][0], -self._frames[-1][0].T @ self._frames[-1][1]
            rng = generator(settings.seed, "station set up anew", number)
            level = rng.uniform(-_LEVEL_HALF_WIDTH_RAD, _LEVEL_HALF_WIDTH_RAD, 2)
            turn = rotation(np.array([*level, 0.0])) @ rotation(np.array([0.0, 0.0, move.turn_rad])) @ turn
            self._frames.append((turn, -turn @ (origin + np.array(move.by_m))))
            self._drifts.append([_DriftSince(rng, amplitude, at_s) for amplitude in amplitudes])

    def drift_free_series(self, places_m: Array, t_s: Array) -> Array:
        """Points of the machine frame at times (n,), (n, k, 3), in the frame of the set-up without its drift."""
        setup = np.searchsorted(self._moved_s, t_s)
        turn = np.array([frame[0] for frame in self._frames])[setup]
        shift = np.array([frame[1] for frame in self._frames])[setup]
        return np.asarray(places_m @ turn.transpose(0, 2, 1) + shift[:, None, :])

    def drift_series(self, t_s: Array) -> tuple[Array, Array]:
        """Small rotation and shift of what is seen at times (n,): (n, 3) each, frame of the set-up."""
        turns, shifts = super().drift_series(t_s)
        setup = np.searchsorted(self._moved_s, t_s)
        for number, drift in enumerate(self._drifts, start=1):
            own = setup == number
            values = np.stack([signal.series(t_s[own]) for signal in drift], axis=1)
            turns[own], shifts[own] = values[:, :3], values[:, 3:]
        return turns, shifts


class _DriftSince:
    """A slow signal that is zero when the station is set up."""

    def __init__(self, rng: np.random.Generator, amplitude: float, start_s: float) -> None:
        self._signal = SlowSignal(rng, amplitude, 5400.0, 28800.0)
        self._start = self._signal.at(start_s)

    def series(self, t_s: Array) -> Array:
        return np.asarray(self._signal.series(t_s) - self._start)
