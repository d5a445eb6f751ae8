"""What to measure next: additions to a campaign, ranked by the information on the cause that they promise a minute.

Each hypothesis (nothing, an effect of the ranking as it was fitted, an effect that the campaign could not show, of a
plausible size) predicts what further visits would see otherwise than the visit next to them that was measured: the
rest, calibration has taken up. How much an addition tells is bounded from below by the distances of the predictions
(Kolchinsky and Tracey 2017, eq. 10, with the Bhattacharyya distance).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import setting_from
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import Baseline, Seen
from calibration.diagnosis.result import NONE, UNKNOWN, Candidate, PlannedVisit
from calibration.diagnosis.search import Explanation
from calibration.effects.api import Acts, Effect
from calibration.effects.context import History, Moments, held, joined
from calibration.machine.description import Machine
from calibration.machine.inverse import rigid_drives
from calibration.model.visits import Visits

VISITS = 60
SEED = 4  # of the poses that are proposed, so that a diagnosis says the same twice
WORTH = 0.005  # probability from which on an effect is a hypothesis
UNTESTED = 0.4  # of the probability, for what the campaign could not show
SUPPOSED_SIGMA = 2.0  # RMS at the platform of what it could not show
DWELLS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SUPPOSED_FRICTION = 0.1  # of the drive's median torque, by the side of approach
EXCHANGE_S, SET_UP_S = 300.0, 1800.0  # what people take, roughly: exchange of a payload; station, nests and warming
READING_S = 1.0  # half of what aiming and a reading take
LEAST_SWING_K, SWING_MIN, REFLECTORS_MIN = 1.0, 120.0, 60.0
TOLD_APART = 2.0  # Bhattacharyya distance from which on two hypotheses are taken to be told apart
MOST = 6


@dataclass(frozen=True)
class _Idea:
    """An addition before it is judged."""

    name: str
    adds: str
    visits: tuple[PlannedVisit, ...]


def candidates(
    readout: Readout,
    found: Explanation,
    ranking: Mapping[str, float],
    untested: tuple[Effect, ...],
) -> tuple[Candidate, ...]:
    """Additions to the campaign, the most informative a minute first."""
    known = readout.baseline
    ideas = list(_ideas(known))
    if not ideas:
        return ()
    hypotheses = _Hypotheses(readout, found, ranking, untested)
    # All visits at once: forms are built over the campaign only once.
    everything = _Idea("", "", tuple(visit for idea in ideas for visit in idea.visits))
    parts = np.split(hypotheses.predicted(everything), len(ideas), axis=1)
    pairs = zip(ideas, parts, strict=True)
    out = [hypotheses.judged(idea, predicted, _minutes(known, idea)) for idea, predicted in pairs]
    out.sort(key=lambda candidate: -candidate.gain_bit_per_min)
    return (*out[:MOST], *_beyond_visits(known))


def _ideas(known: Baseline) -> Iterator[_Idea]:
    """Further visits, each varying what a campaign may vary, and all of it together."""
    m, machine = known.moments, known.machine
    rng = np.random.default_rng(SEED)
    poses = _poses(machine, rng, VISITS)
    side = np.sign(m.direction[known.visit >= 0].mean(axis=0) + 1e-9)
    same = tuple(int(s) for s in np.where(side == 0.0, 1.0, side))
    speed = float(np.median(m.speed_m_per_s[known.visit >= 0]))
    dwell = _usual_rest_s(known)
    payload = int(np.median(known.recording["payload"][known.rows]))
    heavy = int(np.argmax([p.mass_kg for p in known.recording.file.payloads]))
    speeds = (0.4 * speed, speed, 2.0 * speed)

    def visits(**varied: bool) -> tuple[PlannedVisit, ...]:
        out = []
        for k, pose in enumerate(poses):
            sides = tuple(int(s) for s in rng.choice([-1, 1], len(same))) if varied.get("sides") else same
            rest = float(rng.choice(DWELLS_S)) if varied.get("dwells") else dwell
            at = float(rng.choice(speeds)) if varied.get("speeds") else speed
            load = heavy if varied.get("loads") and 2 * k >= VISITS else payload
            out.append(PlannedVisit(tuple(float(x) for x in pose), sides, load, at, rest))
        return tuple(out)

    yield _Idea("random poses", "poses off the campaign's, as it was measured", visits())
    yield _Idea("both directions", "random poses, approached from either side", visits(sides=True))
    yield _Idea("varied rest", "random poses, rests from 0.5 to 16 s, three speeds", visits(dwells=True, speeds=True))
    yield _Idea(
        "directions and rest", "either side, rests from 0.5 to 16 s, three speeds",
        visits(sides=True, dwells=True, speeds=True),
    )  # fmt: skip
    if heavy != payload:
        yield _Idea("another payload", "random poses, half of them with the heaviest payload", visits(loads=True))
        yield _Idea(
            "everything varied", "either side, varied rest and speed, half with the heaviest payload",
            visits(sides=True, dwells=True, speeds=True, loads=True),
        )  # fmt: skip


def _poses(machine: Machine, rng: np.random.Generator, count: int) -> Array:
    """Tool poses (v, 6) drawn over the workspace, denser towards its edge."""
    low, high = machine.workspace.T
    unit = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(0.0, 1.0, (count, len(machine.commanded))))
    out = np.repeat(machine.workspace.mean(axis=1)[None], count, axis=0)
    out[:, machine.commanded] = low[machine.commanded] + (high - low)[machine.commanded] * unit
    return out


def _usual_rest_s(known: Baseline) -> float:
    """Median over visits of the rest before their first reading."""
    on_pose = known.visit >= 0
    first = np.full(int(known.visit.max()) + 1, np.inf)
    np.minimum.at(first, known.visit[on_pose], known.moments.dwell_s[on_pose])
    return float(np.median(first))


def _minutes(known: Baseline, idea: _Idea) -> float:
    """How long it takes: setting up, visits at the campaign's pace with their rests, exchanges of payload."""
    pace = float(np.median(np.diff(known.moments.history.arrived_s)))
    loads = [known.recording["payload"][known.rows][-1], *(v.payload for v in idea.visits)]
    exchanges = sum(a != b for a, b in pairwise(loads))
    without_rest_s = max(pace - _usual_rest_s(known), 1.0)
    visits_s = sum(without_rest_s + v.dwell_s for v in idea.visits)
    return float(SET_UP_S + visits_s + EXCHANGE_S * exchanges) / 60.0


