"""Features of a recording: its residuals projected on what general functions would do at every channel.

For each channel of the machine (docs/reference/effects.md) and each function of a coordinate the score g = h' C^-1 y
over the root of its information h' C^-1 h, all unknowns of the calibration projected out: standard normal where nothing
is wrong. Of parts that are alike the two largest count: where an effect is does not tell what it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.diagnosis.effect_inputs import periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.machine.description import Machine
from calibration.recording.recording import Recording

Array = NDArray[np.float64]

KINDS = (
    "travel",
    "sideways",
    "turn",
    "length",
    "pose",
    "smr",
    "station",
    "light",
    "growth",
    "payload",
    "scale",
    "floor",
)
BANDS_M = ((1e-5, 3e-3), (3e-3, 6e-2))  # of periods
LAG_S = 1500.0
LEAST = 1e-12  # information of a column below which it says nothing
DEGREES = 4


def features_of(recording: Recording) -> Array:
    """Features (f,), the same ones of every recording of a machine. Raises InputError of an unsuitable recording."""
    linear = linearise_recording(recording)
    likelihood = MarginalLikelihood.of(linear)
    machine, rows = recording.machine, linear.rows
    shapes = [_functions(recording, rows, own) for own in range(len(machine.drive_names))]
    by_kind: dict[str, list[Array]] = {kind: [np.zeros(shapes[0].shape[1])] * 2 for kind in KINDS}
    for channel in likelihood.channels.names:
        kind = channel.partition(".")[0]
        if kind in by_kind:
            squares = _squares(likelihood, channel, shapes[_drive_of(channel, machine)])
            by_kind[kind].append(np.log1p(squares))
    out = [np.array([np.log1p(float(np.mean(likelihood.weighted_residual**2)))])]
    out += [-np.sort(-np.array(found), axis=0)[:2].ravel() for found in by_kind.values()]
    return np.concatenate([*out, _periods(recording, likelihood, rows)])


def _squares(likelihood: MarginalLikelihood, channel: str, shapes: Array) -> Array:
    """Squares (j,) of the projected scores of functions (n, j) at a channel."""
    found = likelihood.information_and_score([((channel, shape),) for shape in shapes.T])
    information = np.diag(found.information)
    return np.where(information > LEAST, found.score**2 / np.maximum(information, LEAST), 0.0)


def _drive_of(channel: str, machine: Machine) -> int:
    part = channel.split(".")[1]
    if part in machine.strut_names:
        return int(machine.strut_drive[machine.strut_names.index(part)])
    return machine.drive_names.index(part) if part in machine.drive_names else 0


def _functions(recording: Recording, rows: NDArray[np.intp], own: int) -> Array:
    """Functions (n, j) of the coordinates of readings, as a drive has them."""
    q, side = recording.drives("actual_m")[rows], recording.drives("direction")[rows, own]
    torque, velocity = recording.drives("torque_ratio")[rows, own], recording.drives("velocity_m_per_s")[rows, own]
    partner, t_s = (own + 1) % q.shape[1], recording["t_rig_s"][rows]
    load, speed = _unit(recording["payload_mass_kg"][rows]), _unit(recording["speed_m_per_s"][rows])
    is_pose = np.asarray(recording["phase"])[rows] != "nests"
    dwell_s = recording["dwell_s"][rows]
    dwell = _unit(np.minimum(dwell_s, dwell_s[is_pose].max()))
    visit = np.maximum(recording["visit"][rows].astype(int), 0)
    _, first, of_visit = np.unique(visit, return_index=True, return_inverse=True)
    before = np.concatenate([q[first[:1], own], q[first[:-1], own]])[of_visit]
    warm = np.mean([values[rows] for values in recording.temperatures_c().values()], axis=0)
    lagged = _lagged(t_s, warm)
    height = recording.positions_m[rows, 2]
    place, time = _unit(q[:, own]), _unit(t_s)
    columns = [
        side, side * place, side * load, side * dwell, side * speed, velocity, torque, load, speed, speed**2, dwell,
        dwell**2, _unit(np.abs(place - _unit(before))), _unit(warm), _unit(warm) * place, _unit(lagged),
        _unit(lagged) * place, time * place, load * place, _unit(recording["air_temperature_c"][rows]),
    ]  # fmt: skip
    for x, degrees in ((q[:, own], DEGREES), (q[:, partner], DEGREES), (t_s, DEGREES), (before, 2), (height, 2)):
        columns += list(np.polynomial.legendre.legvander(_unit(x), degrees).T[1:])
    return np.stack([column - column.mean() for column in columns], axis=1)


def _periods(recording: Recording, likelihood: MarginalLikelihood, rows: NDArray[np.intp]) -> Array:
    """The strongest waves of any drive in each band of periods."""
    names, found = recording.machine.drive_names, periodograms(likelihood)
    out = []
    for low_m, high_m in BANDS_M:
        best = 0.0
        for a, drive in enumerate(names):
            for period_m, _ in found[a].strongest_periods(low_m, high_m):
                angle = 2.0 * np.pi * recording.drives("actual_m")[rows, a] / period_m
                waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
                best = max(best, float(_squares(likelihood, f"travel.{drive}", waves).sum()))
        out.append(np.log1p(best))
    return np.array(out)


def _unit(x: Array) -> Array:
    """On [-1, 1] over the values taken; zeros of a constant."""
    low, high = float(x.min()), float(x.max())
    return (2.0 * x - low - high) / (high - low) if high > low else np.zeros_like(x)


def _lagged(t_s: Array, x: Array) -> Array:
    out = x.copy()
    keep = np.exp(-np.maximum(np.diff(t_s), 0.0) / LAG_S)
    for i in range(1, len(x)):
        out[i] = x[i] + (out[i - 1] - x[i]) * keep[i - 1]
    return out
