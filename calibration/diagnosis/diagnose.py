"""The diagnosis of a recording: a pure function of readings and nominal machine (docs/explanation/diagnosis.md)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.detectable_effects import NO_INSTRUMENT
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.effect_summary import equivalent_effects, summarise_effect
from calibration.diagnosis.findings.folder_remarks import remarks_on_folder
from calibration.diagnosis.findings.further_columns import further_columns
from calibration.diagnosis.findings.next_measurement import rank_additions
from calibration.diagnosis.findings.remarks import remarks
from calibration.diagnosis.findings.variance_shares import spectra, variance_shares
from calibration.diagnosis.findings.withheld_blocks import (
    GapField,
    gap_field,
    gap_figures,
    regions,
    withheld_differences,
)
from calibration.diagnosis.folder_effects import effects_of_unknowns
from calibration.diagnosis.linear_folder import LinearFolder, linearise_measurements
from calibration.diagnosis.linear_model import LinearModel, linearise_again, linearise_recording, require_recording
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.non_parametric import LEFT_SIGMA, log_evidence_at_platform
from calibration.diagnosis.ranking import Cause, differs_by_visit, include_cause
from calibration.diagnosis.reading_weights import judge_beside_causes
from calibration.diagnosis.result import NONE, UNKNOWN, Clue, Diagnosis, VisitGaps, Withheld
from calibration.diagnosis.search import SearchResult, include_effects
from calibration.diagnosis.search_budget import BY_VISIT, SearchBudget
from calibration.diagnosis.searched_readings import search_readings
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.twin.folder_twin import FolderTwin, score_folder_twin, twin_of_folder
from calibration.diagnosis.twin.joint_fit import JointFit
from calibration.diagnosis.twin.score import TwinScore, score_twin
from calibration.diagnosis.twin.twin import Twin
from calibration.diagnosis.verdict import kept_evidence, probabilities
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.model.parameters import KINDS
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording

CLUES = 4
LEAST_FREEDOM = 10.0  # of the readings: with less left over, any function explains what is left
SAFEGUARDS = 2  # non-parametric alternatives added when noise-free readings are estimated: the catalogue has gaps
OFFSETS = {"smr_offset": ("mounting.",), "joint_spacing": ("platform_joint.", "base_joint.")}


def diagnose(
    recording: Recording, catalogue: Catalogue | None = None, *, work: float = VERDICT.search_work
) -> Diagnosis:
    """Locate the gap of a recording, identify the effect that causes it, and estimate how far it shrinks.

    work: beyond which no further search begins, to save time; infinite for none to be left out (search_budget). Raises
    InputError if the recording is unsuitable.
    """
    return _diagnose_with_models(linearise_recording(recording), catalogue, work).diagnosis


def diagnose_and_add(recording: Recording, catalogue: Catalogue | None = None) -> tuple[Diagnosis, Twin]:
    """The diagnosis, and the machine's twin: the fitted model with the effects that were found."""
    result = _diagnose_with_models(linearise_recording(recording), catalogue)
    return result.diagnosis, Twin.from_diagnosis(result.likelihood, result.causes, result.inputs)


def diagnose_and_score(
    recording: Recording, catalogue: Catalogue | None = None, *, work: float = VERDICT.search_work
) -> tuple[Diagnosis, Twin, TwinScore]:
    """The same, and how well the campaign simulated on the twin agrees with readings withheld from it."""
    result = _diagnose_with_models(linearise_recording(recording), catalogue, work)
    joint_fit = JointFit(result.likelihood, result.causes)
    twin = Twin.from_solution(joint_fit.solution, result.likelihood, result.causes, result.inputs)
    return result.diagnosis, twin, score_twin(result.likelihood, result.truth_likelihood, joint_fit, twin)


