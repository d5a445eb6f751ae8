"""The twin: the fitted model of a machine with the effects that a diagnosis found, ready to be simulated.

It contains the campaign's own context, which defines the effects' basis sets; anything beyond its range is clipped to
it. Geometry, mounting and effects are one joint solution. A twin is data, not code: effects are named, and their basis
sets built anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, require_recording
from calibration.diagnosis.ranking import Cause
from calibration.diagnosis.twin import plain_data
from calibration.diagnosis.twin.answers import RecordedAnswers
from calibration.diagnosis.twin.joint_fit import JointFit, Solution, machine_of_linear_model
from calibration.diagnosis.twin.twin_model import (
    FittedMachine,
    TwinCampaign,
    TwinEffect,
    reflector_positions_m,
    rms_of_columns,
    visits_of,
)
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.effects.columns import Contributions
from calibration.effects.combined_context import CombinedContext, cached_context, clip_to_campaign, combine_contexts
from calibration.effects.context import ReadingContext
from calibration.effects.departures import departing, lasting_columns, lasting_departures
from calibration.machine.description import Machine, parse_machine
from calibration.model.visits import Visits

# Readings of the campaign for each one that is simulated at once: means over all rows remain those of the campaign.
CAMPAIGN_ROWS_PER_ROW = 40
SAME_COLUMNS = 1e-6  # relative difference of their RMS: rounding, of another computer too
SELF_TEST_ROWS = 50  # readings of the campaign on which a twin is tried when it is read


@dataclass(frozen=True)
class Twin:
    """The fitted machine and its effects, over the campaign that found them."""

    campaign: TwinCampaign
    fitted_machine: FittedMachine
    added: tuple[TwinEffect, ...]
    catalogue: Catalogue

    @classmethod
    def from_diagnosis(cls, likelihood: MarginalLikelihood, causes: Sequence[Cause], inputs: EffectInputs) -> Twin:
        """The twin of a diagnosed recording."""
        return cls.from_solution(JointFit(likelihood, causes).solution, likelihood, causes, inputs)

    @classmethod
    def from_solution(
        cls, solution: Solution, likelihood: MarginalLikelihood, causes: Sequence[Cause], inputs: EffectInputs
    ) -> Twin:
        """The twin of a joint solution."""
        linear = require_recording(likelihood.linear)
        added = tuple(
            _twin_effect(cause, coefficients, linear.machine, inputs)
            for cause, coefficients in zip(causes, solution.coefficients, strict=True)
        )
        catalogue = Catalogue(tuple(dict.fromkeys(cause.effect for cause in causes)))
        return cls(_campaign(linear), solution.fitted_machine, added, catalogue)

    def with_solution(self, solution: Solution) -> Twin:
        """The same machine and effects with another joint solution."""
        added = tuple(
            replace(effect, coefficients=tuple(coefficients[: len(effect.coefficients)].tolist()))
            for effect, coefficients in zip(self.added, solution.coefficients, strict=True)
        )
        return replace(self, fitted_machine=solution.fitted_machine, added=added)

    @property
    def machine(self) -> Machine:
        """The nominal machine."""
        return self.campaign.machine

    @property
    def frame(self) -> Frame:
        """From the machine's frame to the station's."""
        return self.fitted_machine.frame

    def places_m(self, context: ReadingContext, rows: NDArray[np.intp] | None = None) -> Array:
        """Positions (n, smrs, 3) of all reflectors in the machine's frame, at rows (n,) of a context or at all of them.

        The other rows of the context are the history of those that are requested.
        """
        requested = np.arange(len(context)) if rows is None else rows
        smrs = len(self.machine.smrs)
        flat = self.readings_m(context, np.repeat(requested, smrs), np.tile(np.arange(smrs), len(requested)))
        return flat.reshape(len(requested), smrs, 3)

    def readings_m(self, context: ReadingContext, rows: NDArray[np.intp], smr: NDArray[np.intp]) -> Array:
        """Positions (n, 3) of reflectors smr (n,) in the machine's frame at rows (n,) of a context.

        Raises InputError if there is no equilibrium or a position is not finite.
        """
        different, row = np.unique(rows, return_inverse=True)
        visits = visits_of(self.machine, context).take(different)
        with np.errstate(all="ignore"):
            poses = self.campaign.poses(self.fitted_machine, visits)
            out = reflector_positions_m(poses, self.fitted_machine.mounted_m, smr, row)
            if self.added:
                start = replace(visits, target_m=poses.equilibrium.coordinates())
                out += self._shift_m(context, start, rows, smr, row)
        if not np.all(np.isfinite(out)):
            raise InputError("twin: a place is not a finite number; make it again with diagnose --add")
        return out

    def _shift_m(
        self,
        context: ReadingContext,
        visits: Visits,
        rows: NDArray[np.intp],
        smr: NDArray[np.intp],
        row: NDArray[np.intp],
    ) -> Array:
        """Shifts (n, 3) of the reflectors by the effects."""
        clipped = clip_to_campaign(self.campaign.context, context)
        poses = self.campaign.model.predict(self.campaign.linearised_at.values, visits)
        if not np.all(poses.equilibrium.converged):
            poses = self.campaign.poses(self.campaign.linearised_at, visits)
        channels, requested = self.campaign.channels_and_inputs(poses, clipped, smr, row)
        cached = cached_context(clipped, context)
        out = np.zeros((len(rows), 3))
        rows_at_once = max(1, len(self.campaign.context) // CAMPAIGN_ROWS_PER_ROW)
        for first in range(0, len(rows), rows_at_once):
            chunk = np.arange(first, min(first + rows_at_once, len(rows)))
            combined = combine_contexts(self.campaign.cached_context, clipped, cached, rows[chunk])
            inputs = self._combined_inputs(requested, chunk, combined)
            for effect in self.added:
                columns = self._contributions(inputs, effect)
                for contribution, coefficient in zip(columns, effect.coefficients, strict=True):
                    for channel, shape in contribution:
                        out[chunk] += coefficient * channels.shift_m(channel)[chunk] * shape[-len(chunk) :, None]
        return out

    def _combined_inputs(
        self, requested: EffectInputs, chunk: NDArray[np.intp], combined: CombinedContext
    ) -> EffectInputs:
        """Inputs for the campaign's readings, followed by some of those requested, clipped to the campaign's range."""
        campaign = self.campaign.inputs

        def append(of_campaign: Array, of_requested: Array) -> Array:
            clipped = np.clip(of_requested[chunk], of_campaign.min(axis=0), of_campaign.max(axis=0))
            return np.concatenate([of_campaign, clipped])

        return replace(
            campaign,
            context=combined,
            tension_n=append(campaign.tension_n, requested.tension_n),
            tension_response_n_per_m=append(campaign.tension_response_n_per_m, requested.tension_response_n_per_m),
            payload_elongation_m={
                name: append(elongation, requested.payload_elongation_m[name])
                for name, elongation in campaign.payload_elongation_m.items()
            },
            pull_n=append(campaign.pull_n, requested.pull_n),
            moment_nm=append(campaign.moment_nm, requested.moment_nm),
            sight_m=append(campaign.sight_m, requested.sight_m),
        )

    def _contributions(self, inputs: EffectInputs, added: TwinEffect) -> list[Contributions]:
        effect = self.catalogue.effect(added.effect)
        replayed = added.answers.replay(inputs)
        contributions = effect.contributions(replayed, added.place, added.curve)
        own = [contributions[column] for column in added.columns]
        return [*own, *departing(replayed, effect, added.place, own, added.departures)]

    def to_data(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        return plain_data.to_data(self.campaign, self.fitted_machine, self.added)

    @classmethod
    def from_data(cls, machine_text: str, data: Mapping[str, Any], catalogue: Catalogue | None = None) -> Twin:
        """The twin that `to_data` described. Raises InputError, in one line, if the data are invalid."""
        machine = parse_machine(machine_text, "twin")
        catalogue = catalogue or load_catalogue()
        twin = cls(*plain_data.from_data(machine, data, catalogue), catalogue)
        twin._self_test()
        return twin

    def _self_test(self) -> None:
        """Use everything once, so that invalid data show here and not while the twin is served."""
        try:
            for added in self.added:
                built = rms_of_columns(self._contributions(self.campaign.inputs, added))
                if not np.allclose(built, added.column_rms, rtol=SAME_COLUMNS, atol=0.0):
                    raise InputError(
                        f"twin: '{added.effect}' has other columns in this version; make it again with diagnose --add"
                    )
            rows = np.unique(np.linspace(0, len(self.campaign.smr) - 1, SELF_TEST_ROWS).astype(np.intp))
            self.readings_m(self.campaign.context, rows, self.campaign.smr[rows])
        except InputError:
            raise
        except Exception as error:  # a user's effect may raise anything
            line = " ".join(str(error).split())
            raise InputError(
                f"twin: {type(error).__name__}: {line}; make it again with diagnose --add and the same effects"
            ) from error


def _twin_effect(cause: Cause, coefficients: Array, machine: Machine, inputs: EffectInputs) -> TwinEffect:
    """The effect of a cause with the answers that its basis sets were built with.

    What belongs to single visits of the campaign is no property of the machine and left out.
    """
    effect, basis_set = cause.effect, cause.best.basis_set
    place = effect.places(machine).index(cause.place)
    contributions = effect.contributions(inputs, place, basis_set.curve)
    columns = lasting_columns(contributions, inputs, effect, place, basis_set)
    return TwinEffect(
        effect=effect.name,
        place=place,
        columns=basis_set.columns,
        curve=basis_set.curve,
        departures=lasting_departures(basis_set),
        coefficients=tuple(coefficients[: len(columns)].tolist()),
        answers=RecordedAnswers.record(inputs, lambda used: effect.contributions(used, place, basis_set.curve)),
        column_rms=rms_of_columns(columns),
    )


def _campaign(linear: LinearModel) -> TwinCampaign:
    return TwinCampaign(
        machine=linear.machine,
        context=linear.context,
        smr=linear.smr,
        visit=linear.visit,
        equilibrium_poses=linear.poses.equilibrium.coordinates(),
        linearised_at=machine_of_linear_model(linear),
    )
