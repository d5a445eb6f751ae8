"""Summary of the causes: size, place, probability, and the effects that are equivalent to the verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.cause_size import absorbed_share, relative_u_of_form, size_of
from calibration.diagnosis.channels import unit_of_channel
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.parameter_uncertainty import aliases, parameter_uncertainty
from calibration.diagnosis.ranking import Cause, as_found, include_cause
from calibration.diagnosis.result import FoundEffect, FoundPlace, Quantity
from calibration.diagnosis.search import SearchResult
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.verdict import presence_probability
from calibration.effects.api import EffectInputs
from calibration.effects.departures import STIFFENED


def equivalent_effects(
    search_result: SearchResult, likelihood: MarginalLikelihood, verdict: str
) -> tuple[tuple[str, ...], float]:
    """Effects that the readings do not exclude and whose prediction is that of the verdict; the largest difference.

    Predictions agree if they differ by less than `equivalent_sigma`, RMS over the platform's readings, after the
    calibration has been refitted.
    """
    main = [cause for cause in search_result.causes if cause.effect.name == verdict]
    if not main:
        return (), 0.0
    signal = np.sum([_signal(cause, likelihood) for cause in main], axis=0)
    names, largest = [], 0.0
    log_evidence = next(cause.log_evidence for cause in search_result.ranking if cause.effect.name == verdict)
    threshold = log_evidence - VERDICT.distinguishable - VERDICT.distinguishable_share * log_evidence
    rivals = [c for c in search_result.ranking if c.effect.name != verdict and c.log_evidence > threshold]
    for rival in rivals[: VERDICT.max_compared]:
        remaining_signal = include_cause(likelihood, rival).apply(signal[:, :, None])[:, :, 0]
        difference = likelihood.linear.rms_sigma(remaining_signal)
        if difference < VERDICT.equivalent_sigma:
            names.append(rival.effect.name)
            largest = max(largest, difference)
    return tuple(names), largest


def _signal(cause: Cause, likelihood: MarginalLikelihood) -> Array:
    """Whitened shifts (n, w) of the readings by a cause."""
    return np.einsum("nwk,k->nw", likelihood.columns(cause.contributions), cause.best.coefficients)


def summarise_effect(
    found: Sequence[Cause],
    others: Sequence[Cause],
    ranking: Mapping[str, float],
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    *,
    explained: float,
    main: bool,
) -> FoundEffect:
    """An effect at the places where it was found, the strongest first, beside others; `main`: it is the verdict.

    likelihood: without any cause; explained: log evidence of all causes together.
    """
    first = found[0]
    places = tuple(
        _summarise_place(cause, [other for other in (*found, *others) if other is not cause], likelihood, inputs)
        for cause in found
    )
    signal = np.sum([_signal(cause, likelihood) for cause in found], axis=0)
    return FoundEffect(
        effect=first.effect.name,
        place=places[0].place,
        size=places[0].size,
        probability=ranking[first.effect.name] if main else presence_probability(_gain(found), explained, ranking),
        place_probability=places[0].probability,
        raw_sigma=likelihood.linear.rms_shift_sigma(signal),
        visible_sigma=likelihood.linear.rms_shift_sigma(likelihood.linear.after_calibration(signal)),
        others=places[0].others,
        differs_with=places[0].differs_with,
        aliases=places[0].aliases,
        places=places,
    )


def _gain(found: Sequence[Cause]) -> float:
    """Log evidence that an effect adds at all its places; of those that are alike, the first part has all of it."""
    alike = max((cause.log_evidence for cause in found if cause.alike), default=0.0)
    return alike + sum(cause.log_evidence for cause in found if not cause.alike)


def _is_one_with(cause: Cause, other: Cause) -> bool:
    """Whether two causes have their coefficients in common."""
    return cause.in_common and other.in_common and cause.effect is other.effect


def _summarise_place(
    cause: Cause, others: Sequence[Cause], likelihood: MarginalLikelihood, inputs: EffectInputs
) -> FoundPlace:
    value, u_of_fit = size_of(cause)
    signal = _signal(cause, likelihood)
    raw = likelihood.linear.rms_shift_sigma(signal)
    visible = likelihood.linear.rms_shift_sigma(likelihood.linear.after_calibration(signal))
    of_form = float(relative_u_of_form(absorbed_share(raw, visible)))
    u = math.hypot(u_of_fit, value * of_form)
    given_others = likelihood
    for other in as_found([other for other in others if not _is_one_with(cause, other)]):
        given_others = include_cause(given_others, other)
    effect, parameters = cause.effect, cause.best.basis_set.parameters
    return FoundPlace(
        place=cause.place,
        size=Quantity(effect.size.name, value, u, effect.size.unit),
        probability=cause.places[cause.place],
        raw_sigma=raw,
        visible_sigma=visible,
        others=tuple(
            Quantity(
                parameter.name,
                parameters[parameter.name],
                parameter_uncertainty(cause, parameter, given_others, inputs),
                parameter.unit,
            )
            for parameter in effect.others
            if parameter.name in parameters
        ),
        differs_with=cause.differs_with,
        aliases=tuple(
            value
            for parameter in effect.others
            if parameter.aliased and parameter.name in parameters
            for value in aliases(cause, parameter, given_others, inputs)
        ),
        at_channels=tuple(_at_channels(cause, likelihood, of_form)),
    )


def _at_channels(cause: Cause, likelihood: MarginalLikelihood, of_form: float) -> Iterator[Quantity]:
    """RMS of what a cause does at each of its channels, over the readings that respond to it; of_form: the relative
    standard uncertainty that no form is exact."""
    coefficients, covariance = cause.best.coefficients, cause.best.covariance
    every = dict.fromkeys(channel for column in cause.contributions for channel, _ in column)
    for channel in (channel for channel in every if not channel.startswith(f"{STIFFENED}.")):
        rows = likelihood.response.rows(channel)
        shapes = np.zeros((rows.size, len(coefficients)))
        for k, column in enumerate(cause.contributions):
            shapes[:, k] = sum(shape[rows] for name, shape in column if name == channel)
        rms = float(np.linalg.norm(shapes @ coefficients)) / math.sqrt(max(rows.size, 1))
        slope = shapes.T @ (shapes @ coefficients) / max(rows.size * rms, 1e-300)
        u = math.hypot(math.sqrt(max(float(slope @ covariance @ slope), 0.0)), rms * of_form)
        yield Quantity(channel, rms, u, unit_of_channel(channel))
