"""What to measure next: additions to a campaign, ranked by the expected information on the cause per minute.

Each hypothesis (no effect, an effect of the ranking as fitted, an effect that the campaign could not show, at a
plausible size) predicts by how much readings at further visits differ from those at the nearest measured visit; the
calibration has absorbed the rest. The information of an addition is bounded from below by the distances between these
predictions (Kolchinsky and Tracey 2017, eq. 10, with the Bhattacharyya distance).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.diagnosis.channel_responses import UNKNOWN_CHANNEL
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.findings.proposals import VISITS, Proposal, duration_min, proposals
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.observed_model import TOOL, ObservedModel
from calibration.diagnosis.result import NONE, UNKNOWN, CampaignAddition
from calibration.diagnosis.search import SearchResult
from calibration.effects.api import Effect
from calibration.effects.columns import Contributions
from calibration.effects.combined_context import append_context, clip_to_campaign
from calibration.effects.context import ArrivalHistory, ReadingContext
from calibration.effects.departures import lasting_columns
from calibration.machine.inverse import rigid_drives
from calibration.model.visits import Visits

OF_CAMPAIGN = ("way.", "warmth.", "temperature")  # coordinates whose range is that of the campaign's own readings
HYPOTHESIS_MIN_PROBABILITY = 0.005
UNTESTED_PRIOR_SHARE = 0.4  # of the probability, for effects that the campaign could not show
NEGLIGIBLE_SIGMA = 1e-12  # RMS that a size of one makes at the platform
ASSUMED_SIGMA = 2.0  # RMS at the platform of such an effect
ASSUMED_FRICTION = 0.1  # of the drive's median torque, by approach direction
READING_S = 1.0  # half the duration of aiming and a reading
DISTINGUISHABLE_DISTANCE = 2.0  # Bhattacharyya distance from which on two hypotheses count as distinguished
MAX_ADDITIONS = 6
LEAST_SWING_K, SWING_MIN, REFLECTORS_MIN = 1.0, 120.0, 60.0


def rank_additions(
    linear: LinearisedReadings,
    search_result: SearchResult,
    ranking: Mapping[str, float],
    untested: tuple[Effect, ...],
) -> tuple[CampaignAddition, ...]:
    """Additions to the campaign, the most informative per minute first."""
    proposed = list(proposals(linear))
    if not proposed:
        return ()
    hypotheses = _Hypotheses(linear, search_result, ranking, untested)
    # All visits at once, because basis sets are built over the campaign and all further visits.
    everything = Proposal("", "", tuple(visit for proposal in proposed for visit in proposal.visits))
    parts = np.split(hypotheses.predict(everything), len(proposed), axis=1)
    out = [
        hypotheses.evaluate(proposal, predictions, duration_min(linear, proposal))
        for proposal, predictions in zip(proposed, parts, strict=True)
    ]
    out.sort(key=lambda addition: -addition.gain_bit_per_min)
    return (*out[:MAX_ADDITIONS], *(_additions_without_visits(linear) if linear.by_station else ()))


class _Hypotheses:
    """The predictions of each hypothesis, evaluated addition by addition."""

    def __init__(
        self,
        linear: LinearisedReadings,
        search_result: SearchResult,
        ranking: Mapping[str, float],
        untested: tuple[Effect, ...],
    ) -> None:
        self._linear = linear
        self._fitted = [
            cause
            for cause in search_result.ranking
            if ranking.get(cause.effect.name, 0.0) >= HYPOTHESIS_MIN_PROBABILITY
        ]
        self._assumed = [(effect, i) for effect in untested for i in range(len(effect.places(self._linear.machine)))]
        tested_share = 1.0 - UNTESTED_PRIOR_SHARE if self._assumed else 1.0
        self.names = [
            NONE,
            *(cause.effect.name for cause in self._fitted),
            *(effect.name for effect, _ in self._assumed),
        ]
        weights = [ranking.get(NONE, 0.0) + ranking.get(UNKNOWN, 0.0)]
        weights += [ranking[cause.effect.name] for cause in self._fitted]
        assumed_share = UNTESTED_PRIOR_SHARE / max(len(self._assumed), 1)
        self.prior = np.array([*(tested_share * w for w in weights), *([assumed_share] * len(self._assumed))])
        self.prior /= self.prior.sum()

    def evaluate(self, proposal: Proposal, predictions: Array, minutes: float) -> CampaignAddition:
        """A proposal with its gain and the names that it would distinguish; predictions (h, r) at its visits."""
        distance = np.sum((predictions[:, None] - predictions[None]) ** 2, axis=2) / 8.0
        gain = max(0.0, -float(self.prior @ np.log2(np.exp(-distance) @ self.prior)))
        settles = {
            name
            for i, name in enumerate(self.names)
            if name != NONE and np.min(np.delete(distance[i], i), initial=np.inf) > DISTINGUISHABLE_DISTANCE
        }
        return CampaignAddition(proposal.name, proposal.adds, tuple(sorted(settles)), minutes, gain, proposal.visits)

    def predict(self, proposal: Proposal) -> Array:
        """Whitened readings (h, r) of the platform's and the sliders' reflectors at the visits, by hypothesis."""
        linear = self._linear
        smrs = np.array(sorted(set(linear.smr[linear.visit >= 0].tolist())), dtype=np.intp)
        planned, pose = self._planned_context(proposal)
        appended = append_context(linear.context, clip_to_campaign(linear.context, planned))
        observed = self._observed_model(planned, pose, smrs)
        with_campaign = self._with_campaign(appended, observed)
        inputs = inputs_of_readings(with_campaign, Channels(with_campaign), lambda *_: [], lambda *_: [])
        rows = np.repeat(np.arange(len(linear.smr), len(appended)), len(smrs))
        measured = np.flatnonzero(linear.visit >= 0)
        distance = np.sum((planned.drives[:, None] - linear.context.drives[measured][None]) ** 2, axis=2)
        nearest_row = np.repeat(measured[np.argmin(distance, axis=1)], len(smrs))
        response = _ChannelResponse(linear, observed, rows, nearest_row)
        no_change = np.zeros(len(observed.smr) * 3)
        predictions = [no_change]
        for cause in self._fitted:
            place = cause.effect.places(linear.machine).index(cause.place)
            best, basis_set = cause.best, cause.best.basis_set
            contributions = cause.effect.contributions(inputs, place, basis_set.curve)
            if basis_set.parameters.keys() & {"period_m", "onset_s"} or max(basis_set.columns) >= len(contributions):
                predictions.append(no_change)  # periods and onsets of the campaign do not tell about later visits
                continue
            if any(departure.coordinate.startswith(OF_CAMPAIGN) for departure in basis_set.departures):
                predictions.append(no_change)  # nor what goes with a way or a temperature that are yet to come
                continue
            if any(name.startswith(UNKNOWN_CHANNEL) for column in contributions for name, _ in column):
                predictions.append(no_change)  # how such an unknown acts is known of the measured readings alone
                continue
            columns = lasting_columns(contributions, inputs, cause.effect, place, basis_set)
            coefficients = best.coefficients[: len(columns)]
            shifts = [c * response(column) for column, c in zip(columns, coefficients, strict=True)]
            predictions.append(np.sum(shifts, axis=0))
        for effect, place in self._assumed:
            built = effect.basis_sets(inputs, place)
            if not built.sets:
                predictions.append(no_change)
                continue
            main = built.contributions[built.sets[0].columns[0]]
            absolute = float(np.sqrt(np.mean(response(main, absolute=True) ** 2)))
            seen = absolute > NEGLIGIBLE_SIGMA  # of a size of one: else no planned reading responds to it
            predictions.append(response(main) * (ASSUMED_SIGMA / absolute) if seen else no_change)
        return np.array(predictions)

    def _planned_context(self, proposal: Proposal) -> tuple[ReadingContext, Array]:
        """Context of the visits, one row each, after the campaign, and approximate poses (v, 6) of the platform."""
        linear, machine = self._linear, self._linear.machine
        context, n = linear.context, len(proposal.visits)
        target = np.array([visit.target_m for visit in proposal.visits])
        pose = target.copy()
        pose[:, :3] -= rotation_matrix(target[:, 3:]) @ machine.tool_point_m
        drives = rigid_drives(machine, linear.poses.geometry, pose)
        drives = np.where(np.isfinite(drives), drives, np.nanmean(drives, axis=0))
        pace = float(np.median(np.diff(context.history.arrived_s)))
        times = np.asarray(float(context.t_s.max()) + pace * (1.0 + np.arange(n) % VISITS), dtype=np.float64)
        loads = linear.loads
        payload = np.array([loads[visit.payload].mass_kg for visit in proposal.visits])
        carried_kg = machine.moving_mass_kg + float(np.median(context.payload_kg))
        weight = (machine.moving_mass_kg + payload) / carried_kg if carried_kg > 0.0 else np.ones(n)  # none stated
        direction = np.array([visit.direction for visit in proposal.visits], dtype=np.float64)
        planned = ReadingContext(
            history=ArrivalHistory(times, drives),
            t_s=times,
            arrival=np.arange(n),
            drives=drives,
            direction=direction,
            velocity_m_per_s=np.zeros_like(drives),
            torque=np.median(context.torque, axis=0) * (weight[:, None] + ASSUMED_FRICTION * direction),
            speed_m_per_s=np.array([visit.speed_m_per_s for visit in proposal.visits]),
            dwell_s=np.array([visit.dwell_s for visit in proposal.visits]) + READING_S,
            payload_kg=payload,
            payload_com_m=np.array([loads[visit.payload].com_m for visit in proposal.visits]),
            exchanges=np.full(n, float(context.exchanges.max())),
            air_refractivity=np.full(n, float(np.median(context.air_refractivity))),
            temperatures_c={name: np.full(n, float(np.median(t))) for name, t in context.temperatures_c.items()},
            start_s=context.start_s,
            known_tables=context.known_tables,
        )
        return planned, pose

    def _observed_model(self, planned: ReadingContext, pose: Array, smrs: NDArray[np.intp]) -> ObservedModel:
        """All reflectors (k) at all planned visits (v), visit by visit."""
        linear = self._linear
        temperatures = {name: t for name, t in planned.temperatures_c.items() if name != "air"}
        # Nobody pulls at visits that are proposed, whatever forces the readings at hand were taken under.
        unloaded = tuple((np.zeros((len(pose), 3)), np.zeros((len(pose), 3))) for _ in linear.poses.visits.forces)
        visits = Visits(planned.drives, pose, planned.payload_kg, planned.payload_com_m, temperatures, unloaded)
        poses = linear.poses.model.predict(linear.poses.values, visits)
        n, k = len(planned), len(smrs)
        middle = linear.position_m[linear.visit >= 0].mean(axis=0)
        return ObservedModel(
            machine=linear.machine,
            context=planned,
            smr=np.tile(smrs, n),
            visit=np.repeat(np.arange(n), k),
            poses=poses,
            frame=linear.frame,
            mounted_m=linear.mounted_m,
            position_m=np.repeat(middle[None], n * k, axis=0),
        )

    def _with_campaign(self, appended: ReadingContext, observed: ObservedModel) -> ObservedModel:
        """One row per reading of the campaign and per planned visit: the rows over which basis sets are built."""
        linear = self._linear
        visits = linear.poses.visits.concatenate(observed.poses.visits)
        poses = linear.poses.model.predict(linear.poses.values, visits)
        count, planned = len(linear.poses.visits), len(observed.context)
        visit = np.concatenate([np.where(linear.visit >= 0, linear.visit, 0), count + np.arange(planned)])
        middle = np.repeat(linear.position_m.mean(axis=0)[None], planned, 0)
        return replace(
            observed,
            context=appended,
            smr=np.full(len(appended), 0 if linear.by_station else TOOL, dtype=np.intp),
            visit=visit,
            poses=poses,
            position_m=np.concatenate([linear.sight_m, middle]),
        )


class _ChannelResponse:
    """Shifts of the readings at planned visits by a column, beyond its shift at the nearest measured visits."""

    def __init__(
        self, linear: LinearisedReadings, observed: ObservedModel, rows: NDArray[np.intp], nearest_row: NDArray[np.intp]
    ) -> None:
        self._channels, self._rows, self._nearest_row = Channels(observed), rows, nearest_row
        self._by_axis = linear.read_shares / linear.sigma_of_length_m

    def __call__(self, contributions: Contributions, *, absolute: bool = False) -> Array:
        """In sigma, (m,); `absolute`: without subtracting the shift at the nearest measured visit."""
        measured = 0.0 if absolute else 1.0
        shift = sum(
            self._channels.shift_m(name) * (shape[self._rows] - measured * shape[self._nearest_row])[:, None]
            for name, shape in contributions
        )
        return np.nan_to_num(np.asarray(shift * self._by_axis).ravel())  # a pose out of reach carries no information


def _additions_without_visits(linear: LinearisedReadings) -> Iterator[CampaignAddition]:
    """Additions whose gain is not computed: a swing of temperature, reflectors that were not measured."""
    swing_k = max(float(np.ptp(t)) for t in linear.context.temperatures_c.values())
    if swing_k < LEAST_SWING_K:
        adds = f"let the shop warm and cool by 2 K while measuring; so far it was {swing_k:.1f} K"
        yield CampaignAddition("temperature swing", adds, (), SWING_MIN, 0.0, ())
    measured = set(linear.smr.tolist())
    for place, where in (("slider", "on the sliders"), ("floor", "on the floor")):
        missing = [s.name for i, s in enumerate(linear.machine.smrs) if s.on == place and i not in measured]
        if missing:
            adds = f"measure {', '.join(missing)} at every visit or nest check"
            yield CampaignAddition(f"reflectors {where}", adds, (), REFLECTORS_MIN, 0.0, ())
