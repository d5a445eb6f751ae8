"""The air that the station corrects its distances for, kept up to date from the PLC's sensors."""

from __future__ import annotations

import math

from drivers.plc.plc_registers import PlcState
from drivers.station.atmosphere import atmospheric_ppm
from drivers.station.laser_tracker import LaserTracker
from pkm_rig.rig.clock import RigClock


class StationAir:
    """Sets the station's air anew when it was set more than `age_limit_s` of rig time ago or is off by `limit_ppm`.

    Setting it takes a few exchanges, so it is for whoever measures to say when: between two points, never during one.
    """

    def __init__(self, station: LaserTracker, clock: RigClock, age_limit_s: float, limit_ppm: float) -> None:
        self._station, self._clock = station, clock
        self._age_limit_s, self._limit_ppm = age_limit_s, limit_ppm
        self._set_s, self._set_ppm = -math.inf, math.nan

    def apply(self, state: PlcState) -> None:
        """Give this air to the station, whose other settings must be what they were.

        Raises SettingsChanged where they are not, and what the station raises.
        """
        self._set_s = -math.inf  # what the station holds is in doubt until it has answered
        self._station.require_settings()
        self._station.set_atmosphere(state.temperatures_c["air"], state.pressure_hpa, state.humidity)
        self._set_ppm, self._set_s = _deviation_ppm(state), self._clock.now_s()

    def apply_if_stale(self, state: PlcState) -> None:
        """`apply` where what the station holds is too old or too far from this air; else nothing is sent."""
        age_s = self._clock.now_s() - self._set_s
        fresh = 0.0 <= age_s <= self._age_limit_s  # a clock that went back tells nothing about ages
        if not (fresh and abs(_deviation_ppm(state) - self._set_ppm) <= self._limit_ppm):
            self.apply(state)


def _deviation_ppm(state: PlcState) -> float:
    return atmospheric_ppm(state.temperatures_c["air"], state.pressure_hpa, state.humidity)