def diagnose_measurements(
    measured: MeasuredMachine, catalogue: Catalogue | None = None, *, work: float = VERDICT.search_work
) -> Diagnosis:
    """The same of a measurement folder. What its columns cannot show is in `not_tested`.

    Where the folder knows of a former fit, the kinds of errors which that left alone are possible causes too
    (`folder_effects`). Raises InputError if the readings are unsuitable.
    """
    return _diagnose_folder(linearise_measurements(measured), catalogue, work).diagnosis


def diagnose_measurements_and_score(
    measured: MeasuredMachine, catalogue: Catalogue | None = None, *, work: float = VERDICT.search_work
) -> tuple[Diagnosis, FolderTwin, TwinScore]:
    """The same, the machine fitted together with the effects that were found, and how well that predicts readings
    withheld from it."""
    found = _diagnose_folder(linearise_measurements(measured), catalogue, work)
    linear = found.likelihood.linear  # with the levels of disturbances that were found
    if not isinstance(linear, LinearFolder):
        raise TypeError("a measurement folder stays one")
    twin = twin_of_folder(linear, found.likelihood, found.causes)
    return found.diagnosis, twin, score_folder_twin(linear, found.likelihood, found.truth_likelihood, found.causes)


def _diagnose_folder(linear: LinearFolder, catalogue: Catalogue | None, work: float) -> _DiagnosisWithModels:
    catalogue = catalogue or load_catalogue()
    left_alone = tuple(effects_of_unknowns(linear.left_unknowns, KINDS))
    found = _diagnose_with_models(linear, Catalogue((*catalogue.effects, *left_alone)), work)
    remarks_of_all = (*remarks_on_folder(linear), *found.diagnosis.remarks)
    return replace(found, diagnosis=replace(found.diagnosis, remarks=remarks_of_all))


def withheld_with(recording: Recording, names: Collection[str], catalogue: Catalogue | None = None) -> Withheld:
    """Predictions of withheld readings, without and with some effects of the catalogue, whatever their evidence.

    Raises InputError if the recording is unsuitable.
    """
    linear = linearise_recording(recording)
    likelihood = MarginalLikelihood.of(linear)
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    effects = [effect for effect in (catalogue or load_catalogue()).effects if effect.name in names]
    region = regions(linear)
    before = withheld_differences(likelihood, region)
    likelihood_after = include_effects(likelihood, inputs, effects)
    return _withheld(linear, before, withheld_differences(likelihood_after, region))


@dataclass(frozen=True)
class _DiagnosisWithModels:
    """A diagnosis and the inputs of its twin.

    likelihood: without causes; truth_likelihood: from which the noise-free readings are estimated.
    """

    diagnosis: Diagnosis
    likelihood: MarginalLikelihood
    truth_likelihood: MarginalLikelihood
    causes: tuple[Cause, ...]
    inputs: EffectInputs


