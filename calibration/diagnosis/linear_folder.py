"""The linear model of a measurement folder: coordinates of the tool and distances, one number a row.

A coordinate is a row. A distance between two visits is two rows, one at each end, since an effect acts at each as the
machine was there: with r1 and r2 the whitened responses of the ends to the distance, the rows have sqrt(2) r1 and
sqrt(2) r2, each holds the reading over sqrt(2), and the rows' difference is left open by an unknown of their own. What
is not open, (row 1 + row 2) / sqrt(2) = r1 + r2 with unit noise, is the distance.

Where the folder says of a former fit which kinds of unknowns it varied, the machine is as that fit leaves it: those
kinds are fitted, and what it left alone may be the cause of what is left (`left_alone`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.diagnosis.disturbances import machine_disturbance_columns
from calibration.diagnosis.folder_context import context_of_visits
from calibration.diagnosis.folder_fit import fit_folder
from calibration.diagnosis.folder_rows import NO_AXIS, FolderRows, rows_of
from calibration.diagnosis.linearised_readings import (
    GapScale,
    LinearisedReadings,
    Load,
    OffTogether,
    inverse_covariance_factor,
)
from calibration.diagnosis.observed_model import TOOL, ObservedModel
from calibration.diagnosis.one_by_one import whitening_of_each
from calibration.identification.measured_gate import without_wrong_readings
from calibration.model.model import Unknown
from calibration.model.payload import PayloadEntry
from calibration.model.visits import Visits
from calibration.recording.header import DeclaredLevels, DisturbanceLevels
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.reduction.data_checks import require_enough_poses
from calibration.reduction.part_temperatures import most_likely_temperatures_of_folder

MOST_AT_VISITS = 600  # drives at visits, where there are distances: of more, what each is off by would take too long


@dataclass(frozen=True)
class LinearFolder(LinearisedReadings):
    """The linearised readings of a measurement folder.

    measured: without the readings of left_out. rows: what each row is. used (v,): rows of the folder's visits.
    declared: levels of the disturbances. left_unknowns: those whose responses are in `left_alone`, in its order.
    """

    measured: MeasuredMachine
    rows: FolderRows
    used: NDArray[np.intp]
    declared: DisturbanceLevels
    left_unknowns: tuple[Unknown, ...]

    @property
    def campaign(self) -> str:
        """Name of the calibration."""
        return self.measured.file.name

    @property
    def levels(self) -> DisturbanceLevels:
        """Default levels: a folder declares none."""
        return self.declared

    @property
    def accuracy(self) -> None:
        """There is no station."""
        return None

    @property
    def payloads(self) -> Sequence[PayloadEntry]:
        """Nothing is stated of them but their masses and centres."""
        return ()

    @cached_property
    def _loads(self) -> tuple[Array, NDArray[np.intp]]:
        different, load = different_loads(self.measured.visits)
        return different, load[self.used[self.visit]]

    @property
    def loads(self) -> Sequence[Load]:
        """What visits of the folder carried, the lightest first."""
        return [Load(float(mass), (float(x), float(y), float(z))) for mass, x, y, z in self._loads[0]]

    @property
    def load(self) -> NDArray[np.intp]:
        """Number (n,) of the load at each reading."""
        return self._loads[1]

    @property
    def read_shares(self) -> Array:
        """1 along axes that are read; of distances alone, which lie in any direction, the same along all."""
        read = np.unique(self.rows.axis[self.rows.axis != NO_AXIS])
        return np.isin(np.arange(3), read).astype(np.float64) if read.size else np.full(3, 3.0**-0.5)

    @property
    def sigma_of_length_m(self) -> float:
        """Median standard deviation of the lengths read."""
        return float(np.median(self.rows.sigma[self.rows.is_length]))

    @property
    def visit_number(self) -> NDArray[np.intp]:
        """Number (n,) of the visit in the folder; of a distance that of its first one."""
        return np.asarray(self.measured.number[self.used[self.visit]]).astype(np.intp)

    @property
    def source_rows(self) -> NDArray[np.intp]:
        """Number (n,) of the reading of its kind."""
        return self.rows.reading

    @property
    def home_visit(self) -> NDArray[np.intp]:
        """A distance is withheld with its first visit."""
        return self.rows.home

    @cached_property
    def gap_scale(self) -> GapScale:
        """Lengths that were read: coordinates of the tool, and distances by their first ends."""
        rows = np.flatnonzero(self.rows.is_length & self.rows.is_first)
        sigma = self.rows.sigma[rows]
        ends = np.where(self.rows.has_two_ends[rows], np.sqrt(2.0), 1.0)
        return GapScale(rows, (sigma * ends)[:, None, None], (sigma**2)[:, None])

    @property
    def degrees_of_freedom(self) -> float:
        """Numbers read less those that the calibration's unknowns used up."""
        used = inverse_covariance_factor(self.columns[:, :, : self.of_calibration])
        return self.numbers_read - float(np.sum(used**2))

    @property
    def numbers_read(self) -> int:
        """A distance is one, though it has two ends."""
        return int(self.rows.is_first.sum())

    def scattering(self, times: float) -> LinearFolder:
        """The same with readings that scatter so many times as much as the folder says."""
        return self._with_noise(np.full(len(self.residual), times))

    def standing_off(self, sd_m: float) -> LinearFolder:
        """The same on a machine whose drives stand off anew at each visit.

        Where there are distances it has a column for each drive at each visit: each visit may have many of them.
        """
        if sd_m == 0.0:
            return self
        if not np.any(self.rows.has_two_ends):
            off = OffTogether(self.drive_responses(), self.rows.visit)
            return self._with_noise(1.0 / whitening_of_each(off, sd_m)[:, 0, 0])
        columns = np.concatenate([self.columns, sd_m * self._drives_at_visits()], axis=2)
        names = tuple(f"positioning.{number}" for number in range(columns.shape[2] - len(self.names)))
        return replace(self, columns=columns, names=(*self.names, *names), q=self.rows.factor_of(columns))

    def off_together(self) -> OffTogether | None:
        """What drives do at a visit moves all that was read there; a distance is off by what they do at both."""
        if not np.any(self.rows.has_two_ends):
            return super().off_together()
        if len(self.poses.visits) * len(self.machine.drive_names) > MOST_AT_VISITS:
            return None
        numbers = self.of_numbers(self._drives_at_visits())
        return OffTogether(numbers, np.zeros(len(numbers), dtype=np.intp))

    def _drives_at_visits(self) -> Array:
        """Whitened shifts (n, 1, v d), joined, for one unit of each drive's travel at each visit."""
        response, visit = self.drive_responses(), self.rows.visit
        at = np.zeros((*response.shape[:2], int(visit.max()) + 1, response.shape[2]))
        at[np.arange(len(visit)), :, visit] = response
        return self.joined(at.reshape(*response.shape[:2], -1))

    def of_numbers(self, whitened: Array) -> Array:
        """Those of the first ends, from joined ones."""
        ends = np.where(self.rows.has_two_ends, np.sqrt(2.0), 1.0).reshape(-1, *[1] * (whitened.ndim - 1))
        return np.asarray((ends * whitened)[self.rows.is_first])

    def _with_noise(self, times: Array) -> LinearFolder:
        """The same with so many times (n,) the stated noise, the same at both ends of a distance."""
        columns = self.columns / times[:, None, None]
        return replace(
            self,
            whiten=self.whiten / times[:, None, None],
            residual=self.residual / times[:, None],
            columns=columns,
            q=self.rows.factor_of(columns),
            left_alone={name: column / times[:, None] for name, column in self.left_alone.items()},
            rows=replace(self.rows, whiten=self.rows.whiten / times[:, None, None], sigma=self.rows.sigma * times),
        )

    def places(self) -> Array:
        """Predicted coordinates (v, c) of each visit: commanded ones need not be in the folder."""
        return self.poses.equilibrium.coordinates()[:, self.machine.commanded]

    def joined(self, whitened: Array) -> Array:
        """The mean of the two ends of a distance at each of them."""
        return self.rows.joined(whitened)

    def with_levels(self, levels: DisturbanceLevels, scales: Array) -> LinearFolder:
        """The same with other levels of the disturbances: scales (b,) on the columns' prior standard deviations."""
        columns = self.columns * scales
        sigma = self.sigma * scales[: len(self.sigma)]
        return replace(self, declared=levels, sigma=sigma, columns=columns, q=self.rows.factor_of(columns))

    def factor_of(self, columns: Array) -> Array:
        """q (n, 1, r) of columns (n, 1, b), with what is open of the ends of distances."""
        return self.rows.factor_of(columns)

    def rms_sigma(self, whitened: Array) -> float:
        """RMS in sigma over the numbers read, of whitened shifts (n, 1)."""
        return float(np.sqrt(np.sum(self.joined(whitened) ** 2) / max(int(self.rows.is_first.sum()), 1)))

    def rms_shift_sigma(self, whitened: Array) -> float:
        """The same: sigma is what is stated of each number."""
        return self.rms_sigma(whitened)

    def lengths_m(self, whitened: Array) -> Array:
        """Shifts (m, 1) of the lengths that were read."""
        scale = self.gap_scale
        return np.asarray(np.einsum("ncj,nj->nc", scale.metres, self.joined(whitened)[scale.rows]))

    def gap_by_shift(self, shift_m: Array) -> Array:
        """The same for shifts (n, 3) of the tool."""
        return self.lengths_m(self.whiten_shift(shift_m))

    def gap_by_visit(self, gap_m: Array) -> tuple[NDArray[np.intp], Array]:
        """Gap of the coordinates that were read at each visit, zero in the others; distances are in no direction."""
        rows = self.gap_scale.rows
        axis, visit = self.rows.axis[rows], self.visit[rows]
        along = axis != NO_AXIS
        numbers, index = np.unique(visit[along], return_inverse=True)
        out = np.zeros((len(numbers), 3))
        out[index, axis[along]] = gap_m[along, 0]
        return numbers, out @ self.frame.rotation

    def predicted(self, differences: Array) -> Array:
        """Predicted readings (n, 1), in m or rad."""
        ends = np.where(self.rows.has_two_ends, np.sqrt(2.0), 1.0)
        return (self.rows.value - self.rows.sigma * ends * self.joined(differences)[:, 0])[:, None]

    def repeatability_m(self) -> None:
        """Not known: of each visit there is one reading."""
        return


