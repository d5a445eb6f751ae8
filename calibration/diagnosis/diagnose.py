"""The diagnosis of a recording: a pure function of readings and nominal machine (docs/explanation/diagnosis.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.effect_inputs import periodograms, setting_of
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.findings import variance_shares as location
from calibration.diagnosis.findings import withheld_blocks as shrink
from calibration.diagnosis.findings.effect_summary import equivalents, found_effect
from calibration.diagnosis.findings.next_measurement import candidates
from calibration.diagnosis.linear_model import Baseline, baseline_of
from calibration.diagnosis.non_parametric import Formless, platform_hides
from calibration.diagnosis.result import NONE, UNKNOWN, Clue, Diagnosis, GapFigures, VisitGaps, Withheld
from calibration.diagnosis.search import Cause, Explanation, explain, taken, tested
from calibration.diagnosis.twin.joint_fit import Joint
from calibration.diagnosis.twin.score import TwinScore, scored
from calibration.diagnosis.twin.twin import Twin
from calibration.diagnosis.verdict import probabilities
from calibration.effects.api import Setting
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.recording.recording import Recording

CLUES = 4
SAFEGUARDS = 2  # form-free alternatives that stand in for what the model may lack when the truth is estimated
OFFSETS = {"smr_offset": ("mounting.",), "joint_spacing": ("platform_joint.", "base_joint.")}


def diagnose(recording: Recording, catalogue: Catalogue | None = None) -> Diagnosis:
    """Where the gap of a recording lies, which effect causes it, how far it shrinks. InputError where it is not fit."""
    return _diagnosed(recording, catalogue).diagnosis


def diagnose_and_add(recording: Recording, catalogue: Catalogue | None = None) -> tuple[Diagnosis, Twin]:
    """The diagnosis, and the machine's twin: the fitted model with the effects that were found."""
    worked = _diagnosed(recording, catalogue)
    return worked.diagnosis, Twin.of(worked.readout, worked.causes, worked.setting)


def diagnose_and_score(recording: Recording, catalogue: Catalogue | None = None) -> tuple[Diagnosis, Twin, TwinScore]:
    """The same, and how the campaign simulated on the twin agrees with readings withheld from it."""
    worked = _diagnosed(recording, catalogue)
    joint = Joint(worked.readout, worked.causes)
    twin = Twin.by(joint.solution, worked.readout, worked.causes, worked.setting)
    return worked.diagnosis, twin, scored(worked.readout, worked.truth, joint, twin)


@dataclass(frozen=True)
class _Worked:
    """A diagnosis, and what a twin is made of: the readout before the causes, the one for the truth, the causes."""

    diagnosis: Diagnosis
    readout: Readout
    truth: Readout
    causes: tuple[Cause, ...]
    setting: Setting


def _diagnosed(recording: Recording, catalogue: Catalogue | None) -> _Worked:
    catalogue = catalogue or load_catalogue()
    baseline = baseline_of(recording)
    readout = Readout(baseline)
    periods = periodograms(readout)
    setting = setting_of(readout, periods)
    effects, not_tested = tested(setting, catalogue)
    untested = tuple(effect for effect in catalogue.effects if effect.name in not_tested)
    found = explain(readout, setting, effects)
    ranking = probabilities(found)
    verdict = max(ranking, key=lambda name: ranking[name])
    named = verdict not in (NONE, UNKNOWN)
    causes = _main_first(found.causes, verdict) if named else ()
    after = found.readouts[-1] if named else readout
    region = shrink.regions(baseline)
    before_left = shrink.withheld(readout, region)
    after_left = shrink.withheld(after, region) if causes else before_left
    truth = _with_safeguards(found, after)
    field = shrink.field(truth, before_left, after_left)
    gap = shrink.figures(field) if causes else _unchanged(shrink.figures(field))
    floor = shrink.repeated_m(baseline)
    gap = gap if floor is None else replace(gap, noise_floor_m=floor)
    equivalent, matters = equivalents(found, readout, verdict) if named else ((), 0.0)
    diagnosis = Diagnosis(
        campaign=recording.file.campaign,
        verdict=verdict,
        equivalent=equivalent,
        matters_m=matters * field.noise_m,
        effects=tuple(found_effect(cause, ranking, readout, main=cause.effect.name == verdict) for cause in causes),
        ranking=ranking,
        where=()
        if verdict == NONE
        else location.shares(readout, truth, field, _acting(found, readout, causes), periods),
        gap=gap,
        not_tested=not_tested,
        hidden_m=_hidden_m(after, setting, field.noise_m),
        inside_geometry=_inside_geometry(baseline),
        clues=_clues(found) if verdict == UNKNOWN else (),
        next_measurement=candidates(readout, found, ranking, untested),
        withheld=_withheld(readout, before_left, after, after_left, field),
        visits=_visits(baseline, field),
        spectra=location.spectra(readout, periods),
        remarks=_remarks(found, verdict, floor),
    )
    return _Worked(diagnosis, readout, truth, causes, setting)


def _main_first(causes: tuple[Cause, ...], verdict: str) -> tuple[Cause, ...]:
    return tuple(sorted(causes, key=lambda cause: cause.effect.name != verdict))


