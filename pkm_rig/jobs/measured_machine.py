"""`import printer.cfg` and `identify` of a measurement folder: a machine measured by anything but reflectors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.estimators import identify
from calibration.identification.explanations import Explanation, explanations, group_indistinguishable
from calibration.identification.fit import Estimator, Fit
from calibration.identification.joint_covariance import joint_covariance
from calibration.identification.leave_one_out import LeaveOneOutErrors, leave_one_out
from calibration.identification.measured_gate import without_wrong_readings
from calibration.identification.observability import Observability, observability_of
from calibration.identification.positioning import with_positioning
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import COORDINATES
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.delta_printer import machine_with_measurements
from calibration.recording.header import STORE_FILES
from calibration.recording.klipper import read_printer
from calibration.recording.measurement_folder import (
    MeasuredMachine,
    is_measurement_folder,
    read_measurements,
    write_measurements,
)
from calibration.reduction.data_checks import require_enough_poses
from calibration.reduction.part_temperatures import most_likely_temperatures_of_folder, remarks_on_sensors
from pkm_rig.report.notation import plain_number
from pkm_rig.results.unknowns import kind_in_words

MIN_DOF = 10  # degrees of freedom below which a residual says little: its own relative uncertainty is 1 / sqrt(2 FEW)
MIN_REMAINING_SHARE = 0.8  # of the readings' numbers; with less left over the fit follows its readings
MAX_TERMS = 4  # largest number of parameters in a combination that is listed
HIGH_SCATTER = 2.0  # ratio to the stated deviations above which it is reported
ALIASED_SHARE = 0.01  # share of an effect that is left after the owner's fit, below which it is called aliased with it


def find_measurement_folder(what: str, out: Path) -> MeasuredMachine | None:
    """A measurement folder by its path or its name in `out`; None if it is none."""
    for folder in (Path(what), out / what):
        if is_measurement_folder(folder):
            return read_measurements(folder)
    return None


def printer_name(path: Path) -> str:
    """Name of the calibration that a printer.cfg holds, and of its folder: the file's, where it can be one."""
    name = re.sub(r"[^A-Za-z0-9._-]", "-", path.stem).lstrip("._-")[:100]
    return name if name and not name.lower().startswith(STORE_FILES) else "printer"


def import_printer(path: Path, folder: Path) -> dict[str, Any]:
    """Write the calibration that a printer.cfg holds as a measurement folder; its summary (docs/reference/json.md)."""
    printer = read_printer(path)
    name = printer_name(path)
    measured = machine_with_measurements(printer, name, f"Klipper's delta_calibrate block in {path.name}"[:1000])
    write_measurements(measured, folder)
    counted = {_reading_kind(r): len(r) for r in measured.readings()}
    return {"campaign": name, "readings": sum(counted.values()), **counted, "folder": str(folder)}


def identify_measurements(measured: MeasuredMachine, estimator: str) -> dict[str, Any]:
    """Identification of a measurement folder (docs/reference/json.md). InputError where nothing can be said of it."""
    if estimator not in get_args(Estimator) or estimator == "truncated_svd":
        known_estimators = ", ".join(e for e in get_args(Estimator) if e != "truncated_svd")
        raise InputError(f"estimator '{estimator}' is not known for a measurement folder; use {known_estimators}")
    chosen: Estimator = estimator  # type: ignore[assignment]
    readings = measured.readings()
    numbers = sum(len(r) * r.width for r in readings)
    former = measured.file.former
    if former is not None and numbers <= former.parameters:
        raise InputError(
            f"{measured.file.name}: {numbers} readings leave no degrees of freedom for {former.parameters} parameters; "
            "measure more poses"
        )
    measured, sensors = most_likely_temperatures_of_folder(measured)
    measured, left_out = without_wrong_readings(measured)
    readings = measured.readings()
    numbers = sum(len(r) * r.width for r in readings)
    require_enough_poses(measured.machine, measured.visits.target_m)
    model = Model(measured.parameters())
    fit = with_positioning(identify(model, measured.visits, readings, chosen))
    observed = observability_of(fit)
    out: dict[str, Any] = {
        "calibration": measured.file.name,
        "source": measured.file.source,
        "estimator": chosen,
        "readings": {_reading_kind(r): len(r) for r in readings},
        "left_out": [reading.as_dict() for reading in left_out],
        "parameters": _parameters(fit),
        "quantities": _quantities(measured, fit),
        **_figures(fit),
        "rank": observed.n_determined,
        "machine_parameters": len(model.parameters),
        "unknowns": fit.layout.size,
        "former": None,
        "explanations": [],
        "alike": [],
        "aliased": list(observed.sentences),
        "aliased_in_short": list(_short_sentences(observed)),
    }
    if former is not None:
        previous_fit = _fit_as_owner_did(measured, former.unknowns)
        candidates = explanations(previous_fit, model, readings)
        groups = group_indistinguishable(candidates, numbers)
        out["former"] = {
            "parameters": former.parameters,
            "unknowns": list(former.unknowns),
            "bare_degrees_of_freedom": numbers - former.parameters,
            "quantities": _quantities(measured, previous_fit),
            **_figures(previous_fit),
        }
        out["explanations"] = [_explanation(e) for e in candidates]
        out["alike"] = [[e.kind for e in group] for group in groups if len(group) > 1]
    out["remarks"] = [*remarks_on_sensors(sensors), *_remarks(out, numbers)]
    return out


def _fit_as_owner_did(measured: MeasuredMachine, kinds: Sequence[str]) -> Fit:
    """The owner's kinds of unknowns by least squares, without unknowns for the instruments."""
    model = Model(ParameterSet.of(measured.machine, tuple(kinds)))
    return identify(model, measured.visits, measured.readings(instrument_unknowns=False), "least_squares")


