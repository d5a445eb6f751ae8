"""Campaigns on the mock plant, whose change the plant itself carries out (benchmarks/comparison)."""

from __future__ import annotations

from functools import lru_cache

from benchmarks.comparison.change import Change
from benchmarks.comparison.planar import Circumstances, PlanarCampaign
from calibration.recording.recording import Recording
from mock_devices.settings import DisturbanceLevels

LEVELS = DisturbanceLevels(2e-6, 1e-6, 1e-6, 0.02)
MACHINE_SEED = 11


def recorded(change: Change | None = None, *, name: str = "after", machine: int = MACHINE_SEED, **other) -> Recording:
    """A campaign on machine 11; `other` changes its circumstances."""
    at = Circumstances(**({"seed": 5, "station": 6, "design": 3} | other))
    return PlanarCampaign(machine, at, LEVELS, change or Change()).recording(name)


@lru_cache(maxsize=1)
def first() -> Recording:
    """The campaign before."""
    return recorded(name="before", seed=1, station=2, design=1)
