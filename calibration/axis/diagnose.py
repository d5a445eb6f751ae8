"""The diagnosis of one drive alone: a pure function of its recording (docs/explanation/axis.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import expit

from calibration.axis.effects import axis_effects
from calibration.axis.likelihood import AxisLikelihood
from calibration.axis.model import AxisModel
from calibration.axis.noise import cosines
from calibration.axis.result import AxisDiagnosis, AxisEffectFound
from calibration.axis.scale import Scale, with_free_scale
from calibration.axis.search import AxisCause, AxisSearch, explain_effect, search_axis
from calibration.axis.signals import Signals, samples_in_group
from calibration.axis.smooth_function import smooth_function
from calibration.axis.withheld_stretches import gap_figures
from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import log_evidence_of_sizes
from calibration.diagnosis.result import NONE, UNKNOWN, Quantity
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.verdict import verdict_probabilities
from calibration.recording.axis_recording import AxisRecording
from calibration.recording.axis_wrong_samples import WrongSamples, without_wrong_samples

CLUES = 4
MOST_TOLD = 5  # places of wrong samples in a remark
# Tuned on simulated drives, whose reversals are sharper than a law.
AXIS_VERDICT = replace(VERDICT, none_prior_log_odds=7.0, excess_share=0.1, strong_evidence=math.inf, u_of_form=0.04)
INEXACT = 10.0  # excess log evidence from which on a remark says that the effects' models are not exact
ROUNDING = "the gap is no more than the rounding of the positions"
NO_RATIO = "the ratio is not stated: a compliance counts per unit of the motor's torque"


def diagnose_axis(recording: AxisRecording) -> AxisDiagnosis:
    """What makes the second position of an axis differ from its motor's, and how far the gap shrinks with it."""
    motor, second, wrong = without_wrong_samples(recording.time_s, recording.motor, recording.second)
    recording = replace(recording, motor=motor, second=second)
    signals = Signals.of(recording)
    command = recording.command
    following = None if command is None else following_delay(Signals.of_following(recording, command))
    remarks = _remarks_on_recording(recording, len(signals), wrong)
    return diagnose_signals(signals, recording.file.name, recording.file.simulated, following, remarks, wrong)


def diagnose_signals(
    signals: Signals,
    name: str,
    simulated: bool = False,
    following: Quantity | None = None,
    remarks: tuple[str, ...] = (),
    left_out: tuple[WrongSamples, ...] = (),
) -> AxisDiagnosis:
    """The same of signals."""
    stated_u = signals.scale_u
    signals, search = _with_stated_or_free_scale(signals)
    logs: dict[str, float] = {cause.effect.name: cause.log_evidence for cause in search.ranking}
    ranking = verdict_probabilities(logs, search.log_evidence, search.excess_log_evidence, AXIS_VERDICT)
    verdict = max(ranking, key=lambda effect: ranking[effect])
    is_effect = bool(search.causes) and verdict == search.causes[0].effect.name
    if not is_effect and verdict != UNKNOWN:
        verdict = NONE
    equivalent, matters = _equivalent(search) if is_effect else ((), 0.0)
    after = search.after if is_effect else search.before
    return AxisDiagnosis(
        recording=name,
        simulated=simulated,
        unit=signals.unit,
        verdict=verdict,
        equivalent=equivalent,
        matters=matters,
        effects=_found(search, ranking, signals.travel) if is_effect else (),
        ranking=ranking,
        gap=gap_figures(search.before, after),
        not_tested=_not_tested(search, signals),
        hidden=_detection_limit(after, signals),
        clues=_clues(search.alternatives) if verdict == UNKNOWN else {},
        following_delay=following,
        frequency_hz=_frequencies(after, signals.step_s),
        noise=np.exp(0.5 * after.knots) * np.sqrt(2.0 * signals.step_s),
        remaining=after.remaining,
        model=_model(search.causes if is_effect else (), after, signals),
        remarks=(*remarks, *_remarks_on_scale(search, after, signals, stated_u), *_remarks(search, verdict)),
        left_out=left_out,
    )