def _parameters(fit: Fit) -> dict[str, Any]:
    u = np.sqrt(np.diag(fit.covariance))
    return {
        unknown.name: {
            "value": float(value),
            "u": float(size),
            "unit": unknown.unit,
            "observable": bool(size < 0.5 * unknown.sigma),
        }
        for unknown, value, size in zip(fit.layout.unknowns, fit.unknowns, u, strict=True)
    }


def _quantities(measured: MeasuredMachine, fit: Fit) -> dict[str, Any]:
    """The numbers that the owner knows the machine by, with standard uncertainties."""
    names = fit.model.parameters.names
    count = len(names)
    covariance = joint_covariance(fit)[:count, :count] if measured.file.quantities else np.zeros((count, count))
    out = {}
    for quantity in measured.file.quantities:
        by = np.array([quantity.of.get(name, 0.0) for name in names])
        u = float(np.sqrt(max(0.0, by @ covariance @ by)))
        value = quantity.nominal + float(by @ fit.theta)
        out[quantity.name] = {"value": value, "u": u, "unit": quantity.unit, "nominal": quantity.nominal}
    return out


def _figures(fit: Fit) -> dict[str, Any]:
    """Residual, leave-one-out error and its bound, by kind of reading and for all lengths and all angles together."""
    left = leave_one_out(fit)
    return {
        "residual": _by_kind(fit.instruments, left, "residual"),
        "leave_one_out": _by_kind(fit.instruments, left, "error"),
        "held_out": _rms_by_unit(fit.instruments, left, "error"),
        "bound": _rms_by_unit(fit.instruments, left, "u"),
        "effective_unknowns": sum(r.residual.size for r in left) - fit.degrees_of_freedom,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "chi2_per_dof": fit.chi2_per_dof,
        "positioning_sd_m": fit.positioning_sd_m,
    }


def _in_si(readings: Readings, part: Array) -> list[tuple[str, str, Array]]:
    """Name, unit and values (r,) of each number of a reading, in SI."""
    if isinstance(readings, ToolCoordinates):
        return [
            (COORDINATES[c], "rad" if c > 2 else "m", part[:, i] * readings.sigma[:, i])
            for i, c in enumerate(readings.coordinates)
        ]
    return [("distance", "m", part[:, 0] * readings.sigma_m)]  # type: ignore[attr-defined]


def _by_kind(instruments: Sequence[Readings], left: Sequence[LeaveOneOutErrors], field: str) -> dict[str, float]:
    return {
        f"{name}_rms_{unit}": float(np.sqrt(np.mean(values**2)))
        for readings, part in zip(instruments, left, strict=True)
        for name, unit, values in _in_si(readings, getattr(part, field))
    }


def _rms_by_unit(
    instruments: Sequence[Readings], left: Sequence[LeaveOneOutErrors], field: str
) -> dict[str, float | None]:
    """None where no such number was read."""
    values_by_unit: dict[str, list[Array]] = {"m": [], "rad": []}
    for readings, part in zip(instruments, left, strict=True):
        for _, unit, values in _in_si(readings, getattr(part, field)):
            values_by_unit[unit].append(values)
    rms = {unit: float(np.sqrt(np.mean(np.concatenate(v) ** 2))) if v else None for unit, v in values_by_unit.items()}
    return {"position_rms_m": rms["m"], "orientation_rms_rad": rms["rad"]}


def _reading_kind(readings: Readings) -> str:
    if isinstance(readings, ToolCoordinates):
        return "heights" if readings.coordinates == (2,) else "coordinates"
    return "distances"


def _short_sentences(observed: Observability) -> tuple[str, ...]:
    """Sentences on what stays open with few parameters in it, and how many others there are."""
    few = tuple(c for c in observed.open_combinations if len(c.coefficients) <= MAX_TERMS)
    sentences = replace(observed, open_combinations=few).sentences
    others = len(observed.open_combinations) - len(few)
    return (*sentences, f"{others} more combinations of many parameters") if others else sentences


def _explanation(explanation: Explanation) -> dict[str, Any]:
    return {
        "kind": explanation.kind,
        "rms": explanation.size,
        "unit": explanation.unit,
        "share": explanation.share,
        "prior_standard_deviations": explanation.prior_deviations,
        "absorbed": explanation.absorbed,
    }


def _remarks(result: dict[str, Any], numbers: int) -> list[str]:
    """What must be said beside the figures."""
    out = []
    figures = result if result["former"] is None else result["former"]
    dof, scatter = figures["degrees_of_freedom"], float(np.sqrt(figures["chi2_per_dof"]))
    followed = plain_number(figures["effective_unknowns"])
    if dof < MIN_DOF or dof < MIN_REMAINING_SHARE * numbers:
        out.append(
            f"the residual is no accuracy: {followed} unknowns followed {numbers} numbers read (degrees of freedom "
            f"left: {plain_number(dof, 2)}); the leave-one-out error is what a new reading would show"
        )
    if scatter > HIGH_SCATTER:
        out.append(
            f"the readings scatter {scatter:.1f} times as much as is stated of them: the model leaves something out, "
            "or the stated deviations are too small; every U here is too small by about as much"
        )
    if hidden := [kind_in_words(e["kind"]) for e in result["explanations"] if 1.0 - e["absorbed"] < ALIASED_SHARE]:
        out.append(
            f"aliased with what the owner fitted (less than {ALIASED_SHARE:.0%} of what they do to the readings is "
            f"left): {', '.join(hidden)}"
        )
    for group in result["alike"]:
        out.append(
            f"not told apart by these readings: {', '.join(kind_in_words(kind) for kind in group)}; each explains the "
            "residual as well as the others, and sag and play, which no parameter stands for, may too"
        )
    return out
