"""Readings that are wrong by what all others say, whatever an effect may have changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from calibration.base.arrays import Array
from calibration.base.outliers import GATE_SIGMAS, scale_of
from calibration.diagnosis.any_change import FREE_SIGMAS, columns_by_stand, columns_of_any_change, stands
from calibration.diagnosis.chance import are_by_chance
from calibration.diagnosis.observed_model import ObservedModel
from calibration.diagnosis.staggered_columns import StaggeredColumns
from calibration.identification.gate import LinearReadings
from calibration.recording.recording import Recording
from calibration.reduction.left_out import DIAGNOSIS, GIANT, LeftOutReading

GROSS_SIGMAS, GIANT_SIGMAS = 15.0, 60.0  # of a reading's own
MOST_ALIKE = 3.0  # giants that are off alike hide each other: each then looks so many times closer
LARGEST_WRONG_SHARE = 0.025  # unless they come by chance
MOST_SIGMAS_OF_COUNT = 3.0  # by which a reflector has more or fewer of them than all together, were they by chance
LARGEST_GROSS_SHARE = 0.15  # hardly anything that an effect does is so far off what any change explains
MOST_SUSPECTS = 0.25  # of all readings, before the search for wrong ones is given up
WORST_SHARE = 0.3  # of the worst: what is at least so far off goes in the same round
FEWEST_OF_ONE, TIMES_OF_OTHERS = (
    8,
    6,
)  # wrong readings of a reflector that is itself what is wrong; and their share, over any other's
SINGULAR = 1e-9  # information of a coordinate that nothing but its own reading says anything about


@dataclass(frozen=True)
class JudgedReadings:
    """keep (n,): readings that are not wrong; sigmas (n,): own standard deviations by which each is off the others.

    size_m (k,): of the deviations of those that are wrong from what all that are kept say. reason: why they are wrong.
    far (m,): how many standard deviations those are off that are kept because they are too many to be wrong.
    """

    keep: NDArray[np.bool_]
    sigmas: Array
    size_m: Array
    reason: str
    far: Array

    def named(self, recording: Recording, rows: NDArray[np.intp]) -> dict[int, LeftOutReading]:
        """The wrong ones by their rows in a recording, rows (n,) being those of all."""
        return {
            int(rows[i]): LeftOutReading.of_recording(recording, int(rows[i]), m, self.sigmas[i], self.reason)
            for i, m in zip(np.flatnonzero(~self.keep), self.size_m, strict=True)
        }


def judge_readings(observed: ObservedModel, whiten: Array, residual: Array, columns: Array) -> JudgedReadings:
    """Which readings are wrong, whiten (n, 3, 3), residual (n, 3) and columns (n, 3, b) of the linear model.

    Giants spoil the fit by which the others are judged, so where there are some nothing else is looked for.
    """
    giants = giant_readings(observed, whiten, residual, columns)
    return fitting_readings(observed, whiten, residual, columns) if giants is None else giants


def fitting_readings(observed: ObservedModel, whiten: Array, residual: Array, columns: Array) -> JudgedReadings:
    """Which readings are not wrong by what the others say, whatever an effect may have changed (any_change.py).

    Where many are wrong that do not come by chance, only those count that are so grossly; where very many are gross, an
    effect that nothing here describes is the likely cause, and all stay.
    """
    stand, (of_platform, of_drives) = stands(observed), columns_by_stand(observed, whiten)
    # Of whatever may have changed, much concerns one reflector or one drive only.
    both = StaggeredColumns(np.concatenate([*columns_of_any_change(observed, whiten), columns], axis=2))
    of_platform = of_platform * _shift_sigmas(stand, residual, both, observed.on_platform)
    by_stand = np.concatenate([of_platform, FREE_SIGMAS * of_drives], axis=2)
    leave_one_out = _LeaveOneOut(stand, by_stand, residual, both)
    sigmas = leave_one_out.judge(_parts(observed))
    limit = _limit_of_wrong(observed, sigmas)
    keep = np.asarray(sigmas <= limit) | _of_one_reflector(observed, sigmas > limit)
    off = [(sigmas, GATE_SIGMAS), (leave_one_out.stated_sigmas(keep), GROSS_SIGMAS)]  # wrong ones widen their scale
    many = (number[keep & (number > limit)] for number, limit in off if np.mean(number > limit) >= LARGEST_WRONG_SHARE)
    size_m = lengths_m(whiten[~keep], leave_one_out.deviations_without(keep))
    return JudgedReadings(keep, sigmas, size_m, DIAGNOSIS, next(many, np.zeros(0)))


def _limit_of_wrong(observed: ObservedModel, sigmas: Array) -> float:
    """From how many of their own standard deviations (n,) on readings are wrong; infinite where too many are gross."""
    gross, far = sigmas > GROSS_SIGMAS, sigmas > GATE_SIGMAS
    if np.mean(gross) >= LARGEST_GROSS_SHARE:
        return np.inf
    if np.mean(far & ~gross) < LARGEST_WRONG_SHARE or come_by_chance(observed, far):
        return GATE_SIGMAS
    return GROSS_SIGMAS


def come_by_chance(observed: ObservedModel, far: NDArray[np.bool_]) -> bool:
    """Whether readings that are far off (n,) come to all reflectors of the platform alike, whatever was measured before
    and wherever that was. What an effect does to a reading comes at some time or place, or to one reflector.
    """
    if np.mean(far) >= LARGEST_GROSS_SHARE:
        return False
    rows = np.flatnonzero(observed.on_platform)
    numbers, every = np.unique(observed.smr, return_inverse=True)
    expected = np.bincount(every) * np.mean(far[rows])
    more = (np.bincount(every, far) - expected) / np.sqrt(np.maximum(expected, 1.0))
    on_platform = np.isin(numbers, observed.smr[rows])  # of other parts hardly anything says what they should read
    if np.any(more > MOST_SIGMAS_OF_COUNT) or np.any(more[on_platform] < -MOST_SIGMAS_OF_COUNT):
        return False
    context = observed.context
    along = np.column_stack([context.t_s, context.drives])[rows]
    in_order = np.argsort(np.argsort(along, axis=0, kind="stable"), axis=0)
    one_by_one = in_order + len(rows) * every[rows, None]
    return are_by_chance(far[rows].astype(np.float64), one_by_one.astype(np.float64))


def _of_one_reflector(observed: ObservedModel, wrong: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Readings (n,) of a reflector of the platform that is wrong (n,) much more often than any other: that is one which
    does not lie still, as gross readings come to all of them alike."""
    out = np.zeros(len(wrong), dtype=bool)
    of_reflector = {
        k: observed.on_platform & (observed.smr == k) for k in np.unique(observed.smr[observed.on_platform])
    }
    share = {k: float(np.mean(wrong[rows])) for k, rows in of_reflector.items()}
    for k, rows in of_reflector.items():
        others = max((other for j, other in share.items() if j != k), default=share[k])
        if np.sum(wrong & rows) >= FEWEST_OF_ONE and share[k] > TIMES_OF_OTHERS * others:
            out |= rows
    return out


