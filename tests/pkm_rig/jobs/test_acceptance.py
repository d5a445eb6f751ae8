from __future__ import annotations

import pytest

from calibration.reduction.figures import Figures
from pkm_rig.jobs.acceptance import decide


def made(rms, u):
    return Figures(rms, 2 * rms, 0.0, u, 0.0, 30)


@pytest.mark.parametrize(
    ("before", "after", "accepted"),
    [(made(40e-6, 2e-6), made(6e-6, 0.5e-6), True), (made(8e-6, 1e-6), made(6e-6, 0.5e-6), False)],
)
def test_tables_stay_only_if_the_error_falls_by_more_than_its_uncertainty(before, after, accepted):
    decision = decide(before, after)
    assert decision.accepted is accepted
    assert ("the tables stay" in decision.rule) is accepted


def test_a_rise_is_never_accepted():
    assert not decide(made(6e-6, 0.0), made(6e-6, 0.0)).accepted
    assert not decide(made(6e-6, 1e-7), made(60e-6, 1e-7)).accepted
