"""What is commanded, visit by visit, and how the simulated machine carries it out.

A visit is an approach of both drives to a target, each from its side, and the readings taken while it rests. Only the
last part of the approach and the rest are integrated, from what the former visit left in play, springs and controllers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.drive_model import Arrival, Drive, DrivePart
from benchmarks.emergent.statics import drives_of, hang, loads_n, places_m
from benchmarks.emergent.strut_model import PAYLOADS_KG, SLIDERS, Machine, StrutParts, Struts

Array = NDArray[np.float64]

SPEEDS_M_PER_S = (0.04, 0.12, 0.3)
SHORT_S = (0.25, 0.6, 1.2)
FIRST_S, NEXT_S = 2.0, 1.5  # dwell before the first reading of a visit that reads all reflectors, and between readings
ON_MACHINE, NESTS = range(5), (5, 6)
HALF_X_M, HALF_Y_M = 0.33, 0.28
STYLES = ("randomised", "bidirectional", "oneway")
BLOCKS, POSES_A_BLOCK = 6, 14
NEST_EVERY = 3
FRICTION_SD = 0.15  # of its logarithm, from stop to stop
ALL_AT_ONCE = 0.6  # share of the poses at which one visit reads all reflectors


# What a drive did on a campaign, by its number and its part: places over the command and motor's forces, by reading.
Kept = dict[tuple[int, DrivePart], tuple[Array, Array]]


@dataclass(frozen=True)
class Visit:
    """One arrival. target (2,): x, y of the platform in m; directions: side of each drive, +1 from below.

    readings: reflector and dwell in s of each; pass_: how often the target was visited before;
    rub: friction of each guide, over its usual one.
    """

    target_m: tuple[float, float]
    directions: tuple[int, int]
    speed_m_per_s: float
    payload: int
    pose: int
    pass_: int
    readings: tuple[tuple[int, float], ...]
    nests: bool = False
    rub: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class Campaign:
    """Visits in their order on a nominal machine."""

    nominal: Machine
    visits: tuple[Visit, ...]

    @cached_property
    def drives_m(self) -> Array:
        """Commanded drives (v, 2)."""
        target = np.array([visit.target_m for visit in self.visits])
        return drives_of(self.nominal, target[:, 0], target[:, 1])

    @cached_property
    def payload(self) -> NDArray[np.intp]:
        """Number of the payload (v,) of each visit."""
        return np.array([visit.payload for visit in self.visits])

    @property
    def payload_kg(self) -> Array:
        """Its mass (v,)."""
        return np.array(PAYLOADS_KG)[self.payload]

    @cached_property
    def of_reading(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        """Visit, reflector and dwell of each reading (r,), nests among them."""
        rows: list[tuple[int, int, float]] = []
        for v, visit in enumerate(self.visits):
            rows += [(v, reflector, dwell) for reflector, dwell in visit.readings]
            if visit.nests:
                last = visit.readings[-1][1]
                rows += [(v, nest, last + NEXT_S * (k + 1)) for k, nest in enumerate(NESTS)]
        visits, reflectors, dwell_s = zip(*rows, strict=True)
        return np.array(visits), np.array(reflectors), np.array(dwell_s)

    def thinned(self, step: int) -> Campaign:
        """Each so many-th visit only."""
        return Campaign(self.nominal, self.visits[::step])


@dataclass(frozen=True)
class CarriedOut:
    """What was there without noise: reflectors' places (r, 3), machine's axes; motors' forces (r, 2) in N.

    off_m (r, 2): where carriages stood over their commands by what is in the drives.
    """

    places_m: Array
    motor_n: Array
    off_m: Array


@dataclass(frozen=True)
class Disturbances:
    """What is always there, by reading: travel_m (r, 2) of the drives, growth (r, 4) of the struts, relative."""

    travel_m: Array
    growth: Array


def draw_campaign(nominal: Machine, style: str, rng: np.random.Generator) -> Campaign:
    """The visits of a campaign of one of the STYLES."""
    visits = _drawn_visits(style, rng)
    rub = np.exp(FRICTION_SD * rng.standard_normal((len(visits), SLIDERS)))
    return Campaign(
        nominal,
        tuple(replace(visit, rub=(float(r[0]), float(r[1]))) for visit, r in zip(visits, rub, strict=True)),
    )


def _drawn_visits(style: str, rng: np.random.Generator) -> list[Visit]:
    visits: list[Visit] = []
    poses = [(rng.uniform(-HALF_X_M, HALF_X_M), rng.uniform(-HALF_Y_M, HALF_Y_M)) for _ in range(70)]
    if style != "randomised":
        sides = (1, -1) if style == "bidirectional" else (1,)
        many = 45 if style == "bidirectional" else 70
        for p in range(many):
            for k, side in enumerate(sides):
                nests = len(visits) % NEST_EVERY == NEST_EVERY - 1
                visits.append(Visit(poses[p], (side, side), 0.12, 0, p, k, _all_at_once(), nests))
        return visits
    seen: dict[int, int] = {}
    order = [int(p) for p in rng.permutation(70)] + [int(p) for p in rng.integers(0, 6, 14)]
    payloads = [0, 1, 2, *(int(p) for p in rng.permutation(3))]
    for number, p in enumerate(order):
        first, second = (int(side) for side in rng.choice((-1, 1), 2))
        speed = float(rng.choice(SPEEDS_M_PER_S))
        payload, nests = payloads[number // POSES_A_BLOCK], number % NEST_EVERY == NEST_EVERY - 1
        if rng.uniform() < ALL_AT_ONCE:
            plans = [_all_at_once()]
        else:
            dwell = float(rng.choice(SHORT_S))
            plans = [((reflector, dwell),) for reflector in ON_MACHINE]
        for k, readings in enumerate(plans):
            pass_, last = seen.get(p, 0), k == len(plans) - 1
            seen[p] = pass_ + 1
            visits.append(Visit(poses[p], (first, second), speed, payload, p, pass_, readings, nests and last))
    return visits


def _all_at_once() -> tuple[tuple[int, float], ...]:
    return tuple((reflector, FIRST_S + NEXT_S * k) for k, reflector in enumerate(ON_MACHINE))


def carry_out(
    machine: Machine,
    campaign: Campaign,
    drives: Mapping[int, DrivePart],
    parts: StrutParts,
    disturbances: Disturbances,
    kept: Kept | None = None,
) -> CarriedOut:
    """Send both drives to all targets. kept: what the same campaign and drives gave before, which is added to."""
    visits, reflectors, _ = campaign.of_reading
    commanded = campaign.drives_m
    pose, tension = hang(machine, commanded, campaign.payload)
    load_n = loads_n(machine, commanded, pose, tension)
    off_m, motor_n = np.zeros((len(visits), SLIDERS)), np.empty((len(visits), SLIDERS))
    kept = {} if kept is None else kept
    for a, part in drives.items():
        if (a, part) not in kept:
            kept[a, part] = _along(part, a, campaign, load_n[:, a])
        off_m[:, a], motor_n[:, a] = kept[a, part]
    places = _places(machine, campaign, off_m + disturbances.travel_m, parts, disturbances.growth)
    return CarriedOut(places[np.arange(len(visits)), reflectors], motor_n, off_m)


def _along(part: DrivePart, a: int, campaign: Campaign, load_n: Array) -> tuple[Array, Array]:
    """Where one drive's carriage was over its command, and the motor's force, at each reading (r,)."""
    drive, at, forces = Drive(part), [], []
    visits, _, dwell_s = campaign.of_reading
    for v, visit in enumerate(campaign.visits):
        arrival = Arrival(
            float(campaign.drives_m[v, a]), visit.directions[a], visit.speed_m_per_s, float(load_n[v]), visit.rub[a]
        )
        rest = drive.visit(arrival, dwell_s[visits == v])
        at.append(rest.carriage_m)
        forces.append(rest.motor_n)
    return np.concatenate(at), np.concatenate(forces)


def _places(machine: Machine, campaign: Campaign, off_m: Array, parts: StrutParts, growth: Array) -> Array:
    """Places (r, 7, 3) of all reflectors at each reading."""
    visits, _, _ = campaign.of_reading
    drives_m = campaign.drives_m[visits] + off_m
    payload = campaign.payload[visits]
    pose, _ = hang(machine, drives_m, payload, growth)
    if parts == StrutParts():  # springs alone: the same as MuJoCo's to a nanometre, which a test watches
        carriages = np.concatenate([machine.carriages_m(drives_m), np.zeros((len(visits), SLIDERS, 1))], axis=-1)
        return places_m(machine, pose, carriages)
    grown = hang(machine, drives_m, payload)[0]
    struts = Struts(machine, parts)
    rests = [struts.rest(drives_m[r], grown[r], int(payload[r])) for r in range(len(visits))]
    poses = np.array([rest.pose for rest in rests]) + (pose - grown)  # growth is small enough to be added
    return places_m(machine, poses, np.array([rest.carriages for rest in rests]))


def timeline(campaign: Campaign) -> tuple[Array, NDArray[np.intp]]:
    """Rig time (r,) of each reading, and payload exchanges (r,) before it."""
    visits, _, dwell_s = campaign.of_reading
    arrived, exchanges, clock, count = [], [], 20.0, 0
    before: Sequence[float] = campaign.drives_m[0].tolist()
    for v, visit in enumerate(campaign.visits):
        if v and visit.payload != campaign.visits[v - 1].payload:
            clock += 120.0
            count += 1
        way = max(abs(a - b) for a, b in zip(campaign.drives_m[v].tolist(), before, strict=True))
        before = campaign.drives_m[v].tolist()
        clock += 2.5 + way / visit.speed_m_per_s
        arrived.append(clock)
        exchanges.append(count)
        clock += float(dwell_s[visits == v][-1]) + 0.5
    return np.array(arrived)[visits] + dwell_s, np.array(exchanges)[visits]