def _with_stated_or_free_scale(signals: Signals) -> tuple[Signals, AxisSearch]:
    """What explains the gap, and its signals: with a free scale of the second position where that is likelier."""
    free = with_free_scale(signals)
    if free is None:
        return signals, search_axis(signals)
    freed = search_axis(free)
    if not freed.causes and freed.before.is_rounding(free):
        return free, freed
    stated = search_axis(signals)
    likelier = freed.after.log_marginal > stated.after.log_marginal
    return (free, freed) if likelier else (signals, stated)


def _remarks_on_scale(search: AxisSearch, after: AxisLikelihood, signals: Signals, stated_u: float) -> tuple[str, ...]:
    """That the scale is far off, and that there is nothing but rounding beside it."""
    out = [] if signals.scale_u == stated_u else [Scale.of(after, signals, stated_u).remark]
    return (*out, ROUNDING) if search.before.is_rounding(signals) else tuple(out)


def _remarks_on_recording(recording: AxisRecording, used: int, wrong: tuple[WrongSamples, ...] = ()) -> tuple[str, ...]:
    """What its header does not say, what of its samples is wrong or was averaged; used: samples after that."""
    out = []
    if wrong:
        out.append(_left_out_remark(wrong, recording.file.unit))
    if recording.file.torque_side == "motor" and recording.file.ratio is None:
        out.append(NO_RATIO)
    if (group := samples_in_group(recording)) > 1:
        out.append(
            f"to save time the {len(recording.motor)} samples were averaged to {used}, {group} at a time, one every "
            f"{group * recording.step_s:.3g} s: the gap of a shorter recording is looked at sample by sample"
        )
    return tuple(out)


def _left_out_remark(wrong: tuple[WrongSamples, ...], unit: str) -> str:
    """How many samples are left out, and where the first are."""
    count = sum(w.count for w in wrong)
    told = []
    for w in wrong[:MOST_TOLD]:
        of = "motor" if w.of_motor else "second position"
        told.append(f"at {w.time_s:.6g} s ({abs(w.off):.3g} {unit} off, {of})")
    if len(wrong) > MOST_TOLD:
        told.append(f"and at {len(wrong) - MOST_TOLD} more")
    return f"{count} wrong sample{'s' if count > 1 else ''} left out: {', '.join(told)}"


def following_delay(signals: Signals) -> Quantity:
    """The time by which the motor is later than the command, from the signals of that gap."""
    likelihood = AxisLikelihood.of(signals)
    effect = next(e for e in axis_effects(signals, lambda _shortest, _longest: []) if e.name == "delay")
    cause = explain_effect(likelihood, signals, effect)
    best = cause.explanation.best
    u = float(np.sqrt(best.covariance[0, 0]))
    return Quantity(effect.size.name, float(best.coefficients[0]), u, effect.size.unit)


def _not_tested(search: AxisSearch, signals: Signals) -> dict[str, str]:
    """Effects that the recording cannot show, and those for which its torque leaves no room."""
    out = {}
    for effect in axis_effects(signals, lambda _shortest, _longest: []):
        if effect.untested is not None:
            out[effect.name] = effect.untested
        elif effect.name in search.excluded:
            out[effect.name] = "excluded: the recorded torque has too little friction of this kind for such a wind-up"
    return out


