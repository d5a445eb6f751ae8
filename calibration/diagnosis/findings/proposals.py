"""Visits that would extend a campaign: random poses with varied approach, dwell, speed and payload."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.result import ProposedVisit
from calibration.machine.description import Machine

VISITS = 60  # of each proposal
SEED = 4  # of the poses, so that repeated diagnoses agree
DWELLS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
CONDITIONS = ("direction", "dwell_s", "speed_m_per_s")
SPEED_FACTORS = (0.4, 1.0, 2.0)
EXCHANGE_S, SET_UP_S = 300.0, 1800.0  # rough durations: exchange of a payload; station, nests and warming up


@dataclass(frozen=True)
class Proposal:
    """An addition to a campaign: its name, what it adds in words, its visits."""

    name: str
    adds: str
    visits: tuple[ProposedVisit, ...]


@dataclass(frozen=True)
class _Usual:
    """How the campaign's visits were measured: approach, speed and dwell of most, number of the median payload."""

    direction: tuple[int, ...]
    speed_m_per_s: float
    dwell_s: float
    payload: int

    @classmethod
    def of(cls, linear: LinearisedReadings) -> _Usual:
        """Of the readings at poses."""
        context, on_pose = linear.context, linear.visit >= 0
        side = np.sign(context.direction[on_pose].mean(axis=0) + 1e-9)
        return cls(
            direction=tuple(int(s) for s in np.where(side == 0.0, 1.0, side)),
            speed_m_per_s=float(np.median(context.speed_m_per_s[on_pose])),
            dwell_s=_median_dwell_s(linear),
            payload=int(np.median(linear.load)),
        )


def proposals(linear: LinearisedReadings) -> Iterator[Proposal]:
    """Further visits, each varying what a campaign may vary, and all of it together.

    What the readings at hand do not say of themselves is not varied: half of a column would be empty.
    """
    rng = np.random.default_rng(SEED)
    poses = _poses(linear.machine, rng, VISITS)
    usual = _Usual.of(linear)
    heaviest = int(np.argmax([load.mass_kg for load in linear.loads]))
    said = {field for field in CONDITIONS if field not in linear.context.missing}
    speeds = tuple(factor * usual.speed_m_per_s for factor in SPEED_FACTORS)

    def visits(
        *, sides: bool = False, dwells: bool = False, speed: bool = False, loads: bool = False
    ) -> tuple[ProposedVisit, ...]:
        out = []
        for k, pose in enumerate(poses):
            direction = tuple(int(s) for s in rng.choice([-1, 1], len(usual.direction))) if sides else usual.direction
            dwell_s = float(rng.choice(DWELLS_S)) if dwells else usual.dwell_s
            speed_m_per_s = float(rng.choice(speeds)) if speed else usual.speed_m_per_s
            payload = heaviest if loads and 2 * k >= VISITS else usual.payload
            out.append(ProposedVisit(tuple(float(x) for x in pose), direction, payload, speed_m_per_s, dwell_s))
        return tuple(out)

    yield Proposal("random poses", "poses off the campaign's, as it was measured", visits())
    rests = {"dwell_s", "speed_m_per_s"} <= said
    if "direction" in said:
        yield Proposal("both directions", "random poses, approached from either side", visits(sides=True))
    if rests:
        adds = "random poses, rests from 0.5 to 16 s, three speeds"
        yield Proposal("varied rest", adds, visits(dwells=True, speed=True))
    if rests and "direction" in said:
        yield Proposal(
            "directions and rest", "either side, rests from 0.5 to 16 s, three speeds",
            visits(sides=True, dwells=True, speed=True),
        )  # fmt: skip
    if heaviest != usual.payload:
        yield Proposal("another payload", "random poses, half of them with the heaviest payload", visits(loads=True))
    if heaviest != usual.payload and rests and "direction" in said:
        yield Proposal(
            "everything varied", "either side, varied rest and speed, half with the heaviest payload",
            visits(sides=True, dwells=True, speed=True, loads=True),
        )  # fmt: skip


def _poses(machine: Machine, rng: np.random.Generator, count: int) -> Array:
    """Tool poses (v, 6) drawn over the workspace, denser towards its edge."""
    low, high = machine.workspace.T
    share = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(0.0, 1.0, (count, len(machine.commanded))))
    out = np.repeat(machine.workspace.mean(axis=1)[None], count, axis=0)
    out[:, machine.commanded] = low[machine.commanded] + (high - low)[machine.commanded] * share
    return out


def _median_dwell_s(linear: LinearisedReadings) -> float:
    """Median over visits of the dwell before their first reading."""
    on_pose = linear.visit >= 0
    first = np.full(int(linear.visit.max()) + 1, np.inf)
    np.minimum.at(first, linear.visit[on_pose], linear.context.dwell_s[on_pose])
    return float(np.median(first))


def duration_min(linear: LinearisedReadings, proposal: Proposal) -> float:
    """Duration in minutes: setting up, visits at the campaign's pace with their dwell, exchanges of payload."""
    pace = float(np.median(np.diff(linear.context.history.arrived_s)))
    payloads = [int(linear.load[-1]), *(visit.payload for visit in proposal.visits)]
    exchanges = sum(a != b for a, b in pairwise(payloads))
    without_dwell_s = max(pace - _median_dwell_s(linear), 1.0)
    visits_s = sum(without_dwell_s + visit.dwell_s for visit in proposal.visits)
    return float(SET_UP_S + visits_s + EXCHANGE_S * exchanges) / 60.0
