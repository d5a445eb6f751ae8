"""What is switched at one temperature and switched back at another."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.state import Array


def switched(warmer_k: Array, up_k: float, back_k: float) -> Array:
    """1 or 0 (n,) along a course of temperature: 1 once it is above `up_k`, 0 once below `back_k`, and 0 at first."""
    states, now = np.empty_like(warmer_k), 0.0
    for i, k in enumerate(warmer_k.tolist()):
        now = 1.0 if k > up_k else 0.0 if k < back_k else now
        states[i] = now
    return states
