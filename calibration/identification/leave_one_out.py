"""Leave-one-out: how well a fit predicts each reading from all the others.

For squares with priors the refit without reading i misses it by e_i = (1 - H_ii)^-1 r_i, with the residual r_i and the
block H_ii = J_i C J_i^T of the hat matrix, C the posterior covariance (Allen's PRESS, 1974). It is exact for a linear
model, and as good as the model is linear over the change that one reading makes. A residual beside it is small for two
reasons, a good model or a reading that the fit follows; the leave-one-out error distinguishes them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.problem import VISITS_AT_ONCE
from calibration.instruments.readings import split_by_visits


@dataclass(frozen=True)
class LeaveOneOutErrors:
    """One instrument's readings (r, w), in standard deviations of a reading.

    residual: of the fit; error: of the refits without the reading, prediction minus reading; u: standard
    uncertainty of that prediction by the model with its priors, noise of the reading not included.
    """

    residual: Array
    error: Array
    u: Array


def leave_one_out(fit: Fit) -> tuple[LeaveOneOutErrors, ...]:
    """Residuals and leave-one-out errors of every instrument's readings, of a fit by squares with priors.

    Not for a truncated or robust fit. Raises InputError if a reading is followed exactly.
    """
    out = []
    count = len(fit.model)
    for readings, instrument_columns in zip(fit.instruments, fit.layout.instrument_slices, strict=True):
        residual, error, u = (np.empty((len(readings), readings.width)) for _ in range(3))
        for rows, some, needed, local in split_by_visits(readings, VISITS_AT_ONCE):
            poses = fit.predict(fit.visits.take(needed))
            compared = some.compare(poses, local, fit.unknowns[instrument_columns])
            columns = np.concatenate([np.arange(count), np.arange(instrument_columns.start, instrument_columns.stop)])
            jacobian = np.concatenate([compared.by_model, compared.by_own], axis=2)
            hat = jacobian @ fit.covariance_as_stated[np.ix_(columns, columns)] @ jacobian.transpose(0, 2, 1)
            try:
                inverse_complement = np.linalg.inv(np.eye(readings.width) - hat)
            except np.linalg.LinAlgError:
                raise InputError(
                    "identification: an unknown is determined by a single reading, so its leave-one-out error cannot "
                    "be computed; measure more poses"
                ) from None
            residual[rows] = compared.residual
            error[rows] = np.einsum("rij,rj->ri", inverse_complement, compared.residual)
            u[rows] = np.sqrt(np.maximum(np.einsum("rij,rji->ri", hat, inverse_complement), 0.0))
        out.append(LeaveOneOutErrors(residual, error, u))
    return tuple(out)
