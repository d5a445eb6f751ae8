"""What the diagnosis asks of linearised readings, whatever instrument took them.

Rows are readings (n) of w whitened numbers each: three coordinates of a reflector in a recording, one number of the
tool in a measurement folder. Every other module of the diagnosis computes with these alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.observed_model import ObservedModel, whitened_shift
from calibration.model.payload import PayloadEntry
from calibration.recording.header import AccuracyEntry, DisturbanceLevels
from calibration.reduction.left_out import LeftOutReading
from calibration.reduction.part_temperatures import PartSensor

NEGLIGIBLE_INFORMATION = 1.0e-2  # information of a direction over its prior's, below which the prior alone counts


@dataclass(frozen=True)
class GapScale:
    """How the gap is stated: of readings rows (m,), c lengths each, metres (m, c, w) of their whitened numbers.

    variance (m, c): of these lengths if every reading has the noise that is stated of it.
    """

    rows: NDArray[np.intp]
    metres: Array
    variance: Array


@dataclass(frozen=True)
class Load:
    """What a visit carried: its mass and centre, platform's frame."""

    mass_kg: float
    com_m: tuple[float, float, float]


@dataclass(frozen=True)
class OffTogether:
    """Readings (r), those of a group (r,) being off by the same d numbers: response (r, w, d), whitened."""

    response: Array
    group: NDArray[np.intp]

    def products(self, columns: Array) -> Array:
        """Products (g, d, k) of the responses with columns (r, w, k), over the readings of each group in its order."""
        groups, of_reading = np.unique(self.group, return_inverse=True)
        if len(groups) == 1:  # of many numbers, whose products for each reading would take too much memory
            flat = self.response.reshape(-1, self.response.shape[2])
            return np.asarray(flat.T @ columns.reshape(-1, columns.shape[2]))[None]
        out = np.zeros((len(groups), self.response.shape[2], columns.shape[2]))
        np.add.at(out, of_reading, np.swapaxes(self.response, 1, 2) @ columns)
        return out

    def by_one(self, drive: int, drives: int) -> OffTogether:
        """Where they are off by one of so many drives alone."""
        return OffTogether(self.response[:, :, drive::drives], self.group)


