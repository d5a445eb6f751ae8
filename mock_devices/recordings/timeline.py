"""A design in time: which motion when, which reading when. The same for every machine that carries it out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mock_devices.effects.base import Array, Effect, Leg, MotionState, StationSight
from mock_devices.machine_file import MachineFile
from mock_devices.plant.affected_machine import AffectedMachine, motion_states
from mock_devices.plant.motion_history import MotionHistory
from mock_devices.plant.plant import Motion
from mock_devices.plant.thermal import Thermal
from mock_devices.recordings.design import Design, Visit, nominal_drives
from mock_devices.settings import Payload

SETTLED_S = 0.1
RUN_UP_M = 0.005
INCREMENT_M = 1.0e-8

Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Timeline:
    """Readings (r,) of a campaign and the motions between them.

    `visit` and `check` count visits and nest checks begun, -1 before the first. q_m, velocity: (r, d). smr: index in
    the machine file. dwell_s: since the target was reached. motions: (drive, motion) in order. moved_s: when the
    station was set up anew.
    """

    design: Design
    machine: MachineFile
    start_m: tuple[float, ...]
    motions: tuple[tuple[int, Motion], ...]
    t_s: Array
    smr: Ints
    visit: Ints
    check: Ints
    is_nest: NDArray[np.bool_]
    samples: Array
    dwell_s: Array
    payload: Ints
    exchanges: Array
    q_m: Array
    velocity_m_per_s: Array
    moved_s: tuple[float, ...] = ()

    @property
    def setup(self) -> Ints:
        """Number (r,) of the station's set-up, from 1."""
        return np.searchsorted(np.array(self.moved_s), self.t_s).astype(np.intp) + 1

    def __len__(self) -> int:
        return len(self.t_s)

    def moments(self, thermal: Thermal, payloads: Sequence[Payload]) -> MotionState:
        """The moments of all readings: the same whatever the effects."""
        history, _ = self._history
        mass = np.array([payload.mass_kg for payload in payloads])[self.payload]
        return motion_states(history, self.t_s, self.q_m, self.velocity_m_per_s, mass, self.exchanges, thermal)

    def tell(self, effects: Sequence[Effect]) -> None:
        """Tell effects, which must be new, of every motion."""
        _, ended = self._history
        for effect in effects:
            if type(effect).record_leg is not Effect.record_leg:
                for drive, leg in ended:
                    effect.record_leg(drive, leg)

    @cached_property
    def _history(self) -> tuple[MotionHistory, list[tuple[int, Leg]]]:
        """The legs of all drives, and in which order effects are told of them: the same whatever the effects."""
        history = MotionHistory(self.start_m, (), self.design.start_s)
        ended = []
        for drive, motion in self.motions:
            ended.append((drive, history.legs(drive)[-1]))
            history.add(drive, motion.start_s, motion.end_s, motion.to_m, motion.speed_m_per_s)
        return history, ended

    def sight(self, affected: AffectedMachine, m: MotionState) -> StationSight:
        """What the station sees of all reflectors at every reading, free of noise; the effects must be new."""
        self.tell(affected.effects)
        early_s = affected.early_s(m)
        seen = replace(m, q_m=m.q_m + m.velocity_m_per_s * early_s[:, None]) if np.any(early_s) else m
        return affected.sight(seen, self.payload)


