"""Carries out a plan: which reflector is read when, where the drives stand then and where they came from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import ON_FLOOR, ON_PLATFORM, Machine, rotations_of
from benchmarks.other_simulator.plan import RANDOMISED, Payload, Visit, draw_payload_of_visits, workspace_of

Array = NDArray[np.float64]

NESTS, CALIBRATION = "nests", "calibration"
MOST_READINGS = 870  # no further visit after so many
OVERRUN_M = 0.03  # that a drive goes back and comes again from the wanted side
FAST_M_PER_S, HOMING_M_PER_S = 0.2, 0.1
SECONDS_OF_VISIT = 38  # with its readings, on average


@dataclass(frozen=True)
class Reading:
    """One reading of the reflector `smr` and how the machine came to where it stood."""

    phase: str
    smr: int
    visit: int
    pose_number: int  # -1 for none
    run: int  # at this pose, from 0
    nest_check: int
    t_s: float
    dwell_s: float
    pose: Array  # (6,)
    drives_m: Array  # (d,), as commanded
    velocity_m_per_s: Array  # (d,)
    speed_m_per_s: float
    side: Array  # (d,), +1 came from below
    payload: int
    way_m: Array  # (d,), moved since the beginning
    approach_m: Array  # (d,), length of the last approach
    moving: bool
    face: int


class Journey:
    """The machine on its way through a campaign of one style; `carry_out` once, then `readings`."""

    def __init__(
        self, machine: Machine, style: str, payloads: Sequence[Payload], hours: float, rng: np.random.Generator
    ) -> None:
        self.readings: list[Reading] = []
        self.reseats_s: list[float] = []  # when payloads were changed, and reflectors put back
        self._machine, self._style, self._payloads, self._hours, self._rng = machine, style, payloads, hours, rng
        self._box = workspace_of(machine)
        self._home = machine.poses_of(self._box.mean(1)[None])[0]
        self._pose, self._drives_m = self._home, self._drives_at(self._home)
        drives = len(machine.drives)
        self._way_m, self._side, self._still = np.zeros(drives), np.ones(drives), np.zeros(drives)
        self._t_s, self._visit, self._nest_check, self._last_nests_s = 0.0, 0, -1, 0.0
        self._two_faces = False
        self._runs: dict[int, int] = {}
        self._platform = np.flatnonzero(machine.carriers == ON_PLATFORM)
        self._sliders = np.flatnonzero(machine.carriers >= 0)
        self._nests = np.flatnonzero(machine.carriers == ON_FLOOR)

    def carry_out(self, visits: Sequence[Visit]) -> None:
        """All visits, with changes of payload, pauses and checks of the nests between them."""
        rng, count = self._rng, len(visits)
        payload = draw_payload_of_visits(self._payloads, count, rng)
        idling = self._draw_idling(count)
        pause_s = rng.gamma(1.2, 1.0, count)
        pause_s *= max(self._hours * 3600 - count * SECONDS_OF_VISIT, count * 3) / pause_s.sum()
        between_nests_s = rng.uniform(30, 60) * 60
        self._t_s = float(rng.uniform(20, 400))
        self._two_faces = bool(rng.random() < 0.3)
        carried = int(payload[0])
        self._check_nests(carried)
        for visit, wanted, rest_s, idle in zip(visits, payload, pause_s, idling, strict=True):
            if wanted != carried:
                self._t_s += rng.uniform(300, 900)
                self.reseats_s.append(self._t_s)
            elif rng.random() < 0.012:  # a break
                self._t_s += rng.uniform(300, 1200)
            carried = int(wanted)
            if self._t_s - self._last_nests_s > between_nests_s:
                self._check_nests(carried)
            self._visit += 1
            self._t_s += rest_s
            self._way_m = self._way_m + idle * rest_s * 0.25 * rng.uniform(0.5, 1, len(self._way_m))
            if visit.on_the_fly:
                self._fly_past(visit, carried)
                continue
            self._rest_at(visit, carried)
            if len(self.readings) > MOST_READINGS:
                break
        self._check_nests(carried)

    def _draw_idling(self, count: int) -> Array:
        """How much the drives move in the pauses (v,): they make heat in some stretches of the campaign."""
        out, begin = np.zeros(count), 0
        while begin < count:
            length = int(self._rng.integers(12, 45))
            out[begin : begin + length] = self._rng.choice([0, 0, 0.3, 0.8])
            begin += length
        return out

    def _check_nests(self, payload: int) -> None:
        """Read all nests once or twice, from home."""
        self._nest_check += 1
        self._visit += 1
        drives_m = self._drives_at(self._home)
        move = drives_m - self._drives_m
        approach = np.abs(move)
        self._way_m = self._way_m + approach
        self._side = np.where(approach > 1e-9, np.sign(move), self._side)
        self._t_s += 6 + approach.max() / HOMING_M_PER_S
        arrived_s = self._t_s
        self._t_s += 3
        self._pose, self._drives_m = self._home, drives_m
        for _ in range(int(self._rng.integers(1, 3))):
            for nest in self._nests:
                rested_s = self._t_s - arrived_s
                reading = self._reading(NESTS, int(nest), payload, rested_s, HOMING_M_PER_S, approach)
                self.readings.append(replace(reading, face=self._draw_face()))
                self._t_s += self._rng.uniform(4, 6)
        self._last_nests_s = self._t_s

    def _fly_past(self, visit: Visit, payload: int) -> None:
        """A reading on the move to the visit's place, and often another on the move on to anywhere."""
        rng, begin = self._rng, self._drives_m
        pose = self._machine.poses_of(visit.tool_pose[None])[0]
        middle = self._fly(pose, rng.uniform(0.35, 0.75), visit.speed_m_per_s, payload, self._any_reflector)
        self._way_m = self._way_m + np.abs(middle - begin)
        self._way_m = self._way_m + np.abs(self._drives_m - middle)
        if rng.random() < 0.7:
            begin, share = self._drives_m, rng.uniform(0.35, 0.75)
            pose = self._machine.poses_of(rng.uniform(self._box[:, 0], self._box[:, 1])[None])[0]
            self._visit += 1
            self._fly(pose, share, visit.speed_m_per_s, payload, self._platform_reflector)
            self._way_m = self._way_m + np.abs(self._drives_m - begin)

    def _fly(self, pose: Array, share: float, speed: float, payload: int, choose: Callable[[], int]) -> Array:
        """Move to a pose and read when this share of the way is done; the drives (d,) at that moment."""
        way, begin = pose - self._pose, self._drives_m
        drives_m = self._drives_at(pose)
        duration_s = max(float(np.linalg.norm(drives_m - begin)), 1e-3) / speed
        middle = self._pose + share * way
        middle_m = self._drives_at(middle)
        step = 1e-3
        ahead, behind = (self._drives_at(self._pose + (share + sign * step) * way) for sign in (1, -1))
        velocity = (ahead - behind) / (2 * step) / duration_s
        self._t_s += 2 + share * duration_s
        done = np.abs(middle_m - begin)
        reading = self._reading(CALIBRATION, choose(), payload, 0.0, speed, done)
        self.readings.append(
            replace(
                reading, moving=True, pose=middle, drives_m=middle_m, velocity_m_per_s=velocity,
                side=np.sign(velocity), way_m=self._way_m + done,
            )
        )  # fmt: skip
        self._t_s += (1 - share) * duration_s + 1
        self._side, self._pose, self._drives_m = np.sign(velocity), pose, drives_m
        return middle_m

    def _rest_at(self, visit: Visit, payload: int) -> None:
        """Go to the visit's place, wait and read its reflectors."""
        rng, randomised = self._rng, self._style == RANDOMISED
        pose = self._machine.poses_of(visit.tool_pose[None])[0]
        drives_m = self._drives_at(pose)
        if visit.side is None:
            move = drives_m - self._drives_m
            approach = np.abs(move)
            self._side = np.where(approach > 1e-7, np.sign(move), self._side)
            self._way_m = self._way_m + approach
            self._t_s += approach.max() / visit.speed_m_per_s + 0.5
        else:
            to_begin = np.abs(drives_m - visit.side * OVERRUN_M - self._drives_m)
            self._way_m = self._way_m + to_begin + OVERRUN_M
            self._side = np.full(len(drives_m), float(visit.side))
            approach = np.full(len(drives_m), OVERRUN_M)
            self._t_s += to_begin.max() / FAST_M_PER_S + OVERRUN_M / visit.speed_m_per_s + 1
        arrived_s = self._t_s
        self._t_s += visit.dwell_s
        self._pose, self._drives_m = pose, drives_m
        run = self._runs[visit.number] = self._runs.get(visit.number, -1) + 1
        for smr in self._draw_reflectors():
            rested_s = self._t_s - arrived_s
            reading = self._reading(CALIBRATION, smr, payload, rested_s, visit.speed_m_per_s, approach)
            self.readings.append(replace(reading, pose_number=visit.number, run=run, face=self._draw_face()))
            self._t_s += rng.uniform(2.2, 5.0) if randomised else rng.uniform(3.2, 5.5)

    def _draw_reflectors(self) -> list[int]:
        """What is read at a rest: all of the platform, of the sliders all, some or none."""
        rng, randomised = self._rng, self._style == RANDOMISED
        out = [*self._platform, *self._sliders]
        if len(self._machine.drives) > 2:
            out = [*self._platform]
            if len(self._sliders):
                out += [*rng.permutation(self._sliders)[: int(rng.integers(1, 3))]]
        elif randomised and rng.random() < 0.4:
            out = [*self._platform, *rng.permutation(self._sliders)[:1]]
        return [int(smr) for smr in (rng.permutation(out) if randomised else out)]

    def _any_reflector(self) -> int:
        if self._rng.random() < 0.8 or not len(self._sliders):
            return self._platform_reflector()
        return int(self._sliders[self._rng.integers(len(self._sliders))])

    def _platform_reflector(self) -> int:
        return int(self._platform[self._rng.integers(len(self._platform))])

    def _draw_face(self) -> int:
        return 2 if self._two_faces and self._rng.random() < 0.5 else 1

    def _drives_at(self, pose: Array) -> Array:
        return self._machine.drives_at(pose[None, :3], rotations_of(pose[None, 3:]))[0]

    def _reading(
        self, phase: str, smr: int, payload: int, dwell_s: float, speed_m_per_s: float, approach_m: Array
    ) -> Reading:
        """A reading now, of the machine as it stands."""
        return Reading(
            phase=phase, smr=smr, visit=self._visit, pose_number=-1, run=0, nest_check=self._nest_check,
            t_s=self._t_s, dwell_s=dwell_s, pose=self._pose, drives_m=self._drives_m, velocity_m_per_s=self._still,
            speed_m_per_s=speed_m_per_s, side=self._side, payload=payload, way_m=self._way_m, approach_m=approach_m,
            moving=False, face=1,
        )  # fmt: skip
