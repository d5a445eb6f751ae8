"""The diagnosis of a recording: a pure function of its readings and its nominal machine (docs/diagnosis.md)."""

from __future__ import annotations

import numpy as np

from calibration.effects.base import Setting
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.gap import location, shrink
from calibration.gap.baseline import Baseline, baseline_of
from calibration.gap.evidence import Readout
from calibration.gap.formless import Formless, platform_hides
from calibration.gap.next_measurement import candidates
from calibration.gap.result import (
    NONE,
    UNKNOWN,
    Clue,
    Diagnosis,
    FoundEffect,
    GapFigures,
    Quantity,
    VisitGaps,
    Withheld,
)
from calibration.gap.search import Cause, Explanation, explain, taken, tested
from calibration.gap.setting import periodograms, setting_of
from calibration.gap.solution import Joint
from calibration.gap.twin import Twin
from calibration.gap.twin_score import TwinScore, scored
from calibration.gap.verdict import probabilities
from calibration.machine import Array
from calibration.recording import Recording

EQUIVALENT_SIGMA = 0.3
TOLD_APART, TOLD_APART_SHARE = 10.0, 0.05  # of log evidence, by which the data do tell an effect from the first
COMPARED = 6  # effects that come next in the ranking are held against the first
CLUES = 4
SAFEGUARDS = 2  # form-free alternatives that stand in for what the model may lack when the truth is estimated
OFFSETS = {"smr_offset": ("mounting.",), "joint_spacing": ("platform_joint.", "base_joint.")}


def diagnose(recording: Recording, catalogue: Catalogue | None = None) -> Diagnosis:
    """Where the gap of a recording lies, which effect causes it, how far it shrinks. InputError where it is not fit."""
    return _diagnosed(recording, catalogue)[0]


def diagnose_and_add(recording: Recording, catalogue: Catalogue | None = None) -> tuple[Diagnosis, Twin]:
    """The diagnosis, and the machine's twin: the fitted model with the effects that were found."""
    diagnosis, readout, _, causes, setting = _diagnosed(recording, catalogue)
    return diagnosis, Twin.of(readout, causes, setting)


def diagnose_and_score(recording: Recording, catalogue: Catalogue | None = None) -> tuple[Diagnosis, Twin, TwinScore]:
    """The same, and how the campaign simulated on the twin agrees with readings withheld from it."""
    diagnosis, readout, truth, causes, setting = _diagnosed(recording, catalogue)
    joint = Joint(readout, causes)
    twin = Twin.by(joint.solution, readout, causes, setting)
    return diagnosis, twin, scored(readout, truth, joint, twin)


def _diagnosed(
    recording: Recording, catalogue: Catalogue | None
) -> tuple[Diagnosis, Readout, Readout, tuple[Cause, ...], Setting]:
    """The diagnosis, and what a twin is made of: the readout before the causes, the one for the truth, the causes."""
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
    equivalent, matters = _equivalents(found, readout, verdict) if named else ((), 0.0)
    diagnosis = Diagnosis(
        campaign=recording.file.campaign,
        verdict=verdict,
        equivalent=equivalent,
        matters_m=matters * field.noise_m,
        effects=tuple(_found(cause, ranking, readout, after) for cause in causes),
        ranking=ranking,
        where=location.shares(readout, truth, field, _acting(found, readout, causes), periods),
        gap=gap,
        not_tested=not_tested,
        hidden_m=_hidden_m(after, setting, field.noise_m),
        inside_geometry=_inside_geometry(baseline),
        clues=_clues(found) if verdict == UNKNOWN else (),
        next_measurement=candidates(readout, found, ranking, untested),
        withheld=_withheld(baseline, readout, before_left, after, after_left, field),
        visits=_visits(baseline, field),
        spectra=location.spectra(readout, periods),
        remarks=_remarks(found, verdict),
    )
    return diagnosis, readout, truth, causes, setting


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


