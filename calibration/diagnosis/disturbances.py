"""The ordinary wander that a recording declares for its rig: columns with the declared standard deviations.

Levels are those of docs/reference/definitions.md; what is not declared has no column.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.effects.basis_functions import brownian, waves
from calibration.recording.header import DRIFT_LEVER_M, HOUR_S

if TYPE_CHECKING:
    from calibration.diagnosis.linear_model import Baseline

OVERWEIGHT = 0.05  # of the moving mass: what a strut's own weight may add at its joint
WALK_TERMS = 14
LOUD_M, LOUD_TERMS = 8.0e-6, 24  # a rig that wanders more is followed closer
WAVE_TERMS = 5
LOUD_K, LOUD_WAVE_TERMS = 0.05, 8


def nuisance_columns(bare: Baseline) -> tuple[Array, tuple[str, ...]]:
    """Columns (n, 3, k), each times its standard deviation, and their names."""
    channels, m = Channels(bare), bare.moments
    declared, stated = bare.recording.file.nuisance, bare.recording.file.station.accuracy
    found: list[tuple[str, Array]] = []

    def add(channel: str, shapes: Array, label: str) -> None:
        response = bare.whitened(channels.shift_m(channel))
        for k in range(shapes.shape[1]):
            found.append((f"{label}.{channel}.{k}", response * shapes[:, k : k + 1]))

    # A strut's own weight is inside the geometry: taken up, but no cause.
    for strut in bare.machine.strut_names:
        add(f"weight.{strut}", np.full((len(m), 1), OVERWEIGHT * bare.machine.moving_mass_kg), "inside")
    terms = WALK_TERMS if declared.drift_m < LOUD_M else LOUD_TERMS
    walk = brownian(m.elapsed_s / HOUR_S, terms)
    per_axis = declared.drift_m / np.sqrt(2.0)
    for name in channels.stations():
        kind = name.rsplit(".", 1)[1]
        own = stated.drift_m_per_sqrt_h
        if kind.startswith("r"):
            own = stated.drift_rad_per_sqrt_h if kind == "rz" else stated.drift_of_level_rad_per_sqrt_h
        sd = np.hypot(own, per_axis / (DRIFT_LEVER_M if kind.startswith("r") else 1.0))
        add(name, walk * sd, "drift")
    if declared.reseat_m > 0.0:
        numbers = np.unique(m.exchanges)[1:]
        sits = (m.exchanges[:, None] == numbers).astype(np.float64) * declared.reseat_m
        for i in sorted(set(bare.smr[bare.on_platform].tolist())):
            for name in channels.smrs(i):
                add(name, sits, "reseat")
    for a, drive in enumerate(bare.machine.drive_names):
        if declared.reversal_m > 0.0:
            add(f"travel.{drive}", m.direction[:, a : a + 1] * declared.reversal_m, "reversal")
    if declared.temperature_k > 0.0:
        pairs = WAVE_TERMS if declared.temperature_k < LOUD_K else LOUD_WAVE_TERMS
        slow = waves(m.elapsed_s, 1500.0, pairs) * declared.temperature_k
        expansion = bare.machine.expansion_per_k
        for i, strut in enumerate(bare.machine.strut_names):
            grown = expansion["struts"] * bare.machine.nominal.length_m[i]
            add(f"length.{strut}", slow * grown, "temperature")
        for a, drive in enumerate(bare.machine.drive_names):
            add(f"travel.{drive}", slow * expansion["drives"] * m.drives[:, a : a + 1], "temperature")
    return np.stack([column for _, column in found], axis=2), tuple(name for name, _ in found)
