"""Rigs of the rig study identified every way and scored against the noise-free truth.

Intervals whose coverage is counted come from each fit's own covariance; the bound does not (`rig_bound`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rig_bound import Bound, rms, rms_of_spread
from benchmarks.rig_measured import Rig, measured_targets
from benchmarks.rig_settings import CASES, ESTIMATORS, WITHIN_95, CalibrationCase, Study
from benchmarks.rig_truth import Array, deviations, generator
from calibration.base.errors import InputError
from calibration.identification.estimators import identify
from calibration.identification.fit import Fit
from calibration.identification.rigid.models import RIGID_KINDS, fit_rigid_identifications
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits


def run_rig(study: Study, seed: int) -> dict[str, Any]:
    """One rig through all cases; positions in um, orientations in urad."""
    started = time.monotonic()
    rig = Rig.from_seed(study, seed)
    cases = {case.name: score(rig, case) for case in CASES}
    return {
        "seed": seed,
        "draw": {name: round(rig.errors[name] / size, 6) for name, size in deviations(study.path).items()},
        "cases": cases,
        "seconds": round(time.monotonic() - started, 2),
    }


def score(rig: Rig, case: CalibrationCase) -> dict[str, Any]:
    """Measure, identify and score one case."""
    study, machine = rig.study, rig.machine
    systematic = (
        SystematicUncertainties(study.u_payload_mass, study.u_payload_com_m)
        if case.uncertain
        else SystematicUncertainties()
    )
    model = Model(ParameterSet.of(machine), systematic)
    draws = generator(f"payload {machine.name}", rig.seed)
    off = {u.name: float(draws.standard_normal()) * u.sigma for u in systematic.unknowns(machine.planar)}
    target = measured_targets(machine, study.poses)
    visits = rig.visits_of_all(target, case.measured_kg)
    rng = generator(f"noise {machine.name} {case.name}", rig.seed)
    value = rig.measured(rig.truth(visits, off), rng)
    readings = ToolCoordinates.of(visits, rig.coordinates, value, rig.sigma)
    true_values = np.array([{**rig.errors, **off}[u.name] for u in model.unknowns])

    failed: dict[str, str] = {}
    predictors, best = _predictors(rig, case, model, visits, value, failed)
    held_target = rig.held_out()
    bound = Bound.of(model, true_values, visits, readings)
    own = Bound(model, best.unknowns, best.covariance, np.zeros(len(model)))
    used = {}
    for kg in case.used_kg:
        held_out_visits = rig.visits(held_target, kg)
        true = rig.truth(held_out_visits, off)
        error = {}
        for name, predict in predictors.items():
            rms_error = rms(rig.tool_error(predict(held_out_visits), true))
            if np.all(np.isfinite(rms_error)):
                error[name] = rms_error
            else:
                failed[name] = "no fit, or no equilibrium at a held-out pose"
        spread = own.spread(held_out_visits)[:, :, machine.dof][:, machine.dof]
        white = rig.tool_error(predictors["map"](held_out_visits), true)[:, machine.dof] / np.sqrt(
            np.diagonal(spread, axis1=1, axis2=2)
        )
        apart = rig.tool_error(model.predict(true_values, held_out_visits).equilibrium.coordinates(), true)
        used[f"{kg:g}"] = {
            "error": error,
            "bound": rms_of_spread(bound.spread(held_out_visits)),
            "linear": rms(bound.linear_error(held_out_visits)),
            "covered": [int(c) for c in np.sum(np.abs(white) < WITHIN_95, axis=0)],
            "model_apart_nm": float(np.max(np.abs(apart)) * 1e9),
        }
    z = (best.unknowns - true_values) / np.sqrt(np.diag(best.covariance))
    return {
        "z": {u.name: round(float(value), 4) for u, value in zip(best.layout.unknowns, z, strict=True)},
        "chi2_per_dof": best.chi2_per_dof,
        "degrees_of_freedom": best.degrees_of_freedom,
        "used": used,
        "failed": failed,
    }


def _predictors(
    rig: Rig, case: CalibrationCase, model: Model, visits: Visits, value: Array, failed: dict[str, str]
) -> tuple[dict[str, Callable[[Visits], Array]], Fit]:
    """What predicts platform poses (v, 6), by name, and the default fit; what fails is named."""

    def fit(model: Model, rows: NDArray[np.bool_], estimator: Any = "map", *, robust: bool = False) -> Fit:
        some = ToolCoordinates.of(visits.take(rows), rig.coordinates, value[rows], rig.sigma)
        return identify(model, visits.take(rows), [some], estimator, robust=robust)

    fits_by_key: dict[tuple[object, ...], Fit | None] = {}  # one baseline is a member of another

    def fit_if_any(model: Model, rows: NDArray[np.bool_]) -> Fit | None:
        key = (model.machine.strut_names, tuple(model.machine.nominal.stiffness_n_per_m), rows.tobytes())
        if key not in fits_by_key:
            try:
                fits_by_key[key] = fit(model, rows)
            except InputError:  # a rigid machine with fewer struts may be singular inside the workspace
                fits_by_key[key] = None
        return fits_by_key[key]

    def coordinates_of(one_fit: Fit | None, at: Visits) -> Array:
        return np.full((len(at), 6), np.nan) if one_fit is None else one_fit.predict(at).equilibrium.coordinates()

    everything = np.ones(len(visits), dtype=bool)
    best = fit(model, everything)
    fits = {"map": best}
    if case.compared:
        nominal = replace(model, parameters=ParameterSet.of(rig.machine, RIGID_KINDS))
        fits_of_case: dict[str, Callable[[], Fit]] = {
            name: lambda name=name: fit(model, everything, name) for name in ESTIMATORS if name != "map"
        }
        fits_of_case["map_robust"] = lambda: fit(model, everything, robust=True)
        fits_of_case["map_nominal_stiffness"] = lambda: fit(nominal, everything)
        for name, make in fits_of_case.items():
            try:
                fits[name] = make()
            except InputError as error:
                failed[name] = str(error)
    out = {name: lambda at, one_fit=one_fit: coordinates_of(one_fit, at) for name, one_fit in fits.items()}
    if case.compared:
        measured = rig.platform_measured(visits, value)
        out |= {
            b.name: b.predict
            for b in fit_rigid_identifications(rig.machine, visits, fit_if_any, coordinates_of, measured)
        }
    return out, best
