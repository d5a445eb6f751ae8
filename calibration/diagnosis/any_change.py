"""Columns for whatever may have changed from one reading to the next: by them readings are judged, not effects.

A wrong reading is told from an effect by what surrounds it. What moves the platform moves all reflectors of a visit;
what happens to a slider, a reflector, the light or the station comes back where and when things are alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.channels import AXES, Channels, alike_but_for_zero
from calibration.diagnosis.observed_model import ObservedModel
from calibration.effects.basis_functions import cosine_basis, random_walk_basis, scale_to_symmetric
from calibration.recording.header import HOUR_S

FREE_SIGMAS = 30.0  # standard deviation of each function, in those of a reading: larger than effects are
SAME_PLACE_M = 2.0e-5  # between visits of one place: some programs count each reading as a visit
WALK_TERMS, SLOW_TERMS, CURVE_TERMS, FEW_TERMS = 24, 4, 16, 6
FUNCTIONS_PER_READING = 0.5  # of a reflector on a slider: more would explain every single one
DWELLS_S = (1.5, 6.0, 24.0)


def stands(observed: ObservedModel) -> NDArray[np.intp]:
    """Number (n,) of the stand of each reading: following visits of one place in the same way; nests have their own."""
    context = observed.context
    order = np.argsort(context.t_s, kind="stable")
    order = order[observed.visit[order] >= 0]
    state = np.column_stack([context.direction, context.payload_kg, context.speed_m_per_s, context.moving])[order]
    moved = np.max(np.abs(np.diff(context.drives[order], axis=0)), axis=1) > SAME_PLACE_M
    begins = np.concatenate([[True], moved | np.any(np.diff(state, axis=0) != 0.0, axis=1)])
    out = np.full(len(context), -1, dtype=np.intp)
    out[order] = np.cumsum(begins) - 1
    alone = np.flatnonzero(out < 0)
    out[alone] = out.max(initial=-1) + 1 + np.arange(len(alone))
    return out


def columns_by_stand(observed: ObservedModel, whiten: Array) -> tuple[Array, Array]:
    """Whitened shifts that may be others at every stand, one sigma RMS each: (n, 3, f) by the platform's free
    coordinates alone, and (n, 3, d) by each drive, along its travel and across.
    """
    channels = Channels(observed)
    drives = [
        name
        for a, drive in enumerate(observed.machine.drive_names)
        for name in (f"travel.{drive}", *channels.sideways_channels(a))
    ]
    of_platform, of_drives = (
        np.stack([_free(whiten, observed, channels.shift_m(name)) / FREE_SIGMAS for name in names], axis=2)
        for names in (channels.pose_channels(), drives)
    )
    return of_platform, of_drives


def columns_of_any_change(observed: ObservedModel, whiten: Array) -> list[Array]:
    """Whitened columns, some (n, 3, k) for each channel: functions of time, place, side, load, speed and rest at all
    that is not the platform.
    """
    machine, context, channels = observed.machine, observed.context, Channels(observed)
    hours = context.elapsed_s / HOUR_S
    walk = np.concatenate([np.ones((len(context), 1)), random_walk_basis(hours, WALK_TERMS)], axis=1)
    exchanged = (context.exchanges[:, None] >= np.unique(context.exchanges)[1:]).astype(np.float64)
    parts = []
    for smr in machine.smrs:
        if smr.on == "platform":
            shapes = np.concatenate([walk, exchanged], axis=1)
            moved = [channels.shift_m(f"smr.{smr.name}.{axis}") for axis in AXES]
            parts += [_shaped(_free(whiten, observed, shift_m), shapes) for shift_m in moved]
    for a, drive in enumerate(machine.drive_names):
        on_drive = [i for i, smr in enumerate(machine.smrs) if smr.on == "slider" and smr.drive == a]
        readings = np.count_nonzero(np.isin(observed.smr, on_drive)) / max(len(on_drive), 1)
        shapes = np.concatenate([_functions_of_drive(observed, a), walk[:, 1:], exchanged], axis=1)
        shapes = shapes[:, : int(readings * FUNCTIONS_PER_READING)]
        for name in (f"travel.{drive}", *channels.sideways_channels(a)):
            parts.append(_shaped(_free(whiten, observed, channels.shift_m(name)), shapes))
    slow = walk[:, : SLOW_TERMS + 1]
    for names in alike_but_for_zero([name for name in channels.names if name.startswith(("station.", "light."))]):
        alike = _free(whiten, observed, np.stack([channels.shift_m(name) for name in names], axis=2))
        parts += [_shaped(alike[:, :, k], slow) for k in range(len(names))]
    return parts


def _functions_of_drive(observed: ObservedModel, drive: int) -> Array:
    """Functions (n, k) of what a slider's place may depend on, the likeliest first: few readings allow few of them."""
    context = observed.context
    q, side = context.drives[:, drive], context.direction[:, drive : drive + 1]
    speed = scale_to_symmetric(context.speed_m_per_s)[:, None]
    load = scale_to_symmetric(context.payload_kg)[:, None]
    velocity = context.velocity_m_per_s[:, drive : drive + 1]
    velocity = velocity / max(float(np.max(np.abs(velocity))), 1e-9)
    rest = np.exp(-context.dwell_s[:, None] / np.array(DWELLS_S))
    warm = np.stack([scale_to_symmetric(t) for t in context.temperatures_c.values()], axis=1)
    others = np.concatenate([scale_to_symmetric(p)[:, None] for p in context.drives.T], axis=1)
    curve = cosine_basis(q, CURVE_TERMS, roughness=0.5)
    few = curve[:, :FEW_TERMS]
    return np.concatenate(
        [
            np.ones_like(side), side, load, velocity, few, others, side * load, side * rest, side * rest * speed,
            warm, warm * scale_to_symmetric(q)[:, None], side * few, velocity * np.abs(velocity), velocity * load,
            load * few, side * speed, rest, others**2, curve[:, FEW_TERMS:], side * curve[:, FEW_TERMS:],
        ],
        axis=1,
    )  # fmt: skip


def _free(whiten: Array, observed: ObservedModel, shift_m: Array) -> Array:
    """Whitened shifts (n, 3), or several alike (n, 3, k), scaled to FREE_SIGMAS RMS over the readings that move."""
    moved = np.einsum("nij,nj...->ni...", whiten, np.einsum("ij,nj...->ni...", observed.frame.rotation, shift_m))
    size = np.linalg.norm(moved, axis=1)
    rms = float(np.sqrt(np.mean(size[size > 0.0] ** 2))) if np.any(size > 0.0) else 1.0
    return np.asarray(moved * (FREE_SIGMAS / rms))


def _shaped(response: Array, shapes: Array) -> Array:
    return np.asarray(response[:, :, None] * shapes[:, None, :])
