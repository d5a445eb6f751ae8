"""Reflectors on the platform and on the drives, measured by a station whose frame is unknown."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array, RowSelection
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.base.rotation import skew
from calibration.instruments.readings import WhitenedResiduals
from calibration.instruments.setups import RANGE_ERRORS, Setups, range_shifts
from calibration.instruments.station_geometry import StationAccuracy, whitening
from calibration.machine.description import Machine
from calibration.model.model import Poses, Unknown
from calibration.model.visits import Visits

FRAME_PRIOR_M = 10.0  # non-informative
FRAME_PRIOR_RAD = 1.0
REFRACTION_U_PER_M = 5e-7  # half a kelvin per metre across the line of sight


@dataclass(frozen=True)
class ReflectorObservations:
    """Reflector positions measured during visits, one row a reading (r).

    visit (r,): row of `visits`; smr (r,): index in the machine file; position_m (r, 3) in the frame of the station's
    first set-up; covariance_m2 (r, 3, 3); setup (r,): row of the set-ups, None with one.
    """

    visits: Visits
    visit: NDArray[np.intp]
    smr: NDArray[np.intp]
    position_m: Array
    covariance_m2: Array
    setup: NDArray[np.intp] | None = None

    def __len__(self) -> int:
        return len(self.visit)

    def take(self, rows: RowSelection) -> ReflectorObservations:
        """Some of the readings, of the same visits."""
        return ReflectorObservations(
            self.visits,
            self.visit[rows],
            self.smr[rows],
            self.position_m[rows],
            self.covariance_m2[rows],
            None if self.setup is None else self.setup[rows],
        )

    def of_visits(self, keep: NDArray[np.bool_]) -> ReflectorObservations:
        """The readings of the visits that are kept."""
        new_row = np.cumsum(keep) - 1
        rows = keep[self.visit]
        some = self.take(rows)
        return replace(some, visits=self.visits.take(np.flatnonzero(keep)), visit=new_row[some.visit])


@dataclass(frozen=True)
class StationModel:
    """The station of a fit. start: frame to start from (its prior is loose); smrs: reflectors that it measured.

    range_constant_u_m, range_scale_u: standard uncertainties common to all ranges; refraction_u_per_m:
    of the curvature of the line of sight that a vertical gradient of the air's index causes (1e-6 per kelvin per
    metre); zero leaves an unknown out. known_frame: the machine frame is the station's (gauge fixed), nothing to be
    fitted. setups: where the station stood; the errors of their motions are unknowns, the first frame is that of start.
    """

    start: Frame
    smrs: tuple[int, ...]
    range_constant_u_m: float = 0.0
    range_scale_u: float = 0.0
    refraction_u_per_m: float = 0.0
    known_frame: bool = False
    setups: Setups = field(default_factory=Setups.single)

    @classmethod
    def from_accuracy(
        cls, start: Frame, smrs: tuple[int, ...], accuracy: StationAccuracy, *, known_frame: bool = False
    ) -> StationModel:
        """A station of the accuracy that a recording or a rig file states, its line of sight bent by the air."""
        return cls(
            start,
            smrs,
            range_constant_u_m=accuracy.range_constant_u_m,
            range_scale_u=accuracy.range_scale_u,
            refraction_u_per_m=REFRACTION_U_PER_M,
            known_frame=known_frame,
        )

    def unknowns(self, machine: Machine) -> tuple[Unknown, ...]:
        """Mounting of each reflector (3), frame (rotation, translation), range constant and scale, refraction; errors
        of the set-ups' motions as combinations (6 a set-up) of unit variance."""
        mounting = machine.file.tolerances.smr_position_m / np.sqrt(3.0)
        out = [Unknown(f"mounting.{machine.smrs[i].name}.{c}", "m", mounting) for i in self.smrs for c in "xyz"]
        if not self.known_frame:
            out += [Unknown(f"frame.r{c}", "rad", FRAME_PRIOR_RAD) for c in "xyz"]
            out += [Unknown(f"frame.{c}", "m", FRAME_PRIOR_M) for c in "xyz"]
        ranges = (
            Unknown("range.constant", "m", self.range_constant_u_m),
            Unknown("range.scale", "1", self.range_scale_u),
            Unknown("refraction.curvature", "1/m", self.refraction_u_per_m),
        )
        motions = (Unknown(f"setup.{number}.{i}", "1", 1.0) for number in self.setups.numbers[1:] for i in range(1, 7))
        return (*out, *(u for u in ranges if u.sigma > 0.0), *motions)

    @property
    def frame_column(self) -> int:
        """First of the six unknowns of the frame."""
        return 3 * len(self.smrs)

    def frame(self, station_unknowns: Array) -> Frame:
        """The frame for values of the station's unknowns."""
        if self.known_frame:
            return self.start
        return self.start.with_increment(station_unknowns[self.frame_column : self.frame_column + 6])

    def mounting_m(self, machine: Machine, station_unknowns: Array, smr: int) -> Array:
        """Position (3,) of a reflector on its part for values of the station's unknowns."""
        if smr not in self.smrs:
            raise InputError(f"SMR {machine.smrs[smr].name} was not measured; measure it")
        first = 3 * self.smrs.index(smr)
        return np.asarray(machine.smrs[smr].position_m + station_unknowns[first : first + 3])

    def setup_error(self, machine: Machine, station_unknowns: Array) -> tuple[Array, Array]:
        """Errors (m,) of the motions of the later set-ups, in one row, and derivatives (m, k) with the unknowns."""
        names = [u.name for u in self.unknowns(machine)]
        errors = self.setups.error_mean
        by_unknowns = np.zeros((len(errors), len(names)))
        for column, name in enumerate(RANGE_ERRORS):
            if name in names:
                by_unknowns[:, names.index(name)] = self.setups.error_by_range[:, column]
        by_unknowns[:, len(names) - len(errors) :] = self._setup_root
        return errors + by_unknowns @ station_unknowns, by_unknowns

    @cached_property
    def _setup_root(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.setups.error_covariance))

    def observe(
        self, machine: Machine, station_unknowns: Array, point_m: Array, setup: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array]:
        """Points (n, 3) of the machine's frame as the station reports them, derivatives (n, 3, k) with its unknowns.

        In the frame of the first set-up; setup (n,): row of the set-up that each is seen from, None for the first. The
        columns of the mountings are left at zero: they act before the frame.
        """
        frame = self.frame(station_unknowns)
        turned = point_m @ frame.rotation.T
        observed = turned + frame.translation_m
        names = [u.name for u in self.unknowns(machine)]
        out = np.zeros((len(point_m), 3, len(names)))
        first = self.frame_column
        if not self.known_frame:
            out[:, :, first : first + 3] = -skew(turned)
            out[:, :, first + 3 : first + 6] = np.eye(3)
        seen_from = np.zeros(len(point_m), dtype=np.intp) if setup is None else setup
        shifts = range_shifts(observed - self.setups.translation_m[seen_from])
        reported = observed.copy()
        for name, shift in shifts.items():
            if name in names:
                column = names.index(name)
                out[:, :, column] = shift
                reported += station_unknowns[column] * shift
        if len(self.setups) > 1:
            error, by_unknowns = self.setup_error(machine, station_unknowns)
            reported = self.setups.moved_by_error(reported, seen_from, error)
            out += self.setups.shift_by_error(reported, seen_from) @ by_unknowns
        return reported, out


