"""What simple methods say of a recording: they must lose. Nothing of the diagnosis is used.

Each effect has signatures: what a quantity that follows it looks like over the visits (side of approach, time,
drive coordinate, load ...). `nearest_residual` takes the effect whose signature correlates best with the residuals of
the ordinary identification; `greedy_bic` adds signatures to the nominal machine in a fitted frame as long as BIC
falls. `form_free` only says whether residuals are structured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.frame import station_frame
from calibration.identification.estimators import identify
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.recording import Recording
from calibration.reduction.grouped_readings import group_by_visit
from calibration.reduction.report_frame import fit_report_frame

Array = NDArray[np.float64]

NONE, UNKNOWN = "none", "unknown"
CORRELATED = 0.22  # about four standard deviations of chance over 240 visits
STRUCTURED = 1.35  # residual over stated noise: what drift and other nuisance leave stays below, mostly
PERIODS_M = (0.005, 0.01, 0.02, 0.04)
FINE_PERIODS_M = (1e-4, 2e-4, 4e-4, 1e-3)


def simple_answers(recording: Recording, without: tuple[str, ...] = ()) -> dict[str, str]:
    """A verdict by method."""
    observations, station = _observations(recording)
    signatures = {
        name: columns for name, columns in effect_signatures(recording, observations).items() if name not in without
    }
    fitted = _per_reflector(observations, _after_identification(recording, observations, station))
    plain = _per_reflector(observations, _after_frame(recording, observations, station))
    structured = float(np.sqrt(np.mean(fitted**2))) > STRUCTURED
    return {
        "nearest_residual": nearest(fitted, signatures) if structured else NONE,
        "greedy_bic": greedy_bic(plain, signatures),
        "form_free": UNKNOWN if structured else NONE,
    }


def residuals_after_identification(recording: Recording) -> Array:
    """Whitened residuals (r, 3), model minus measured, of all readings but the nests'."""
    observations, station = _observations(recording)
    return _after_identification(recording, observations, station)


def nearest(residual: Array, signatures: dict[str, list[Array]]) -> str:
    """Effect of the signature that correlates best with any residual (v, k), or none."""
    size = np.linalg.norm(residual - residual.mean(axis=0), axis=0)
    best_score, best_name = CORRELATED, NONE
    for name, columns in signatures.items():
        for column in columns:
            s = column - column.mean()
            norm = np.linalg.norm(s)
            if norm > 0.0:
                score = float(np.max(np.abs(s @ (residual - residual.mean(axis=0))) / (norm * size)))
                if score > best_score:
                    best_score, best_name = score, name
    return best_name


def greedy_bic(residual: Array, signatures: dict[str, list[Array]]) -> str:
    """First effect that is added, or none if BIC does not fall."""
    n = residual.size
    centred = residual - residual.mean(axis=0)
    base = float(n * np.log(np.sum(centred**2) / n))
    best_score, best_name = base, NONE
    for name, columns in signatures.items():
        for column in columns:
            s = column - column.mean()
            power = float(s @ s)
            if power > 0.0:
                remaining = np.sum(centred**2) - np.sum((s @ centred) ** 2) / power
                bic = float(n * np.log(remaining / n) + residual.shape[1] * np.log(n))
                if bic < best_score:
                    best_score, best_name = bic, name
    return best_name


