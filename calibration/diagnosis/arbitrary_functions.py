"""Functions of which an arbitrary function of one coordinate is made, whatever effects there are.

Coordinates are what a reading may depend on: when and where it was taken, how the drives came there, what they carry,
how warm it is. What a part remembers of its way is one of them: what a drive drags along in a play or in dry friction
lies where the last motions have left it (stop operators: Krasnosel'skii, Pokrovskii, Systems with Hysteresis, 1989),
and what a motion leaves behind dies away.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import EffectInputs
from calibration.effects.basis_functions import cosine_basis, random_walk_basis, tensor_product

DWELL_S = 6.0
LAGS_S = (0.0, 600.0, 3000.0)  # with which a part follows a recorded temperature
PLAYS = (0.003, 0.01, 0.03, 0.1, 0.2, 0.4)  # over the travel: widths within which a drive drags something along
FADING_S = (10.0, 60.0, 300.0, 1200.0)  # time constants of what motions leave behind
APPROACH_TERMS = 5
NOTHING = 1e-12
ASK_FOR = {  # the field of the context without which a coordinate is none
    "time": "t_s", "direction": "direction", "rest": "dwell_s", "direction and place": "direction",
    "time and place": "t_s",
}  # fmt: skip


def functions_for_all_channels(inputs: EffectInputs) -> dict[str, Array]:
    """By coordinate (n, k): of time, approach direction, rest and speed, payload, place, temperatures."""
    context = inputs.context
    t = context.elapsed_s / max(float(context.elapsed_s.max()), 1.0)
    speed = context.speed_m_per_s / max(float(context.speed_m_per_s.max()), 1e-9)
    decay = np.stack([np.exp(-context.dwell_s / tau) for tau in (1.5, DWELL_S, 4.0 * DWELL_S)], axis=1)
    settling = np.concatenate([decay, decay * speed[:, None], decay * np.sqrt(speed)[:, None], speed[:, None]], axis=1)
    sides = context.direction
    by_drive = [cosine_basis(q, 4, roughness=1.0, constant=True) for q in context.drives.T]
    place = by_drive[0]
    for other in by_drive[1:]:
        place = tensor_product(place, other)[:, :40]
    over_time = np.concatenate([random_walk_basis(t, 28), cosine_basis(t, 4)], axis=1)
    bases = {
        "time": _with_payload_interaction(inputs, over_time),
        "direction": _with_payload_interaction(inputs, sides),
        "rest": np.concatenate([settling, tensor_product(sides, settling)], axis=1),
        "load": np.stack([inputs.payload_ratio, inputs.payload_ratio**2], axis=1),
        "place": _with_payload_interaction(inputs, place[:, 1:]),
        "direction and place": tensor_product(sides, place),
        "time and place": tensor_product(random_walk_basis(t, 12), place[:, :5]),
    }
    courses = [] if "t_s" in context.not_said else context.relative_changes(context.temperatures_c, LAGS_S)
    if courses:
        bases["temperature"] = _with_payload_interaction(inputs, _centred([course for course, _ in courses]))
    return {name: shapes for name, shapes in bases.items() if ASK_FOR.get(name) not in context.missing}


def functions_of_drive(inputs: EffectInputs, drive: int) -> dict[str, Array]:
    """The same of a drive and what hangs on it: of its place, its side, its way.

    Not of its torque: what follows that is wound up, which is an effect of the catalogue.
    """
    context, not_said = inputs.context, inputs.context.not_said
    curve = cosine_basis(context.drives[:, drive], 16, roughness=1.0)
    bases = {"place": _with_payload_interaction(inputs, curve)}
    side = context.direction[:, drive : drive + 1]
    if "direction" not in not_said:
        bases["direction and place"] = tensor_product(side, curve)
    if not {"t_s", "history"} & not_said.keys():
        bases["former motions"] = _with_payload_interaction(inputs, _left_by_motions(inputs, drive))
    if not {"direction", "history"} & not_said.keys():
        length = np.sqrt(context.history.travelled_m[context.arrival, drive])
        of_length = cosine_basis(length, APPROACH_TERMS, constant=True)
        bases["length of the approach"] = _with_payload_interaction(inputs, side * of_length)
    return bases


def _left_by_motions(inputs: EffectInputs, drive: int) -> Array:
    """What a drive's motions so far may have left (n, k), each of mean square one: where something lies that it drags
    along, for several widths, and what came with each motion, to its side or either way, and dies away."""
    context = inputs.context
    q, at_arrival = context.drives[:, drive], context.history.drives[:, drive]
    span_m = max(float(np.ptp(q)), NOTHING)
    dragged = [q - context.dragged(drive, share * span_m) for share in PLAYS]
    steps = np.diff(at_arrival, prepend=at_arrival[:1])
    faded = [context.left_by_motions(left, tau_s) for tau_s in FADING_S for left in (steps, np.abs(steps))]
    columns = _centred([*dragged, *faded])
    return np.asarray(columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), NOTHING))


def functions_of_sight(inputs: EffectInputs) -> Array:
    """Functions (n, k) of where the measured point is, seen from the station: on the level across the middle of all
    lines of sight, wherever the circle has its zero, and in height.
    """
    middle = inputs.sight_m.mean(axis=0)
    hz_rad, height = np.arctan2(middle[0], middle[1]), inputs.sight_m[:, 2]
    across = inputs.sight_m[:, :2] @ np.array([np.cos(hz_rad), -np.sin(hz_rad)])
    return tensor_product(
        cosine_basis(across, 5, roughness=1.0, constant=True), cosine_basis(height, 4, roughness=1.0, constant=True)
    )


def _with_payload_interaction(inputs: EffectInputs, shapes: Array) -> Array:
    """Shapes (n, k), followed by their products with the payload."""
    return np.concatenate([shapes, shapes * (inputs.payload_ratio - 0.5)[:, None]], axis=1)


def _centred(columns: list[Array]) -> Array:
    stacked = np.stack(columns, axis=1)
    return np.asarray(stacked - stacked.mean(axis=0))
