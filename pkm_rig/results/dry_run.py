"""A campaign that was not made: its visits in their order, and how long it would take."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

STATION_S = 4.0  # assumed of the station for a reading: turn, aim, measure


@dataclass(frozen=True)
class DryVisit:
    """A visit: its number, payload, commanded coordinates, side of approach, speed, and when it would be measured."""

    number: int
    pose: int
    payload: int
    commanded: tuple[float, ...]
    direction: tuple[int, ...]
    speed_m_per_s: float
    way_s: float
    t_s: float


@dataclass(frozen=True)
class DryRun:
    """A campaign that was not made. Durations are rig time, by assumptions."""

    machine: str
    coordinates: tuple[str, ...]
    motion: str
    visits: tuple[DryVisit, ...]
    moving_s: float
    measuring_s: float
    total_s: float
    readings: int

    def as_json(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"assumed_station_s": STATION_S}
