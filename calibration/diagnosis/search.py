"""Which causes the readings speak for: every effect of the catalogue at every place, and form-free alternatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.curve_fit import refit
from calibration.diagnosis.evidence import Readout, Weighed, log_sum, weigh
from calibration.diagnosis.non_parametric import Formless, weigh_formless
from calibration.effects.api import Acts, Effect, Setting
from calibration.effects.catalogue import Catalogue

MOST_CAUSES = 3
SEEN = 6.0  # of log evidence: below it nothing is taken into the model
LEAST_SHARE = 0.006  # of what is explained already, that a further cause must add
LEAST_SHARE_NEARBY = 0.03  # the same where it could be what the former one's form leaves
FURTHER, FURTHER_SHARE = 10.0, 0.02  # what every further cause costs: several together mimic much that is one
WORTH_REFITTING = 0.25  # of the strongest effect's log evidence: below it curves are not looked at
WORTH_REFITTING_THERE = 0.6  # of the effect's log evidence at its best place
WORTH_A_LOOK = 4.0  # of log evidence that is left: below it nothing more is searched for


@dataclass(frozen=True)
class Cause:
    """An effect as far as the readings speak for it: over all its places and forms, and at its best.

    log_evidence: over `none`, natural logarithm. places: probability of each, given the effect. acts: columns of the
    best form, in the order of its coefficients.
    """

    effect: Effect
    log_evidence: float
    places: dict[str, float]
    place: str
    best: Weighed
    acts: tuple[Acts, ...]

    @property
    def deviations(self) -> Array:
        """Prior standard deviations (k,) of the best form's coefficients."""
        return self.best.size * np.array(self.best.form.relative)


def weigh_effects(readout: Readout, setting: Setting, effects: Sequence[Effect]) -> list[Cause]:
    """All effects, the likeliest first; those without any form at any place are left out."""
    found = [(effect, there) for effect in effects if (there := _by_forms(readout, setting, effect))]
    most = max((_total(there) for _, there in found), default=0.0)
    worth = max(SEEN, WORTH_REFITTING * most)
    causes = [
        _cause(effect, _by_curves(readout, setting, effect, there) if _total(there) > worth else there)
        for effect, there in found
    ]
    return sorted(causes, key=lambda cause: -cause.log_evidence)


@dataclass(frozen=True)
class _There:
    """An effect at one of its places: log evidence with the place's prior, the best form, its columns."""

    place: str
    log_evidence: float
    best: Weighed
    acts: tuple[Acts, ...]


def _by_forms(readout: Readout, setting: Setting, effect: Effect) -> list[_There]:
    names = effect.places(setting.machine)
    low = _smallest(readout, effect)
    out = []
    for index, name in enumerate(names):
        forms = effect.forms(setting, index)
        if not forms.forms:
            continue
        weighed = weigh(readout.judge(forms.acts), forms.forms, low, effect.size.high)
        weights = np.array([w.form.weight for w in weighed])
        # Weights that add up to less than one leave the rest to forms that were not worth listing.
        weights /= max(1.0, float(weights.sum()))
        logs = np.array([w.log_evidence for w in weighed]) + np.log(weights)
        best = weighed[int(np.argmax(logs))]
        acts = tuple(forms.acts[c] for c in best.form.columns)
        out.append(_There(name, float(log_sum(logs)) - float(np.log(len(names))), best, acts))
    return out


def _by_curves(readout: Readout, setting: Setting, effect: Effect, found: list[_There]) -> list[_There]:
    """The same with the effect's curves, at the places that its forms speak for."""
    names, low = effect.places(setting.machine), _smallest(readout, effect)
    most = max(there.log_evidence for there in found)

    def closer(there: _There) -> _There:
        curves = effect.curves(setting, names.index(there.place))
        fitted = refit(readout, curves, low, effect.size.high)
        if fitted is None:
            return there
        value = fitted.log_evidence - float(np.log(len(names) * len(curves)))
        both = float(np.logaddexp(value, there.log_evidence)) - float(np.log(2.0))
        if value > there.log_evidence:
            return _There(there.place, both, fitted.best, fitted.acts)
        return replace(there, log_evidence=both)

    worth = WORTH_REFITTING_THERE * most
    return [closer(there) if there.log_evidence > worth else there for there in found]


def _cause(effect: Effect, found: list[_There]) -> Cause:
    total, best = _total(found), max(found, key=lambda there: there.log_evidence)
    places = {there.place: float(np.exp(there.log_evidence - total)) for there in found}
    return Cause(effect, total, places, best.place, best.best, best.acts)