class _Hypotheses:
    """What each hypothesis predicts, judged addition by addition."""

    def __init__(
        self, readout: Readout, found: Explanation, ranking: Mapping[str, float], untested: tuple[Effect, ...]
    ) -> None:
        self._readout, self._known = readout, readout.baseline
        self._fitted = [c for c in found.ranking if ranking.get(c.effect.name, 0.0) >= WORTH]
        self._supposed = [(e, i) for e in untested for i in range(len(e.places(self._known.machine)))]
        rest = 1.0 - UNTESTED if self._supposed else 1.0
        self.names = [NONE, *(c.effect.name for c in self._fitted), *(e.name for e, _ in self._supposed)]
        weights = [ranking.get(NONE, 0.0) + ranking.get(UNKNOWN, 0.0)]
        weights += [ranking[c.effect.name] for c in self._fitted]
        shared = UNTESTED / max(len(self._supposed), 1)
        self.prior = np.array([*(rest * w for w in weights), *([shared] * len(self._supposed))])
        self.prior /= self.prior.sum()

    def judged(self, idea: _Idea, predicted: Array, minutes: float) -> Candidate:
        """The idea with its gain, and the names that it would tell apart; predicted (h, r) at its visits."""
        distance = np.sum((predicted[:, None] - predicted[None]) ** 2, axis=2) / 8.0
        gain = -float(self.prior @ np.log2(np.exp(-distance) @ self.prior))
        settles = {
            name
            for i, name in enumerate(self.names)
            if name != NONE and np.min(np.delete(distance[i], i), initial=np.inf) > TOLD_APART
        }
        return Candidate(idea.name, idea.adds, tuple(sorted(settles)), minutes, gain, idea.visits)

    def predicted(self, idea: _Idea) -> Array:
        """Whitened readings (h, r) of the platform's and the sliders' reflectors at the visits, by hypothesis."""
        known = self._known
        smrs = np.array(sorted(set(known.smr[known.visit >= 0].tolist())), dtype=np.intp)
        new, pose = self._moments(idea)
        after = joined(known.moments, held(known.moments, new))
        seen = self._seen(new, pose, smrs)
        everything = self._both(after, seen)
        setting = setting_from(everything, Channels(everything), lambda *_: [], lambda *_: [])
        first = len(known.smr)
        rows = np.repeat(np.arange(first, len(after)), len(smrs))
        measured = np.flatnonzero(known.visit >= 0)
        distance = np.sum((new.drives[:, None] - known.moments.drives[measured][None]) ** 2, axis=2)
        next_to = np.repeat(measured[np.argmin(distance, axis=1)], len(smrs))
        through = _Through(known, seen, rows, next_to)
        nothing = np.zeros(len(seen.smr) * 3)
        out = [nothing]
        for cause in self._fitted:
            place = cause.effect.places(known.machine).index(cause.place)
            best = cause.best
            acts = cause.effect.acts(setting, place, best.form.curve)
            if best.form.parameters.keys() & {"period_m", "onset_s"} or max(best.form.columns) >= len(acts):
                out.append(nothing)  # what stood out in the campaign says nothing of visits after it
                continue
            shifts = [c * through(acts[k]) for k, c in zip(best.form.columns, best.coefficients, strict=True)]
            out.append(np.sum(shifts, axis=0))
        for effect, place in self._supposed:
            forms = effect.forms(setting, place)
            if not forms.forms:
                out.append(nothing)
                continue
            main = forms.acts[forms.forms[0].columns[0]]
            whole = float(np.sqrt(np.mean(through(main, whole=True) ** 2)))
            out.append(through(main) * (SUPPOSED_SIGMA / max(whole, 1e-300)))
        return np.array(out)

    def _moments(self, idea: _Idea) -> tuple[Moments, Array]:
        """Moments of the visits, one a visit, after the campaign, and rough poses (v, 6) of the platform."""
        known, machine = self._known, self._known.machine
        m, n = known.moments, len(idea.visits)
        target = np.array([v.target_m for v in idea.visits])
        pose = target.copy()
        pose[:, :3] -= rotation_matrix(target[:, 3:]) @ machine.tool_point_m
        drives = rigid_drives(machine, known.poses.geometry, pose)
        drives = np.where(np.isfinite(drives), drives, np.nanmean(drives, axis=0))
        pace = float(np.median(np.diff(m.history.arrived_s)))
        times = np.asarray(float(m.t_s.max()) + pace * (1.0 + np.arange(n) % VISITS), dtype=np.float64)
        payloads = known.recording.file.payloads
        load = np.array([payloads[v.payload].mass_kg for v in idea.visits])
        weight = (machine.moving_mass_kg + load) / (machine.moving_mass_kg + float(np.median(m.payload_kg)))
        direction = np.array([v.direction for v in idea.visits], dtype=np.float64)
        moments = Moments(
            history=History(times, drives),
            t_s=times,
            arrival=np.arange(n),
            drives=drives,
            direction=direction,
            velocity_m_per_s=np.zeros_like(drives),
            torque=np.median(m.torque, axis=0) * (weight[:, None] + SUPPOSED_FRICTION * direction),
            speed_m_per_s=np.array([v.speed_m_per_s for v in idea.visits]),
            dwell_s=np.array([v.dwell_s for v in idea.visits]) + READING_S,
            payload_kg=load,
            payload_com_m=np.array([payloads[v.payload].com_m for v in idea.visits]),
            exchanges=np.full(n, float(m.exchanges.max())),
            temperatures_c={name: np.full(n, float(np.median(t))) for name, t in m.temperatures_c.items()},
            start_s=m.start_s,
        )
        return moments, pose

    def _seen(self, moments: Moments, pose: Array, smrs: NDArray[np.intp]) -> Seen:
        known = self._known
        temperatures = {name: t for name, t in moments.temperatures_c.items() if name != "air"}
        visits = Visits(moments.drives, pose, moments.payload_kg, moments.payload_com_m, temperatures)
        values = known.poses.values
        poses = known.poses.model.predict(values, visits)
        n, k = len(moments), len(smrs)
        return Seen(
            known.machine, moments, np.tile(smrs, n), np.repeat(np.arange(n), k), poses, known.frame, known.mounted_m,
            np.repeat(known.position_m[known.visit >= 0].mean(axis=0)[None], n * k, axis=0),
        )  # fmt: skip

    def _both(self, after: Moments, seen: Seen) -> Seen:
        """One row a moment, old and new: what forms are built over."""
        known = self._known
        visits = known.poses.visits.concatenate(seen.poses.visits)
        poses = known.poses.model.predict(known.poses.values, visits)
        count = len(known.poses.visits)
        of_old = np.where(known.visit >= 0, known.visit, 0)
        visit = np.concatenate([of_old, count + np.arange(len(seen.moments))])
        position = np.concatenate(
            [known.position_m, np.repeat(known.position_m.mean(axis=0)[None], len(seen.moments), 0)]
        )
        smr = np.zeros(len(after), dtype=np.intp)
        return replace(seen, moments=after, smr=smr, visit=visit, poses=poses, position_m=position)


