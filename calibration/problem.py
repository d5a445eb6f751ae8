"""A fit as a sum of squares over readings: cost, linearisation block by block, minimisation.

Unknowns are scaled by their prior standard deviation: z = unknowns / sigma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.equilibrium import Status
from calibration.linear_system import Folding, Linearised, regularised_step
from calibration.machine import Array, Machine
from calibration.measurements import Readings, Whitened, parts
from calibration.model import Model, Poses, Unknown
from calibration.toml_file import InputError
from calibration.visits import Visits

VISITS_AT_ONCE = 1024
MOST_STEPS = 60
HUBER = 2.5  # in standard deviations of a number


@dataclass(frozen=True)
class Layout:
    """Where each unknown stands: those of the model first, then those of each instrument."""

    unknowns: tuple[Unknown, ...]
    own: tuple[slice, ...]

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


@dataclass
class Problem:
    """Readings of visits under a model.

    robust: Huber's loss on each reading instead of squares. centre (u,): where the priors stand, in scaled unknowns;
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

    def __post_init__(self) -> None:
        self.layout = Layout.of(self.model, self.readings)
        self._start = self.visits.target_m.copy()  # poses found last: where the next search starts
        self._blocks = [
            _Block(index, *block) for index, part in enumerate(self.readings) for block in parts(part, VISITS_AT_ONCE)
        ]

    @property
    def machine(self) -> Machine:
        """The machine that is fitted."""
        return self.model.machine

    @property
    def rows(self) -> int:
        """Numbers read."""
        return sum(len(part) * part.width for part in self.readings)

    def prior(self, weight: float) -> Array:
        """Weights (u,) of the priors: `weight` for the machine's tolerances.

        What is known of instruments, payload and temperatures is not regularisation and keeps its weight.
        """
        weights = np.ones(self.layout.size)
        weights[: len(self.model.parameters)] = weight
        return weights

    def linearise(self, z: Array) -> Linearised:
        """Residuals and derivatives at z with respect to z, folded into a triangle."""
        folding = Folding(self.layout.size)
        sigma = self.layout.sigma
        for index, _, compared in self._compared(z, derivatives=True):
            jacobian = np.zeros((*compared.residual.shape, self.layout.size))
            jacobian[:, :, : len(self.model)] = compared.by_model
            jacobian[:, :, self.layout.own[index]] = compared.by_own
            weight = self._weights(compared.residual)
            jacobian *= sigma * weight[:, None, None]
            residual = compared.residual * weight[:, None]
            folding.add(jacobian.reshape(-1, self.layout.size), residual.ravel())
        return folding.done()

    def residuals(self, z: Array) -> list[Array]:
        """Whitened residuals (r, w) of each instrument's readings, in the order of its readings."""
        out = [np.empty((len(part), part.width)) for part in self.readings]
        for index, rows, compared in self._compared(z):
            out[index][rows] = compared.residual
        return out

    def loss(self, z: Array, weight: Array) -> float:
        """The function that is minimised."""
        total = float(np.sum((weight * self._off_centre(z)) ** 2))
        for found in self.residuals(z):
            square = np.sum(found**2, axis=1)
            total += float(np.sum(self._rho(square, found.shape[1])))
        return total

    def minimise(self, z: Array, free: NDArray[np.intp], weight: float) -> Array:
        """Levenberg-Marquardt over the unknowns `free`; the tolerances have the given weight."""
        prior = self.prior(weight)
        z, damping = z.copy(), 0.0
        held = np.setdiff1d(np.arange(z.size), free)
        system = self.linearise(z)
        best = self._loss_of(system, z, prior)
        for _ in range(MOST_STEPS):
            step = _step(system, self._off_centre(z), prior, held, damping)
            try:
                trial = self.linearise(z + step)
                loss = self._loss_of(trial, z + step, prior)
            except InputError:
                if damping > 1e8:
                    raise
                loss = np.inf
            if loss <= best * (1.0 + 1e-12):
                small = np.max(np.abs(step), initial=0.0) < 1e-9 or best - loss < 1e-14 * (best + 1.0)
                z, system, best = z + step, trial, loss
                damping = 0.0 if damping < 1e-6 else damping / 10.0
                if small and damping == 0.0:
                    break
            elif np.max(np.abs(step), initial=0.0) < 1e-9:
                break
            else:
                damping = max(1e-3, 10.0 * damping)
        return z

    def _loss_of(self, system: Linearised, z: Array, prior: Array) -> float:
        if self.robust:
            return self.loss(z, prior)
        return system.cost + float(np.sum((prior * self._off_centre(z)) ** 2))

    def _off_centre(self, z: Array) -> Array:
        return z if self.centre is None else z - self.centre

    def _weights(self, residual: Array) -> Array:
        """Square roots (r,) of the weights of readings with whitened residuals (r, w)."""
        if not self.robust:
            return np.ones(len(residual))
        size = np.sqrt(np.mean(residual**2, axis=1))
        return np.asarray(np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, 1e-300))))

    def _rho(self, square: Array, width: int) -> Array:
        if not self.robust:
            return square
        size = np.sqrt(square / width)
        return np.where(size <= HUBER, square, width * (2.0 * HUBER * size - HUBER**2))

    def _compared(self, z: Array, *, derivatives: bool = False) -> Iterator[tuple[int, NDArray[np.intp], Whitened]]:
        """Instrument, rows of its readings, and the comparison, block by block."""
        values = z * self.layout.sigma
        for block in self._blocks:
            visits = self.visits.take(block.visits)
            poses = self.model.predict(values[: len(self.model)], visits, self._start[block.visits])
            self._refuse_lost(poses, block.visits)
            self._start[block.visits] = poses.rest.coordinates()
            own = values[self.layout.own[block.instrument]]
            yield block.instrument, block.rows, block.readings.compare(poses, block.local, own, derivatives=derivatives)

    def _refuse_lost(self, poses: Poses, visits: NDArray[np.intp]) -> None:
        lost = np.flatnonzero(~poses.rest.converged)
        if lost.size:
            what = Status(int(poses.rest.status[lost[0]])).name.lower().replace("_", " ")
            raise InputError(
                f"identification: the model finds no equilibrium for visit {visits[lost[0]]} ({what}); check units, "
                "drive coordinates and that the machine file fits the machine"
            )


def _step(system: Linearised, off_centre: Array, prior: Array, held: NDArray[np.intp], damping: float) -> Array:
    """Step (u,) of the regularised linear problem; what is held does not move."""
    weight = np.hypot(prior, np.sqrt(damping))
    offset = off_centre * prior**2 / weight**2
    if held.size == 0:
        return regularised_step(system, offset, weight)
    free = np.setdiff1d(np.arange(offset.size), held)
    part = Linearised(system.factor[:, free], system.right, system.rest, system.rows)
    step = np.zeros_like(offset)
    step[free] = regularised_step(part, offset[free], weight[free])
    return step
