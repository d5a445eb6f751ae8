"""Heat that drives make: by friction and motors' losses, and by each motion as far as it is written down."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import EffectInputs, geometric_series, varies

TIME_CONSTANTS_S = geometric_series(250.0, 7000.0, 6)  # of parts that take up heat
HEAT_TIME_CONSTANTS_S = TIME_CONSTANTS_S[1::2]
DUTY_M_PER_S = 0.01
MOTION_TIMES_S = geometric_series(90.0, 4000.0, 3)  # of joints and bearings up to whole columns
SPEED_M_PER_S, BETWEEN_MOTIONS_S = 0.5, 30.0  # of a typical motion, and between two
LEAST_TORQUE = 0.05  # over rated torque: where it varies less, friction is as the way and a motor's losses are constant


def heats_of_torque(inputs: EffectInputs, drive: int) -> list[tuple[Array, float]]:
    """Heat (n,) by a drive's friction, |torque| times speed, and by its motor's losses, torque squared, which parts
    take up and lose again with time constants; over their ranges. None where the torque is not known or hardly varies.
    """
    return inputs.once(("heats", drive), lambda: _followed_heats(inputs, drive))


def _followed_heats(inputs: EffectInputs, drive: int) -> list[tuple[Array, float]]:
    context = inputs.context
    if {"torque", "t_s", "history"} & context.not_said.keys():
        return []
    torque = np.abs(context.torque[:, drive])
    if not varies(torque, LEAST_TORQUE):
        return []
    lasted_s = np.diff(context.history.arrived_s, prepend=np.nan)
    lasted_s = np.where(lasted_s > 0.0, lasted_s, np.inf)  # of the first arrival nobody knows
    speed_m_per_s = (context.history.travelled_m[:, drive] / lasted_s)[context.arrival]
    out = []
    for power in (torque * speed_m_per_s, torque**2):
        for tau in HEAT_TIME_CONSTANTS_S:
            heat = context.lagging(power, tau)
            out.append((heat / max(float(np.ptp(heat)), 1e-12), tau))
    return out


def heats_of_motion(inputs: EffectInputs, drive: int, *, shortest_s: float = 0.0) -> list[tuple[Array, float]]:
    """Heat (n,) that a drive's motions have left, with time constants: by the way (Coulomb's friction), by way and
    speed (viscous friction), by way and square of the speed (churned oil), and by the number of motions (losses of
    starting and stopping). Each is one for typical motions all the time. shortest_s: of the time constants of a part.
    """
    heats = inputs.once(("heats of motion", drive), lambda: _heats_left(inputs, drive))
    return [(heat, tau) for heat, tau in heats if tau >= shortest_s]


def _heats_left(inputs: EffectInputs, drive: int) -> list[tuple[Array, float]]:
    context = inputs.context
    if {"t_s", "history", "speed_m_per_s"} & context.not_said.keys():
        return []
    way_m = context.history.travelled_m[:, drive]
    rates = (
        way_m / DUTY_M_PER_S,
        way_m * context.approach_speed_m_per_s / (DUTY_M_PER_S * SPEED_M_PER_S),
        way_m * context.approach_speed_m_per_s**2 / (DUTY_M_PER_S * SPEED_M_PER_S**2),
        np.where(way_m > 0.0, BETWEEN_MOTIONS_S, 0.0),
    )
    return [(context.left_by_motions(rate, tau) / tau, tau) for rate in rates for tau in MOTION_TIMES_S]