def _total(found: list[_There]) -> float:
    return float(log_sum(np.array([there.log_evidence for there in found])))


def _smallest(readout: Readout, effect: Effect) -> float:
    return effect.smallest(readout.baseline.recording.file.nuisance)


def taken(readout: Readout, cause: Cause | Formless) -> Readout:
    """The readout once a cause, in its best form or without one, belongs to the model."""
    if isinstance(cause, Formless):
        return readout.given(cause.columns(readout))
    return readout.given(readout.columns(cause.acts) * cause.deviations)


def tested(setting: Setting, catalogue: Catalogue) -> tuple[list[Effect], dict[str, str]]:
    """The effects that the campaign can show, and why not by name of the others."""
    reasons = {effect.name: effect.untested(setting) for effect in catalogue.effects}
    can = [effect for effect in catalogue.effects if reasons[effect.name] is None]
    return can, {name: reason for name, reason in reasons.items() if reason is not None}


@dataclass(frozen=True)
class Explanation:
    """What the readings are explained by.

    ranking: all effects alone, the likeliest first. causes: effects of the catalogue that together explain most;
    readouts: before any of them and after each. log_evidence: of the causes together over `none`, less what more than
    one of them costs; excess: by how much the best form-free alternative, alone or on top of them, says more. formless:
    what is left to form-free alternatives on top of the causes; alone: form-free alternatives without any cause (empty
    where not needed).
    """

    ranking: tuple[Cause, ...]
    causes: tuple[Cause, ...]
    readouts: tuple[Readout, ...]
    log_evidence: float
    excess: float
    formless: tuple[Formless, ...]
    alone: tuple[Formless, ...]


def explain(readout: Readout, setting: Setting, effects: Sequence[Effect]) -> Explanation:
    """Take effects into the model as long as each tells more than chance; then look at what is left."""
    ranking = weigh_effects(readout, setting, effects)
    readouts, total, best = [readout], 0.0, 0.0
    causes: list[Cause] = []
    left: list[Formless] = []
    candidates = ranking
    while candidates and len(causes) < MOST_CAUSES:
        gain = candidates[0].log_evidence
        nearby = any(_near(setting, candidates[0], cause) for cause in causes)
        if gain < max(SEEN, (LEAST_SHARE_NEARBY if nearby else LEAST_SHARE) * total):
            break
        if causes:
            total -= FURTHER + FURTHER_SHARE * (total + gain)
        causes.append(candidates[0])
        total += gain
        readouts.append(taken(readouts[-1], candidates[0]))
        left = weigh_formless(readouts[-1], setting)
        best = max(best, total + left[0].log_evidence)
        if left[0].log_evidence < WORTH_A_LOOK:
            break
        candidates = weigh_effects(readouts[-1], setting, effects)
    alone: list[Formless] = []
    if best - total > WORTH_A_LOOK or not causes:
        alone = weigh_formless(readout, setting)
        best = max(best, alone[0].log_evidence)
        left = left or alone
    if len(causes) > 1:
        causes, readouts = _in_order(readout, setting, causes)
    return Explanation(
        tuple(ranking),
        tuple(causes),
        tuple(readouts),
        total,
        max(best - total, 0.0),
        tuple(left),
        tuple(alone),
    )


def _near(setting: Setting, one: Cause, other: Cause) -> bool:
    """Whether two causes live at the same part of the machine, or are the same effect."""
    machine = setting.machine

    def drives(cause: Cause) -> set[int]:
        if cause.effect.place == "drive":
            return {machine.drive_names.index(cause.place)}
        if cause.effect.place == "strut":
            return {int(machine.strut_drive[machine.strut_names.index(cause.place)])}
        return set()

    return one.effect.name == other.effect.name or bool(drives(one) & drives(other))


def _in_order(readout: Readout, setting: Setting, causes: list[Cause]) -> tuple[list[Cause], list[Readout]]:
    """Each cause in the form that is best once the others belong to the model, the strongest first."""
    again: list[Cause] = []
    for number, cause in enumerate(causes):
        without = readout
        for other, there in enumerate(causes):
            if other != number:
                without = taken(without, again[other] if other < number else there)
        again.append(weigh_effects(without, setting, [cause.effect])[0])
    again.sort(key=lambda cause: -cause.log_evidence)
    readouts = [readout]
    for cause in again:
        readouts.append(taken(readouts[-1], cause))
    return again, readouts