def giant_readings(observed: ObservedModel, whiten: Array, residual: Array, columns: Array) -> JudgedReadings | None:
    """Those so far off the fit of the others that no effect can be meant; None without any, and where they are many."""
    readings = LinearReadings(np.zeros(columns.shape[2]), (-residual,), (columns,), (_parts(observed),))
    if readings.farthest() <= GIANT_SIGMAS / MOST_ALIKE:
        return None
    judged = readings.judge([np.ones(len(residual), dtype=bool)], GIANT_SIGMAS / MOST_ALIKE)[0]
    giant = judged.sigmas > GIANT_SIGMAS
    if not 0.0 < np.mean(giant) < LARGEST_GROSS_SHARE:
        return None
    return JudgedReadings(~giant, judged.sigmas, lengths_m(whiten[giant], judged.deviation[giant]), GIANT, np.zeros(0))


def lengths_m(whiten: Array, deviation: Array) -> Array:
    """Lengths (k,) of whitened deviations (k, 3)."""
    return np.asarray(np.linalg.norm(np.linalg.solve(whiten, deviation[:, :, None])[:, :, 0], axis=1))


def _parts(observed: ObservedModel) -> NDArray[np.intp]:
    """On what each reading's reflector is, by number: each kind of part has its own scale."""
    parts = np.array([smr.on for smr in observed.machine.smrs])
    return np.unique(parts[observed.smr], return_inverse=True)[1].astype(np.intp)


