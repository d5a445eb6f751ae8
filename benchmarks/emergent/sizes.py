"""How large a change of the readings is: raw, and what a new fit of frame, reflectors and geometry leaves of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.campaign import Campaign
from benchmarks.emergent.machines import JOINT_M, LENGTH_M, LN_STIFFNESS, MOUNTING_M, SCALE, TILT_RAD
from benchmarks.emergent.statics import hang, places_m
from benchmarks.emergent.strut_model import SLIDERS, STRUTS, Machine

Array = NDArray[np.float64]

SHARE = 1e-3  # of a tolerance: readings are linear that far
FLOOR_M = 3e-3  # nests are roughly known
GROUPS = (range(3), range(3, 5))  # platform, carriages


class Sizes:
    """Of one machine and campaign. angle_sd_rad, range_sd_m: a reading's; sight_m: where the station stands."""

    def __init__(
        self, machine: Machine, campaign: Campaign, angle_sd_rad: float, range_sd_m: float, sight_m: Array
    ) -> None:
        self._campaign = campaign
        _, self._reflectors, _ = campaign.of_reading
        base = self._readings(machine)
        self.sigma_m = angle_sd_rad * np.linalg.norm(base - sight_m, axis=1)
        # The line of sight is nearly the machine's z.
        self._sd = np.stack([self.sigma_m, self.sigma_m, np.full(len(base), range_sd_m)], axis=1)
        columns = [(self._readings(moved) - base) / SHARE for moved in _moved(machine)]
        for axis in np.eye(3):
            columns += [1e-2 * np.tile(axis, (len(base), 1)), 5e-3 * np.cross(axis, base)]
        jacobian = np.stack([(column / self._sd).ravel() for column in columns], axis=1)
        self._q = np.linalg.qr(np.concatenate([jacobian, np.eye(jacobian.shape[1])]))[0]

    def raw(self, change_m: Array) -> list[float]:
        """RMS in sigma over the coordinates in the plane, of the platform's reflectors and of the carriages'."""
        return self._by_group(change_m / self._sd)

    def visible(self, change_m: Array) -> list[float]:
        """The same after a new fit, each parameter within its tolerance."""
        rows = np.concatenate([(change_m / self._sd).ravel(), np.zeros(self._q.shape[1])])
        left = rows - self._q @ (self._q.T @ rows)
        return self._by_group(left[: change_m.size].reshape(-1, 3))

    def _by_group(self, whitened: Array) -> list[float]:
        return [
            float(np.sqrt(np.mean(whitened[np.isin(self._reflectors, group), :2] ** 2))) for group in GROUPS
        ]  # fmt: skip

    def _readings(self, machine: Machine) -> Array:
        visits, reflectors, _ = self._campaign.of_reading
        drives_m = self._campaign.drives_m
        pose, _ = hang(machine, drives_m, self._campaign.payload)
        carriages = np.concatenate([machine.carriages_m(drives_m), np.zeros((len(pose), SLIDERS, 1))], axis=-1)
        return np.asarray(places_m(machine, pose, carriages)[visits, reflectors])


def _moved(machine: Machine) -> Iterator[Machine]:
    """The machine with each parameter moved by a share of its tolerance's deviation."""
    share = SHARE / np.sqrt(3.0)

    def stepped(name: str, index: tuple[int, ...], step: float) -> Machine:
        values = getattr(machine, name).copy()
        values[index] += step
        return replace(machine, **{name: values})

    for i in range(STRUTS):
        yield stepped("length_m", (i,), share * LENGTH_M)
        yield stepped("stiffness_n_per_m", (i,), SHARE * LN_STIFFNESS * machine.stiffness_n_per_m[i])
        for k in range(2):
            yield stepped("platform_m", (i, k), share * JOINT_M)
            yield stepped("base_m", (i, k), share * JOINT_M)
    for a in range(SLIDERS):
        yield stepped("tilt_rad", (a,), share * TILT_RAD)
        yield stepped("scale", (a,), share * SCALE)
    for j in range(len(machine.reflectors_m)):
        for k in range(3):
            yield stepped("reflectors_m", (j, k), share * (MOUNTING_M if j < 5 else FLOOR_M))