def different_loads(visits: Visits) -> tuple[Array, NDArray[np.intp]]:
    """Masses and centres (k, 4) that visits carried, the lightest first, and which of them each visit (v,) had."""
    loads = np.column_stack([visits.payload_kg, visits.payload_com_m])
    different, load = np.unique(loads, axis=0, return_inverse=True)
    return different, np.asarray(load).ravel().astype(np.intp)


def linearise_measurements(measured: MeasuredMachine) -> LinearFolder:
    """Fit the model to the readings of a folder and linearise it there, wrong readings left out.

    Raises InputError if the readings do not allow it.
    """
    measured, sensors = most_likely_temperatures_of_folder(measured)
    measured, left_out = without_wrong_readings(measured)
    readings = measured.readings()
    require_enough_poses(measured.machine, measured.visits.drives)
    fit = fit_folder(measured, readings)
    rows = rows_of(readings, fit.local, fit.poses, fit.frame, fit.bowl_m)
    if not np.any(rows.is_length):
        raise InputError(f"{measured.file.name}: only rotations were read; a diagnosis needs lengths, measure some")
    observed = ObservedModel(
        machine=measured.machine,
        context=context_of_visits(measured, fit.used, rows.visit),
        smr=np.full(len(rows), TOOL, dtype=np.intp),
        visit=rows.visit,
        poses=fit.poses,
        frame=fit.frame,
        mounted_m=np.array([*(smr.position_m for smr in measured.machine.smrs), measured.machine.tool_point_m]),
        position_m=fit.poses.tool_m()[rows.visit],
        turns=rows.turns,
    )
    by_unknowns, names, sigma = rows.of_numbers(fit.columns), fit.layout.names, fit.layout.sigma
    fitted = np.flatnonzero(fit.fitted)
    levels = DeclaredLevels()
    by_disturbances, disturbance_names = machine_disturbance_columns(observed, rows.whiten, levels, sensors)
    columns = np.concatenate([by_unknowns[:, :, fitted] * sigma[fitted], rows.joined(by_disturbances)], axis=2)
    return LinearFolder(
        **{f.name: getattr(observed, f.name) for f in fields(ObservedModel)},
        whiten=rows.whiten,
        residual=rows.of_numbers(fit.residual),
        columns=columns,
        names=(*(names[i] for i in fitted), *disturbance_names),
        sigma=sigma[fitted],
        q=rows.factor_of(columns),
        of_calibration=fitted.size,
        left_alone={names[i]: by_unknowns[:, :, i] for i in np.flatnonzero(~fit.fitted)},
        measured=measured,
        rows=rows,
        used=fit.used,
        left_out=left_out,
        declared=levels,
        left_unknowns=tuple(fit.layout.unknowns[i] for i in np.flatnonzero(~fit.fitted)),
        sensors=sensors,
    )
