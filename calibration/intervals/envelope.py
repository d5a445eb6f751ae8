"""Within which a machine's tables may be exchanged without anybody's approval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtri

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.facts import CalibrationFact, ErrorFigure

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True)
class Envelope:
    """Largest changes that need no approval: parameter_sigmas, of a parameter in standard uncertainties of former and
    new calibration and its allowed drift together; table_m, of a table's correction; error_m, of the error as found."""

    parameter_sigmas: float = 6.0
    table_m: float = 50e-6
    error_m: float = 50e-6

    def __post_init__(self) -> None:
        sizes = (self.parameter_sigmas, self.table_m, self.error_m)
        if not all(math.isfinite(v) and v > 0.0 for v in sizes):
            raise InputError("envelope: its limits must be finite and above zero")


@dataclass(frozen=True)
class EnvelopeResult:
    """Whether tables may be exchanged alone; if not, one reason for each limit that is exceeded."""

    allowed: bool
    reasons: tuple[str, ...]


def judge(
    envelope: Envelope,
    former: CalibrationFact,
    new: CalibrationFact,
    drift_sd: Array,
    table_change_m: float,
    found: ErrorFigure,
) -> EnvelopeResult:
    """Compare a new calibration with the envelope.

    drift_sd (p,): standard deviation of each parameter's allowed drift since the former one; table_change_m: largest
    change of a table's correction; found: error with the former tables.
    """
    if former.parameter_names != new.parameter_names:
        return EnvelopeResult(False, ("the parameters have other names: history begins anew",))
    if not math.isfinite(table_change_m) or not np.all(np.isfinite(drift_sd)):
        raise InputError("envelope: changes must be finite")
    change = np.asarray(new.parameters) - np.asarray(former.parameters)
    variance = np.diag(np.asarray(new.covariance)) + np.diag(np.asarray(former.covariance)) + drift_sd**2
    size = np.abs(change) / np.sqrt(np.maximum(variance, 1e-300))
    reasons = []
    if size.size and size.max() > envelope.parameter_sigmas:
        worst = int(np.argmax(size))
        reasons.append(
            f"{new.parameter_names[worst]} has changed by {change[worst]:.3g}, {size[worst]:.1f} standard deviations; "
            f"{envelope.parameter_sigmas:g} are allowed"
        )
    if abs(table_change_m) > envelope.table_m:
        reasons.append(
            f"a drive's correction would change by {table_change_m * 1e6:.1f} um; {envelope.table_m * 1e6:.1f} um are "
            "allowed"
        )
    if found.position_m > envelope.error_m:
        reasons.append(f"the error was {found.position_m * 1e6:.1f} um; {envelope.error_m * 1e6:.1f} um are allowed")
    return EnvelopeResult(not reasons, tuple(reasons))


@dataclass(frozen=True)
class Verification:
    """Squared errors of the tool at verification poses with both tables, and whether the new ones stay."""

    fall_m: float
    u_m: float
    accepted: bool
    reason: str


def verify(before_m: Array, after_m: Array, u_point_m: float) -> Verification:
    """Whether new tables are an improvement, from errors (n, k) of the tool's coordinates at the same fresh poses.

    The fall of the RMS error with its standard uncertainty, from independent readings of standard uncertainty
    u_point_m; accepted if the fall exceeds U = 2 u, as everywhere in this project.
    """
    if before_m.shape != after_m.shape or before_m.ndim != 2 or not len(before_m):
        raise InputError("verification: needs the same poses before and after")
    if not (np.all(np.isfinite(before_m)) and np.all(np.isfinite(after_m)) and u_point_m > 0.0):
        raise InputError("verification: errors must be finite, their uncertainty above zero")
    before, after, u_square = _squares(before_m, after_m, u_point_m)
    fall = math.sqrt(before) - math.sqrt(after)
    u = u_square / (2.0 * max(0.5 * (math.sqrt(before) + math.sqrt(after)), math.sqrt(u_square)))
    accepted = before - after > COVERAGE_FACTOR * u_square
    words = "the tables stay" if accepted else "former tables back"
    return Verification(fall, u, accepted, f"{_fall_words(fall, u)}: {words}")


