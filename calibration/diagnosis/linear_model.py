"""The linear model of a recording: residuals of the readings and their derivatives with respect to every unknown.

Geometry, stiffness, mounting and frame remain unknowns with their priors, together with the declared disturbances, so
that an effect is credited only with what they cannot explain. Rows are readings (n) of three whitened coordinates each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.outliers import are_elsewhere
from calibration.diagnosis.disturbed_recording import linearise_with_disturbances
from calibration.diagnosis.linearisation import Unknowns
from calibration.diagnosis.linearised_readings import (
    GapScale,
    LinearisedReadings,
    OffTogether,
    inverse_covariance_factor,
)
from calibration.diagnosis.one_by_one import whitening_of_each
from calibration.diagnosis.outlying_readings import JudgedReadings, judge_readings, lengths_m
from calibration.diagnosis.reading_weights import SecondJudgement, weights_by_model
from calibration.diagnosis.repeated_visits import scatter_over_visits
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.model.payload import PayloadEntry
from calibration.recording.header import AccuracyEntry, DisturbanceLevels
from calibration.recording.recording import Recording
from calibration.reduction.data_checks import require_enough_visits
from calibration.reduction.grouped_readings import group_by_visit, reflector_indices
from calibration.reduction.left_out import GIANT, LeftOutReading
from calibration.reduction.part_temperatures import most_likely_temperatures
from calibration.reduction.recording_setups import in_first_frame, setups_of

GATINGS = 8
PHASES = ("calibration", "repeatability", "nests", "verification_before")


@dataclass(frozen=True)
class LinearModel(LinearisedReadings):
    """The linearised readings of a recording: reflectors' positions, three numbers each.

    rows (n,): rows of the recording that are used; wrong (k,): those of left_out. values (u,):
    unknowns of model and station, where it is linear. station: as fitted; setup (n,): its row. weight (n,): by which
    whitened readings are multiplied (reading_weights).
    """

    station: StationModel
    setup: NDArray[np.intp]
    recording: Recording
    rows: NDArray[np.intp]
    wrong: NDArray[np.intp]
    values: Array
    weight: Array

    @property
    def campaign(self) -> str:
        """Name of the campaign."""
        return self.recording.file.campaign

    @property
    def levels(self) -> DisturbanceLevels:
        """Levels of the ordinary disturbances."""
        return self.recording.file.nuisance

    @property
    def accuracy(self) -> AccuracyEntry:
        """What is stated of the station."""
        return self.recording.file.station.accuracy

    @property
    def payloads(self) -> Sequence[PayloadEntry]:
        """What was mounted, by number from 0 (none)."""
        return self.recording.file.payloads

    @property
    def load(self) -> NDArray[np.intp]:
        """Number (n,) of the payload at each reading."""
        return np.asarray(self.recording["payload"][self.rows]).astype(np.intp)

    @property
    def visit_number(self) -> NDArray[np.intp]:
        """Number (n,) of the visit in the recording."""
        return np.asarray(self.recording["visit"][self.rows]).astype(np.intp)

    @property
    def source_rows(self) -> NDArray[np.intp]:
        """Rows (n,) of the recording."""
        return self.rows

    @property
    def moves(self) -> NDArray[np.intp]:
        """Coordinates of a place in which the platform moves."""
        return self.machine.dof[self.machine.dof < 3]

    @cached_property
    def gap_scale(self) -> GapScale:
        """The platform's reflectors, in the coordinates of the machine's frame in which it moves."""
        rows = np.flatnonzero(self.on_platform)
        metres = np.einsum("ci,nij->ncj", self.frame.rotation.T[self.moves], np.linalg.inv(self.whiten[rows]))
        return GapScale(rows, metres, np.sum(metres**2, axis=2))

    @property
    def degrees_of_freedom(self) -> float:
        """Numbers read less those that the calibration's unknowns used up."""
        return self.residual.size - float(np.sum(self.q_of_calibration**2))

    def places(self) -> Array:
        """Commanded coordinates (v, c) of each visit."""
        return self.poses.visits.target_m[:, self.machine.commanded]

    def with_levels(self, levels: DisturbanceLevels, scales: Array) -> LinearModel:
        """The same with other levels of the disturbances: scales (b,) on the columns' prior standard deviations."""
        file = self.recording.file.model_copy(update={"nuisance": levels})
        columns = self.columns * scales
        return replace(
            self,
            recording=replace(self.recording, file=file),
            sigma=self.sigma * scales[: len(self.sigma)],
            columns=columns,
            q=inverse_covariance_factor(columns),
        )

    def scattering(self, times: float) -> LinearModel:
        """The same with readings that scatter so many times as much as the station's accuracy says."""
        return self.reweighted(self.weight / times)

    def off_together(self) -> OffTogether:
        """By what the readings of a visit are off where drives stand off anew at each."""
        return OffTogether(self.drive_responses(), self.visit)

    def standing_off(self, sd_m: float) -> LinearModel:
        """The same on a machine whose drives stand off anew at each visit."""
        if sd_m == 0.0:
            return self
        turn = whitening_of_each(self.off_together(), sd_m)
        columns = turn @ self.columns
        return replace(
            self,
            whiten=turn @ self.whiten,
            residual=(turn @ self.residual[:, :, None])[:, :, 0],
            columns=columns,
            q=inverse_covariance_factor(columns),
        )

    def reweighted(self, weight: Array) -> LinearModel:
        """The same with other weights (n,) of the readings."""
        scale = weight / self.weight
        columns = self.columns * scale[:, None, None]
        return replace(
            self,
            whiten=self.whiten * scale[:, None, None],
            residual=self.residual * scale[:, None],
            columns=columns,
            q=inverse_covariance_factor(columns),
            weight=weight,
        )

    def rms_sigma(self, whitened: Array) -> float:
        """RMS in sigma over the moving coordinates of the platform's readings, of whitened shifts (n, 3)."""
        rows = self.on_platform
        return float(np.sqrt(np.sum(whitened[rows] ** 2) / (len(self.moves) * max(int(rows.sum()), 1))))

    def rms_shift_sigma(self, whitened: Array) -> float:
        """RMS shift of the platform's reflectors in sigma, from whitened shifts (n, 3).

        Of the coordinates in which the platform moves, one by one. Sigma is the angles' stated standard deviation times
        the distance: that of a coordinate across the line of sight (docs/reference/definitions.md).
        """
        rows = np.flatnonzero(self.on_platform)
        if not rows.size:
            return 0.0
        shift_m = np.linalg.solve(self.whiten[rows], whitened[rows, :, None])[:, :, 0] @ self.frame.rotation
        sigma_m = self.accuracy.angle_sd_rad * np.linalg.norm(self.sight_m[rows], axis=1)
        return float(np.sqrt(np.mean((shift_m[:, self.moves] / sigma_m[:, None]) ** 2)))

    def gap_by_shift(self, shift_m: Array) -> Array:
        """Shifts (m, c) of the platform's reflectors in the coordinates in which it moves."""
        return shift_m[self.gap_scale.rows][:, self.moves]

    def gap_by_visit(self, gap_m: Array) -> tuple[NDArray[np.intp], Array]:
        """Mean gap of the platform's reflectors at each visit."""
        numbers, index = np.unique(self.visit[self.gap_scale.rows], return_inverse=True)
        out = np.zeros((len(numbers), 3))
        for k, c in enumerate(self.moves):
            out[:, c] = np.bincount(index, gap_m[:, k])
        return numbers, np.asarray(out / np.bincount(index)[:, None])

    def lengths_m(self, whitened: Array) -> Array:
        """Shifts (m, 3, 1) of the platform's reflectors."""
        return np.asarray(np.linalg.solve(self.whiten, whitened[:, :, None])[self.on_platform])

    def predicted(self, differences: Array) -> Array:
        """Predicted positions (n, 3) in the station's frame."""
        return np.asarray(self.position_m - np.linalg.solve(self.whiten, differences[:, :, None])[:, :, 0])

    def repeatability_m(self) -> float | None:
        """RMS scatter of the platform's reflectors over visits of one target, approach and payload.

        In the machine's frame, per moving coordinate, at rest, of the mean of what was read of a reflector at a visit;
        None if no target was visited LEAST_REPEATED times under the same conditions.
        """
        context, moves = self.context, self.moves
        rows = np.flatnonzero(self.on_platform & ~context.moving)
        position_m = ((self.position_m[rows] - self.frame.translation_m) @ self.frame.rotation)[:, moves]
        target = np.round(self.poses.visits.target_m[self.visit[rows]], 7)
        conditions = np.column_stack([target, context.direction[rows], context.payload_kg[rows], self.smr[rows]])
        return scatter_over_visits(position_m, conditions, self.visit[rows])