def _acting(found: Explanation, readout: Readout, causes: tuple[Cause, ...]) -> list[str]:
    """Channels at which something acts, the strongest first: of the causes, or of the best form-free alternative."""
    sizes: dict[str, float] = {}
    for cause in causes:
        for act, coefficient in zip(cause.acts, cause.best.coefficients, strict=True):
            for channel, shape in act:
                square = float(np.sum((coefficient * readout.response(channel) * shape[:, None]) ** 2))
                sizes[channel] = sizes.get(channel, 0.0) + square
    if sizes:
        return sorted(sizes, key=lambda channel: -sizes[channel])
    pool = sorted((*found.alone, *found.formless), key=lambda f: -f.log_evidence)
    if pool and pool[0].log_evidence > 0.0:
        return [channel for channel, _ in pool[0].channels]
    return list(readout.channels.poses())


def _unchanged(figures: GapFigures) -> GapFigures:
    """Nothing is added, nothing shrinks."""
    return GapFigures(figures.before_m, figures.before_m, figures.noise_floor_m, 0.0, (0.0, 0.0), figures.withheld)


def _with_safeguards(found: Explanation, after: Readout) -> Readout:
    """The readout by which the truth is estimated: with what form-free alternatives may add, as far as they say."""
    pool = found.formless if after is found.readouts[-1] and found.causes else found.alone or found.formless
    for formless in pool[:SAFEGUARDS]:
        after = taken(after, formless)
    return after


def _hidden_m(after: Readout, setting: Setting, noise_m: float) -> float:
    """Largest RMS, per coordinate, of something at the platform in single visits that 95 % still allow."""
    sizes = np.geomspace(0.02, 20.0, 40)
    logs = platform_hides(after, setting, sizes)
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    below = np.cumsum(weights, axis=1) / np.sum(weights, axis=1, keepdims=True)
    return float(max(sizes[int(np.searchsorted(row, 0.95))] for row in below)) * noise_m


def _inside_geometry(baseline: Baseline) -> dict[str, float]:
    """RMS in m of the fitted offsets, by what they stand for; of the struts' weight, RMS of what it moves."""
    flat = baseline.columns.reshape(-1, baseline.columns.shape[2])
    coefficients = flat.T @ baseline.apply(baseline.residual).ravel()
    values = coefficients[: len(baseline.sigma)] * baseline.sigma
    out = {}
    for name, prefixes in OFFSETS.items():
        rows = [i for i, unknown in enumerate(baseline.names[: len(values)]) if unknown.startswith(prefixes)]
        out[name] = float(np.sqrt(np.mean(values[rows] ** 2))) if rows else 0.0
    rows = [i for i, unknown in enumerate(baseline.names) if unknown.startswith("inside.weight.")]
    moved = np.linalg.solve(baseline.whiten, (baseline.columns[:, :, rows] @ coefficients[rows])[:, :, None])
    out["link_self_weight"] = float(np.sqrt(np.mean(moved[baseline.on_platform] ** 2)))
    return out


def _clues(found: Explanation) -> tuple[Clue, ...]:
    """Where an unknown effect lives: channels and coordinates by what they explain, over the best."""
    pool: list[Formless] = [f for f in (*found.alone, *found.formless) if f.log_evidence > 0.0]
    pool.sort(key=lambda f: -f.log_evidence)
    seen: dict[tuple[str, str], Clue] = {}
    for f in pool:
        key = (f.channel, f.coordinate)
        seen.setdefault(key, Clue(*key, f.log_evidence / pool[0].log_evidence))
    return tuple(seen.values())[:CLUES]


def _withheld(readout: Readout, before: Array, after_readout: Readout, after: Array, field: shrink.Field) -> Withheld:
    return Withheld(
        readout.baseline.rows[field.rows],
        shrink.predicted_m(readout, before)[field.rows],
        shrink.predicted_m(after_readout, after)[field.rows],
    )


def _visits(baseline: Baseline, field: shrink.Field) -> VisitGaps:
    """Mean gap of the platform's reflectors at each visit."""
    visit = baseline.visit[field.rows]
    numbers, first, of = np.unique(visit, return_index=True, return_inverse=True)
    count = np.bincount(of)[:, None]
    moves = baseline.machine.dof[baseline.machine.dof < 3]

    def mean(values: Array) -> Array:
        out = np.zeros((len(numbers), 3))
        for k, c in enumerate(moves):
            out[:, c] = np.bincount(of, values[:, k])
        return out / count

    head = field.rows[first]
    m = baseline.moments
    return VisitGaps(
        tool_m=baseline.poses.tool_m()[numbers],
        before_m=mean(field.before),
        after_m=mean(field.after),
        t_rig_s=m.t_s[head],
        drives=m.drives[head],
        direction=m.direction[head],
        payload_kg=m.payload_kg[head],
        dwell_s=m.dwell_s[head],
    )


def _remarks(found: Explanation, verdict: str, floor: float | None) -> tuple[str, ...]:
    out = []
    if floor is None:
        out.append(
            "no target was visited three times alike: the noise floor is what the fullest model leaves of the readings"
        )
    if verdict not in (NONE, UNKNOWN) and found.excess > 10.0:
        f = found.formless[0]
        out.append(
            f"the effect's form is not exact: something at {f.channel} that depends on {f.coordinate} remains "
            f"({found.excess:.0f} of log evidence, {found.log_evidence:.0f} explained)"
        )
    if verdict not in (NONE, UNKNOWN) and not any(c.effect.name == verdict for c in found.causes):
        out.append("the most probable single effect is not among those that together explain most")
    return tuple(out)
