"""FIGAROH's solver on our residual.

Its kinematics are of serial chains, so its models cannot describe these machines; its solver can be used alone: a
calibration class whose residual is given. It is scipy's `least_squares`, MINPACK's Levenberg-Marquardt with 2-point
differences, with prior weights as further rows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from calibration.base.arrays import Array


def minimise(base: type[Any], residual: Callable[[Array], Array], unknowns: int) -> tuple[Array, int]:
    """The minimum (u,) of residuals (m,) with unit priors, from zero, and the number of evaluations.

    base: `figaroh.calibration.base_calibration.BaseCalibration`.
    """

    class Given(base):  # type: ignore[misc]
        """A calibration without a robot: only the solver is used."""

        def __init__(self) -> None:
            self.calib_config = {"prior_weights": np.ones(unknowns), "outlier_eps": None}
            self.PEE_measured, self.q_measured = np.zeros(1), np.zeros(1)

        def cost_function(self, var: Array) -> Array:
            """The residual that was given."""
            return residual(var)

        def get_pose_from_measure(self, res_: Array) -> Array:
            """Not used: nothing is reported."""
            return np.zeros(1)

        def _compute_logmap_residuals(self, *_: Any) -> Array:
            return np.zeros(1)

        def _sample_position_errors(self, residuals: Array) -> None:
            return None

    result, _ = Given().solve_optimisation(var_init=np.zeros(unknowns), max_iterations=1)
    return np.asarray(result.x), int(result.nfev)