def require_recording(linear: LinearisedReadings) -> LinearModel:
    """The same, if it is of a recording. Raises InputError otherwise."""
    if not isinstance(linear, LinearModel):
        raise InputError(f"{linear.campaign}: a twin is of a recording, this is a measurement folder")
    return linear


def linearise_recording(
    recording: Recording, *, judge: bool = True, held: Mapping[str, float] | None = None
) -> LinearModel:
    """Fit the model to a recording and linearise it there, wrong readings left out (outlying_readings).

    judge: whether wrong readings are looked for; the costliest part, in vain where there are none. held: values of
    unknowns, in SI units, at which it is linearised whatever the readings say; the others are fitted. Raises InputError
    if the readings do not allow it.
    """
    usable = usable_rows(recording)
    of_another_place = _readings_of_another_place(recording, usable) if judge else {}
    rows, left_out = np.setdiff1d(usable, list(of_another_place)), tuple(of_another_place.values())
    far_off = np.zeros(0)
    for _ in range(GATINGS):
        linear, judged = _linearise_rows(recording, rows, np.setdiff1d(usable, rows), judge=judge, held=held)
        far_off = far_off if judged is None else judged.far
        linear = replace(linear, left_out=left_out, far_off=far_off)
        wrong = {} if judged is None else judged.named(recording, rows)
        if not wrong:
            break
        left_out = (*left_out, *wrong.values())
        # Giants spoil the fit by which the others are judged; what is wrong beside these hardly moves it.
        rows = np.setdiff1d(rows, list(wrong))
        judge = any(reading.reason == GIANT for reading in wrong.values())
    return linear


