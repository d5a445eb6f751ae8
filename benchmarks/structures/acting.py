"""Where a structure acts: given shifts of a part at every reading, on the machine's mechanics and the station's sight.

The mechanics (how a strut that is longer moves the platform) are those of the mock's plain machine. What acts has the
methods that the plant calls; nothing of the mock's effects is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import MachineFile

Array = NDArray[np.float64]

LEVER_M = 3.0  # distance at which a turn of the station counts as much as a shift
# Channels: unit in which a size is first tried, and the largest root mean square that a machine may have.
UNITS: dict[str, tuple[float, float]] = {
    "travel": (1e-5, 2e-3),
    "scale": (1e-5, 4e-3),
    "sideways": (1e-5, 2e-3),
    "turn": (1e-4, 5e-3),
    "length": (1e-5, 2e-3),
    "joint": (1e-5, 4e-3),
    "struts": (1e-5, 1e-3),
    "reflector": (1e-5, 1e-3),
    "station": (1e-5, 1e-3),
    "light": (1e-5, 1e-3),
    "floor": (1e-5, 1e-3),
    "force": (100.0, 2e4),
    "payload": (1e-2, 1.0),
    "drives": (1e-5, 2e-3),
}
OF_DRIVE = ("travel", "scale", "sideways", "turn")
OF_STRUT = ("length", "joint")


def places(channel: str, machine: MachineFile) -> tuple[int, ...]:
    """Indices of the parts where a channel may be; (0,) for what there is one of."""
    if channel in OF_DRIVE:
        return tuple(range(len(machine.sliders)))
    if channel in OF_STRUT:
        return tuple(range(len(machine.struts)))
    if channel == "reflector":
        return tuple(i for i, smr in enumerate(machine.smrs) if smr.on == "platform")
    return (0,)


def name_of(channel: str, place: int, machine: MachineFile) -> str:
    """Name of a part; empty for what there is one of."""
    if channel in OF_DRIVE:
        return machine.sliders[place].name
    if channel in OF_STRUT:
        return machine.struts[place].name
    return machine.smrs[place].name if channel == "reflector" else ""


@dataclass(frozen=True)
class Acting:
    """Shifts (r, d) in SI units, one a drive where a channel is that of all drives, else all alike. direction: angle in
    the plane, of what may go anywhere; axis: of the station's turn, a unit vector."""

    machine: MachineFile
    channel: str
    place: int
    shifts: Array
    direction_rad: float
    axis: tuple[float, float, float]

    def record_leg(self, drive: int, leg: Any) -> None:
        """Memory is in the shifts already."""

    def early_s(self, state: Any) -> float:
        """Drives and station are seen at the same time."""
        return 0.0

    def act(self, state: Any, deviation: Any) -> None:
        """Move the part."""
        shift, place = self.shifts[:, 0], self.place
        along = shift * np.exp(1j * self.direction_rad)
        if self.channel == "travel":
            deviation.travel_m[:, place] += shift
        elif self.channel == "drives":
            deviation.travel_m += self.shifts
        elif self.channel == "scale":
            low, high = self.machine.sliders[place].travel_m
            deviation.travel_m[:, place] += shift * (state.q_m[:, place] - 0.5 * (low + high))
        elif self.channel == "sideways":
            deviation.sideways_m[:, place] += shift
        elif self.channel == "turn":
            deviation.yaw_rad[:, place] += shift
        elif self.channel == "length":
            deviation.length_m[:, place] += shift
        elif self.channel == "struts":
            deviation.length_m += shift[:, None] * np.array([strut.length_m for strut in self.machine.struts])
        elif self.channel == "joint":
            deviation.platform_joint_m[:, place] += along
        elif self.channel == "reflector":
            deviation.smr_m[:, place, 0] += along.real
            deviation.smr_m[:, place, 1] += along.imag
        elif self.channel == "floor":
            deviation.frame_shift_m += along
        elif self.channel == "payload":
            deviation.payload_shift_m += along
        elif self.channel == "force":
            point = np.full(len(shift), self.machine.struts[0].platform_joint)
            deviation.loads.append((point, along))

    def apply_to_sight(self, state: Any, sight: Any) -> None:
        """Turn and shift what the station sees, or bend its light."""
        shift = self.shifts[:, :1]
        if self.channel == "light":
            sight.v_rad += shift
        if self.channel == "station":
            turn = shift / LEVER_M * np.array(self.axis)
            moved = shift * np.array([np.cos(self.direction_rad), 0.0, np.sin(self.direction_rad)])
            before = sight.points_m
            after = before + np.cross(turn[:, None, :], before) + moved[:, None, :]
            # Differences: a drift of the rig's own has changed the angles already.
            for name, now, was in zip(("hz_rad", "v_rad", "distance_m"), _polar(after), _polar(before), strict=True):
                getattr(sight, name)[...] += now - was


def _polar(points_m: Array) -> tuple[Array, Array, Array]:
    """Horizontal angles, zenith angles and distances of points (..., 3) in the station's frame."""
    distance = np.linalg.norm(points_m, axis=-1)
    return np.arctan2(points_m[..., 0], points_m[..., 1]), np.arccos(points_m[..., 2] / distance), distance