def _found(search: AxisSearch, ranking: Mapping[str, float], travel: float) -> tuple[AxisEffectFound, ...]:
    """All causes with size, probability and what they contribute; the main one first."""
    remaining = float(np.std(search.after.remaining))
    named = 1.0 - ranking[NONE] - ranking[UNKNOWN]
    out, first = [], search.before.model.shape[1]
    for number, cause in enumerate(search.causes):
        columns = slice(first, first + cause.explanation.columns.shape[1])
        first = columns.stop
        prior = cause.explanation.prior_deviations
        coefficients = search.after.coefficients[columns] * prior
        covariance = search.after.covariance[columns, columns] * np.outer(prior, prior)
        contribution = float(np.sqrt(max(search.without[number] ** 2 - remaining**2, 0.0)))
        present = float(named * expit(cause.log_evidence - AXIS_VERDICT.none_prior_log_odds))
        probability = ranking[cause.effect.name] if number == 0 else present
        size, others = _quantities(cause, coefficients, covariance, travel)
        out.append(AxisEffectFound(cause.effect.name, size, probability, contribution, others))
    rest = sorted(out[1:], key=lambda effect: -effect.contribution)
    return (*out[:1], *rest)


def _quantities(
    cause: AxisCause, coefficients: Array, covariance: Array, travel: float
) -> tuple[Quantity, tuple[Quantity, ...]]:
    """Size of a cause and its further parameters, from its coefficients (k,) and their covariance (k, k)."""
    effect, basis_set = cause.effect, cause.explanation.best.basis_set
    main = [i for i, relative in enumerate(basis_set.relative) if relative >= 1.0]
    if effect.rms:
        centred = cause.explanation.columns - cause.explanation.columns.mean(axis=0)
        done = centred @ coefficients
        value = float(np.sqrt(np.mean(done**2)))
        gradient = centred.T @ done / (len(done) * max(value, 1e-300))
        u = float(np.sqrt(gradient @ covariance @ gradient))
    elif len(main) > 1:
        value = float(np.linalg.norm(coefficients[main]))
        direction = coefficients[main] / max(value, 1e-300)
        u = float(np.sqrt(direction @ covariance[np.ix_(main, main)] @ direction))
    else:
        value, u = float(coefficients[0]), float(np.sqrt(covariance[0, 0]))
    others = []
    for parameter in effect.others:
        if parameter.name not in basis_set.parameters:
            continue
        if parameter.name == "asymmetry":
            ratio = float(coefficients[1] / coefficients[0]) if coefficients[0] else 0.0
            gradient = np.array([-ratio, 1.0]) / (float(coefficients[0]) or 1.0)
            others.append(Quantity("asymmetry", ratio, float(np.sqrt(gradient @ covariance[:2, :2] @ gradient)), "1"))
            continue
        at = basis_set.parameters[parameter.name]
        u_at = 0.5 * at  # of a transition, which is tried at steps
        if parameter.name == "period":  # that of a sine over this travel (Rife and Boorstyn 1974)
            u_at = at**2 * float(np.sqrt(3.0)) * u / (np.pi * travel * max(value, 1e-300))
        others.append(Quantity(parameter.name, at, u_at, parameter.unit))
    u = math.hypot(u, AXIS_VERDICT.u_of_form * value)  # no drive has the law exactly
    return Quantity(effect.size.name, value, u, effect.size.unit), tuple(others)


def _equivalent(search: AxisSearch) -> tuple[tuple[str, ...], float]:
    """Effects that the data do not exclude in the main cause's place and that predict the same; the largest difference.

    Predictions are the same if they differ by less than `equivalent_sigma` of what remains, RMS, everything else fitted
    again.
    """
    main, remaining = search.ranking[0], float(np.std(search.after.remaining))
    first = search.before.model.shape[1]
    width = main.explanation.columns.shape[1]
    signal = main.explanation.scaled @ search.after.coefficients[first : first + width]
    least = main.log_evidence - VERDICT.distinguishable - VERDICT.distinguishable_share * main.log_evidence
    names, largest = [], 0.0
    for rival in search.ranking[1:]:
        if rival.log_evidence < least:
            continue
        other = search.slot.including(rival.explanation.scaled)
        missed = float(np.std(replace(other, gap=cosines(signal)).remaining))
        if missed < VERDICT.equivalent_sigma * remaining:
            names.append(rival.effect.name)
            largest = max(largest, missed)
    return tuple(names), largest