@dataclass(frozen=True)
class SmrPositions:
    """Positions of reflectors, measured by a station."""

    observations: ReflectorObservations
    station: StationModel

    def __len__(self) -> int:
        return len(self.observations)

    @property
    def width(self) -> int:
        """x, y and z of the station's frame."""
        return 3

    @property
    def free_rigid_motion(self) -> bool:
        """Unless the station's frame is known."""
        return not self.station.known_frame

    @cached_property
    def whiten(self) -> Array:
        """Whitening matrices (r, 3, 3) of the readings."""
        return whitening(self.observations.covariance_m2, self.observations.position_m)

    def unknowns(self, machine: Machine) -> tuple[Unknown, ...]:
        """The station's unknowns."""
        return self.station.unknowns(machine)

    def visit_indices(self) -> NDArray[np.intp]:
        """One visit a reading."""
        return self.observations.visit[:, None]

    def take(self, rows: NDArray[np.intp]) -> SmrPositions:
        """Some of the readings."""
        return SmrPositions(self.observations.take(rows), self.station)

    def with_noise(self, white: Array) -> SmrPositions:
        """Positions with whitened noise (r, 3) added."""
        shift = np.linalg.solve(self.whiten, white[:, :, None])[:, :, 0]
        return SmrPositions(replace(self.observations, position_m=self.observations.position_m + shift), self.station)

    def compare(
        self, poses: Poses, local: NDArray[np.intp], instrument_unknowns: Array, *, derivatives: bool = True
    ) -> WhitenedResiduals:
        """Whitened differences of predicted and measured positions."""
        machine = poses.model.machine
        positions_m, by_mounting = np.empty((len(self), 3)), np.empty((len(self), 3, 3))
        by_model = np.zeros((len(self), 3, len(poses.model) if derivatives else 0))
        for smr in self.station.smrs:
            rows = np.flatnonzero(self.observations.smr == smr)
            visit = local[rows, 0]
            mounting = self.station.mounting_m(machine, instrument_unknowns, smr)
            positions_m[rows] = poses.reflector_m(smr, mounting)[visit]
            by_mounting[rows] = poses.mounting_derivatives(smr)[visit]
            if derivatives:
                by_model[rows] = poses.reflector_derivatives(smr, mounting)[visit]
        predicted_m, by_own = self.station.observe(machine, instrument_unknowns, positions_m, self.observations.setup)
        rotation = self.station.frame(instrument_unknowns).rotation
        for column, smr in enumerate(self.station.smrs):
            rows = np.flatnonzero(self.observations.smr == smr)
            by_own[rows, :, 3 * column : 3 * column + 3] = rotation @ by_mounting[rows]
        residual = np.einsum("rij,rj->ri", self.whiten, predicted_m - self.observations.position_m)
        if not derivatives:
            return WhitenedResiduals(residual, by_model, by_own[:, :, :0])
        return WhitenedResiduals(residual, self.whiten @ (rotation @ by_model), self.whiten @ by_own)