def _equivalents(found: Explanation, readout: Readout, verdict: str) -> tuple[tuple[str, ...], float]:
    """Effects that the readings do not exclude and whose prediction, calibration fitted again, is that of the first to
    0.3 sigma; the largest difference."""
    first = next((c for c in found.causes if c.effect.name == verdict), None)
    if first is None:
        return (), 0.0
    signal = np.einsum("nwk,k->nw", readout.columns(first.acts), first.best.coefficients)
    names, most = [], 0.0
    alone = next(c.log_evidence for c in found.ranking if c.effect.name == verdict)
    open_still = alone - TOLD_APART - TOLD_APART_SHARE * alone
    rivals = [c for c in found.ranking if c.effect.name != verdict and c.log_evidence > open_still]
    for other in rivals[:COMPARED]:
        left = taken(readout, other).apply(signal[:, :, None])[:, :, 0]
        apart = _platform_rms(readout.baseline, left)
        if apart < EQUIVALENT_SIGMA:
            names.append(other.effect.name)
            most = max(most, apart)
    return tuple(names), most


def _platform_rms(baseline: Baseline, whitened: Array) -> float:
    """RMS in sigma over the moving coordinates of the platform's readings."""
    moves = int(np.sum(baseline.machine.dof < 3))
    rows = baseline.on_platform
    return float(np.sqrt(np.sum(whitened[rows] ** 2) / (moves * max(int(rows.sum()), 1))))


def _found(cause: Cause, ranking: dict[str, float], readout: Readout, after: Readout) -> FoundEffect:
    best, effect = cause.best, cause.effect
    value, u = _size(cause)
    signal = np.einsum("nwk,k->nw", readout.columns(cause.acts), best.coefficients)
    known = {p.name: p for p in effect.others}
    others = tuple(
        Quantity(name, at, _u_of_parameter(name, at), known[name].unit)
        for name, at in best.form.parameters.items()
        if name in known
    )
    return FoundEffect(
        effect=effect.name,
        place=cause.place,
        size=Quantity(effect.size.name, value, u, effect.size.unit),
        probability=ranking.get(effect.name, 0.0) if cause is not None else 0.0,
        place_probability=cause.places[cause.place],
        raw_sigma=_platform_rms(readout.baseline, signal),
        visible_sigma=_platform_rms(readout.baseline, readout.apply(signal[:, :, None])[:, :, 0]),
        others=others,
    )


def _size(cause: Cause) -> tuple[float, float]:
    """Size of a cause in its best form and its standard uncertainty, by what its effect says of several columns."""
    best = cause.best
    main = [i for i, relative in enumerate(best.form.relative) if relative >= 1.0]
    some, covariance = best.coefficients[main], best.covariance[np.ix_(main, main)]
    if len(main) == 1:
        return float(some[0]), float(np.sqrt(covariance[0, 0]))
    norm = float(np.linalg.norm(some))
    u = float(np.sqrt(some @ covariance @ some)) / max(norm, 1e-300)
    if cause.effect.measured == "norm":
        return norm, u
    if cause.effect.measured == "sum":
        return float(np.sum(some)), float(np.sqrt(np.sum(covariance)))
    done: dict[str, Array] = {}
    for i, coefficient in zip(main, some, strict=True):
        channel, shape = cause.acts[i][0]
        done[channel] = done.get(channel, 0.0) + coefficient * shape
    each = [np.ptp(x) if cause.effect.measured == "range" else np.sqrt(np.mean(x**2)) for x in done.values()]
    value = float(np.linalg.norm(each))
    return value, u * value / max(norm, 1e-300)


def _u_of_parameter(name: str, at: float) -> float:
    """Forms are tried at steps: half a step is what is not told apart."""
    return 0.002 * at if name == "period_m" else 0.3 * at if name == "tau_s" else 120.0


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


def _withheld(
    baseline: Baseline, readout: Readout, before: Array, after_readout: Readout, after: Array, field: shrink.Field
) -> Withheld:
    return Withheld(
        baseline.rows[field.rows],
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


def _remarks(found: Explanation, verdict: str) -> tuple[str, ...]:
    out = []
    if verdict not in (NONE, UNKNOWN) and found.excess > 10.0:
        f = found.formless[0]
        out.append(
            f"the effect's form is not exact: something at {f.channel} that depends on {f.coordinate} remains "
            f"({found.excess:.0f} of log evidence, {found.log_evidence:.0f} explained)"
        )
    if verdict not in (NONE, UNKNOWN) and not any(c.effect.name == verdict for c in found.causes):
        out.append("the most probable single effect is not among those that together explain most")
    return tuple(out)
