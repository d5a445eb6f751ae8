"""What is anew at each visit: whether it is seen where that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import rank_non_parametric
from calibration.diagnosis.ranking import Cause, as_found, differs_by_visit, include_cause, rank_effects
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Effect, EffectInputs


def acting_elsewhere(
    likelihood: MarginalLikelihood, inputs: EffectInputs, causes: Sequence[Cause], ranking: Sequence[Cause]
) -> set[str]:
    """Names of the effects among some causes that are anew at each visit and may as well act elsewhere.

    ranking: all effects, each alone. Numbers for the visits explain anything that stays as it is during one, at
    whatever channel that is; at the true one they explain clearly more than any function does elsewhere, given the
    other causes. What acts at a reflector, no other channel does.
    """
    anew = [cause for cause in causes if _is_anew(cause)]
    names = dict.fromkeys(cause.effect.name for cause in anew)
    out = set()
    for name in names:
        beside = [cause for cause in causes if cause.effect.name != name]
        given = likelihood
        for cause in as_found(beside):
            given = include_cause(given, cause)
        (effect,) = {id(c.effect): c.effect for c in anew if c.effect.name == name}.values()
        ranked = rank_effects(given, inputs, [effect], by_visit=True) if beside else ranking
        alone = next(cause for cause in ranked if cause.effect.name == name)
        if not _is_told(alone, given, inputs):
            out.add(name)
    return out


def without_anew(effect: Effect) -> Effect:
    """An effect that is the same at each visit, if it may be anew and others act through its channels."""
    if not effect.anew_by_visit or effect.place == "smr":
        return effect
    return replace(effect, anew_by_visit="", differs_by_visit=False)


def _is_anew(cause: Cause) -> bool:
    return bool(cause.effect.anew_by_visit) and cause.effect.place != "smr" and differs_by_visit(cause)


def _is_told(alone: Cause, given: MarginalLikelihood, inputs: EffectInputs) -> bool:
    """Whether an effect, or numbers for the visits at its channels, explain more than functions elsewhere do."""
    channels = {channel for part in alone.parts for column in part.contributions for channel, _ in column}
    own = {_of_part(channel) for channel in channels}
    here, elsewhere = alone.log_evidence, 0.0
    for function in rank_non_parametric(given, inputs):
        if {_of_part(name) for name, _ in function.channels} <= own:
            here = max(here, function.log_evidence)
        else:
            elsewhere = max(elsewhere, function.log_evidence)
    return here >= elsewhere + VERDICT.least_gain_of_channel


def _of_part(channel: str) -> str:
    """A channel, or all turns of one carriage: about which axis it turns in its play is no question."""
    return channel.rpartition(".")[0] if channel.startswith("turn.") else channel
