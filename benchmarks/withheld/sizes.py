"""Noise-free readings of a simulated campaign, and how large a change of them is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mock_devices.recordings.columns import points
from mock_devices.recordings.maker import SimulatedCampaign

Array = NDArray[np.float64]


def raw_of(bench: SimulatedCampaign, change_m: Array, *, turned: bool = False) -> float:
    """Raw size of a change (r, 3) of the readings, given in the machine's axes if `turned`."""
    moved = change_m if turned else change_m @ bench.view.rotation
    rows = platform_rows(bench)
    place = bench.points_m([])[rows]
    sigma_m = bench.settings.instrument.angle_sd_rad * np.linalg.norm(place, axis=1)
    return float(np.sqrt(np.mean((moved[rows, :2] / sigma_m[:, None]) ** 2)))


def platform_rows(bench: SimulatedCampaign) -> NDArray[np.intp]:
    """Rows of the platform's reflectors."""
    on_platform = np.array([smr.on == "platform" for smr in bench.nominal.smrs])
    return np.flatnonzero(on_platform[bench.timeline.smr])


def noise_free(bench: SimulatedCampaign) -> Array:
    """What the station would read without noise (r, 3), its frame: its range's constant, scale and ppm included."""
    sight, _, _ = bench.sight()
    rows, k = np.arange(len(bench.timeline)), bench.timeline.smr
    air = bench._air()
    raw = sight.distance_m[rows, k] * bench.view.range_scale + bench.view.range_constant_m
    distance = raw * (1.0 + (air["ppm"] - air["ppm_true"]) * 1.0e-6)
    return points(sight.hz_rad[rows, k], sight.v_rad[rows, k], distance)
