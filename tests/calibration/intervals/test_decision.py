"""Decision rule with a guard band."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals.decision import decide, require_decidable
from calibration.intervals.facts import ErrorFigure


@pytest.mark.parametrize(
    ("error_m", "verdict"),
    [
        (20.0e-6, "conforms"),
        (21.7e-6, "conforms"),
        (21.8e-6, "undecided"),
        (28.2e-6, "undecided"),
        (28.4e-6, "does not conform"),
    ],
)
def test_between_the_guard_bands_nothing_is_stated(error_m, verdict):
    decision = decide(ErrorFigure(error_m, 2.0e-6), 25e-6)
    assert decision.verdict == verdict
    assert decision.guard_band_m == pytest.approx(1.6449 * 2e-6, rel=1e-4)
    assert "25.0 um" in decision.reason


def test_a_statement_is_wrong_no_more_often_than_stated():
    rng = np.random.default_rng(3)
    at_the_limit = np.abs(25e-6 + 2e-6 * rng.standard_normal(4000))
    verdicts = [decide(ErrorFigure(float(e), 2e-6), 25e-6, 0.95).verdict for e in at_the_limit]
    for verdict in ("conforms", "does not conform"):
        assert np.mean([v == verdict for v in verdicts]) == pytest.approx(0.05, abs=3.5 * np.sqrt(0.05 * 0.95 / 4000))


def test_a_tolerance_below_2_u_is_refused_with_the_figure():
    require_decidable(8.0e-6, 2.0e-6)
    with pytest.raises(InputError, match=r"7\.9 um is below 2 U = 8\.0 um"):
        require_decidable(7.9e-6, 2.0e-6)


def test_a_probability_below_one_half_is_refused():
    with pytest.raises(InputError, match=r"0\.4"):
        decide(ErrorFigure(1e-6, 1e-6), 2e-6, 0.4)