@dataclass(frozen=True)
class LinearisedReadings(ObservedModel, ABC):
    """Readings, linear in all unknowns of the calibration.

    whiten (n, w, 3): numbers by a shift of what is read, in the instrument's frame. residual (n, w): whitened, measured
    minus modelled, extrapolated linearly to zero values of all unknowns. columns (n, w, b): derivatives by every
    unknown, each times its prior standard deviation; names (b,); sigma (u,): these deviations, of the first u,
    those of the model and its instruments. q (n, w, r): 1 - q q' is the inverse covariance of
    the readings. of_calibration: number of columns before those of the disturbances. left_alone: whitened responses
    (n, w) to one unit of unknowns that the calibration does not fit, by their names; channels 'unknown.NAME'.
    left_out: readings that are none of these, because they do not fit them; far_off (m,): standard deviations by which
    some are off the others and stay, because they are too many to be wrong. sensors: of part temperatures, what is
    known of them.
    """

    whiten: Array
    residual: Array
    columns: Array
    names: tuple[str, ...]
    sigma: Array
    q: Array
    of_calibration: int
    left_alone: Mapping[str, Array] = field(default_factory=dict, kw_only=True)
    left_out: tuple[LeftOutReading, ...] = field(default=(), kw_only=True)
    far_off: Array = field(default_factory=lambda: np.zeros(0), kw_only=True)
    sensors: Mapping[str, PartSensor] = field(default_factory=dict, kw_only=True)

    @property
    @abstractmethod
    def campaign(self) -> str:
        """Name of the campaign."""

    @property
    @abstractmethod
    def levels(self) -> DisturbanceLevels:
        """Levels of the ordinary disturbances."""

    @property
    @abstractmethod
    def accuracy(self) -> AccuracyEntry | None:
        """What is stated of the station; None without one."""

    @property
    @abstractmethod
    def payloads(self) -> Sequence[PayloadEntry]:
        """What was mounted, and how well it is known."""

    @property
    def loads(self) -> Sequence[Load]:
        """What further visits may carry, by number."""
        return [Load(payload.mass_kg, payload.com_m) for payload in self.payloads]

    @property
    @abstractmethod
    def load(self) -> NDArray[np.intp]:
        """Number (n,) of each reading's load."""

    @property
    @abstractmethod
    def visit_number(self) -> NDArray[np.intp]:
        """Number (n,) in the source of each reading's visit; of a distance that of its first one."""

    @property
    def read_shares(self) -> Array:
        """How much a reading says of a shift along each axis (3,): 1 where it is read."""
        return np.ones(3)

    @property
    def sigma_of_length_m(self) -> float:
        """Standard deviation of a typical length read; of several numbers (w) of a reading their geometric mean."""
        square = np.linalg.det(self.whiten @ self.whiten.transpose(0, 2, 1))
        return float(np.median(square ** (-0.5 / self.whiten.shape[1])))

    @property
    @abstractmethod
    def source_rows(self) -> NDArray[np.intp]:
        """Rows (n,) in the source, of each reading."""

    @property
    @abstractmethod
    def gap_scale(self) -> GapScale:
        """The lengths in which the gap is stated, of the readings of the platform."""

    @abstractmethod
    def places(self) -> Array:
        """Where each visit was (v, c), in the coordinates in which regions are withheld."""

    @property
    def numbers_read(self) -> int:
        """How many numbers of independent noise the readings are."""
        return int(self.residual.size)

    @abstractmethod
    def scattering(self, times: float) -> Self:
        """The same with readings that scatter so many times as much as stated, which may be too little."""

    @abstractmethod
    def with_levels(self, levels: DisturbanceLevels, scales: Array) -> LinearisedReadings:
        """The same with other levels of the disturbances: scales (b,) on the columns' prior standard deviations."""

    @abstractmethod
    def rms_sigma(self, whitened: Array) -> float:
        """RMS in sigma over the numbers read of the platform, of whitened shifts (n, w)."""

    @abstractmethod
    def rms_shift_sigma(self, whitened: Array) -> float:
        """RMS shift of the platform in sigma, from whitened shifts (n, w) (docs/reference/definitions.md)."""

    @abstractmethod
    def gap_by_shift(self, shift_m: Array) -> Array:
        """The lengths (m, c) in which the gap is stated, for shifts (n, 3) in the machine's frame."""

    @abstractmethod
    def gap_by_visit(self, gap_m: Array) -> tuple[NDArray[np.intp], Array]:
        """Visits (k,) and the mean gap (k, 3) of each in the machine's frame, from the gap (m, c), for pictures."""

    @abstractmethod
    def lengths_m(self, whitened: Array) -> Array:
        """Shifts in m of what is read of the platform, in any shape, from whitened shifts (n, w)."""

    @abstractmethod
    def predicted(self, differences: Array) -> Array:
        """Predicted readings (n, k), in the units in which they were read, from whitened differences (n, w)."""

    @abstractmethod
    def repeatability_m(self) -> float | None:
        """Noise floor: RMS scatter over repeated visits; None if there are too few."""

    @property
    @abstractmethod
    def degrees_of_freedom(self) -> float:
        """Numbers read less those that the calibration's unknowns used up."""

    def drive_responses(self) -> Array:
        """Whitened shifts (n, w, d) of what is read for one metre of each drive's travel; of a crank, at its joint."""
        shift_m, machine = Channels(self).shift_m, self.machine
        by_drive = [self.whiten_shift(shift_m(f"travel.{drive}")) for drive in machine.drive_names]
        return np.stack(by_drive, axis=2) / machine.arms_m

    def off_together(self) -> OffTogether | None:
        """By what readings are off together where drives stand off anew at each visit; None if that is too much."""
        return OffTogether(self.drive_responses(), self.home_visit)

    def of_numbers(self, whitened: Array) -> Array:
        """Whitened figures (r, w, ...) of what was read, once each, from those of the rows (n, w, ...)."""
        return whitened

    @abstractmethod
    def standing_off(self, sd_m: float) -> Self:
        """The same on a machine whose drives stand off anew at each visit, with a standard deviation in m.

        All readings of a visit are off by that together; here it is as if each were by itself, by so much more that
        they say as much of the drives as they do together.
        """

    def factor_of(self, columns: Array) -> Array:
        """q (n, w, r) such that 1 - q q' is the inverse covariance of the readings with columns (n, w, b)."""
        return inverse_covariance_factor(columns)

    def joined(self, whitened: Array) -> Array:
        """Whitened numbers (n, w, ...) where rows that are ends of one reading have the mean of both."""
        return whitened

    @property
    def home_visit(self) -> NDArray[np.intp]:
        """Visit (n,) with which each reading is withheld; -1 for floor nests."""
        return self.visit

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times whitened columns (n, w, k) or (n, w)."""
        return project_out(self.q, columns)

    def after_calibration(self, shift: Array) -> Array:
        """What a fit of the calibration's unknowns leaves of a whitened shift (n, w)."""
        return project_out(self.q_of_calibration, shift)

    @cached_property
    def u_of_ln_stiffness(self) -> dict[int, float]:
        """What the readings leave open of the logarithm of each stiffness, by the number of the strut or guide."""
        parts, column = (*self.machine.strut_names, *self.machine.guide_names), {n: i for i, n in enumerate(self.names)}
        names = {c: f"ln_stiffness.{part}" for c, part in enumerate(parts)}
        known = {c: column[name] for c, name in names.items() if name in column}
        numbers = list(known.values())
        told = np.sum(self.joined(self.columns[:, :, numbers]) * self.apply(self.columns[:, :, numbers]), axis=(0, 1))
        left = np.sqrt(np.clip(1.0 - told, 0.0, 1.0)) * self.sigma[numbers]
        return dict(zip(known, left.tolist(), strict=True))

    @cached_property
    def q_of_calibration(self) -> Array:
        """As q, without the disturbances."""
        return self.factor_of(self.columns[:, :, : self.of_calibration])

    def whiten_shift(self, shift_m: Array) -> Array:
        """Shifts (n, 3) in the machine's frame, whitened (n, w)."""
        return whitened_shift(self.whiten, self.frame, shift_m)


def inverse_covariance_factor(columns: Array) -> Array:
    """q (n, w, r) such that 1 - q q' is the inverse of 1 + A A' for columns A (n, w, b).

    Directions that are determined by the priors alone are omitted.
    """
    flat = columns.reshape(-1, columns.shape[2])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    informative = values > NEGLIGIBLE_INFORMATION
    q = flat @ (vectors[:, informative] / np.sqrt(1.0 + values[informative]))
    return np.ascontiguousarray(q).reshape(*columns.shape[:2], -1)


def project_onto(q: Array, columns: Array) -> Array:
    """q q' times columns (n, w, k) or (n, w)."""
    flat = columns.reshape(q.shape[0] * q.shape[1], -1)
    factor = q.reshape(len(flat), -1)
    return np.asarray((factor @ (factor.T @ flat)).reshape(columns.shape))


def project_out(q: Array, columns: Array) -> Array:
    """(1 - q q') times columns (n, w, k) or (n, w): what remains once all that q (n, w, r) spans has been fitted."""
    return columns - project_onto(q, columns)
