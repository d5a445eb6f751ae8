"""The size of a cause from the coefficients of its best basis set, and what of its uncertainty no readings reduce."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.ranking import Cause
from calibration.diagnosis.settings import VERDICT, VerdictSettings
from calibration.effects.departures import VISIT


def size_of(cause: Cause) -> tuple[float, float]:
    """Size of a cause in its best basis set and its standard uncertainty, from the coefficients as `measured` says."""
    best, basis_set = cause.best, cause.best.basis_set
    if basis_set.size:
        weights = np.zeros(len(best.coefficients))
        first = _largest_spell(cause)[0] if basis_set.spells > 1 else 0
        weights[first : first + len(basis_set.size)] = basis_set.size
        return float(weights @ best.coefficients), float(np.sqrt(weights @ best.covariance @ weights))
    main = _largest_spell(cause)
    if _is_anew(cause):  # then what it is at each visit is all there is of it
        main = list(range(len(best.coefficients)))
    coefficients, covariance = best.coefficients[main], best.covariance[np.ix_(main, main)]
    if len(main) == 1:
        return float(coefficients[0]), float(np.sqrt(covariance[0, 0]))
    norm = float(np.linalg.norm(coefficients))
    u = float(np.sqrt(coefficients @ covariance @ coefficients)) / max(norm, 1e-300)
    measured = cause.effect.measured
    if _is_anew(cause):
        value = _along_main_direction(cause, coefficients)
    elif measured == "norm":
        value = norm
    elif measured == "norm of channels":
        channels = len({cause.contributions[i][0][0] for i in main})
        value = norm / np.sqrt(len(main) / channels)
    elif measured == "sum":
        return float(np.sum(coefficients)), float(np.sqrt(np.sum(covariance)))
    else:
        by_channel = _by_channel(cause, main, coefficients).values()
        value = float(
            np.linalg.norm([np.ptp(x) if measured == "range" else np.sqrt(np.mean(x**2)) for x in by_channel])
        )
    return value, u * value / max(norm, 1e-300)


def _largest_spell(cause: Cause) -> list[int]:
    """Main columns; where they act in several spells of time, those of the one with the largest coefficients."""
    basis_set = cause.best.basis_set
    own = basis_set.relative[: len(basis_set.relative) - len(basis_set.departures)]
    main = np.flatnonzero(np.array(own) >= 1.0)
    spells: list[list[int]] = [spell.tolist() for spell in np.split(main, basis_set.spells)]
    return max(spells, key=lambda spell: float(np.linalg.norm(cause.best.coefficients[spell])))


def _is_anew(cause: Cause) -> bool:
    """Whether a cause is anything at each visit: there its departures are as large as the form, and no shares of it."""
    basis_set = cause.best.basis_set
    return VISIT in cause.differs_with and min(basis_set.relative[-len(basis_set.departures) :]) >= 1.0


def _along_main_direction(cause: Cause, coefficients: Array) -> float:
    """RMS, or range where the effect's size is one, of what a cause contributes where it acts, along the direction of
    its channels in which most happens: the noise of each of them would add up."""
    by_channel = _by_channel(cause, range(len(coefficients)), coefficients)
    at_readings = np.stack(list(by_channel.values()), axis=1)
    at_readings = at_readings[np.any(at_readings != 0.0, axis=1)]
    at_readings = at_readings - at_readings.mean(axis=0)
    along = at_readings @ np.linalg.svd(at_readings, full_matrices=False)[2][0]
    return float(np.ptp(along) if cause.effect.measured == "range" else np.sqrt(np.mean(along**2)))


def _by_channel(cause: Cause, columns: Sequence[int], coefficients: Array) -> dict[str, Array]:
    """What some columns of a cause contribute (n,) at each of their first channels."""
    out: dict[str, Array] = {}
    for i, coefficient in zip(columns, coefficients, strict=True):
        channel, shape = cause.contributions[i][0]
        out[channel] = out.get(channel, 0.0) + coefficient * shape
    return out


def absorbed_share(raw: float, visible: float) -> float:
    """Share of a raw size that the calibration absorbs."""
    return 1.0 - min(visible / raw, 1.0) if raw > 0.0 else 1.0


def relative_u_of_form(absorbed: Array | float, settings: VerdictSettings = VERDICT) -> Array:
    """Standard uncertainty that a size has because no form is exact, over the size; absorbed: `absorbed_share`.

    What the calibration absorbs of an effect follows from the form alone, so it is known far less well than what is
    seen (docs/reference/definitions.md).
    """
    return np.hypot(settings.u_of_form, settings.u_of_absorbed * np.asarray(absorbed))
