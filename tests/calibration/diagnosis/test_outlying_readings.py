"""Wrong readings are told from effects: by what all other readings predict, whatever an effect may have moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.outlying_readings import _LeaveOneOut
from calibration.diagnosis.staggered_columns import StaggeredColumns
from tests.calibration.diagnosis.campaigns import Arrivals, simulated

GROSS_M = {"platform": 1.5e-4, "slider": 4.0e-4, "floor": 3.0e-4}


def test_deviations_are_those_of_dense_predictions_without_the_reading():
    """Of those that are kept, and of those that are left out; two of one stand among them."""
    rng = np.random.default_rng(3)
    stand = np.array([0, 0, 0, 1, 1, 2, 3, 3, 3])
    n = len(stand)
    by_stand, columns = 3.0 * rng.standard_normal((n, 3, 2)), rng.standard_normal((n, 3, 4))
    residual = 4.0 * rng.standard_normal((n, 3))
    keep = np.ones(n, dtype=bool)
    keep[[1, 6, 7]] = False
    leave_one_out = _LeaveOneOut(stand, by_stand, residual, StaggeredColumns(columns.copy()))
    got, off = leave_one_out._distances(keep), leave_one_out.deviations_without(keep)
    a, y = columns.reshape(3 * n, -1), residual.ravel()
    shifted = np.repeat(by_stand.reshape(3 * n, -1), 4, axis=1).reshape(3 * n, 2, 4)
    shifted *= np.repeat(stand[:, None] == np.arange(4), 3, axis=0)[:, None, :]
    z = shifted.reshape(3 * n, -1)
    covariance = np.eye(3 * n) + a @ a.T + z @ z.T
    for i in range(n):
        own = np.arange(3 * i, 3 * i + 3)
        others = np.repeat(keep & (np.arange(n) != i), 3)
        cross = covariance[np.ix_(own, others)]
        gain = np.linalg.solve(covariance[np.ix_(others, others)], cross.T).T
        deviation = y[own] - gain @ y[others]
        spread = covariance[np.ix_(own, own)] - gain @ cross.T
        if not keep[i]:
            assert off[int(np.sum(~keep[:i]))] == pytest.approx(deviation, rel=1e-6)
        assert got[i] == pytest.approx(np.sqrt(deviation @ np.linalg.solve(spread, deviation)), rel=1e-6)


def slipped(arrivals: Arrivals) -> np.ndarray:
    """The left drive stands off by 0.2 mm at three visits, and everywhere by a play of 0.1 mm."""
    off = -5.0e-5 * arrivals.sides
    off[[20, 31, 32], 0] += 2.0e-4
    return off


def test_gross_readings_are_left_out_and_an_effect_of_a_few_visits_is_not():
    recording = simulated("planar4", 80, slipped)
    on = {smr.name: smr.on for smr in recording.machine.smrs}
    kind = np.array([on[name] for name in recording["smr"].tolist()])
    rng = np.random.default_rng(7)
    wrong = np.sort(np.concatenate([rng.choice(np.flatnonzero(kind == one), 2, replace=False) for one in GROSS_M]))
    position = recording.positions_m.copy()
    for row in wrong:
        away = rng.standard_normal(3) * [1.0, 0.0, 1.0]  # across the line of sight: ranges are less accurate
        position[row] += GROSS_M[str(kind[row])] * away / np.linalg.norm(away)
    columns = dict(recording.columns) | {f"{axis}_m": position[:, k] for k, axis in enumerate("xyz")}
    linear = linearise_recording(replace(recording, columns=columns))
    assert set(linear.wrong.tolist()) == set(wrong.tolist())
    assert linearise_recording(recording).wrong.size == 0


def test_a_reflector_that_is_often_far_off_is_no_wrong_reading():
    """By half a millimetre at every second visit: something happens to it, and it alone is kept for that."""
    recording = simulated("planar4", 80, slipped)
    visit, smr = recording["visit"], np.asarray(recording["smr"], dtype=str)
    of_it = np.flatnonzero((smr == smr[0]) & (visit % 2 == 1))
    gross = np.flatnonzero((smr != smr[0]) & (visit % 20 == 3))[::2]
    position = recording.positions_m.copy()
    position[of_it] += [3.0e-4, 0.0, 4.0e-4]
    position[gross] += [0.0, 0.0, 7.0e-4]
    columns = dict(recording.columns) | {f"{axis}_m": position[:, k] for k, axis in enumerate("xyz")}
    wrong = linearise_recording(replace(recording, columns=columns)).wrong
    assert not set(of_it.tolist()) & set(wrong.tolist())


@pytest.mark.parametrize(("times", "others_off", "kept"), [(8, 0, True), (7, 0, False), (8, 2, False), (13, 2, True)])
def test_a_reflector_that_alone_is_off_at_some_visits_does_not_lie_still(times, others_off, kept):
    """Gross readings come to all alike: one reflector's are an effect of it if they are many, and far more than any
    other one's."""
    recording = simulated("planar4", 160, slipped)
    smr, on = np.asarray(recording["smr"], dtype=str), {s.name: s.on for s in recording.machine.smrs}
    one, other = sorted({name for name in smr.tolist() if on[name] == "platform"})[:2]
    rng = np.random.default_rng(4)
    of_one, of_other = (
        rng.choice(np.flatnonzero(smr == name), count, replace=False)
        for name, count in ((one, times), (other, others_off))
    )
    position = recording.positions_m.copy()
    for row in (*of_one, *of_other):
        away = rng.standard_normal(3) * [1.0, 0.0, 1.0]
        position[row] += 4.0e-4 * away / np.linalg.norm(away)
    columns = dict(recording.columns) | {f"{axis}_m": position[:, k] for k, axis in enumerate("xyz")}
    wrong = set(linearise_recording(replace(recording, columns=columns)).wrong.tolist())
    assert wrong == set(of_other.tolist()) | (set() if kept else set(of_one.tolist()))