def _diagnose_with_models(
    linear: LinearisedReadings, catalogue: Catalogue | None, work: float = VERDICT.search_work
) -> _DiagnosisWithModels:
    catalogue, stated = catalogue or load_catalogue(), linear.levels
    searched = search_readings(linear, catalogue, SearchBudget(limit=work))
    if isinstance(linear, LinearModel):
        beside_causes = searched.found.result.likelihoods[-1]
        judged = judge_beside_causes(beside_causes, require_recording(beside_causes.linear).weight)
        if judged is not None:
            again = SearchBudget(found=_begins_of(searched.found.result.causes), limit=work)
            del searched  # half of the memory: what follows needs none of its columns
            searched = search_readings(linearise_again(linear, judged), catalogue, again)
    inputs, by_drive, not_tested, found = searched.inputs, searched.by_drive, searched.not_tested, searched.found
    likelihood, search_result = found.likelihood, found.result
    linear = likelihood.linear
    ranking = probabilities(search_result, found.none_elsewhere)
    verdict = max(ranking, key=lambda name: ranking[name])
    is_effect = verdict not in (NONE, UNKNOWN)
    causes = _main_cause_first(search_result.causes, verdict) if is_effect else ()
    likelihood_after = search_result.likelihoods[-1] if is_effect else likelihood
    region = regions(linear)
    before = withheld_differences(likelihood, region)
    after = withheld_differences(likelihood_after, region) if causes else before
    truth_likelihood = _add_non_parametric_alternatives(search_result, likelihood_after)
    field = gap_field(truth_likelihood, before, after)
    gap = gap_figures(field) if causes else gap_figures(field).without_effect()
    noise_floor_m = linear.repeatability_m()
    gap = gap if noise_floor_m is None else replace(gap, noise_floor_m=noise_floor_m)
    equivalent, difference = equivalent_effects(search_result, likelihood, verdict) if is_effect else ((), 0.0)
    acting = _strongest_channels(search_result, likelihood, causes)
    # Further visits do not show what is written down of none, nor what no instrument is there for.
    unsaid = {*linear.context.missing.values(), NO_INSTRUMENT}
    untested = tuple(e for e in catalogue.effects if e.name in not_tested and not_tested[e.name] not in unsaid)
    diagnosis = Diagnosis(
        campaign=linear.campaign,
        verdict=verdict,
        equivalent=equivalent,
        matters_m=difference * field.noise_m,
        effects=tuple(
            summarise_effect(
                [cause for cause in causes if cause.effect.name == name],
                [cause for cause in causes if cause.effect.name != name],
                ranking,
                likelihood,
                inputs,
                explained=search_result.log_evidence,
                main=name == verdict,
            )
            for name in dict.fromkeys(cause.effect.name for cause in causes)
        ),
        ranking=ranking,
        where=()
        if verdict == NONE or linear.degrees_of_freedom < LEAST_FREEDOM
        else variance_shares(likelihood, truth_likelihood, field, acting, by_drive),
        gap=gap,
        not_tested=not_tested,
        hidden_m=_detection_limit_m(likelihood_after, field.noise_m),
        inside_geometry=_inside_geometry(linear),
        clues=_clues(search_result) if verdict == UNKNOWN else (),
        next_measurement=(
            *rank_additions(linear, search_result, ranking, untested),
            *further_columns(linear, not_tested),
        ),
        withheld=_withheld(linear, before, after),
        visits=_visit_gaps(linear, field),
        spectra=spectra(likelihood, by_drive),
        remarks=remarks(linear, stated, found, verdict, noise_floor_m, gap),
        evidence=kept_evidence(search_result, found.none_elsewhere),
        left_out=linear.left_out,
    )
    return _DiagnosisWithModels(diagnosis, likelihood, truth_likelihood, causes, inputs)


def _begins_of(causes: Sequence[Cause]) -> set[str]:
    """What searches that found some causes began with."""
    names = {cause.effect.name for cause in causes}
    return names | ({BY_VISIT} if any(differs_by_visit(cause) for cause in causes) else set())


def _withheld(linear: LinearisedReadings, before: Array, after: Array) -> Withheld:
    """Predictions of the platform's readings from whitened differences (n, w) of all, without and with the causes."""
    rows = linear.gap_scale.rows
    return Withheld(linear.source_rows[rows], linear.predicted(before)[rows], linear.predicted(after)[rows])


def _main_cause_first(causes: tuple[Cause, ...], verdict: str) -> tuple[Cause, ...]:
    return tuple(sorted(causes, key=lambda cause: cause.effect.name != verdict))


def _strongest_channels(
    search_result: SearchResult, likelihood: MarginalLikelihood, causes: tuple[Cause, ...]
) -> list[str]:
    """Channels with the largest contributions, the strongest first: of the causes, or of the best alternative."""
    sizes: dict[str, float] = {}
    for cause in causes:
        for contribution, coefficient in zip(cause.contributions, cause.best.coefficients, strict=True):
            for channel, shape in contribution:
                square = float(np.sum((coefficient * likelihood.response(channel) * shape[:, None]) ** 2))
                sizes[channel] = sizes.get(channel, 0.0) + square
    if sizes:
        return sorted(sizes, key=lambda channel: -sizes[channel])
    alternatives = (*search_result.non_parametric_alone, *search_result.non_parametric)
    best = max(alternatives, key=lambda alternative: alternative.log_evidence, default=None)
    if best is not None and best.log_evidence > 0.0:
        return [channel for channel, _ in best.channels]
    return list(likelihood.channels.pose_channels())


