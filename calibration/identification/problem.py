"""A fit as a sum of squares over readings: cost, linearisation block by block, minimisation.

Unknowns are scaled by their prior standard deviation: z = unknowns / sigma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.gauss_newton import NEAR, accelerated_step, left_to_go
from calibration.identification.linear_system import QrAccumulator, TriangularSystem, regularised_step
from calibration.instruments.readings import Readings, WhitenedResiduals, split_by_visits
from calibration.machine.description import Machine
from calibration.machine.equilibrium import PoseStatus
from calibration.machine.mechanics import retain_heap
from calibration.model.model import Model, Poses, Unknown
from calibration.model.visits import Visits

VISITS_AT_ONCE = 1024
MIN_VISITS_TO_SUBSAMPLE = 0.5
MOST_STEPS = 60
SETTLED = 1e-7  # of the last step, in standard errors
START_SETTLED = 1.0
ROUND_OFF = 1e-11  # of a loss, relative
LARGEST_DAMPING = 1e9  # beyond it no step gains anything that the loss can show
HUBER = 2.5  # in standard deviations of a number


@dataclass(frozen=True)
class Layout:
    """Order of the unknowns: those of the model first, then those of each instrument."""

    unknowns: tuple[Unknown, ...]
    instrument_slices: tuple[slice, ...]

    @classmethod
    def of(cls, model: Model, readings: Sequence[Readings]) -> Layout:
        """The layout of a model and its readings."""
        unknowns = list(model.unknowns)
        own = []
        for part in readings:
            more = part.unknowns(model.machine)
            own.append(slice(len(unknowns), len(unknowns) + len(more)))
            unknowns += more
        return cls(tuple(unknowns), tuple(own))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.unknowns)

    @property
    def sigma(self) -> Array:
        """Prior standard deviations (u,)."""
        return np.array([u.sigma for u in self.unknowns])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns."""
        return tuple(u.name for u in self.unknowns)


@dataclass(frozen=True)
class _Block:
    """Some readings of one instrument: their rows, the visits they need, and local rows of these."""

    instrument: int
    rows: NDArray[np.intp]
    readings: Readings
    visits: NDArray[np.intp]
    local: NDArray[np.intp]


@dataclass(frozen=True)
class ReadingDerivatives:
    """Some readings (rows) of one instrument: whitened residuals (r, w) and their derivatives (r, w, u)."""

    instrument: int
    rows: NDArray[np.intp]
    residual: Array
    jacobian: Array


