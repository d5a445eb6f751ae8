"""A correction at some poses: to compare it with the former one, to find it again, and to limit how fast it changes."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses

COUNT = 32
SEED = 15
STEP = 1e-3  # of a coordinate's range, for differences
DIGITS = 10  # of m and rad that are kept: 0.1 nm
REVERSAL = "reversal"  # the key of values by direction; left out where there are none
SAME = 2e-9  # m or rad, within which a correction that is computed anew is the same

Corrections = Callable[[Array], Array]  # platform poses (n, 6) -> what is added to the drives there (n, d)


@dataclass(frozen=True)
class CorrectionSamples:
    """Platform poses (n, 6) and corrections (n, d) there, m or rad; reversal (d,): values that are compensated too."""

    target_m: Array
    correction: Array
    reversal: Array

    @classmethod
    def of(cls, machine: Machine, box: Array, corrections: Corrections) -> CorrectionSamples:
        """Spread over a box (k, 2) of the commanded coordinates."""
        target = sample_poses(machine, box)
        correction = np.round(corrections(target), DIGITS)
        return cls(target, correction, np.zeros(correction.shape[1]))

    @property
    def crc(self) -> int:
        """Of all values, for people to tell one correction from another."""
        return zlib.crc32(np.ascontiguousarray(np.hstack([self.target_m, self.correction]), dtype="<f8").tobytes())

    def largest_difference(self, corrections: Corrections) -> float:
        """By how much (m or rad) another correction differs from this one at its poses."""
        return float(np.max(np.abs(corrections(self.target_m) - self.correction)))

    def as_json(self) -> dict[str, Any]:
        """For the store."""
        turned = {REVERSAL: self.reversal.tolist()} if np.any(self.reversal) else {}
        return {"target_m": self.target_m.tolist(), "correction": self.correction.tolist()} | turned

    @classmethod
    def of_json(cls, data: Mapping[str, Any]) -> CorrectionSamples:
        """From the store; InputError where it is damaged."""
        try:
            target, correction = (np.array(data[key], dtype=np.float64) for key in ("target_m", "correction"))
            reversal = np.array(data.get(REVERSAL, [0.0] * correction.shape[-1]), dtype=np.float64)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("the stored correction is damaged; see `pkm-rig audit`") from error
        shaped = target.ndim == correction.ndim == 2 and target.shape == (len(correction), 6) and len(target) > 0
        finite = all(np.all(np.isfinite(values)) for values in (target, correction, reversal))
        if not (shaped and finite and reversal.shape == correction.shape[1:]):
            raise InputError("the stored correction is damaged; see `pkm-rig audit`")
        return cls(target, correction, reversal)


def sample_poses(machine: Machine, box: Array) -> Array:
    """COUNT platform poses (n, 6), evenly spread over a box (k, 2) of the commanded coordinates."""
    unit = qmc.Sobol(len(box), seed=SEED).random(COUNT)
    return nominal_poses(machine, box[:, 0] + (box[:, 1] - box[:, 0]) * unit)


def slopes_of(machine: Machine, box: Array, corrections: Corrections) -> Array:
    """Changes (m, d) of corrections a unit of travel of the drive that moves most, at poses over a box (k, 2)."""
    unit = STEP + (1.0 - 2.0 * STEP) * qmc.Sobol(len(box), seed=SEED).random(COUNT)
    middle = box[:, 0] + (box[:, 1] - box[:, 0]) * unit
    steps = 0.5 * STEP * np.diag(box[:, 1] - box[:, 0])
    ahead, behind = (nominal_poses(machine, np.concatenate([middle + s * step for step in steps])) for s in (1, -1))
    travel = np.abs(nominal_drives(machine, ahead) - nominal_drives(machine, behind)).max(axis=1)
    change = corrections(ahead) - corrections(behind)
    return np.asarray(change / travel[:, None])
