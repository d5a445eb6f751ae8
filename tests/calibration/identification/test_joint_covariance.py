"""The covariance of all unknowns together, against true parameters that were drawn from the priors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.joint_covariance import error_in_directions, fitted, main
from calibration.identification.joint_covariance import joint_covariance

RIGS = 6
DECIDED = 1e-2  # posterior over prior variance of directions that the readings decide


@pytest.mark.parametrize(("name", "overconfident"), [("planar4", 5.0), ("gough8", 2.0)])
def test_well_decided_combinations_hold_the_truth(name, overconfident):
    """Of over-constrained machines, where the covariance at the minimum alone is far too small."""
    fits = [fitted(name, seed) for seed in range(RIGS)]
    linear = np.concatenate([error_in_directions(fit, truth, fit.covariance, DECIDED) for fit, truth in fits])
    joint = np.concatenate([error_in_directions(fit, truth, joint_covariance(fit), DECIDED) for fit, truth in fits])
    assert np.mean(linear**2) > overconfident
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], len(joint)) / len(joint)
    assert low < np.mean(joint**2) < high


def test_a_machine_that_is_not_overconstrained_keeps_its_covariance():
    fit, _ = fitted("stewart6", 1)
    joint = joint_covariance(fit)
    ratio = np.linalg.eigvals(np.linalg.solve(fit.covariance, joint)).real
    assert np.max(ratio) < 1.5
    assert np.median(ratio) < 1.01


def test_single_unknowns_hardly_change():
    fit, _ = fitted("gough8", 2)
    u, linear_u = (np.sqrt(np.diag(c)) for c in (joint_covariance(fit), fit.covariance))
    assert np.all(u >= linear_u)
    assert np.median(u / linear_u) < 1.01


def test_other_estimators_keep_the_error_of_their_regularisation():
    fit, _ = fitted("planar4", 1, "truncated_svd")
    assert joint_covariance(fit) is fit.covariance


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (("--rigs", "-1"), "--rigs is -1; give the number of rigs of each machine, 0 for none"),
        (("--rigs", "0", "--chains", "0"), "--rigs and --chains are both 0"),
        (("--chains", "-1"), "--chains is -1; give 0 to 5"),
        (("--chains", "6"), "--chains is 6; give 0 to 5"),
        (("--steps", "0"), "--steps is 0"),
    ],
)
def test_numbers_of_which_no_table_can_be_made_are_one_line(tmp_path, capsys, bad, said):
    with pytest.raises(SystemExit) as ended:
        main([*bad, "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out").exists()
