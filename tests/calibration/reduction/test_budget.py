"""The parts of a budget make up the uncertainty that the figure states."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.reduction.budget import position_budget
from calibration.reduction.figures import visit_figures
from calibration.reduction.reduction import reduce
from tests.pkm_rig.plant_recording import record


@pytest.fixture(scope="module")
def reduction():
    return reduce(record(4, calibration_poses=12))


@pytest.mark.parametrize("payload", [0, 1])
def test_the_parts_are_all_of_the_figures_uncertainty(reduction, payload):
    budget = position_budget(reduction, "verification_before", payload)
    found = visit_figures(reduction, "verification_before", payload)
    assert budget.u_m == pytest.approx(found.u_position_rms_m, rel=1e-12)
    assert sum(entry.share for entry in budget.entries) == pytest.approx(1.0)
    assert [(e.quantity, e.type) for e in budget.entries] == [("scatter", "A"), ("scale", "B")]
    assert budget.entries[0].estimate == found.position_rms_m
    for entry in budget.entries:
        assert entry.contribution_m == pytest.approx(entry.u * entry.sensitivity)


def test_effective_degrees_of_freedom_are_those_of_welch_and_satterthwaite(reduction):
    budget = position_budget(reduction, "verification_before", 0)
    scatter, scale = (entry.contribution_m for entry in budget.entries)
    assert budget.entries[0].degrees_of_freedom == 29
    assert budget.effective_degrees_of_freedom == pytest.approx((scatter**2 + scale**2) ** 2 / (scatter**4 / 29))
    assert budget.effective_degrees_of_freedom > 29


def test_the_scale_acts_over_the_reach_of_the_poses(reduction):
    entry = position_budget(reduction, "verification_before", 0).entries[1]
    target = reduction.observations.visits.target_m[reduction.rows("verification_before", 0), :3]
    assert entry.sensitivity == pytest.approx(np.sqrt(np.sum(np.var(target, axis=0))))


def test_nothing_measured_has_no_budget(reduction):
    with pytest.raises(ValueError, match="no pose"):
        position_budget(reduction, "verification_after", 0)
