"""Standard uncertainty of an effect's further parameters, from the evidence of its basis sets.

The basis sets of an effect at one place have values x_i of a parameter, with posterior probabilities p_i proportional
to prior weight times evidence. Each value stands for a cell that reaches half way to its neighbours. With the reported
value x and a uniform density within each cell, u^2 is the sum over i of p_i times the mean of (x' - x)^2 over cell i:
the spread of the values that the readings allow, never less than the resolution of the grid. Periods and onsets are not
tried on a grid but come from the campaign; here they are tried on a fine one around the reported value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import evidence_of_basis_sets
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.place_evidence import smallest_size
from calibration.diagnosis.ranking import Cause
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import EffectInputs, EffectParameter
from calibration.effects.columns import Contributions

STEPS = 8  # of the fine grid to each side of the reported value
MOST_ALIASES = 5
STEPS_PER_RESOLUTION = 8  # steps in frequency within one over the travelled range


def parameter_uncertainty(
    cause: Cause, parameter: EffectParameter, likelihood: MarginalLikelihood, inputs: EffectInputs
) -> float:
    """Standard uncertainty of a parameter of a cause's best basis set, in the parameter's own unit.

    likelihood: with the other causes in the model.
    """
    effect, reported = cause.effect, cause.best.basis_set.parameters[parameter.name]
    place = effect.places(inputs.machine).index(cause.place)
    built = effect.forms(_refine(inputs, reported), place)
    low = smallest_size(likelihood, effect)
    evidence = evidence_of_basis_sets(
        likelihood.information_and_score(built.contributions), built.sets, low, effect.size.high
    )
    # Those of the same kind: beside one wave, two of them have another period and next to no more evidence.
    best = cause.best.basis_set
    count = best.relative[: len(best.columns)].count(1.0)  # without departures
    of_kind = [entry for entry in evidence if len(entry.basis_set.main) == count]
    entries = [entry for entry in of_kind if parameter.name in entry.basis_set.parameters]
    if not entries:
        return float(np.sqrt(mean_square_about(reported, np.array([reported]), np.ones(1), parameter)))
    logs = np.array([entry.log_evidence + np.log(entry.basis_set.weight) for entry in entries])
    values, index = np.unique([entry.basis_set.parameters[parameter.name] for entry in entries], return_inverse=True)
    posterior = np.bincount(index, np.exp(logs - logs.max()))
    return float(np.sqrt(mean_square_about(reported, values, posterior / posterior.sum(), parameter)))


def aliases(
    cause: Cause, parameter: EffectParameter, likelihood: MarginalLikelihood, inputs: EffectInputs
) -> list[float]:
    """Values far from that of a cause's best basis set which the readings do not exclude, the likeliest first.

    The same likelihood as for the uncertainty. Values of the campaign itself, each a peak of its own.
    """
    effect, reported = cause.effect, cause.best.basis_set.parameters[parameter.name]
    built = effect.forms(inputs, effect.places(inputs.machine).index(cause.place))
    evidence = evidence_of_basis_sets(
        likelihood.information_and_score(built.contributions),
        built.sets,
        smallest_size(likelihood, effect),
        effect.size.high,
    )
    logs: dict[float, float] = {}
    for entry in evidence:
        if (value := entry.basis_set.parameters.get(parameter.name)) is not None:
            log = entry.log_evidence + math.log(entry.basis_set.weight)
            logs[value] = max(log, logs.get(value, -math.inf))
    least = logs.get(reported, -math.inf) - VERDICT.distinguishable
    others = [value for value in logs if value != reported and logs[value] > max(least, VERDICT.detection_threshold)]
    return sorted(others, key=lambda value: -logs[value])[:MOST_ALIASES]


def mean_square_about(reported: float, values: Array, posterior: Array, parameter: EffectParameter) -> float:
    """Mean of (x - reported)^2 for x in the cells of ascending values (m,) with a posterior (m,).

    The cell of a single value is the whole range of the parameter.
    """
    if len(values) == 1:
        edges = np.array([min(parameter.low, values[0]), max(parameter.high, values[0])])
    else:
        middles = 0.5 * (values[1:] + values[:-1])
        edges = np.array([2.0 * values[0] - middles[0], *middles, 2.0 * values[-1] - middles[-1]])
    a, b = edges[:-1] - reported, edges[1:] - reported
    return float(posterior @ ((a**2 + a * b + b**2) / 3.0))


def _refine(inputs: EffectInputs, reported: float) -> EffectInputs:
    """The inputs with a fine grid of periods and onsets around the reported value, in place of that value alone."""
    steps = np.arange(-STEPS, STEPS + 1)

    def periods(
        drive: int, shortest_m: float, longest_m: float, over: tuple[float, ...] = ()
    ) -> list[tuple[float, float]]:
        along = inputs.context.drives @ np.array(over) if over else inputs.context.drives[:, drive]
        resolution = 1.0 / max(float(np.ptp(along)), 1e-6)
        frequency = 1.0 / reported + steps * resolution / STEPS_PER_RESOLUTION if reported > 0.0 else np.empty(0)
        fine = 1.0 / frequency[frequency > 0.0]
        return _replace(inputs.periods(drive, shortest_m, longest_m, over), reported, fine)

    def onsets(channels: Sequence[str]) -> list[tuple[float, float]]:
        return _replace(inputs.onsets(channels), reported, _arrivals_around(inputs, reported))

    def strength_onsets(name: str, column: Contributions) -> list[tuple[float, float]]:
        return _replace(inputs.strength_onsets(name, column), reported, _arrivals_around(inputs, reported))

    return replace(inputs, periods=periods, onsets=onsets, strength_onsets=strength_onsets)


def _arrivals_around(inputs: EffectInputs, reported_s: float) -> Array:
    """Middles between arrivals around a moment."""
    arrived_s = np.unique(inputs.context.history.arrived_s - inputs.context.start_s)
    between = 0.5 * (arrived_s[1:] + arrived_s[:-1])
    return np.asarray(between[np.argsort(np.abs(between - reported_s), kind="stable")[: 2 * STEPS + 1]])


def _replace(answers: Sequence[tuple[float, float]], reported: float, fine: Array) -> list[tuple[float, float]]:
    """The answers with the reported value replaced by a fine grid of the same prior probability, the nearest first."""
    prior = next((prior for value, prior in answers if value == reported), None)
    if prior is None or not fine.size:
        return list(answers)
    nearest_first = fine[np.argsort(np.abs(fine - reported), kind="stable")]
    others = [(value, p) for value, p in answers if not fine.min() <= value <= fine.max()]
    return [*((float(value), prior / len(fine)) for value in nearest_first), *others]
