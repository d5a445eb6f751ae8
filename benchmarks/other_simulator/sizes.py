"""How large an effect is: as it is, and once the calibration has absorbed what looks like geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.equilibrium import hang, points_m
from benchmarks.other_simulator.machine import PARAMETERS
from benchmarks.other_simulator.rig import Rig

Array = NDArray[np.float64]

STATION_PRIOR = 1e-2  # m and rad: as good as free
STEP, LN_STEP = 1e-5, 0.05  # of numerical derivatives


@dataclass(frozen=True)
class Size:
    """Root mean squares over the coordinates in which the platform moves, each in the standard deviation of a reading
    across the line of sight: of the reflectors that move most, and of the platform's.

    raw_length, visible_length: of the shifts' lengths, in the mean standard deviation of a coordinate. Amplitudes are
    drawn by these.
    """

    raw: float
    visible: float
    raw_platform: float
    visible_platform: float
    raw_length: float
    visible_length: float


class Sizes:
    """Measures changes of a rig's readings."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._fit: tuple[Array, Array, Array] | None = None  # made when it is first needed: most of the time goes there

    def of(self, change_m: Array, reflector: int | None = None, share_shown: float = 0.0) -> Size:
        """Sizes of a change (r, 3) of what the station sees.

        reflector: the only one to be judged. share_shown: of the change that the drives' columns show.
        """
        residual = self.unfitted(change_m) * (1 - share_shown)
        rows = self._rig.rows
        groups = [rows.on_platform]
        if reflector is None:
            on_sliders = np.flatnonzero(self._rig.machine.carriers >= 0)
            judged = groups + [rows.calibration & (rows.smr == smr) for smr in on_sliders]
        else:
            judged = [rows.calibration & (rows.smr == reflector)]
        raw, visible = self._in_sigma(change_m), self._in_sigma(residual)
        return Size(
            raw=max(_rms(raw, group) for group in judged),
            visible=max(_rms(visible, group) for group in judged),
            raw_platform=_rms(raw, rows.on_platform),
            visible_platform=_rms(visible, rows.on_platform),
            raw_length=max(self._rms_length(change_m, group) for group in judged),
            visible_length=max(self._rms_length(residual, group) for group in judged),
        )

    def unfitted(self, change_m: Array) -> Array:
        """What is left of a change (r, 3) once the geometry is fitted to it by least squares, within its tolerances."""
        whitening, columns, solution = self._fit = self._fit or self._linear_fit()
        white = (whitening @ change_m[..., None]).reshape(-1)
        return change_m - columns @ (solution @ white)

    def _in_sigma(self, change_m: Array) -> Array:
        """A change (r, 3) of the readings along the machine's axes in which the platform moves (r, c), in sigma."""
        rig = self._rig
        sigma_m = rig.station.angle_sd_rad * np.linalg.norm(rig.scene.sights_m, axis=1)
        moves = [axis for axis in rig.machine.free if axis < 3]
        return np.asarray((change_m @ rig.station.axes)[:, moves] / sigma_m[:, None])

    def _rms_length(self, change_m: Array, group: NDArray[np.bool_]) -> float:
        return float(np.sqrt((change_m[group] ** 2).sum(1).mean()) / self._rig.sigma_m) if group.any() else 0.0

    def _linear_fit(self) -> tuple[Array, Array, Array]:
        """Whitening (r, 3, 3), readings by parameters over tolerances (r, 3, p), and the solution (p, 3r)."""
        rig = self._rig
        machine, scene = rig.machine, rig.scene
        columns, priors = [], []
        for name in PARAMETERS:
            prior = machine.tolerances.get(name, STATION_PRIOR)
            step = min(prior, LN_STEP if name == "ln_stiffness" else STEP)
            for index in zip(*np.nonzero(machine.may_err(name)), strict=True):
                geometry = rig.geometry.changed(name, index, step)
                state = scene.calm
                if name not in ("smr_position_m", "station"):
                    state = hang(machine, geometry, rig.conditions, rig.calm, rig.start, rounds=3)
                points = points_m(machine, geometry, rig.rows.smr, state, rig.calm)
                columns.append((rig.station.sees(points, geometry, rig.calm) - scene.sights_m) / step)
                priors.append(prior)
        jacobian = np.stack(columns, 2)
        whitening = np.linalg.inv(np.linalg.cholesky(rig.covariances_m2))
        white = (whitening @ jacobian).reshape(-1, jacobian.shape[2]) * np.array(priors)
        solution = np.linalg.solve(white.T @ white + np.eye(white.shape[1]), white.T)
        return whitening, jacobian * np.array(priors), solution


def _rms(sizes: Array, group: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(sizes[group] ** 2))) if group.any() else 0.0