@dataclass
class LeastSquaresProblem:
    """Readings of visits under a model.

    robust: Huber's loss on each reading instead of squares. centre (u,): mean of the priors, in scaled unknowns;
    nominal if None.
    """

    model: Model
    visits: Visits
    readings: Sequence[Readings]
    robust: bool = False
    centre: Array | None = None
    layout: Layout = field(init=False)
    _start: Array = field(init=False)
    _blocks: list[_Block] = field(init=False)
    converged: bool = field(init=False, default=False)  # whether the last minimisation converged
    _last: tuple[Array, TriangularSystem] | None = field(init=False, default=None)  # where it was linearised last

    def __post_init__(self) -> None:
        retain_heap()
        self.layout = Layout.of(self.model, self.readings)
        self._start = self.visits.target_m.copy()  # poses found last: where the next search starts
        self._blocks = [
            _Block(index, *block)
            for index, part in enumerate(self.readings)
            for block in split_by_visits(part, VISITS_AT_ONCE)
        ]

    @property
    def machine(self) -> Machine:
        """The machine that is fitted."""
        return self.model.machine

    @property
    def n_numbers(self) -> int:
        """Numbers read."""
        return sum(len(part) * part.width for part in self.readings)

    def prior(self, weight: float) -> Array:
        """Weights (u,) of the priors: `weight` for the machine's tolerances.

        What is known of instruments, payload and temperatures is not regularisation and keeps its weight.
        """
        weights = np.ones(self.layout.size)
        weights[: len(self.model.parameters)] = weight
        return weights

    def subsample(self, visits: int) -> LeastSquaresProblem:
        """The same problem with the readings of about so many visits, to find a start with; itself if that is most.

        They are drawn at random, the same each time: a regular choice might always meet the same reflector.
        """
        share = visits / len(self.visits)
        if share > MIN_VISITS_TO_SUBSAMPLE:
            return self
        rng = np.random.default_rng(0)
        some = [
            part.take(np.sort(rng.permutation(len(part))[: int(np.ceil(share * len(part)))])) for part in self.readings
        ]
        return LeastSquaresProblem(self.model, self.visits, some, self.robust, self.centre)

    def linearise(self, z: Array) -> TriangularSystem:
        """Residuals and derivatives at z with respect to z, folded into a triangle."""
        if self._last is not None and np.array_equal(self._last[0], z):
            return self._last[1]
        folding = QrAccumulator(self.layout.size)
        for block in self.derivatives(z):
            jacobian, residual = block.jacobian, block.residual
            if self.robust:
                weight = self._weights(residual)
                jacobian = jacobian * weight[:, None, None]
                residual = residual * weight[:, None]
            folding.add(jacobian.reshape(-1, self.layout.size), residual.ravel())
        system = folding.result(self.layout.sigma)
        self._last = (z.copy(), system)
        return system

    def derivatives(self, z: Array) -> Iterator[ReadingDerivatives]:
        """Readings block by block, linearised at z with respect to the unknowns in SI units."""
        for index, rows, compared in self._compare_blocks(z, derivatives=True):
            jacobian, residual = compared.by_model, compared.residual
            if not np.all(np.isfinite(residual)):
                raise InputError("identification: a reading or its deviation is not a finite number; repair the data")
            if self.layout.size > len(self.model):
                jacobian = np.zeros((*residual.shape, self.layout.size))
                jacobian[:, :, : len(self.model)] = compared.by_model
                jacobian[:, :, self.layout.instrument_slices[index]] = compared.by_own
            yield ReadingDerivatives(index, rows, residual, jacobian)

    def residuals(self, z: Array) -> list[Array]:
        """Whitened residuals (r, w) of each instrument's readings, in the order of its readings."""
        out = [np.empty((len(part), part.width)) for part in self.readings]
        for index, rows, compared in self._compare_blocks(z):
            out[index][rows] = compared.residual
        return out

    def loss(self, z: Array, weight: Array) -> float:
        """The function that is minimised."""
        total = float(np.sum((weight * self._prior_offset(z)) ** 2))
        for residuals in self.residuals(z):
            square = np.sum(residuals**2, axis=1)
            total += float(np.sum(self._rho(square, residuals.shape[1])))
        return total

    def minimise(self, z: Array, free: NDArray[np.intp], weight: float, *, start_only: bool = False) -> Array:
        """Levenberg-Marquardt over the unknowns `free`; the tolerances have the given weight.

        It ends where the next step is shorter than SETTLED standard errors in any direction. Where the answer is but a
        place for another fit to start from (start_only, or with unknowns fixed), START_SETTLED is enough.
        """
        prior = self.prior(weight)
        fixed = np.setdiff1d(np.arange(z.size), free)
        enough = START_SETTLED if fixed.size or start_only else SETTLED
        z, damping, shortest = z.copy(), 0.0, np.inf
        previous: tuple[Array, Array] | None = None
        system = self.linearise(z)
        best = self._loss_of(system, z, prior)
        self.converged = False
        sizes = [np.inf]  # of steps without damping
        for _ in range(MOST_STEPS):
            step = _step(system, self._prior_offset(z), prior, fixed, damping)
            size = _in_standard_errors(system, step, prior)
            # The gain of so short a step is below the loss's round-off; one that no longer shrinks is round-off itself.
            hidden = size * size < ROUND_OFF * (best + 1.0)
            if damping == 0.0 and (size < enough or (hidden and size > 0.9 * shortest)):
                self.converged = True
                break
            if damping == 0.0:
                sizes.append(size)
                metric = np.vstack([system.factor, np.diag(prior)])
                previous, step = (z, step), accelerated_step(metric, previous, z, step)
            try:
                trial = self.linearise(z + step)
                loss = self._loss_of(trial, z + step, prior)
            except InputError:
                if damping > 1e8:
                    raise
                loss = np.inf
            if loss <= best or (hidden and loss <= best + ROUND_OFF * (best + 1.0)):
                z, system, best = z + step, trial, loss
                damping = 0.0 if damping < 0.1 else damping / 100.0
                shortest = min(shortest, size)
            elif damping > LARGEST_DAMPING:
                break
            else:
                previous, damping = None, max(1.0, 10.0 * damping)
        self.converged = self.converged or left_to_go(sizes) < NEAR
        return z

    def _loss_of(self, system: TriangularSystem, z: Array, prior: Array) -> float:
        if self.robust:
            return self.loss(z, prior)
        return system.cost + float(np.sum((prior * self._prior_offset(z)) ** 2))

    def _prior_offset(self, z: Array) -> Array:
        return z if self.centre is None else z - self.centre

    def _weights(self, residual: Array) -> Array:
        """Square roots (r,) of the weights of readings with whitened residuals (r, w)."""
        size = np.sqrt(np.mean(residual**2, axis=1))
        return np.asarray(np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-300))))

    def _rho(self, square: Array, width: int) -> Array:
        if not self.robust:
            return square
        size = np.sqrt(square / width)
        return np.where(size <= HUBER, square, width * (2.0 * HUBER * size - HUBER**2))

    def _compare_blocks(
        self, z: Array, *, derivatives: bool = False
    ) -> Iterator[tuple[int, NDArray[np.intp], WhitenedResiduals]]:
        """Instrument, rows of its readings, and the comparison, block by block."""
        values = z * self.layout.sigma
        for block in self._blocks:
            visits = self.visits.take(block.visits)
            poses = self.model.predict(values[: len(self.model)], visits, self._start[block.visits])
            self._require_equilibria(poses, block.visits)
            self._start[block.visits] = poses.equilibrium.coordinates()
            instrument_unknowns = values[self.layout.instrument_slices[block.instrument]]
            yield (
                block.instrument,
                block.rows,
                block.readings.compare(poses, block.local, instrument_unknowns, derivatives=derivatives),
            )

    def _require_equilibria(self, poses: Poses, visits: NDArray[np.intp]) -> None:
        failed = np.flatnonzero(~poses.equilibrium.converged)
        if failed.size:
            what = PoseStatus(int(poses.equilibrium.status[failed[0]])).name.lower().replace("_", " ")
            raise InputError(
                f"identification: the model finds no equilibrium for visit {visits[failed[0]]} ({what}); check units, "
                "drive coordinates and that the machine file fits the machine"
            )


def _in_standard_errors(system: TriangularSystem, step: Array, prior: Array) -> float:
    """Length of a step in the metric of the posterior: no unknown moves by more of its standard errors than that."""
    return float(np.sqrt(np.sum((system.factor @ step) ** 2) + np.sum((prior * step) ** 2)))


def _step(system: TriangularSystem, off_centre: Array, prior: Array, fixed: NDArray[np.intp], damping: float) -> Array:
    """Step (u,) of the regularised linear problem; fixed unknowns do not move."""
    weight = np.hypot(prior, np.sqrt(damping))
    offset = off_centre * prior**2 / weight**2
    if fixed.size == 0:
        return regularised_step(system, offset, weight)
    free = np.setdiff1d(np.arange(offset.size), fixed)
    part = TriangularSystem(system.factor[:, free], system.right_side, system.residual_squares, system.n_rows)
    step = np.zeros_like(offset)
    step[free] = regularised_step(part, offset[free], weight[free])
    return step
