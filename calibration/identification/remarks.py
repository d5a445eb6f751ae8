"""Warnings about a fit, one sentence each, with the remedy."""

from __future__ import annotations

import numpy as np

from calibration.identification.fit import Fit

SCATTER = 1.5  # chi-square per degree of freedom from which on readings scatter more than stated
QUIET = 0.5  # below which they scatter less
FAR = 5.0  # prior standard deviations from nominal that no tolerance explains
FEW_CHI = 4.0  # standard deviations of chi-square itself
MOST_NAMED = 3


def remarks(fit: Fit) -> tuple[str, ...]:
    """Sentences on convergence, scatter, drives that do not repeat, parameters far outside their tolerances, loads."""
    return (*_convergence(fit), *_scatter(fit), *_positioning(fit), *_far_from_nominal(fit), *_loads(fit))


def _convergence(fit: Fit) -> tuple[str, ...]:
    if fit.converged:
        return ()
    return (
        "the search did not settle: the figures are not to be trusted; check the data, or use the default estimator",
    )


def _scatter(fit: Fit) -> tuple[str, ...]:
    freedom = max(fit.degrees_of_freedom, 1.0)
    spare = FEW_CHI * np.sqrt(2.0 / freedom)
    square = fit.chi2_per_dof if fit.positioning is None else fit.positioning.scatter**2
    sentence = f"the readings scatter {np.sqrt(square):.2g} times as much as is stated of them"
    if square > SCATTER + spare:
        return (
            f"{sentence}: outliers, a wrong unit of their covariance, or an effect that the model leaves out; the "
            "stated uncertainties are too small, look at the residuals",
        )
    if square < QUIET - spare:
        return (f"{sentence}: check the unit of their covariance; the stated uncertainties are too large",)
    return ()


def _positioning(fit: Fit) -> tuple[str, ...]:
    if fit.positioning is None:
        return ()
    return (
        f"the drives are {1e6 * fit.positioning.sd_m:.1f} um (one standard deviation) off anew at each visit: the "
        "machine does not repeat better, or an effect that the model leaves out moves them (diagnose); the standard "
        "uncertainties include it",
    )


def _far_from_nominal(fit: Fit) -> tuple[str, ...]:
    share = np.abs(fit.theta) / fit.model.parameters.sigma
    far = np.flatnonzero(share > FAR)
    if not far.size:
        return ()
    worst = far[np.argsort(-share[far])][:MOST_NAMED]
    named = ", ".join(f"{fit.model.parameters.names[i]} ({share[i]:.0f})" for i in worst)
    more = f" and {far.size - worst.size} more" if far.size > worst.size else ""
    return (
        f"far outside their tolerances (standard deviations): {named}{more}; check units, signs and offsets of the "
        "drives and the machine file",
    )


def _loads(fit: Fit) -> tuple[str, ...]:
    loads = np.unique(fit.visits.payload_kg)
    stiffness = fit.model.parameters.rows("ln_stiffness")
    if not stiffness.size or loads.size > 1 or fit.visits.forces or not fit.model.with_loads:
        return ()
    return ("one payload only: the size of the stiffness stays open; measure with a second, known payload as well",)
