"""Where the model of a recording is linear with all disturbances that its rig declares, and its columns there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.disturbances import disturbance_columns
from calibration.diagnosis.linearisation import LinearisationPoint, Unknowns, linearise, linearise_at, most_likely
from calibration.diagnosis.nest_readings import columns_of_all_readings, nest_columns
from calibration.diagnosis.observed_model import ObservedModel
from calibration.effects.context import ReadingContext, context_of_recording
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions
from calibration.instruments.station_geometry import whitening
from calibration.recording.recording import Recording
from calibration.reduction.part_temperatures import PartSensor

# Steps with disturbances, how far in tolerances an unknown moves at least for one more, and how much closer to their
# nominal values all together have to come.
MOST_STEPS, NEAR_SIGMA, CLOSER = 3, 1.0, 0.7


@dataclass(frozen=True)
class AllColumns:
    """Of all readings: whiten (n, 3, 3), residual (n, 3), and columns (n, 3, c) with their names: of_calibration of
    unknowns and nests, then those of disturbances."""

    observed: ObservedModel
    whiten: Array
    columns: Array
    residual: Array
    names: tuple[str, ...]
    of_calibration: int


def linearise_with_disturbances(
    used: Recording,
    unknowns: Unknowns,
    observations: ReflectorObservations,
    setups: Setups,
    visit: NDArray[np.intp],
    smr: NDArray[np.intp],
    sensors: Mapping[str, PartSensor],
    held: Mapping[str, float] | None,
) -> tuple[LinearisationPoint, AllColumns]:
    """The point and all columns there; visit, smr (n,): of each reading used, held: as `linearise` has them.

    What a station that drifts for days reads draws the geometry to where the model is another. An effect may too, and
    disturbances that have to stand for it would draw it farther: no step is taken that does not lead back.
    """
    readings, campaign = SmrPositions(observations, unknowns.station), used.file.campaign
    context, machine = context_of_recording(used), slice(unknowns.of_model)
    point = linearise(unknowns, readings, campaign, held)
    every = _all_columns(point, used, context, unknowns, setups, visit, smr, sensors)
    for _ in range(MOST_STEPS):
        values = most_likely(unknowns, every.columns, every.residual, held)
        before, after = (each[machine] / unknowns.sigma[machine] for each in (point.values, values))
        if np.max(np.abs(after - before)) < NEAR_SIGMA or np.linalg.norm(after) > CLOSER * np.linalg.norm(before):
            break
        point = linearise_at(unknowns, readings, campaign, values, point.poses.equilibrium.coordinates())
        every = _all_columns(point, used, context, unknowns, setups, visit, smr, sensors)
    return point, every


def _all_columns(
    point: LinearisationPoint,
    used: Recording,
    context: ReadingContext,
    unknowns: Unknowns,
    setups: Setups,
    visit: NDArray[np.intp],
    smr: NDArray[np.intp],
    sensors: Mapping[str, PartSensor],
) -> AllColumns:
    setup, nuisance = setups.rows(used["station"]), used.file.nuisance
    observed = ObservedModel(
        machine=used.machine,
        context=context,
        smr=smr,
        visit=visit,
        poses=point.poses,
        frame=unknowns.station.frame(point.values[unknowns.of_model :]),
        mounted_m=unknowns.mounted_m(used.machine, point.values),
        position_m=used.positions_m,
        station_m=setups.translation_m[setup],
    )
    # A reflector may be put into its floor nest anew for each check.
    seat_m2 = nuisance.reseat_m**2 * observed.on_floor[:, None, None] * np.eye(3)
    whiten = whitening(used.covariances_m2 + seat_m2, used.positions_m)
    by_unknowns, residual = columns_of_all_readings(observed, whiten, unknowns, point, setup)
    by_nests, nest_names = nest_columns(observed, whiten)
    by_disturbances, disturbance_names = disturbance_columns(
        observed, whiten, nuisance, used.file.station.accuracy, used.file.nest_limit_m, sensors
    )
    return AllColumns(
        observed,
        whiten,
        np.concatenate([by_unknowns, by_nests, by_disturbances], axis=2),
        residual,
        (*unknowns.names, *nest_names, *disturbance_names),
        by_unknowns.shape[2] + by_nests.shape[2],
    )