class _Through:
    """What shapes through their channels do to new visits, beyond what they did to the visits next to them."""

    def __init__(self, known: Baseline, seen: Seen, rows: NDArray[np.intp], next_to: NDArray[np.intp]) -> None:
        self._channels, self._rows, self._next_to = Channels(seen), rows, next_to
        self._sigma_m = float(np.median(1.0 / np.linalg.norm(known.whiten[:, 0], axis=1)))

    def __call__(self, acts: Acts, *, whole: bool = False) -> Array:
        """In sigma, (m,); `whole`: all they do there."""
        shift = sum(
            self._channels.shift_m(name) * (shape[self._rows] - (0.0 if whole else 1.0) * shape[self._next_to])[:, None]
            for name, shape in acts
        )
        return np.nan_to_num(np.asarray(shift).ravel() / self._sigma_m)  # nothing is told of what cannot be reached


def _beyond_visits(known: Baseline) -> Iterator[Candidate]:
    """What visits alone do not add, its worth not computed: reflectors not measured, a swing of temperature."""
    swing_k = max(float(np.ptp(t)) for t in known.moments.temperatures_c.values())
    if swing_k < LEAST_SWING_K:
        adds = f"let the shop warm and cool by 2 K while measuring; so far it was {swing_k:.1f} K"
        yield Candidate("temperature swing", adds, (), SWING_MIN, 0.0, ())
    measured = set(known.smr.tolist())
    for place, adds in (("slider", "on the sliders"), ("floor", "on the floor")):
        missing = [s.name for i, s in enumerate(known.machine.smrs) if s.on == place and i not in measured]
        if missing:
            yield Candidate(
                f"reflectors {adds}", f"measure {', '.join(missing)} at every visit or nest check",
                (), REFLECTORS_MIN, 0.0, (),
            )  # fmt: skip
