"""A running twin: converts the current state of the mock drives into the reading contexts of the twin's effects.

Independent of the mocks: the server of the twin (`mock_rig`) supplies the drive positions. As in a recording, an
arrival is a stop at which something was measured. Not modelled: torque beyond the weight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.context import ArrivalHistory, ReadingContext
from calibration.instruments.air import refractivity

PAST_ROWS = 24  # earlier temperatures that parts which follow slowly are given


class ReflectorModel(Protocol):
    """What a twin provides."""

    def places_m(self, context: ReadingContext, rows: NDArray[np.intp]) -> Array:
        """All reflectors (n, smrs, 3) in the machine's frame, in the order of the machine file, at rows (n,)."""
        ...


@dataclass(frozen=True)
class InstantState:
    """The machine as it is at one instant; d drives.

    drives_m, velocity_m_per_s, direction, torque (d,): as in `ReadingContext`; speed_after: highest speed in m/s of the
    motions that began after a time; arrived_s: when the last motion ended (or will end, while `moving`).
    """

    t_s: float
    drives_m: Array
    velocity_m_per_s: Array
    direction: Array
    torque: Array
    highest_speed_since: Callable[[float], float]
    arrived_s: float
    moving: bool
    payload_kg: float
    payload_com_m: tuple[float, float, float]
    exchanges: int


class RunningTwin:
    """A twin and what its drives have done so far. Not thread-safe: the caller must lock.

    temperatures_c: reading of a sensor at several times (n,), by the sensor's name or 'air'. Drift and settling count
    from the first look.
    """

    def __init__(
        self, twin: ReflectorModel, sensors: tuple[str, ...], temperatures_c: Callable[[str, Array], Array]
    ) -> None:
        self._twin = twin
        self._sensors = ("air", *(name for name in sensors if name != "air"))
        self._temperatures_c = temperatures_c
        self._arrived_s: list[float] = []
        self._arrival_drives_m: list[Array] = []
        self._start_s = 0.0
        self._speed_m_per_s = 0.0

    def places_m(self, look: InstantState) -> Array:
        """All reflectors (smrs, 3) in the machine's frame."""
        self._record_arrival(look)
        context = self.context(look)
        return np.asarray(self._twin.places_m(context, np.array([len(context) - 1]))[0])

    def context(self, look: InstantState) -> ReadingContext:
        """The current state as the last row, preceded by earlier times for parts that lag behind a temperature."""
        times = np.append(np.linspace(self._start_s, look.t_s, PAST_ROWS + 1)[:-1], look.t_s)
        n = len(times)

        def same(value: float | Array | tuple[float, ...]) -> Array:
            return np.repeat(np.asarray(value, dtype=np.float64)[None], n, axis=0)

        temperatures_c = {name: self._temperatures_c(name, times) for name in self._sensors}
        return ReadingContext(
            history=ArrivalHistory(np.array(self._arrived_s), np.array(self._arrival_drives_m)),
            t_s=times,
            arrival=np.full(n, len(self._arrived_s) - 1, dtype=np.intp),
            drives=same(look.drives_m),
            direction=same(look.direction),
            velocity_m_per_s=same(look.velocity_m_per_s),
            torque=same(look.torque),
            speed_m_per_s=same(self._speed_m_per_s),
            dwell_s=same(max(look.t_s - look.arrived_s, 0.0)),
            payload_kg=same(look.payload_kg),
            payload_com_m=same(look.payload_com_m),
            exchanges=same(float(look.exchanges)),
            air_refractivity=refractivity(temperatures_c["air"]),
            temperatures_c=temperatures_c,
            start_s=self._start_s,
        )

    def _record_arrival(self, look: InstantState) -> None:
        """Record an arrival. A stop without a measurement is no arrival, but its motion counts for the speed."""
        if not self._arrived_s:
            self._start_s = look.t_s
        elif look.arrived_s <= self._arrived_s[-1]:
            return
        self._speed_m_per_s = look.highest_speed_since(self._arrived_s[-1] if self._arrived_s else -np.inf)
        if self._arrived_s and look.moving:
            return
        self._arrived_s.append(look.arrived_s if self._arrived_s else min(look.arrived_s, look.t_s))
        self._arrival_drives_m.append(np.array(look.drives_m, dtype=np.float64))