def _shift_sigmas(
    stand: NDArray[np.intp], residual: Array, columns: StaggeredColumns, on_platform: NDArray[np.bool_]
) -> float:
    """Typical shift of the platform at a stand that none of the columns explains, in sigma; one at least.

    A slider's reading that is off while the platform stands where it should is then wrong; where the platform has moved
    with it, the drive has slipped.
    """
    flat = columns.of_readings.reshape(-1, columns.shape[2])
    factor = cho_factor(columns.gram + np.eye(flat.shape[1]), overwrite_a=True, check_finite=False)
    fitted = flat @ cho_solve(factor, flat.T @ residual.ravel(), check_finite=False)
    left = (residual - fitted.reshape(residual.shape))[on_platform]
    numbers, index = np.unique(stand[on_platform], return_inverse=True)
    mean = np.stack([np.bincount(index, left[:, k]) for k in range(3)], axis=1) / np.bincount(index)[:, None]
    return max(1.0, float(np.median(np.linalg.norm(mean, axis=1)))) if numbers.size else 1.0


class _LeaveOneOut:
    """Deviations of single readings from what all others predict, each reading three numbers with correlated others.

    C = B + A A' with A the columns (n, 3, k), which are overwritten, and B = 1 + Z Z' within each stand (n,), Z its
    columns (n, 3, f). Of the readings with index i, (C^-1 y)_i' ((C^-1)_ii)^-1 (C^-1 y)_i is chi-squared (Rasmussen and
    Williams 2006, eq. 5.12).
    """

    def __init__(self, stand: NDArray[np.intp], by_stand: Array, residual: Array, columns: StaggeredColumns) -> None:
        n, width = len(residual), columns.shape[2]
        order = np.argsort(stand, kind="stable")
        self._stands = np.split(order, np.flatnonzero(np.diff(stand[order])) + 1)
        self._stand_of = np.empty(n, dtype=np.intp)
        self._within: list[Array] = []  # B^-1 of each stand
        y, absorbed = np.empty((n, 3)), []
        for number, rows in enumerate(self._stands):
            z = by_stand[rows].reshape(3 * len(rows), -1)
            z = z[:, np.any(z != 0.0, axis=0)]
            # B^-1 = 1 - X X' with X = Z R^-1 and 1 + Z'Z = R'R.
            x = z @ np.linalg.inv(np.linalg.cholesky(np.eye(z.shape[1]) + z.T @ z)).T
            self._within.append(np.eye(len(x)) - x @ x.T)
            y[rows] = (self._within[-1] @ residual[rows].ravel()).reshape(-1, 3)
            absorbed.append(x.T @ columns.of_readings[rows].reshape(len(x), -1))
            self._stand_of[rows] = number
        # C^-1 = B^-1 - D D' with D = B^-1 A L'^-1 and 1 + A' B^-1 A = L L'.
        of_stands = np.concatenate(absorbed)
        lower = np.linalg.cholesky(np.eye(width) + columns.gram - of_stands.T @ of_stands)
        along = columns.divide(np.asarray(lower))
        rest = along.reshape(3 * n, width).T @ y.ravel()
        self._score, self._information = np.empty((n, 3)), np.empty((n, 3, 3))
        for rows, within in zip(self._stands, self._within, strict=True):
            along[rows] = (within @ along[rows].reshape(3 * len(rows), -1)).reshape(len(rows), 3, -1)
            own = within.reshape(len(rows), 3, len(rows), 3).diagonal(axis1=0, axis2=2)
            self._information[rows] = own.transpose(2, 0, 1)
        self._information -= along @ along.transpose(0, 2, 1)
        self._score = y - along @ rest
        self._along = along.reshape(3 * n, width)

    def judge(self, kind: NDArray[np.intp]) -> Array:
        """Own standard deviations (n,) by which each reading is off the others that fit; kind (n,): those of one scale.

        The worst of a stand goes first, since one wrong reading makes good ones beside it look wrong; those come back.
        """
        keep, came_back = np.ones(len(kind), dtype=bool), False
        while True:
            sigmas = self._sigmas(keep, kind)
            if np.mean(~keep) > MOST_SUSPECTS:
                return sigmas
            worst = float(np.max(sigmas[keep]))
            if worst <= GATE_SIGMAS:
                good = ~keep & (sigmas <= GATE_SIGMAS)
                if came_back or not np.any(good):
                    return sigmas
                keep, came_back = keep | good, True
                continue
            limit = max(GATE_SIGMAS, WORST_SHARE * worst)
            for rows in self._stands:
                suspect = rows[np.argmax(np.where(keep[rows], sigmas[rows], 0.0))]
                if sigmas[suspect] > limit:
                    keep[suspect] = False

    def stated_sigmas(self, keep: NDArray[np.bool_]) -> Array:
        """Deviations (n,) from what all that are kept (n,) say, in stated standard deviations."""
        return self._distances(keep)

    def deviations_without(self, keep: NDArray[np.bool_]) -> Array:
        """Whitened deviations (k, 3) of the readings that are not kept (n,) from what all that are say of them."""
        return np.zeros((0, 3)) if np.all(keep) else self._predicted_without(np.flatnonzero(~keep))[2]

    def _sigmas(self, keep: NDArray[np.bool_], kind: NDArray[np.intp]) -> Array:
        """Deviations (n,) in own standard deviations, whose scales those that are kept determine."""
        distance = self._distances(keep)
        for one in np.unique(kind):
            if np.any(keep & (kind == one)):
                distance[kind == one] /= scale_of(distance[keep & (kind == one)], 3)
        return distance

    def _distances(self, keep: NDArray[np.bool_]) -> Array:
        """Roots (n,) of the square forms of the deviations from the prediction by all others that are kept (n,).

        With P = C^-1 of all readings, those that are kept have P - P_S P_SS^-1 P_S' without the others S, and these are
        off the prediction by what is kept by P_SS^-1 (P y)_S with the covariance P_SS^-1 (block elimination).
        """
        score, information = self._score, self._information
        out = np.flatnonzero(~keep)
        if not out.size:
            return _roots(score, information + SINGULAR * np.eye(3))
        by_reading, covariance, deviation = self._predicted_without(out)
        information = information - by_reading @ covariance @ by_reading.transpose(0, 2, 1)
        score = score - (by_reading @ deviation.ravel()).reshape(-1, 3)
        distance = _roots(score, information + SINGULAR * np.eye(3))
        own = covariance.reshape(len(out), 3, len(out), 3).diagonal(axis1=0, axis2=2).transpose(2, 0, 1)
        distance[out] = _roots(deviation, own)
        return distance

    def _predicted_without(self, out: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Of some rows (m,): their columns (n, 3, 3 m) of P, P_SS^-1 (3 m, 3 m), deviations (m, 3) (`_distances`)."""
        by_reading = self._coupled(out).reshape(len(self._score), 3, -1)
        of_out = by_reading[out].reshape(3 * len(out), -1)
        own_information = 0.5 * (of_out + of_out.T) + SINGULAR * np.eye(len(of_out))
        covariance = np.asarray(np.linalg.inv(own_information), dtype=np.float64)
        return by_reading, covariance, (covariance @ self._score[out].ravel()).reshape(-1, 3)

    def _coupled(self, rows: NDArray[np.intp]) -> Array:
        """Columns (3 n, 3 m) of the inverse covariance of all readings, of some of them (m,)."""
        along = self._along.reshape(-1, 3, self._along.shape[1])
        out = -self._along @ along[rows].reshape(3 * len(rows), -1).T
        by_reading = out.reshape(len(along), 3, len(rows), 3)
        for number, row in enumerate(rows.tolist()):
            stand = self._stand_of[row]
            members = self._stands[stand]
            own = self._within[stand].reshape(len(members), 3, len(members), 3)
            by_reading[members, :, number] += own[:, :, int(np.flatnonzero(members == row)[0])]
        return out


def _roots(deviation: Array, covariance: Array) -> Array:
    """Roots (n,) of the square forms of deviations (n, 3) by their covariances (n, 3, 3)."""
    square = np.sum(deviation * np.linalg.solve(covariance, deviation[:, :, None])[:, :, 0], axis=1)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))
