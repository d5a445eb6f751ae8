"""Visits that would extend a campaign: random poses with varied approach, dwell, speed and payload."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.result import ProposedVisit
from calibration.machine.description import Machine
from calibration.recording.header import MOST_DWELL_S, MOST_SPEED_M_PER_S

VISITS = 60  # of each proposal
SEED = 4  # of the poses, so that repeated diagnoses agree
DWELLS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
CONDITIONS = ("direction", "dwell_s", "speed_m_per_s")
SPEED_FACTORS = (0.4, 1.0, 2.0)
NUMBERS = {1: "one speed", 2: "two speeds", 3: "three speeds"}
EXCHANGE_S, SET_UP_S = 300.0, 1800.0  # rough durations: exchange of a payload; station, nests and warming up


@dataclass(frozen=True)
class Proposal:
    """An addition to a campaign: its name, what it adds in words, its visits."""

    name: str
    adds: str
    visits: tuple[ProposedVisit, ...]


@dataclass(frozen=True)
class _Usual:
    """How the campaign's visits were measured: approach, speed and dwell of most, number of the median payload.

    Of a recording speed and dwell are no more than a campaign file may ask for; slower, shorter: in words, where they
    were more, else empty.
    """

    direction: tuple[int, ...]
    speed_m_per_s: float
    dwell_s: float
    payload: int
    speeds_m_per_s: tuple[float, ...]
    slower: str
    shorter: str

    @classmethod
    def of(cls, linear: LinearisedReadings) -> _Usual:
        """Of the readings at poses."""
        context, on_pose = linear.context, linear.visit >= 0
        side = np.sign(context.direction[on_pose].mean(axis=0) + 1e-9)
        fastest, longest_s = (MOST_SPEED_M_PER_S, MOST_DWELL_S) if linear.by_station else (math.inf, math.inf)
        speed, dwell_s = float(np.median(context.speed_m_per_s[on_pose])), _median_dwell_s(linear)
        usual = min(speed, fastest)
        return cls(
            direction=tuple(int(s) for s in np.where(side == 0.0, 1.0, side)),
            speed_m_per_s=usual,
            dwell_s=min(dwell_s, longest_s),
            payload=int(np.median(linear.load)),
            speeds_m_per_s=tuple(dict.fromkeys(min(factor * usual, fastest) for factor in SPEED_FACTORS)),
            slower=f", {fastest:g} m/s where it was faster" if speed > fastest else "",
            shorter=f", {longest_s:g} s of rest where it was longer" if dwell_s > longest_s else "",
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
    speeds, as_far = usual.speeds_m_per_s, usual.slower + usual.shorter
    rest_and_speeds = f"rests from 0.5 to 16 s, {NUMBERS[len(speeds)]}{usual.slower}"

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

    yield Proposal("random poses", f"poses off the campaign's, as it was measured{as_far}", visits())
    rests = {"dwell_s", "speed_m_per_s"} <= said
    if "direction" in said:
        yield Proposal("both directions", f"random poses, approached from either side{as_far}", visits(sides=True))
    if rests:
        yield Proposal("varied rest", f"random poses, {rest_and_speeds}", visits(dwells=True, speed=True))
    if rests and "direction" in said:
        yield Proposal(
            "directions and rest", f"either side, {rest_and_speeds}",
            visits(sides=True, dwells=True, speed=True),
        )  # fmt: skip
    if heaviest != usual.payload:
        adds = f"random poses, half of them with the heaviest payload{as_far}"
        yield Proposal("another payload", adds, visits(loads=True))
    if heaviest != usual.payload and rests and "direction" in said:
        yield Proposal(
            "everything varied", f"either side, varied rest and speed, half with the heaviest payload{usual.slower}",
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
