"""One drive alone, integrated over time: motor, transmission, load and controller, and what a recorder sees of them.

Two masses in rotation. The transmission is a spring and a damper behind a play; the load has weight, dry and viscous
friction (elastoplastic: a bristle that slides); the motor is moved by a controller along smooth motions between random
targets. Many drives are integrated at once, since they share no number. Nothing here knows a column of a diagnosis:
what winds up does so because the spring transmits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
INTEGRATION_S = 1e-4
MOTOR_KG_M2, LOAD_KG_M2 = 30.0, 40.0
STIFF_NM_PER_RAD = 2e7
DAMPING = 0.2  # of the transmission, of critical
SETTLES_S = 0.5  # before the recording, until the load hangs in the spring
BRISTLE_RAD = 2e-5  # motion within which dry friction turns round
TRAVEL_RAD, TOP_SPEED_RAD_S, TOP_ACCELERATION_RAD_S2 = 1.2, 1.0, 4.0


@dataclass(frozen=True)
class DriveFlaws:
    """What is wrong with a drive; all zero but the stiffness: nothing. SI, angles in rad.

    rigid: the second encoder sits on the motor's shaft, so that nothing winds up between them. coulomb_asymmetry: half
    the difference of dry friction in the two directions, forward less backward, over their mean. play_rad: whole play.
    ripple_rad, ripple_period_rad: a wave of the second encoder over position. noise_rad: of slow coloured noise, with
    its correlation time; white_rad: of each sample. torque_side: of the torque that is
    recorded, "motor" or "load"; none if empty.
    """

    rigid: bool = False
    delay_s: float = 0.0
    stiffness_nm_per_rad: float = STIFF_NM_PER_RAD
    viscous_nms: float = 0.0
    coulomb_nm: float = 0.0
    coulomb_asymmetry: float = 0.0
    play_rad: float = 0.0
    weight_nm: float = 0.0
    ripple_rad: float = 0.0
    ripple_period_rad: float = 0.1
    noise_rad: float = 3e-6
    noise_s: float = 0.3
    white_rad: float = 3e-7
    torque_side: str = "motor"


@dataclass(frozen=True)
class DriveRecording:
    """What a recorder sees (n,), positions on the load's side: s, rad, Nm of the motor on the load's side."""

    time_s: Array
    command: Array
    motor: Array
    second: Array
    torque: Array | None
    torque_side: str


def record_drives(
    flaws: Sequence[DriveFlaws], seed: int, *, duration_s: float = 10.0, sampling_s: float = 0.004
) -> list[DriveRecording]:
    """One recording of each drive, moving between random targets of its own."""
    rng = np.random.default_rng(seed)
    every = round(sampling_s / INTEGRATION_S)
    count = round(duration_s / sampling_s)
    before = round(SETTLES_S / INTEGRATION_S)
    command = np.stack([_motions(rng, count * every) for _ in flaws], axis=1)
    waited = np.concatenate([np.repeat(command[:1], before, axis=0), command])
    motor, load, torque, transmitted = (signal[before:] for signal in _integrate(flaws, waited))
    out = []
    for i, flaw in enumerate(flaws):
        seen = torque if flaw.torque_side == "motor" else transmitted
        out.append(_seen(flaw, rng, command[:, i], motor[:, i], load[:, i], seen[:, i], every))
    return out


def _motions(rng: np.random.Generator, steps: int) -> Array:
    """Smooth motions between random targets, with rests (steps,): fifth-order polynomials in time."""
    at = 0.0
    parts = [np.zeros(round(0.3 / INTEGRATION_S))]
    total = len(parts[0])
    while total < steps:
        target = float(rng.uniform(-TRAVEL_RAD, TRAVEL_RAD))
        if abs(target - at) < 0.05:
            continue
        way = abs(target - at)
        fastest, hardest = rng.uniform(0.3, 1.0) * TOP_SPEED_RAD_S, rng.uniform(0.3, 1.0) * TOP_ACCELERATION_RAD_S2
        lasts = max(1.875 * way / fastest, float(np.sqrt(5.7735 * way / hardest)))
        u = np.arange(1, round(lasts / INTEGRATION_S) + 1) * INTEGRATION_S / lasts
        u = np.minimum(u, 1.0)
        parts.append(at + (target - at) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
        parts.append(np.full(round(rng.uniform(0.05, 0.4) / INTEGRATION_S), target))
        total += len(parts[-1]) + len(parts[-2])
        at = target
    return np.concatenate(parts)[:steps]


def _integrate(flaws: Sequence[DriveFlaws], command: Array) -> tuple[Array, Array, Array, Array]:
    """Motor and load positions (steps, drives) in rad, torques of motor and transmission in Nm: semi-implicit Euler."""
    of = {
        f.name: np.array([getattr(flaw, f.name) for flaw in flaws], dtype=np.float64)
        for f in fields(DriveFlaws)
        if f.type == "float"
    }
    stiff, play = of["stiffness_nm_per_rad"], 0.5 * of["play_rad"]
    reduced = MOTOR_KG_M2 * LOAD_KG_M2 / (MOTOR_KG_M2 + LOAD_KG_M2)
    damp = 2.0 * DAMPING * np.sqrt(stiff * reduced)
    bandwidth = 2.0 * np.pi * 12.0
    inertia = MOTOR_KG_M2 + LOAD_KG_M2
    gain, rate_gain = inertia * bandwidth**2, 1.4 * inertia * bandwidth
    speed = np.gradient(command, INTEGRATION_S, axis=0)
    acceleration = np.gradient(speed, INTEGRATION_S, axis=0)
    motor, load = command[0].copy(), command[0].copy()
    motor_speed, load_speed, bristle = np.zeros(len(flaws)), np.zeros(len(flaws)), np.zeros(len(flaws))
    positions, loads, torques, transmitteds = (np.empty_like(command) for _ in range(4))
    dt, coulomb, viscous, weight = INTEGRATION_S, of["coulomb_nm"], of["viscous_nms"], of["weight_nm"]
    uneven = of["coulomb_asymmetry"]
    for k in range(len(command)):
        torque = (
            gain * (command[k] - motor) + rate_gain * (speed[k] - motor_speed) + inertia * acceleration[k]
        ) + weight * np.cos(load)
        twist = motor - load
        beyond = twist - np.clip(twist, -play, play)
        transmitted = stiff * beyond + damp * (motor_speed - load_speed) * (beyond != 0.0)
        transmitted = np.where((beyond != 0.0) & (transmitted * beyond < 0.0) & (play > 0.0), 0.0, transmitted)
        bristle = np.clip(bristle + load_speed * dt, -BRISTLE_RAD, BRISTLE_RAD)
        side = bristle / BRISTLE_RAD
        friction = coulomb * (side + uneven * np.abs(side)) + viscous * load_speed
        motor_speed = motor_speed + dt * (torque - transmitted) / MOTOR_KG_M2
        load_speed = load_speed + dt * (transmitted - friction - weight * np.cos(load)) / LOAD_KG_M2
        motor, load = motor + dt * motor_speed, load + dt * load_speed
        positions[k], loads[k], torques[k], transmitteds[k] = motor, load, torque, transmitted
    return positions, loads, torques, transmitteds


def _seen(
    flaw: DriveFlaws, rng: np.random.Generator, command: Array, motor: Array, load: Array, torque: Array, every: int
) -> DriveRecording:
    """The signals at the recorder's rate."""
    at: Array = np.asarray(np.arange(len(command)) * INTEGRATION_S, dtype=np.float64)
    instants = at[::every]
    position = np.interp(instants - flaw.delay_s, at, motor if flaw.rigid else load)
    position = position + flaw.ripple_rad * np.sin(2.0 * np.pi * position / flaw.ripple_period_rad + 0.7)
    memory = float(np.exp(-every * INTEGRATION_S / flaw.noise_s))
    drawn = rng.standard_normal(len(instants)) * flaw.noise_rad
    slow = np.empty(len(instants))
    state = drawn[0]
    for i, value in enumerate(drawn.tolist()):
        state = memory * state + float(np.sqrt(1.0 - memory**2)) * value
        slow[i] = state
    second = position + slow + flaw.white_rad * rng.standard_normal(len(instants))
    measured = motor[::every] + flaw.white_rad * rng.standard_normal(len(instants))
    seen_torque = torque[::every] + 0.5 * rng.standard_normal(len(instants))
    kept: Array | None = np.asarray(seen_torque) if flaw.torque_side else None
    return DriveRecording(instants, command[::every], measured, second, kept, flaw.torque_side)
