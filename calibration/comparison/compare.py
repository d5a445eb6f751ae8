"""The comparison of two recordings: a pure function of readings and nominal machine.

docs/explanation/comparison.md says how it is computed and how well it does.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from calibration.base.errors import InputError
from calibration.comparison.candidates import CURVE_TERMS, SCREW_CURVE, candidates, parameters_of
from calibration.comparison.result import ChangedQuantity, Comparison, FoundChange
from calibration.comparison.same_machine import require_one_machine, shared_reflectors, without_tables
from calibration.comparison.search import (
    COMPARISON_VERDICT,
    NOTHING,
    UNKNOWN,
    Found,
    Weighed,
    equivalents,
    largest_hidden_change_m,
    weigh,
)
from calibration.comparison.two_campaigns import TwoCampaigns, again_at, curve_of_drive, linearise_pair
from calibration.comparison.two_folders import (
    TwoFolders,
    candidates_of_folders,
    linearise_folders,
    require_one_measured_machine,
)
from calibration.comparison.workspace import WorkspaceChanges
from calibration.diagnosis.findings.remarks import does_not_repeat, elsewhere
from calibration.diagnosis.linear_model import usable_rows
from calibration.machine.description import Machine
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording

ROUGH_SCATTER = 1.5  # of readings about the fit of their own campaign, over the stated: then it is said
LARGE_M = 1.0e-3  # of a shift: beyond, what the linear model leaves out counts
CURVE_POINTS = 200
LN_RATIOS = (-1.5, 1.5)  # of stiffnesses at which the model is linearised


def compare(before: Recording, after: Recording) -> Comparison:
    """What changed on the machine between two campaigns. Raises InputError if they cannot be compared."""
    require_one_machine(before, after)
    shared = shared_reflectors(before.machine, after.machine)
    plain = without_tables(before), without_tables(after)
    pair = linearise_pair(*plain, shared)
    every = candidates(pair.after.machine, sorted(set(pair.after.smr.tolist())), _seen_twice(pair))
    weighed = weigh(pair, every)
    if any(change.candidate.of_machine for change in weighed.changes):
        pair = _about_changes(weighed)
        weighed = weigh(pair, every)
    return _result(weighed, _remarks(plain, pair))


def compare_measurements(before: MeasuredMachine, after: MeasuredMachine) -> Comparison:
    """The same of two measurement folders. Raises InputError if they cannot be compared."""
    require_one_measured_machine(before, after)
    pair = linearise_folders(before, after)
    return _result(weigh(pair, candidates_of_folders(pair)), _remarks_on_folders(pair))


def _about_changes(weighed: Weighed) -> TwoCampaigns:
    """The same readings, linear about the machine before, and after about the machine as it has changed.

    Misfit and stiffness enter as a product: about one machine for both, half of a large change would stand in the
    wrong place. What drives are off by stays in the linear model, in which it errs by its square over a strut's length.
    """
    pair = weighed.model.pair
    machine, changed = pair.after.machine, dict[str, float]()
    for change in weighed.changes:
        for move, value in zip(change.way.moves, change.coefficients.tolist(), strict=True):
            for name, moved in parameters_of(machine, move, value).items():
                changed[name] = changed.get(name, 0.0) + moved
    softer = {name: float(np.clip(v, *LN_RATIOS)) for name, v in changed.items() if name.startswith("ln_stiffness")}
    try:
        return again_at(pair, _machine_before(weighed), changed | softer)
    except InputError:  # no equilibrium there: what was found is not what happened, but weighed all the same
        return pair


def _machine_before(weighed: Weighed) -> dict[str, float]:
    """Values (SI) of the parameters of the machine before, what has changed since being in the model."""
    model = weighed.model
    for change in weighed.changes:
        model = model.including(change.way, change.size)
    return model.pair.machine_values(model.apply(model.pair.residual))


def _seen_twice(pair: TwoCampaigns) -> frozenset[str]:
    seen = [{linear.machine.smrs[i].name for i in set(linear.smr.tolist())} for linear in (pair.before, pair.after)]
    return pair.shared & frozenset(seen[0] & seen[1])


def _result(weighed: Weighed, remarks: list[str]) -> Comparison:
    pair = weighed.model.pair
    ranking = weighed.probabilities()
    verdict = max(ranking, key=lambda name: ranking[name])
    if verdict not in (NOTHING, UNKNOWN) and not weighed.changes:
        verdict = NOTHING  # likelier than nothing, and yet below what a change has to explain
    named = verdict not in (NOTHING, UNKNOWN)
    changes = _main_first(weighed, verdict) if named else ()
    alike, matters = equivalents(weighed, changes[0]) if named else ((), 0.0)
    of_machine = [change for change in changes if change.candidate.of_machine]
    workspace = WorkspaceChanges(pair.after, _machine_before(weighed)) if of_machine else None
    if any(_largest_m(change) > LARGE_M for change in changes):
        remarks.append(f"a change of more than {LARGE_M * 1e3:g} mm: its size holds to some per cent only")
    return Comparison(
        before=pair.before.campaign,
        after=pair.after.campaign,
        verdict=verdict,
        place=changes[0].candidate.place if changes else "",
        equivalent=tuple(found.name for found in alike),
        matters_sigma=matters,
        ranking=ranking,
        changes=tuple(_found_change(weighed, change, ranking, verdict, workspace) for change in changes),
        workspace=workspace.of_changes(of_machine) if workspace else None,
        hidden_m=largest_hidden_change_m(weighed),
        scatter=pair.scatter,
        readings=(len(set(pair.before.source_rows.tolist())), len(set(pair.after.source_rows.tolist()))),
        remarks=tuple(remarks),
    )


def _main_first(weighed: Weighed, verdict: str) -> tuple[Found, ...]:
    """The changes, first those of the verdict's structure."""
    return tuple(sorted(weighed.changes, key=lambda change: change.candidate.structure != verdict))


