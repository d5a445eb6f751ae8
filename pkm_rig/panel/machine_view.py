"""The machine on the page: what of it is drawn, from one snapshot; painted in the browser by machine_view.js."""

from __future__ import annotations

from typing import Any

import numpy as np
from nicegui.element import Element

from calibration.base.arrays import Array
from calibration.machine.description import Machine
from calibration.machine.equilibrium import workspace_middle
from calibration.machine.inverse import nominal_drives
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.live import Snapshot
from pkm_rig.rig.tool_place import places

DECIMALS = 4  # a tenth of a millimetre is less than a pixel


class MachineView(Element, component="machine_view.js"):
    """The canvas of one page."""

    def __init__(self) -> None:
        super().__init__()
        self._shown: dict[str, Any] = {}

    def show(self, scene: dict[str, Any]) -> None:
        """Draw a scene; nothing is sent if it is drawn already."""
        if scene != self._shown:
            self._shown = scene
            self.run_method("show", scene)

    def field(self, mesh: dict[str, Any] | None) -> None:
        """Draw the error field as one mesh, or none."""
        self.run_method("field", mesh)


class Scenes:
    """Scenes of one rig. What stays is computed once: pages are drawn in the process that supervises the rig."""

    def __init__(self, machine: Machine, file: RigFile) -> None:
        self._machine = machine
        self._station = np.array(file.station.position_m)
        self._middle = workspace_middle(machine)
        self._middle_drives = nominal_drives(machine, self._middle[None])[0]
        self._reach = _travelled(machine, self._middle, self._middle_drives)
        self._workspace = _loop(_workspace(machine), "frame", 1)

    def of(self, seen: Snapshot) -> dict[str, Any]:
        """Lines and balls of the machine as its drives say it stands, of its target, of the station and its sight.

        Without a place yet it stands in the middle of its workspace.
        """
        machine, station = self._machine, self._station
        pose = self._middle if seen.pose is None else seen.pose
        drives = self._middle_drives if seen.drives is None else seen.drives
        parts = places(machine, drives, pose)
        lines = [[_at(upper), _at(lower), "strut", 4] for upper, lower in parts.struts]
        lines += _guides(machine, parts.carriages, drives)
        lines += _loop(_around(parts.struts[:, 1]), "platform", 3)
        lines += self._workspace
        names = [smr.name for smr in machine.smrs]
        balls = [
            [_at(point), "aimed" if name == seen.aim else "reflector", 0.022, name if name == seen.aim else ""]
            for name, point in zip(names, parts.reflectors, strict=True)
        ]
        balls += [[_at(carriage), "slider", 0.05, ""] for carriage in parts.carriages]
        balls += [[_at(station), "station", 0.07, "station"], [_at(parts.tool), "tool", 0.02, "tool"]]
        if seen.target is not None:
            balls.append([_at(seen.target[:3]), "target", 0.035, f"target {seen.target_number}"])
        if seen.aim in names:
            lines.append([_at(station), _at(parts.reflectors[names.index(seen.aim)]), "sight", 1.5])
        span = np.vstack([self._reach, parts.reflectors, station])
        centre = (span.min(axis=0) + span.max(axis=0)) / 2.0
        return {
            "lines": lines,
            "balls": balls,
            "centre": _at(centre),
            "radius": round(float(np.max(np.linalg.norm(span - centre, axis=1))), 2),
        }


def mesh_of(points_m: Array, errors_m: Array, columns: int) -> dict[str, Any]:
    """An error field over a grid of points (n, 3), row by row, as one mesh; colours go from none to the largest."""
    most = float(errors_m.max()) or 1.0
    return {
        "columns": columns,
        "places": [_at(point) for point in points_m],
        "shares": [round(float(error) / most, 3) for error in errors_m],
    }


def _at(point: Array) -> list[float]:
    return [round(float(x), DECIMALS) for x in point]


def _loop(points: Array, kind: str, width: float) -> list[list[Any]]:
    return [[_at(a), _at(b), kind, width] for a, b in zip(points, np.roll(points, -1, axis=0), strict=True)]


def _around(points: Array) -> Array:
    """Points (n, 3) in the order in which they lie around their middle, in the plane that they spread most in."""
    away = points - points.mean(axis=0)
    _, _, directions = np.linalg.svd(away, full_matrices=False)
    angle = np.arctan2(away @ directions[1], away @ directions[0])
    ordered: Array = points[np.argsort(angle)]
    return ordered


def _workspace(machine: Machine) -> Array:
    (left, right), (low, high) = machine.workspace[0], machine.workspace[1]
    z = float(machine.workspace[2].mean())
    return np.array([[left, low, z], [right, low, z], [right, high, z], [left, high, z]])


def _guides(machine: Machine, carriages: Array, drives: Array) -> list[list[Any]]:
    """The way of each carriage along its axis, from end to end of its travel."""
    out = []
    for drive, (at, axis) in enumerate(zip(carriages, machine.nominal.axis, strict=True)):
        ends = [at + axis * (limit - drives[drive]) for limit in machine.travel[drive]]
        if np.any(axis):
            out.append([_at(ends[0]), _at(ends[1]), "frame", 5])
    return out


def _travelled(machine: Machine, pose: Array, drives: Array) -> Array:
    """Points that the struts' upper ends may reach from one place of the machine, to have all of them in sight."""
    parts = places(machine, drives, pose)
    ends = [
        carriage + machine.nominal.axis[drive] * (limit - drives[drive])
        for drive, carriage in enumerate(parts.carriages)
        for limit in machine.travel[drive]
    ]
    return np.vstack([parts.struts.reshape(-1, 3), np.array(ends)])