def _detection_limit(likelihood: AxisLikelihood, signals: Signals) -> float:
    """Largest RMS of an arbitrary smooth function of position that 95 % still allow."""
    remaining = max(float(np.std(likelihood.remaining)), 1e-300)
    sizes = remaining * np.geomspace(0.003, 30.0, 60)
    columns = cosines(smooth_function(signals.position)(signals.position))
    logs = log_evidence_of_sizes(likelihood.information_and_score(columns), sizes)
    below = np.cumsum(np.exp(logs - logs.max()))
    return float(sizes[int(np.searchsorted(below / below[-1], 0.95))])


def _clues(alternatives: Mapping[str, float]) -> dict[str, float]:
    """What an unknown effect depends on: log evidence of each coordinate relative to the best."""
    ranked = sorted(((name, log) for name, log in alternatives.items() if log > 0.0), key=lambda item: -item[1])
    return {name: log / ranked[0][1] for name, log in ranked[:CLUES]}


def _frequencies(likelihood: AxisLikelihood, step_s: float) -> Array:
    """Frequencies (k,) in Hz of the knots of the noise."""
    count = len(likelihood.gap)
    cosine = 2.0 ** np.linspace(0.0, np.log2(count), len(likelihood.knots))
    return np.asarray(cosine / (2.0 * (count + 1) * step_s))


def _model(causes: tuple[AxisCause, ...], after: AxisLikelihood, signals: Signals) -> AxisModel:
    laws = tuple(law for cause in causes for law in cause.explanation.laws)
    prior = np.concatenate([cause.explanation.prior_deviations for cause in causes] or [np.empty(0)])
    scale = Scale.of(after, signals, signals.scale_u).value
    return AxisModel(scale, float(signals.position.mean()), laws, after.coefficients[1:] * prior)


def _remarks(search: AxisSearch, verdict: str) -> tuple[str, ...]:
    if verdict == UNKNOWN:
        return (_most_like(search),)
    if verdict == NONE or search.excess_log_evidence <= INEXACT:
        return ()
    name = _strongest(search.alternatives)
    return (
        f"the effects' forms are not exact: something that depends on {name} remains "
        f"({search.excess_log_evidence:.0f} of log evidence, {search.log_evidence:.0f} explained)",
    )


def _most_like(search: AxisSearch) -> str:
    """The effect that comes nearest to something unknown, and what speaks against it."""
    nearest = search.ranking[0] if search.ranking else None
    if nearest is None or nearest.log_evidence <= 0.0:
        return f"no effect explains any of it; an arbitrary function of {_strongest(search.alternatives)} does"
    if not search.causes:
        return (
            f"nearest comes {nearest.effect.name}, with {nearest.log_evidence:.1f} of log evidence of the "
            f"{VERDICT.detection_threshold:.0f} that an effect needs; an arbitrary function of "
            f"{_strongest(search.alternatives)} explains {search.excess_log_evidence:.0f} more"
        )
    beside = ", ".join(dict.fromkeys(cause.effect.name for cause in search.causes[1:]))
    alone = f"beside {beside}" if beside else "alone"
    in_place = _strongest(search.in_place)
    if search.in_place[in_place] - nearest.log_evidence > max(search.alternatives.values()):
        why = f"an arbitrary function of {in_place} in its place explains more"
    else:
        why = f"something that depends on {_strongest(search.alternatives)} remains"
    return (
        f"most like {nearest.effect.name} ({nearest.log_evidence:.0f} of log evidence {alone}), but {why} "
        f"({search.excess_log_evidence:.0f} more)"
    )


def _strongest(alternatives: Mapping[str, float]) -> str:
    """Coordinate of the arbitrary function with the largest log evidence."""
    return max(alternatives, key=lambda name: alternatives[name])
