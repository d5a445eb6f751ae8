"""Decision on a tolerance with a guard band (ISO 14253-1; JCGM 106).

With the standard uncertainty u of a measured error and the probability 1 - p of a wrong statement, the guard band is
g = z(p) u: conformity is stated up to tolerance - g, nonconformity from tolerance + g on, nothing between the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy.special import ndtri

from calibration.base.errors import InputError
from calibration.intervals.facts import ErrorFigure

Verdict = Literal["conforms", "undecided", "does not conform"]
PROBABILITY = 0.95


@dataclass(frozen=True)
class Decision:
    """What can be said of an error against its tolerance, the guard band in metres, and why in words."""

    verdict: Verdict
    guard_band_m: float
    reason: str


def decide(error: ErrorFigure, tolerance_m: float, probability: float = PROBABILITY) -> Decision:
    """Decide with a guard band on each side; probability: of a statement's being right, in [0.5, 1)."""
    if not 0.5 <= probability < 1.0:
        raise InputError(f"decision rule: probability {probability} is not in [0.5, 1)")
    guard_m = float(ndtri(probability)) * error.u_m
    words = f"error {_um(error.position_m)} with guard band {_um(guard_m)}, tolerance {_um(tolerance_m)}"
    if error.position_m <= tolerance_m - guard_m:
        return Decision("conforms", guard_m, f"{words}: within tolerance")
    if error.position_m > tolerance_m + guard_m:
        return Decision("does not conform", guard_m, f"{words}: out of tolerance")
    return Decision("undecided", guard_m, f"{words}: not shown to be within tolerance, nor out of it")


def require_decidable(tolerance_m: float, u_m: float) -> None:
    """Refuse a tolerance below 2 U (U = 2 u): such a check could hardly ever state conformity."""
    smallest_m = 4.0 * u_m
    if tolerance_m < smallest_m:
        raise InputError(
            f"tolerance {_um(tolerance_m)} is below 2 U = {_um(smallest_m)} of the check "
            f"(U = {_um(2.0 * u_m)}, k = 2): state at least {_um(smallest_m)}, or measure more poses"
        )


def _um(length_m: float) -> str:
    return f"{length_m * 1e6:.1f} um"