def effect_signatures(recording: Recording, observations: ReflectorObservations) -> dict[str, list[Array]]:
    """Columns (v,) over the visits by effect."""
    _, head = np.unique(observations.visit, return_index=True)
    rows = np.flatnonzero(np.asarray(recording["phase"]) != "nests")[head]
    t = recording["t_rig_s"][rows]
    x = (t - t[0]) / max(float(np.ptp(t)), 1.0)
    load, dwell = recording["payload_mass_kg"][rows], recording["dwell_s"][rows]
    speed, q = recording["speed_m_per_s"][rows], recording.drives("actual_m")[rows]
    side, velocity = recording.drives("direction")[rows], recording.drives("velocity_m_per_s")[rows]
    u = (q - q.mean(axis=0)) / np.maximum(np.ptp(q, axis=0), 1e-9)
    parts = recording.temperatures_c()
    drives = range(q.shape[1])
    exchanges = np.cumsum(np.abs(np.diff(load, prepend=load[0])) > 0.0).astype(float)

    def waves(a: int, periods_m: tuple[float, ...]) -> list[Array]:
        return [f(2.0 * np.pi * q[:, a] / p) for p in periods_m for f in (np.sin, np.cos)]

    return {
        "backlash": [side[:, a] for a in drives],
        "friction_windup": [side[:, a] * (1.0 + load / 400.0) for a in drives],
        "servo_settling": [side[:, a] * speed * np.exp(-dwell / tau) for a in drives for tau in (1.0, 3.0, 9.0)],
        "latency": [velocity[:, a] for a in drives],
        "axis_coupling": [u[:, a] * u[:, 1 - a] for a in drives] if len(drives) == 2 else [],
        "screw_cumulative_error": [f for a in drives for f in (u[:, a] ** 2, u[:, a] ** 3)],
        "screw_periodic_error": [w for a in drives for w in waves(a, PERIODS_M)],
        "encoder_interpolation": [w for a in drives for w in waves(a, FINE_PERIODS_M)],
        "guide_straightness": [w for a in drives for w in waves(a, (0.3, 0.6, 1.2))],
        "guide_angular": [u[:, a] ** 4 for a in drives],
        "column_compliance": [load * u[:, a] for a in drives],
        "link_stiffness": [load],
        "joint_clearance": [np.sign(u[:, a]) * (load > 0.0) for a in drives],
        "link_thermal_growth": [1.0 - np.exp(-3.0 * x), parts.get("struts", t)[rows] if "struts" in parts else x],
        "column_thermal_growth": [(1.0 - np.exp(-3.0 * x)) * u[:, a] for a in drives],
        "screw_thermal_growth": [x * u[:, a] for a in drives],
        "foundation_settling": [1.0 * (x > onset) for onset in (0.3, 0.5, 0.7)],
        "tracker_drift": [x],
        "refraction": [u[:, 0] * np.abs(u[:, 0])],
        "smr_reseat": [exchanges % 2.0, *(1.0 * (x > onset) for onset in (0.25, 0.4, 0.6))],
    }


def _observations(recording: Recording) -> tuple[ReflectorObservations, StationModel]:
    machine = recording.machine
    rows = np.flatnonzero(np.asarray(recording["phase"]) != "nests")
    observations = group_by_visit(recording, rows, recording.positions_m, recording.covariances_m2).observations
    entry = recording.file.station
    frame = fit_report_frame(machine, observations, station_frame(entry.position_m, entry.heading_rad)).frame
    smrs = tuple(sorted(set(observations.smr.tolist())))
    station = StationModel.from_accuracy(frame, smrs, entry.accuracy.to_station_accuracy())
    return observations, replace(station, refraction_u_per_m=0.0)


def _after_identification(recording: Recording, observations: ReflectorObservations, station: StationModel) -> Array:
    """Whitened residuals (r, 3) of the ordinary identification."""
    model = Model(ParameterSet.of(recording.machine))
    readings = SmrPositions(observations, station)
    fit = identify(model, observations.visits, [readings])
    unknowns_of_station = fit.unknowns[len(model) :]
    return readings.compare(
        fit.predict(observations.visits), observations.visit[:, None], unknowns_of_station, derivatives=False
    ).residual


def _after_frame(recording: Recording, observations: ReflectorObservations, station: StationModel) -> Array:
    """Whitened residuals (r, 3) of the nominal machine, frame and reflectors fitted, geometry not."""
    model = Model(ParameterSet.of(recording.machine))
    readings = SmrPositions(observations, station)
    poses = model.predict(np.zeros(len(model)), observations.visits, observations.visits.target_m)
    unknowns = station.unknowns(recording.machine)
    unknowns_of_station = np.zeros(len(unknowns))
    prior = np.array([1.0 / u.sigma for u in unknowns])
    for _ in range(2):
        compared = readings.compare(poses, observations.visit[:, None], unknowns_of_station)
        jacobian = np.concatenate([compared.by_own.reshape(-1, len(unknowns_of_station)), np.diag(prior)])
        right_side = np.concatenate([compared.residual.ravel(), prior * unknowns_of_station])
        unknowns_of_station = unknowns_of_station - np.linalg.lstsq(jacobian, right_side, rcond=None)[0]
    return readings.compare(poses, observations.visit[:, None], unknowns_of_station, derivatives=False).residual


def _per_reflector(observations: ReflectorObservations, residual: Array) -> Array:
    """One row a visit: residuals (v, k) of every reflector's coordinates; a reading that is missing is zero."""
    smrs = sorted(set(observations.smr.tolist()))
    out = np.zeros((len(observations.visits), 3 * len(smrs)))
    for column, smr in enumerate(smrs):
        rows = np.flatnonzero(observations.smr == smr)
        out[observations.visit[rows], 3 * column : 3 * column + 3] = residual[rows]
    return out
