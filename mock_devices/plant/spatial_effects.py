"""Effects and disturbances that act on a machine in space: what they change of it at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mock_devices.effects.base import Array, Deviation, Effect, MotionState
from mock_devices.effects.friction_windup import FrictionWindup
from mock_devices.effects.geometry import LinkSelfWeight
from mock_devices.effects.in_space import arms_m, check_in_space, require_only_known, view_of
from mock_devices.effects.ordinary_disturbances import OrdinaryTemperature
from mock_devices.effects.payload import Payload
from mock_devices.machine_file import MachineFile
from mock_devices.plant.affected_machine import make_effects
from mock_devices.plant.spatial_machine import Departure
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import SpatialMachine


@dataclass(frozen=True)
class SpatialEffects:
    """Effects of a machine, the view that they have of it, and the unit (d,) of drives in their motions."""

    effects: tuple[Effect, ...]
    view: MachineFile
    metres: Array
    turns: Array  # (d,) whether a drive is a crank
    file: SpatialMachine

    @property
    def need_loads(self) -> bool:
        """Whether an effect follows from the forces of the drives."""
        return any(isinstance(effect, FrictionWindup) for effect in self.effects)

    @property
    def pushes(self) -> Array:
        """Sign (d,) of a drive's force in its positive direction in its load: that of a leg is its strut's tension."""
        return np.array([-1.0 if drive.kind == "leg" else 1.0 for drive in self.file.drives])

    @classmethod
    def of(cls, file: SpatialMachine, settings: MockSettings, *, start_s: float = 0.0) -> SpatialEffects:
        """What the settings switch on; raises EffectError for what the machine cannot have."""
        view = view_of(file)
        for choice in settings.effects:
            check_in_space(choice, file)
        turns = np.array([float(drive.kind == "crank") for drive in file.drives])
        return cls(tuple(make_effects(view, settings, start_s=start_s)), view, arms_m(file), turns, file)

    def early_s(self, state: MotionState) -> float:
        """By how much the machine is ahead in time when the station measures."""
        return float(sum(np.sum(np.broadcast_to(effect.early_s(state), (1,))) for effect in self.effects))

    def departure(self, state: MotionState) -> Departure:
        """What they change at one state (of one row).

        The drives' loads follow from the weight itself, so that a payload's share of them is not added once more; the
        angle of a crank does not grow with the temperature.
        """
        total = Deviation.none(1, self.view)
        hung: list[tuple[Array, Array]] = []
        for effect in self.effects:
            travel, force, loads = total.travel_m.copy(), total.force_n.copy(), len(total.loads)
            effect.act(state, total)
            if isinstance(effect, Payload):
                total.force_n = force
            if isinstance(effect, OrdinaryTemperature):
                total.travel_m = np.where(self.turns > 0.0, travel, total.travel_m)
            if isinstance(effect, LinkSelfWeight):  # at a joint, which the view has in a plane only
                weight = abs(complex(sum(force[0] for _, force in total.loads[loads:])))
                down = self.file.gravity / np.linalg.norm(self.file.gravity)
                hung.append((self.file.rods[effect.place].platform_joint_m, weight * down))
                del total.loads[loads:]
        require_only_known(total)
        shift = complex(total.payload_shift_m[0])
        load_n, point_m = self._loads(total, hung)
        return Departure(
            travel=total.travel_m[0] / self.metres,
            length_m=total.length_m[0],
            ln_stiffness=total.ln_stiffness[0],
            smr_m=total.smr_m[0],
            sideways_m=total.sideways_m[0],
            yaw_rad=total.yaw_rad[0],
            payload_kg=float(total.payload_mass_kg[0]),
            payload_shift_m=np.array([shift.real, shift.imag, 0.0]),
            force_n=total.force_n[0] * self.pushes,
            platform_m=self._along_axes(total.platform_joint_m[0]),
            base_m=self._along_axes(total.base_joint_m[0]),
            load_n=load_n,
            point_m=point_m,
            tilt_rad=self._upright()[2] * float(total.frame_turn_rad[0]) if np.any(total.frame_turn_rad) else None,
        )

    def _upright(self) -> tuple[Array, Array, Array]:
        """Where the view's two axes point (3,): across gravity and up; and the normal, which turns across to up."""
        size = float(np.linalg.norm(self.file.gravity))
        up = -self.file.gravity / size if size else np.array([0.0, 0.0, 1.0])
        along = np.eye(3)[int(np.argmin(np.abs(up)))]
        across = along - up * (along @ up)
        across = across / np.linalg.norm(across)
        return across, up, np.cross(across, up)

    def _along_axes(self, joint_m: Array) -> Array:
        """Shifts (m, 3) of joints along their drives' axes, from those (m,) of the view."""
        axes = np.array([self.file.drives[rod.drive].axis if rod.drive >= 0 else np.zeros(3) for rod in self.file.rods])
        return np.asarray(joint_m.real[:, None] * axes)

    def _loads(self, total: Deviation, hung: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Forces (h, 3) and points (h, 3) of the platform: a moment is a couple of them, in the plane of what moves."""
        across, up, normal = self._upright()
        points, forces = [point for point, _ in hung], [force for _, force in hung]
        for point, force in total.loads:
            points.append(across * point[0].real + up * point[0].imag)
            forces.append(across * force[0].real + up * force[0].imag)
        if (moment_nm := float(total.moment_nm[0])) != 0.0:
            about = np.array([0.0, 0.0, 1.0]) if self.file.planar else normal
            for side in (1.0, -1.0):
                points.append(side * across)
                forces.append(side * 0.5 * moment_nm * np.cross(about, across))
        return np.reshape(forces, (-1, 3)), np.reshape(points, (-1, 3))
