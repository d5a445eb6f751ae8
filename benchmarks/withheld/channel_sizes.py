"""What a true effect does at the channels that a diagnosis names, beside what the diagnosis states (`at_channels`).

Plant and catalogue may state an effect's size as different quantities; what it does at a channel is the same quantity
for both. The plant's noise-free change of the readings, whitened, is fitted at each visit by the responses to all
channels that the diagnosis names of the effect, jointly; the truth of a channel is the RMS of its amplitude over the
readings that respond to it, its mean included, as the diagnosis states it. Where the readings of a visit do not tell
the channels apart, the visit does not count, and a channel that few visits tell is not compared. Compared is, at each
place, the channel whose stated amount moves the readings most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.errors import InputError
from calibration.diagnosis.channel_responses import ChannelResponses
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.recording.folder import read_folder

Array = NDArray[np.float64]

TOLD_APART = 1e-3  # least eigenvalue of the correlations of the responses to a visit's channels
LEAST_SHARE = 0.9  # of the readings that respond to a channel, those of visits that tell it


@dataclass(frozen=True)
class TrueAmount:
    """RMS of what a change does at a channel, and of the same about its mean."""

    rms: float
    about_mean: float


def compared(recording: Path, found: Mapping[str, Any], change_m: Array) -> list[dict[str, Any]]:
    """At each place of an effect the channel whose amount moves the readings most: stated value, u and truth.

    found: an effect of an answer; change_m (r, 3): of all readings by the true effect, machine's axes.
    """
    by_place = [
        [q for q in place["at_channels"] if q["value"] > 0.0 and q["u"] > 0.0 and np.isfinite(q["u"])]
        for place in found.get("places", [])
    ]
    if not any(by_place):
        return []
    try:
        linear = linearise_recording(read_folder(recording), judge=False)
    except InputError:
        return []
    responses = ChannelResponses(linear)
    amounts = true_amounts(linear, list(dict.fromkeys(q["name"] for qs in by_place for q in qs)), change_m, responses)

    def moves(quantity: Mapping[str, Any]) -> float:
        return float(quantity["value"] * np.linalg.norm(responses(quantity["name"])))

    dominant: dict[str, list[Mapping[str, Any]]] = {}
    for quantities in filter(None, by_place):
        largest = max(quantities, key=moves)
        dominant.setdefault(largest["name"], []).append(largest)
    out = []
    for name, quantities in dominant.items():
        if (of := amounts.get(name)) is not None:
            stated = np.array([q["value"] for q in quantities])
            together = float(np.linalg.norm(stated))  # an effect found twice at one place: squares add up
            u = float(np.linalg.norm(stated * [q["u"] for q in quantities])) / together
            at = {"channel": name, "stated": together, "u": u}
            out.append({**at, "true": of.rms, "true_about_mean": of.about_mean})
    return out


def true_amounts(
    linear: LinearModel, names: Sequence[str], change_m: Array, responses: ChannelResponses
) -> dict[str, TrueAmount]:
    """What a change (r, 3) of all readings does at some channels, by name, where the readings tell them apart."""
    response = np.stack([responses(name) for name in names], axis=-1)  # (n, w, k)
    change = linear.whiten_shift(change_m[linear.rows])
    visits = linear.context.arrival
    amplitude = np.full((len(visits), len(names)), np.nan)
    for visit in np.unique(visits):
        rows = visits == visit
        columns = response[rows].reshape(-1, len(names))
        acting = np.flatnonzero(np.any(columns != 0.0, axis=0))
        fitted = _fitted(columns[:, acting], change[rows].ravel())
        if fitted is not None:
            amplitude[np.ix_(rows, acting)] = fitted
    out = {}
    for k, name in enumerate(names):
        at_readings = amplitude[responses.rows(name), k]
        told = at_readings[np.isfinite(at_readings)]
        if len(told) and len(told) >= LEAST_SHARE * len(at_readings):
            out[name] = TrueAmount(float(np.sqrt(np.mean(told**2))), float(np.std(told)))
    return out


def _fitted(columns: Array, change: Array) -> Array | None:
    """Least-squares amplitudes; None if the columns cannot be told apart."""
    if not columns.shape[1]:
        return None
    unit = np.linalg.norm(columns, axis=0)
    scaled = columns / unit
    if np.linalg.eigvalsh(scaled.T @ scaled)[0] < TOLD_APART:
        return None
    return np.asarray(np.linalg.lstsq(scaled, change, rcond=None)[0] / unit)
