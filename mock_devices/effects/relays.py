"""What is thrown to one side at one temperature and to the other side at another."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.state import Array


def thrown(warmer_k: Array, up_k: float, down_k: float) -> Array:
    """1 once a course of temperature (n,) is above `up_k`, -1 once below `down_k`, in between as before; 0 at first."""
    sides, now = np.empty_like(warmer_k), 0.0
    for i, k in enumerate(warmer_k.tolist()):
        now = 1.0 if k > up_k else -1.0 if k < down_k else now
        sides[i] = now
    return sides
