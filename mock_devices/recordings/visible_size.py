"""How much of an effect is left to see once frame, reflectors and geometry are fitted again with their tolerances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mock_devices.effects.base import Array, EffectChoice
from mock_devices.plant.true_machine import TrueMachine
from mock_devices.recordings.effect_size import SizeScale
from mock_devices.recordings.maker import SimulatedCampaign

_FLOOR_M = 3.0e-3  # nests are where the set-up put them, roughly
_STEP = 1.0e-3  # of a prior deviation: readings are linear far beyond
_OF_UNIFORM = 1.0 / math.sqrt(3.0)


class VisibleScale:
    """Visible sizes on one bench. The sensitivities are difference quotients of the plant itself, computed once.

    Refitted, each with the deviation of its tolerance: lengths, joints, tilts, scales, stiffness, mounting of
    reflectors; nests and the station's frame freely. The fit uses all readings of the campaign, whitened.
    """

    def __init__(self, bench: SimulatedCampaign, sizes: SizeScale | None = None) -> None:
        self.sizes = sizes or SizeScale(bench)
        self._bench = bench
        line, accuracy = bench.timeline, bench.settings.instrument
        base = bench.points_m([])
        across = accuracy.angle_sd_rad * np.linalg.norm(base, axis=1)
        sd = np.stack([across, across, np.full(len(base), accuracy.range_sd_m)], axis=1)
        self._weight = (1.0 / sd) * np.sqrt(line.samples)[:, None]  # the line of sight is nearly the machine's z
        columns = [self._column(moved, base) / _STEP for moved in self._moved_machines()]
        columns += list(self._frame(base))
        jacobian = np.stack(columns, axis=1)
        # Gaussian priors of unit deviation are further rows of the least squares.
        self._q, _ = np.linalg.qr(np.concatenate([jacobian, np.eye(jacobian.shape[1])]))
        platform = np.array([smr.on == "platform" for smr in bench.nominal.smrs])[line.smr]
        self._seen = np.flatnonzero(platform)

    def visible_size(self, choice: EffectChoice) -> float:
        """RMS over the platform reflectors' coordinates in the plane, in units of sigma, after the refit."""
        return self.visible_size_of_change(self.sizes.change_m(choice))

    def visible_size_of_change(self, change_m: Array) -> float:
        """The same of a change (r, 3) in the machine's axes, also of another machine on the same timeline."""
        change = (change_m * self._weight).ravel()
        rows = np.concatenate([change, np.zeros(self._q.shape[1])])
        left = (rows - self._q @ (self._q.T @ rows))[: len(change)].reshape(-1, 3)
        single = left / np.sqrt(self._bench.timeline.samples)[:, None]
        return float(np.sqrt(np.mean(single[self._seen, :2] ** 2)))

    def _column(self, machine: TrueMachine, base: Array) -> Array:
        kept, self._bench.machine = self._bench.machine, machine
        try:
            moved = self._bench.points_m([]) - base
        finally:
            self._bench.machine = kept
        return np.asarray((moved @ self._bench.view.rotation) * self._weight).ravel()

    def _moved_machines(self) -> Iterator[TrueMachine]:
        """The true machine with each parameter moved by a step of its prior deviation."""
        true = self._bench.machine
        file, width = true.file, self._bench.nominal.tolerances
        h = _STEP * _OF_UNIFORM
        for i, strut in enumerate(file.struts):
            for changes in (
                {"length_m": strut.length_m + h * width.strut_length_m},
                {"platform_joint": strut.platform_joint + h * width.platform_joint_m},
                {"platform_joint": strut.platform_joint + 1j * h * width.platform_joint_m},
                {"base_joint": strut.base_joint + h * width.base_joint_m},
                {"base_joint": strut.base_joint + 1j * h * width.base_joint_m},
                {"stiffness_n_per_m": strut.stiffness_n_per_m * math.exp(h * width.ln_stiffness)},
            ):
                struts = (*file.struts[:i], replace(strut, **changes), *file.struts[i + 1 :])
                yield replace(true, file=replace(file, struts=struts))
        for a, slider in enumerate(file.sliders):
            tilted = replace(slider, axis=slider.axis * np.exp(1j * h * width.axis_tilt_rad))
            sliders = (*file.sliders[:a], tilted, *file.sliders[a + 1 :])
            yield replace(true, file=replace(file, sliders=sliders))
            scales = list(true.scales)
            scales[a] += h * width.drive_scale
            yield replace(true, scales=tuple(scales))
        for i, smr in enumerate(file.smrs):
            step_m = _STEP * (_FLOOR_M if smr.on == "floor" else width.smr_position_m) * _OF_UNIFORM
            for k in range(3):
                place = list(smr.position_m)
                place[k] += step_m
                moved = replace(smr, position_m=(place[0], place[1], place[2]))
                yield replace(true, file=replace(file, smrs=(*file.smrs[:i], moved, *file.smrs[i + 1 :])))

    def _frame(self, base: Array) -> Iterator[Array]:
        """Shifts by a centimetre and turns by five milliradians, in the machine's axes: wider than any data leave."""
        places = base @ self._bench.view.rotation
        for k in range(3):
            axis = np.eye(3)[k]
            yield (1.0e-2 * axis * self._weight).ravel()
            yield (5.0e-3 * np.cross(axis, places) * self._weight).ravel()