def _add_non_parametric_alternatives(
    search_result: SearchResult, likelihood_after: MarginalLikelihood
) -> MarginalLikelihood:
    """The marginal likelihood from which noise-free readings are estimated: with the strongest alternatives added."""
    alternatives = search_result.non_parametric_alone or search_result.non_parametric
    if likelihood_after is search_result.likelihoods[-1] and search_result.causes:
        alternatives = search_result.non_parametric
    for alternative in alternatives[:SAFEGUARDS]:
        likelihood_after = include_cause(likelihood_after, alternative)
    return likelihood_after


def _detection_limit_m(likelihood_after: MarginalLikelihood, noise_m: float) -> float:
    """Detection limit: largest RMS per coordinate of an independent platform shift per visit that 95 % still allow."""
    logs = log_evidence_at_platform(likelihood_after, LEFT_SIGMA)
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    below = np.cumsum(weights, axis=1) / np.sum(weights, axis=1, keepdims=True)
    return float(max(LEFT_SIGMA[int(np.searchsorted(row, 0.95))] for row in below)) * noise_m


def _inside_geometry(linear: LinearisedReadings) -> dict[str, float]:
    """RMS in m of the fitted offsets, by what they represent; for the struts' own weight, of the shift it causes."""
    flat = linear.columns.reshape(-1, linear.columns.shape[2])
    coefficients = flat.T @ linear.apply(linear.residual).ravel()
    values = coefficients[: len(linear.sigma)] * linear.sigma
    out = {}
    for name, prefixes in OFFSETS.items():
        rows = [i for i, unknown in enumerate(linear.names[: len(values)]) if unknown.startswith(prefixes)]
        out[name] = float(np.sqrt(np.mean(values[rows] ** 2))) if rows else 0.0
    rows = [i for i, unknown in enumerate(linear.names) if unknown.startswith("inside.weight.")]
    shift_m = linear.lengths_m(linear.columns[:, :, rows] @ coefficients[rows])
    out["link_self_weight"] = float(np.sqrt(np.mean(shift_m**2)))
    return out


def _clues(search_result: SearchResult) -> tuple[Clue, ...]:
    """Channel and coordinate of an unknown effect, ranked by log evidence relative to the best."""
    alternatives = (*search_result.non_parametric_alone, *search_result.non_parametric)
    ranked = sorted((a for a in alternatives if a.log_evidence > 0.0), key=lambda a: -a.log_evidence)
    clues: dict[tuple[str, str], Clue] = {}
    for alternative in ranked:
        key = (alternative.channel, alternative.coordinate)
        clues.setdefault(key, Clue(*key, alternative.log_evidence / ranked[0].log_evidence))
    return tuple(clues.values())[:CLUES]


def _visit_gaps(linear: LinearisedReadings, field: GapField) -> VisitGaps:
    """Mean gap of what is read of the platform at each visit."""
    numbers, before_m = linear.gap_by_visit(field.before)
    after_m = linear.gap_by_visit(field.after)[1]
    visit = linear.visit[field.rows]
    first_rows = field.rows[[int(np.argmax(visit == number)) for number in numbers]].astype(np.intp)
    context = linear.context
    return VisitGaps(
        tool_m=linear.poses.tool_m()[numbers],
        before_m=before_m,
        after_m=after_m,
        t_rig_s=context.t_s[first_rows],
        drives=context.drives[first_rows],
        direction=context.direction[first_rows],
        payload_kg=context.payload_kg[first_rows],
        dwell_s=context.dwell_s[first_rows],
        times_known="t_s" not in context.missing,
    )