def _found_change(
    weighed: Weighed, change: Found, ranking: dict[str, float], verdict: str, workspace: WorkspaceChanges | None
) -> FoundChange:
    model, structure = weighed.model, change.candidate.structure
    signal = model.of_moves(change.way.moves) @ change.coefficients
    present = 1.0 - ranking[NOTHING] - ranking[UNKNOWN]
    if structure == verdict:
        probability = ranking[verdict]
    else:
        probability = present * float(expit(change.log_evidence - COMPARISON_VERDICT.none_prior_log_odds))
    return FoundChange(
        structure=structure,
        place=change.candidate.place,
        of_machine=change.candidate.of_machine,
        probability=probability,
        place_probability=weighed.place_probability[change.name],
        quantities=_quantities(change, model.pair.after.machine),
        raw_sigma=model.pair.largest_rms(signal),
        visible_sigma=model.pair.largest_rms(model.apply(signal)),
        workspace=workspace.of_changes([change]) if workspace and change.candidate.of_machine else None,
    )


def _quantities(change: Found, machine: Machine) -> tuple[ChangedQuantity, ...]:
    moves, u = change.way.moves, np.sqrt(np.diag(change.covariance))
    if change.candidate.structure != SCREW_CURVE:
        return tuple(
            ChangedQuantity(move.name, float(c), float(s), move.unit)
            for move, c, s in zip(moves, change.coefficients, u, strict=True)
        )
    drive = machine.drive_names.index(change.candidate.place)
    low, high = machine.travel[drive].tolist()
    grid = np.linspace(low, high, CURVE_POINTS)
    by_term = curve_of_drive(machine.travel[drive], grid, CURVE_TERMS)
    curve = by_term @ change.coefficients
    rms = float(np.sqrt(np.mean(curve**2)))
    gradient = curve @ by_term / (len(grid) * max(rms, 1e-15))
    return (ChangedQuantity("rms", rms, float(np.sqrt(gradient @ change.covariance @ gradient)), moves[0].unit),)


def _largest_m(change: Found) -> float:
    """The largest of a change's numbers that are shifts, or have the effect of one."""
    lengths = [abs(c) / m.relative for c, m in zip(change.coefficients, change.way.moves, strict=True) if m.is_length]
    return float(max(lengths, default=0.0))


def _rough(name: str, scatter: float) -> list[str]:
    if scatter <= ROUGH_SCATTER:
        return []
    return [
        f"{name}: readings scatter {scatter:.1f} times as much as stated about the fit of their campaign and "
        f"count for less; `pkm-rig diagnose {name}` says why"
    ]


def _repeats(pair: TwoCampaigns) -> list[str]:
    return [does_not_repeat(pair.positioning_sd_m)] if pair.positioning_sd_m > 0.0 else []


def _remarks_on_folders(pair: TwoFolders) -> list[str]:
    out = _repeats(pair)
    for linear, scatter in zip((pair.before, pair.after), pair.scatter, strict=True):
        out += _rough(linear.campaign, scatter)
        if linear.left_out:
            names = ", ".join(f"{reading.name} ({reading.of})" for reading in linear.left_out)
            out.append(f"{linear.campaign}: left out, as they do not fit the others: {names}")
    return out


def _remarks(recordings: tuple[Recording, Recording], pair: TwoCampaigns) -> list[str]:
    out = _repeats(pair)
    both = zip(recordings, (pair.before, pair.after), pair.scatter, pair.elsewhere, strict=True)
    for recording, linear, scatter, off in both:
        name = recording.file.campaign
        out += _rough(name, scatter)
        of_these = 0
        if off is not None:
            of_these = int(np.isin(recording["visit"][usable_rows(recording)], off.visits).sum())
            out.append(f"{name}: {elsewhere(off)}; left out, see what happened then")
        if wrong := len(usable_rows(recording)) - of_these - len(linear.source_rows):
            out.append(f"{name}: {wrong} of its readings, which do not fit the others, left out")
        unknown = int(np.sum((recording["compensation"] > 0.0) & (np.asarray(recording["phase"]) != "nests")))
        if unknown:
            out.append(f"{name}: {unknown} readings under tables that it does not hold were left out")
    every = {smr.name for smr in pair.before.machine.smrs} | {smr.name for smr in pair.after.machine.smrs}
    if moved := sorted(every - pair.shared):
        out.append(f"reflectors that the machine files do not share are not compared: {', '.join(moved)}")
    return out