def _readings_of_another_place(recording: Recording, rows: NDArray[np.intp]) -> dict[int, LeftOutReading]:
    """Those of some rows (n,) that are nowhere near where the nominal machine has their reflectors: no fit begins with
    them. Of the floor nests, which do not take part in it, none."""
    setups = setups_of(recording)
    used = in_first_frame(recording.take(rows), setups)
    observations, visit, _ = _observations(used, setups)
    require_enough_visits(used.machine, observations.visits.target_m)
    unknowns = Unknowns.of(used, observations, setups)
    readings = SmrPositions(observations, unknowns.station)
    poses = unknowns.model.predict(np.zeros(unknowns.of_model), observations.visits, observations.visits.target_m)
    missed = readings.compare(poses, observations.visit[:, None], np.zeros(len(unknowns.names) - unknowns.of_model))
    miss_m = lengths_m(readings.whiten, missed.residual)
    at_pose, elsewhere = rows[visit >= 0], are_elsewhere(miss_m)
    sigmas = np.linalg.norm(missed.residual, axis=1)
    return {
        int(at_pose[i]): LeftOutReading.of_recording(recording, int(at_pose[i]), miss_m[i], sigmas[i], GIANT)
        for i in np.flatnonzero(elsewhere)
    }


def linearise_again(linear: LinearModel, judged: SecondJudgement) -> LinearModel:
    """The same recording without the readings that are wrong beside the causes, the others weighed anew."""
    recording, keep = linear.recording, judged.readings.keep
    wrong = judged.readings.named(recording, linear.rows)
    all_wrong = np.union1d(linear.wrong, np.array(list(wrong), dtype=np.intp))
    again, _ = _linearise_rows(recording, linear.rows[keep], all_wrong, judge=False, held=None)
    again = again.reweighted(judged.weight[keep])
    return replace(again, left_out=(*linear.left_out, *wrong.values()), far_off=linear.far_off)


def _linearise_rows(
    recording: Recording,
    rows: NDArray[np.intp],
    wrong: NDArray[np.intp],
    *,
    judge: bool,
    held: Mapping[str, float] | None,
) -> tuple[LinearModel, JudgedReadings | None]:
    """The linear model of some rows (n,) without wrong ones (k,), and which of its own are wrong; None: not judged."""
    setups = setups_of(recording.take(np.delete(np.arange(len(recording)), wrong)))
    of_parts, sensors = most_likely_temperatures(recording)
    used = in_first_frame(of_parts.take(rows), setups)
    observations, visit, smr = _observations(used, setups)
    require_enough_visits(used.machine, observations.visits.target_m)
    unknowns = Unknowns.of(used, observations, setups)
    point, at_point = linearise_with_disturbances(used, unknowns, observations, setups, visit, smr, sensors, held)
    observed, whiten = at_point.observed, at_point.whiten
    residual, columns = at_point.residual, at_point.columns
    judged = judge_readings(observed, whiten, residual, columns) if judge else None
    q = inverse_covariance_factor(columns)
    linear = LinearModel(
        **{field.name: getattr(observed, field.name) for field in fields(observed)},
        station=unknowns.station,
        setup=setups.rows(used["station"]),
        recording=recording,
        rows=rows,
        wrong=wrong,
        whiten=whiten,
        residual=residual,
        columns=columns,
        names=at_point.names,
        sigma=unknowns.sigma,
        values=point.values,
        q=q,
        of_calibration=at_point.of_calibration,
        weight=np.ones(len(residual)),
        sensors=sensors,
    )
    weight = weights_by_model(residual, q)
    return linear if weight is None else linear.reweighted(weight), judged


def usable_rows(recording: Recording) -> NDArray[np.intp]:
    """Rows for a diagnosis: calibration, repeatability, nests, verification; no flags of the station, no tables."""
    phase = np.asarray(recording["phase"])
    keep = np.isin(phase, PHASES)
    keep &= (recording["flags"] == 0.0) & ((recording["compensation"] == 0.0) | (phase == "nests"))
    if not np.any(keep & (phase != "nests")):
        raise InputError(
            f"recording {recording.file.campaign}: no unflagged readings without compensation; measure a calibration"
        )
    return np.flatnonzero(keep)


def _observations(used: Recording, setups: Setups) -> tuple[ReflectorObservations, NDArray[np.intp], NDArray[np.intp]]:
    """Readings at poses; of all readings (n,): the row of the visit (-1 for floor nests), the reflector's index."""
    smr = reflector_indices(used)
    rows = np.flatnonzero(np.array([s.on != "floor" for s in used.machine.smrs])[smr])
    observations = group_by_visit(
        used, rows, used.positions_m, used.covariances_m2, setups.rows(used["station"])
    ).observations
    all_visits = np.full(len(smr), -1, dtype=np.intp)
    all_visits[rows] = observations.visit
    return observations, all_visits, smr