class _Planner:
    """Lays visits and readings out in time."""

    def __init__(self, machine: MachineFile, design: Design) -> None:
        self.machine, self.design = machine, design
        self.names = [smr.name for smr in machine.smrs]
        self.t_s = design.start_s
        self.at_m = nominal_drives(machine, machine.tool_point)
        self.start_m = self.at_m
        self.motions: list[tuple[int, Motion]] = []
        self.rows: list[tuple[float, int, int, int, bool, float, float, int, int]] = []
        self.q: list[tuple[float, ...]] = []
        self.v: list[tuple[float, ...]] = []
        self.visit = self.check = -1
        self.payload = design.visits[0].payload
        self.exchanges = 0
        self.moved_s: list[float] = []
        self.arrived_s = self.t_s

    def plan(self) -> Timeline:
        moves = {move.before_visit: move for move in self.design.moves}
        for number, visit in enumerate(self.design.visits):
            if number in moves:
                self.nests()
                self.t_s += moves[number].takes_s
                self.moved_s.append(self.t_s)
                self.nests()
            if visit.payload != self.payload:
                self.nests()
                self.t_s += self.design.exchange_s
                self.payload, self.exchanges = visit.payload, self.exchanges + 1
                self.nests()
            elif number % self.design.nest_every == 0:
                self.nests()
            self.add_visit(visit)
        self.nests()
        t, smr, visits, checks, nest, samples, dwell, payload, exchanges = zip(*self.rows, strict=True)
        return Timeline(
            design=self.design,
            machine=self.machine,
            start_m=self.start_m,
            motions=tuple(self.motions),
            t_s=np.array(t),
            smr=np.array(smr),
            visit=np.array(visits),
            check=np.array(checks),
            is_nest=np.array(nest),
            samples=np.array(samples),
            dwell_s=np.array(dwell),
            payload=np.array(payload),
            exchanges=np.array(exchanges, dtype=np.float64),
            q_m=np.array(self.q),
            velocity_m_per_s=np.array(self.v),
            moved_s=tuple(self.moved_s),
        )

    def nests(self) -> None:
        if not self.design.nests:
            return
        self.check += 1
        for nest in self.design.nests:
            duration_s = self.design.nest_samples * self.design.measure_s
            self.read(nest, self.at_m, nest=True, samples=self.design.nest_samples, duration_s=duration_s)

    def add_visit(self, visit: Visit) -> None:
        target = tuple(
            round(q / INCREMENT_M) * INCREMENT_M for q in nominal_drives(self.machine, visit.target_m)
        )  # drives stand on whole increments
        self.visit += 1
        if visit.on_the_fly:
            for name in self.design.smrs:
                self.add_pass(visit, target, name)
            return
        self.move([q - s * self.design.approach_m for q, s in zip(target, visit.direction, strict=True)], visit)
        self.move(target, visit)
        self.arrived_s = self.t_s
        self.t_s += visit.dwell_s
        for name in self.design.smrs:
            self.read(name, target)

    def add_pass(self, visit: Visit, target: tuple[float, ...], name: str) -> None:
        """One run through the target at constant speed, all drives at once: a reading in the middle of it."""
        speed = visit.speed_m_per_s
        run_m = RUN_UP_M + 0.5 * speed**2 / self.design.acceleration_m_per_s2
        self.move([q - s * run_m for q, s in zip(target, visit.direction, strict=True)], visit)
        begun_s = self.t_s
        self.move([q + s * run_m for q, s in zip(target, visit.direction, strict=True)], visit)
        middle_s = 0.5 * (begun_s + self.t_s - SETTLED_S)
        velocity = tuple(s * speed for s in visit.direction)
        self.rows.append(
            (middle_s, self.names.index(name), self.visit, self.check, False, 1.0, 0.0, self.payload, self.exchanges)
        )
        self.q.append(target)
        self.v.append(velocity)

    def move(self, to_m: Sequence[float], visit: Visit) -> None:
        """All drives start at once; the next begins when the last one stands."""
        longest_s = 0.0
        for drive, (here, there) in enumerate(zip(self.at_m, to_m, strict=True)):
            if there == here:
                continue
            way, a = abs(there - here), self.design.acceleration_m_per_s2
            speed = min(visit.speed_m_per_s, math.sqrt(way * a))
            duration_s = way / speed + speed / a
            longest_s = max(longest_s, duration_s)
            self.motions.append((drive, Motion(self.t_s, self.t_s + duration_s, here, there, speed)))
        self.at_m = tuple(to_m)
        self.t_s += longest_s + SETTLED_S

    def read(
        self,
        name: str,
        at_m: tuple[float, ...],
        *,
        nest: bool = False,
        samples: int = 1,
        duration_s: float | None = None,
    ) -> None:
        lasts_s = self.design.measure_s if duration_s is None else duration_s
        self.t_s += self.design.aim_s + lasts_s
        dwell_s = self.t_s - self.arrived_s
        self.rows.append(
            (
                self.t_s - 0.5 * lasts_s,
                self.names.index(name),
                self.visit,
                self.check,
                nest,
                float(samples),
                dwell_s,
                self.payload,
                self.exchanges,
            )
        )
        self.q.append(at_m)
        self.v.append((0.0,) * len(at_m))


def plan(machine: MachineFile, design: Design) -> Timeline:
    """Lay a design out in time on a machine."""
    return _Planner(machine, design).plan()
