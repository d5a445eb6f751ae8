"""Plays an NC program on the mock's drives, as the control of a machine does that leads it by itself.

It moves the drives past their bus: they are the control's, and nothing of what it does can be seen on the line. Where
the program commands drives each goes straight to its place, all arriving together; where it commands the tool the
control knows the nominal machine and leads all drives along a line of the tool. Its own correction, one for each
payload that has one, is added to what it commands. Not modelled: look-ahead, blending, feed override, block search by
anything but N, a correction that depends on the side of approach.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mock_devices.clock import RigClock
from mock_devices.drives.axis_motion import Dynamics
from mock_devices.drives.cia402 import State
from mock_devices.drives.drive_axis import DriveAxis
from mock_devices.drives.drive_objects import METRES_PER_INCREMENT
from mock_devices.drives.mock_drive import DriveServer
from mock_devices.nc.correction import Correction
from mock_devices.nc.program import Program, Step
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plant.spatial_equilibrium import SpatialPose, quaternion_of
from mock_devices.plant.spatial_machine import closed_drive, middle_pose
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.spatial_file import SpatialMachine, read_spatial_machine

Array = NDArray[np.float64]

ACCELERATION = 1.0  # m/s2 of the fastest drive, or along the tool's line
STEP_S = 0.02  # between two points of a tool's line
REST_S = 0.1  # after a move, before what follows it
LOOK_S = 1.0
_HARD = 1e4  # acceleration of a drive between two points, over its speed: it follows them at once
_SWITCH_ON = (0x06, 0x07, 0x0F)


class ProgramPlayer:
    """One program on one machine. `operator_s`: the mock's operator presses start so long after a stop, and not before
    the payload is on that the stop is for; without it only `start` does.

    `corrections`: by number of the payload. Safe to use from several threads.
    """

    def __init__(
        self,
        machine_path: str | Path,
        plant: BasePlant,
        drives: Sequence[DriveServer],
        clock: RigClock,
        program: Program,
        *,
        corrections: Mapping[int, Correction] | None = None,
        operator_s: float | None = None,
    ) -> None:
        count = len(drives) if program.commands == "drives" else 6
        if program.axes and len(program.axes) != count:
            raise ValueError(f"the program moves {len(program.axes)} axes, {plant.machine.name} has {count}")
        self._file: SpatialMachine = read_spatial_machine(machine_path)
        if program.commands == "drives" and self._file.redundant:
            raise ValueError(f"{self._file.name} has more drives than coordinates: its control must command the tool")
        self._plant, self._drives, self._clock = plant, tuple(drives), clock
        self._program, self._corrections, self._operator_s = program, dict(corrections or {}), operator_s
        self._next = 0
        self._chain = 0
        self._lock = threading.RLock()
        self._tool = self._tool_at(middle_pose(self._file))
        self.state = "ready"
        self.visit = 0

    def start(self, visit: int | None = None) -> None:
        """Press start: begin, go on after a stop, or begin anew at N`visit`. Raises ValueError where it runs."""
        with self._lock:
            if self.state == "running":
                raise ValueError("the program runs")
            if self.state == "ended" and visit is None:
                raise ValueError("the program has ended; start it at one of its visits")
            if visit is not None:
                self._next = self._program.begin_of(visit)
            for drive in self._drives:
                drive.with_axis(_switch_on)
            self.state = "running"
            self._after(0.0, self._step)

    def stop(self) -> None:
        """Stop where it is; start goes on with what comes next."""
        with self._lock:
            self._chain += 1
            for drive in self._drives:
                drive.with_axis(self._brake)
            if self.state == "running":
                self.state = "stopped"

    def _after(self, wait_s: float, act: Callable[[], None]) -> None:
        """Do something later, unless something else is begun meanwhile."""
        self._chain += 1
        chain = self._chain

        def due() -> None:
            with self._lock:
                if chain == self._chain:
                    act()

        self._clock.call_at(self._clock.now_s() + wait_s, due)

    def _step(self) -> None:
        if self._next >= len(self._program.steps):
            self.state = "ended"
            return
        step = self._program.steps[self._next]
        self._next += 1
        self.visit = step.visit
        if step.kind == "dwell":
            self._after(step.dwell_s, self._step)
        elif step.kind == "stop":
            self.state = "waits for start" if step.payload is None else f"waits for payload {step.payload}"
            if self._operator_s is not None:
                self._after(self._operator_s, lambda: self._press(step))
        else:
            self._move(step)

    def _press(self, step: Step) -> None:
        """The operator looks, and presses start where all is as it should be."""
        if step.payload is not None and self._plant.payload != step.payload:
            self._after(LOOK_S, lambda: self._press(step))
            return
        self.state = "running"
        self._step()

    def _move(self, step: Step) -> None:
        try:
            if self._program.commands == "drives":
                scale = [180.0 / math.pi if d.kind == "crank" else 1e3 for d in self._file.drives]
                target = [word / s for word, s in zip(step.words, scale, strict=True)]
                took_s = self._go(self._corrected(target), step.feed_mm_per_min / 6e4)
                self._after(took_s + REST_S, self._step)
                return
            words = np.array(step.words)
            target_pose = np.concatenate([words[:3] * 1e-3, np.radians(words[3:])])
            self._lead(target_pose, step.feed_mm_per_min / 6e4)
        except (NoEquilibrium, ValueError) as error:
            self._alarm(str(error))

    def _corrected(self, drives: Sequence[float]) -> list[float]:
        correction = self._corrections.get(self._plant.payload)
        return list(drives) if correction is None else correction.corrected(drives)

    def _go(self, target: Sequence[float], speed: float) -> float:
        """All drives to their places by profiles of one shape; how long that takes."""
        t_s = self._clock.now_s()
        inc = [round(value / METRES_PER_INCREMENT) for value in target]
        self._require_travel(inc)
        way = [abs(to - drive.with_axis(_command_at(t_s))) for drive, to in zip(self._drives, inc, strict=True)]
        longest = max(way)
        end_s = t_s
        for drive, to, own in zip(self._drives, inc, way, strict=True):
            share = own / longest if longest > 0.0 else 0.0
            if share > 0.0:
                steep = share * ACCELERATION / METRES_PER_INCREMENT
                dynamics = Dynamics(share * speed / METRES_PER_INCREMENT, steep, steep)
                end_s = max(end_s, drive.with_axis(_going(t_s, to, dynamics)))
        return end_s - t_s

    def _lead(self, target: Array, speed: float) -> None:
        """All drives along the tool's line (6,), point by point, slow at both ends."""
        begin = self._tool
        farthest = float(np.linalg.norm(target[:3] - begin[:3])) + float(np.linalg.norm(target[3:] - begin[3:]))
        count = max(1, math.ceil((1.875 * farthest / speed) / STEP_S))

        def point(number: int) -> None:
            u = number / count
            share = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
            try:
                self._follow(begin + share * (target - begin))
            except (NoEquilibrium, ValueError) as error:
                self._alarm(str(error))
                return
            if number < count:
                self._after(STEP_S, lambda: point(number + 1))
            else:
                self._after(STEP_S + REST_S, self._step)

        point(1)

    def _follow(self, tool: Array) -> None:
        if (why := self._plant.overloaded(self._clock.now_s())) is not None:
            raise ValueError(why)
        t_s = self._clock.now_s()
        turn = _attitude(tool[3:])
        pose = SpatialPose(tool[:3] - turn.turn @ self._file.tool_point_m, turn.quaternion)
        drives = [closed_drive(self._file, a, pose) for a in range(len(self._drives))]
        inc = [round(value / METRES_PER_INCREMENT) for value in self._corrected(drives)]
        self._require_travel(inc)
        for drive, to in zip(self._drives, inc, strict=True):
            way = abs(to - drive.with_axis(_command_at(t_s)))
            if way:
                speed = 1.01 * way / STEP_S
                drive.with_axis(_going(t_s, to, Dynamics(speed, _HARD * speed, _HARD * speed)))
        self._tool = tool

    def _tool_at(self, pose: SpatialPose) -> Array:
        """Tool point and A, B, C (6,) of a platform pose."""
        r = pose.turn
        angles = [math.atan2(r[2, 1], r[2, 2]), -math.asin(max(-1.0, min(1.0, r[2, 0]))), math.atan2(r[1, 0], r[0, 0])]
        return np.concatenate([pose.place(self._file.tool_point_m), angles])

    def _require_travel(self, target_inc: Sequence[int]) -> None:
        for drive, inc in zip(self._drives, target_inc, strict=True):
            limits = drive.axis.limits
            if not limits.low_inc <= inc <= limits.high_inc:
                raise ValueError(f"{drive.axis_name}: {inc * METRES_PER_INCREMENT:.4f} is beyond its travel")

    def _brake(self, axis: DriveAxis) -> None:
        axis.motion.stop(self._clock.now_s(), ACCELERATION / METRES_PER_INCREMENT)

    def _alarm(self, why: str) -> None:
        self.stop()
        self.state = f"alarm at N{self.visit}: {why}"


def _switch_on(axis: DriveAxis) -> None:
    for word in _SWITCH_ON:
        if axis.state is not State.OPERATION_ENABLED:
            axis.control(word)


def _command_at(t_s: float) -> Callable[[DriveAxis], float]:
    return lambda axis: axis.motion.command(t_s)[0]


def _going(t_s: float, target_inc: int, dynamics: Dynamics) -> Callable[[DriveAxis], float]:
    def go(axis: DriveAxis) -> float:
        axis.motion.go(t_s, target_inc, dynamics, at_once=True)
        return axis.motion.end_s

    return go


def _attitude(angles: Array) -> SpatialPose:
    """The attitude R = Rz(C) Ry(B) Rx(A), at the origin."""
    pose = SpatialPose(np.zeros(3), quaternion_of(np.array([angles[0], 0.0, 0.0])))
    for axis in (1, 2):
        motion = np.zeros(6)
        motion[3 + axis] = angles[axis]
        pose = pose.moved(motion)
    return pose


__all__ = ["ProgramPlayer"]