@dataclass(frozen=True)
class VerificationPlan:
    """Poses after which a verification of a partial calibration looks, and the probability, over all looks, that tables
    which are no better are taken for better, or better ones refused early."""

    looks: tuple[int, ...] = (12, 18, 24, 30)
    error: float = 0.025

    def __post_init__(self) -> None:
        if not self.looks or self.looks[0] < 12 or list(self.looks) != sorted(set(self.looks)):
            raise InputError(f"verification: looks {self.looks} must be ascending and begin with at least 12 poses")
        if not 0.0 < self.error < 0.5:
            raise InputError(f"verification: error probability {self.error} is not in (0, 0.5)")


VerificationAnswer = Literal["go on", "accepted", "refused"]


def verify_further(
    before_m: Array, after_m: Array, u_point_m: float, plan: VerificationPlan
) -> tuple[VerificationAnswer, Verification]:
    """What poses so far (n, k) say of new tables, n being one of the plan's looks; the last look always decides.

    Accepted once the fall of the mean squared error exceeds z u, refused once a rise does, z by Bonferroni's inequality
    for all looks. The verification says in words what was decided.
    """
    result = verify(before_m, after_m, u_point_m)
    if len(before_m) not in plan.looks:
        raise InputError(f"verification: {len(before_m)} poses are no look of {plan.looks}")
    z = _most_sigmas(plan)
    before, after, u_square = _squares(before_m, after_m, u_point_m)
    answer: VerificationAnswer = "go on"
    if before - after > z * u_square:
        answer = "accepted"
    elif after - before > z * u_square or len(before_m) == plan.looks[-1]:
        answer = "refused"
    words = {"go on": "not decided yet", "accepted": "the tables stay", "refused": "former tables back"}[answer]
    reason = f"{_fall_words(result.fall_m, result.u_m)} at {len(before_m)} poses: {words}"
    return answer, Verification(result.fall_m, result.u_m, answer == "accepted", reason)


def without_harm(
    answer: VerificationAnswer,
    result: Verification,
    before_rad: Array,
    after_rad: Array,
    u_rad: float,
    plan: VerificationPlan,
) -> tuple[VerificationAnswer, Verification]:
    """The same answer, unless the rotation errors (n, t) at the same poses have risen: then tables are refused."""
    before, after, u_square = _squares(before_rad, after_rad, u_rad)
    if after - before <= _most_sigmas(plan) * u_square:
        return answer, result
    rise = math.sqrt(after) - math.sqrt(before)
    return "refused", Verification(
        result.fall_m,
        result.u_m,
        False,
        f"{result.reason.partition(':')[0]}, but rotation errors rise by {rise * 1e6:.1f} urad: former tables back",
    )


def _most_sigmas(plan: VerificationPlan) -> float:
    """By how many standard uncertainties a difference has to be beyond zero at a look (Bonferroni)."""
    return float(-ndtri(plan.error / len(plan.looks)))


def _fall_words(fall_m: float, u_m: float) -> str:
    return f"fall {fall_m * 1e6:.1f} um, U = {COVERAGE_FACTOR * u_m * 1e6:.1f} um (k = 2)"


def _squares(before_m: Array, after_m: Array, u_point_m: float) -> tuple[float, float, float]:
    """Mean squared errors without noise, and the standard uncertainty of their difference."""
    n, k = before_m.shape
    before, after = (max(float(np.sum(e**2)) / n - k * u_point_m**2, 0.0) for e in (before_m, after_m))
    # the mean of n squared errors E^2 of k coordinates has the variance (4 u^2 E^2 + 2 k u^4) / n
    u_square = math.sqrt(sum(4.0 * u_point_m**2 * s + 2.0 * k * u_point_m**4 for s in (before, after)) / n)
    return before, after, u_square
