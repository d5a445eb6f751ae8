"""A fitted model: values and covariance of all unknowns, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.identification.linear_system import TriangularSystem
from calibration.identification.problem import Layout
from calibration.instruments.readings import Readings
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.machine.description import Machine
from calibration.model.model import Model, Poses
from calibration.model.visits import Visits

Estimator = Literal["map", "least_squares", "tikhonov", "l_curve", "truncated_svd"]


@dataclass(frozen=True)
class Positioning:
    """How far drives stand off anew at each visit, in standard deviations, of a crank at its joint; what that adds to
    the covariance (u, u) of the unknowns; and how much the readings scatter beside it, over what is stated of them."""

    sd_m: float
    covariance: Array
    scatter: float


@dataclass(frozen=True)
class Fit:
    """A fitted model with the readings that it was fitted to.

    unknowns (u,) and covariance_as_stated (u, u): in SI units, in the order of `layout`. The covariance is that of the
    estimator's error if the truth is drawn from the priors and the readings scatter as stated: the posterior covariance
    for the default estimator; for the others it includes the bias of their regularisation. system: the
    readings linearised at the solution, in unknowns scaled by the standard deviations of their priors. weight: factor
    on the standard deviations' inverses in the estimator. chi2_per_dof: weighted sum of squares per degree of freedom
    of the readings. residuals: whitened, one array (r, w) per instrument. converged: the search ended by itself.
    positioning: None where the machine repeats itself, or nobody has asked (calibration.identification.positioning).
    """

    model: Model
    layout: Layout
    visits: Visits
    instruments: tuple[Readings, ...]
    unknowns: Array
    covariance_as_stated: Array
    system: TriangularSystem
    weight: float
    chi2_per_dof: float
    residuals: tuple[Array, ...]
    estimator: Estimator
    converged: bool
    positioning: Positioning | None = None

    @property
    def covariance(self) -> Array:
        """Covariance (u, u) of the unknowns' error, with what the drives add to it."""
        if self.positioning is None:
            return self.covariance_as_stated
        return self.covariance_as_stated + self.positioning.covariance

    @property
    def positioning_sd_m(self) -> float:
        """How far drives stand off anew at each visit, 0 where that cannot be told from noise."""
        return 0.0 if self.positioning is None else self.positioning.sd_m

    @property
    def machine(self) -> Machine:
        """The machine that was fitted."""
        return self.model.machine

    @property
    def theta(self) -> Array:
        """Machine parameters (p,), deviations from nominal."""
        return self.unknowns[: len(self.model.parameters)]

    @property
    def theta_u(self) -> Array:
        """Standard uncertainties (p,) of the machine parameters."""
        return np.sqrt(np.diag(self.covariance)[: len(self.model.parameters)])

    @property
    def spectrum(self) -> Array:
        """Singular values of the whitened, prior-scaled Jacobian; above 1 the data beat the prior."""
        return self.system.spectrum()

    @property
    def degrees_of_freedom(self) -> float:
        """Numbers read minus those that the fit used up, the trace of its hat matrix."""
        sigma = self.layout.sigma
        scaled = self.covariance_as_stated / sigma[:, None] / sigma[None, :]
        return self.system.n_rows - float(np.sum(scaled * self.system.information()))

    @property
    def station(self) -> StationModel:
        """The station that saw the reflectors."""
        return self._station()[0]

    @property
    def frame(self) -> Frame:
        """The machine's frame as the station sees it."""
        station, station_unknowns = self._station()
        return station.frame(station_unknowns)

    def as_station_reports(self, point_m: Array) -> Array:
        """Points (n, 3) of the machine's frame as the station would state them, its range errors included."""
        station, station_unknowns = self._station()
        return station.observe(self.machine, station_unknowns, point_m)[0]

    def mounting_m(self, smr: int) -> Array:
        """Identified position (3,) of a reflector on its part."""
        station, station_unknowns = self._station()
        return station.mounting_m(self.machine, station_unknowns, smr)

    def _station(self) -> tuple[StationModel, Array]:
        for readings, columns in zip(self.instruments, self.layout.instrument_slices, strict=True):
            if isinstance(readings, SmrPositions):
                return readings.station, self.unknowns[columns]
        raise InputError("identification: no station was used in this fit, so it has no frame")

    def predict(self, visits: Visits) -> Poses:
        """Poses of visits in the machine's frame."""
        return self.model.predict(self.unknowns[: len(self.model)], visits)

    def value(self, name: str) -> tuple[float, float]:
        """Value and standard uncertainty of an unknown by its name."""
        if name not in self.layout.names:
            raise InputError(f"identification: there is no unknown '{name}' in this fit")
        row = self.layout.names.index(name)
        return float(self.unknowns[row]), float(np.sqrt(self.covariance[row, row]))
