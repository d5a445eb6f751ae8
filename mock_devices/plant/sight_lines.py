"""What stands between the station and a reflector: the angle at which it looks away, and struts with a diameter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BEAM_RADIUS_M = 0.019  # of a 1.5 inch reflector
_MOUNT_M = 0.05


def looks_here(facing: Array, acceptance_rad: float, place_m: Array, station_m: Array) -> bool:
    """Whether a reflector that looks along `facing` accepts the beam of a station."""
    beam = station_m - place_m
    cosine = float(beam @ facing) / float(np.linalg.norm(beam) * np.linalg.norm(facing))
    return math.acos(max(-1.0, min(1.0, cosine))) <= acceptance_rad


def hides(base_m: Array, joint_m: Array, diameter_m: float, place_m: Array, station_m: Array) -> bool:
    """Whether a round strut stands in the beam: by the distance of points of the strut from the line of sight.

    The reflector's mount, where the beam begins, does not count.
    """
    beam = station_m - place_m
    length = float(np.linalg.norm(beam))
    along = beam / length
    rod = joint_m - base_m
    points = base_m + np.linspace(0.0, 1.0, 201)[:, None] * rod
    way = (points - place_m) @ along
    aside = np.linalg.norm(points - place_m - np.outer(way, along), axis=1)
    between = (way > min(_MOUNT_M, 0.5 * length)) & (way < length)
    return bool(np.any(between & (aside < 0.5 * diameter_m + _BEAM_RADIUS_M)))
