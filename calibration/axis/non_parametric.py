"""Arbitrary functions of what an axis does: what no effect of the catalogue is."""

from __future__ import annotations

import numpy as np

from calibration.axis.effects import Law, LawSets, torque_or_zero
from calibration.axis.signals import Signals
from calibration.axis.smooth_function import smooth_function
from calibration.base.arrays import Array


def non_parametric(signals: Signals) -> dict[str, LawSets]:
    """Any smooth function of one coordinate, or of two, by its name: what no effect of the catalogue is."""
    over_position, over_speed = smooth_function(signals.position), smooth_function(signals.velocity)
    over_acceleration, over_torque = smooth_function(signals.acceleration), smooth_function(torque_or_zero(signals))
    fastest, resolution = max(float(np.abs(signals.velocity).max()), 1e-300), signals.resolution

    def position_and_side(s: Signals) -> Array:
        side, position = s.side(resolution)[:, None], over_position(s.position)
        return np.concatenate([position, side, position * side], axis=1)

    laws: dict[str, Law] = {
        "speed": lambda s: over_speed(s.velocity),
        "acceleration": lambda s: over_acceleration(s.acceleration),
        "position and side": position_and_side,
        "position and speed": lambda s: over_position(s.position) * (s.velocity / fastest)[:, None],
    }
    if signals.torque is not None and float(np.ptp(signals.torque)) > 0.0:
        laws["torque"] = lambda s: over_torque(torque_or_zero(s))
    out = {}
    for name, law in laws.items():
        out[name] = LawSets(signals)
        out[name].add_one(out[name].add_law(law))
    return out
