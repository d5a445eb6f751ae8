"""The truth of a mock rig, free of noise: only for scoring and tests, never for a device or a calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_devices.plant.optics import StationView
from mock_devices.plant.thermal import Thermal
from mock_devices.plant.true_machine import TrueMachine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Array = NDArray[np.float64]


class Truth:
    """Asks the true machine. Drive positions are encoder positions (0x6063) in metres, one a drive.

    Temperatures are the true ones of rig time `t_s`, or those of `temperatures_c` (by sensor name) if given.
    """

    def __init__(self, machine: TrueMachine, view: StationView, thermal: Thermal) -> None:
        self.machine = machine
        self._view = view
        self._thermal = thermal

    @property
    def station_from_machine(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and translation (3,) in metres of the drift-free station frame."""
        return self._view.rotation.copy(), self._view.translation_m.copy()

    @property
    def range_constant_m(self) -> float:
        """The station's constant error of all distances."""
        return self._view.range_constant_m

    def tool_pose(
        self,
        drive_positions_m: Sequence[float],
        payload: int,
        t_s: float = 0.0,
        *,
        temperatures_c: Mapping[str, float] | None = None,
    ) -> tuple[float, float, float]:
        """Tool point x, y in metres of the machine's base frame and rz in radians."""
        at = self._temperatures(t_s, temperatures_c)
        pose = self.machine.pose(tuple(drive_positions_m), payload, at)
        tool = self.machine.tool_point(pose, at)
        return tool.real, tool.imag, pose.rz_rad

    def smr_positions(
        self,
        drive_positions_m: Sequence[float],
        payload: int,
        t_s: float = 0.0,
        *,
        temperatures_c: Mapping[str, float] | None = None,
        in_station_frame: bool = False,
    ) -> dict[str, Array]:
        """Each SMR by name, shape (3,) in metres: machine base frame or drift-free station frame."""
        at = self._temperatures(t_s, temperatures_c)
        drives_m = tuple(drive_positions_m)
        pose = self.machine.pose(drives_m, payload, at)
        places = self.machine.smr_positions(pose, drives_m, at)
        return {
            smr.name: self._view.drift_free(place) if in_station_frame else np.array(place)
            for smr, place in zip(self.machine.file.smrs, places, strict=True)
        }

    def parameters(self) -> dict[str, float]:
        """True parameters by name, SI units, errors included."""
        values: dict[str, float] = {}
        for strut in self.machine.file.struts:
            values[f"{strut.name}.length_m"] = strut.length_m
            values[f"{strut.name}.stiffness_n_per_m"] = strut.stiffness_n_per_m
            values[f"{strut.name}.platform_joint_x_m"] = strut.platform_joint.real
            values[f"{strut.name}.platform_joint_y_m"] = strut.platform_joint.imag
            values[f"{strut.name}.base_joint_x_m"] = strut.base_joint.real
            values[f"{strut.name}.base_joint_y_m"] = strut.base_joint.imag
        for slider, scale in zip(self.machine.file.sliders, self.machine.scales, strict=True):
            values[f"{slider.name}.scale"] = scale
            values[f"{slider.name}.axis_x"] = slider.axis.real
            values[f"{slider.name}.axis_y"] = slider.axis.imag
        return values

    def _temperatures(self, t_s: float, given: Mapping[str, float] | None) -> dict[str, float]:
        return dict(given) if given is not None else self._thermal.parts_c(t_s)
