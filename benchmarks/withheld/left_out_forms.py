"""Which forms of the catalogue a case is diagnosed without: those that the plant's own formula happens to equal.

Plant and catalogue share no code, but come from one project, and where both wrote down the same formula nothing is
learnt of machines whose formula nobody wrote down. So the maker, who knows the truth, compares. The noise-free change
by an effect, whitened, with everything that the model's unknowns and the declared disturbances absorb taken out, is
fitted by each form of that effect at its true place, and of every other one there or at the best of its own: by its
own columns, and as a departure from the columns that it departs from, with the best coefficients, time constants,
onsets and periods. A form that explains more than LARGEST of the square of the change, whichever effect's it is, is
left out of the catalogue, for that case alone. The textbook's form of every effect and general functions stay. As many
forms of other effects are left out beside them, and some in cases of every other kind, so that what is left out does
not tell the truth.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.diagnosis.basis_set_evidence import InformationAndScore
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.effects.api import BasisSets, Effect, EffectInputs
from calibration.effects.catalogue import Catalogue, load_catalogue
from calibration.recording.folder import read_folder

Array = NDArray[np.float64]

LARGEST = 0.98  # share of the square of a change that a form may explain
DECOYS = (1, 2, 3)  # forms of another effect that are left out where none of the true one's is
NEGLIGIBLE = 1e-10  # information of a direction of columns over the largest


@dataclass(frozen=True)
class LeftOut:
    """Forms that a case is diagnosed without, each EFFECT/FORM: those that explain a true effect's change, and decoys.

    explained: share of a true effect's change that each form explains, above LARGEST.
    """

    explained: Mapping[str, float]
    decoys: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All of them, in the order of the alphabet."""
        return tuple(sorted({*self.explained, *self.decoys}))


class FormComparison:
    """Compares true changes with the catalogue's forms on a recording."""

    def __init__(self, catalogue: Catalogue | None = None) -> None:
        self._catalogue = catalogue or load_catalogue()

    def left_out(self, folder: Path, changes: Sequence[tuple[str, str, Array]], rng: np.random.Generator) -> LeftOut:
        """What a recording is diagnosed without. changes: effect, place ('' for the rig) and change of the readings
        (r, 3) in the machine's axes, for each effect of a case."""
        linear = linearise_recording(read_folder(folder), judge=False)
        explained: dict[str, float] = {}
        for name, place, change_m in changes:
            if name in self._catalogue.names:
                shares = explained_shares(linear, self._catalogue.effects, place, change_m)
                for form, share in shares.items():
                    if share > LARGEST:
                        explained[form] = max(share, explained.get(form, 0.0))
        explaining = {name for name, _, _ in changes} | {form.partition("/")[0] for form in explained}
        # By this recording alone: a run that was stopped goes on with the decoys that it would have had.
        forms = forms_by_effect(linear, self._catalogue)
        return LeftOut(explained, decoys_among(forms, explaining, len(explained), rng))


def decoys_among(
    forms_of: Mapping[str, Sequence[str]], true: Collection[str], own: int, rng: np.random.Generator
) -> tuple[str, ...]:
    """As many forms of other effects as of the true ones; where that is none, some of two effects."""
    able = [name for name, forms in forms_of.items() if forms and name not in true]
    wanted = [own] if own else [int(rng.choice(DECOYS)) for _ in range(2)]
    out: list[str] = []
    for count in wanted:
        end = len(out) + count
        for effect in rng.permutation(able):
            forms = [f"{effect}/{form}" for form in forms_of[str(effect)]]
            new = [name for name in forms if name not in out]
            out += [str(name) for name in rng.permutation(new)[: end - len(out)]]
            if len(out) == end:
                break
    return tuple(out)


def forms_by_effect(linear: LinearModel, catalogue: Catalogue) -> dict[str, tuple[str, ...]]:
    """The forms of each effect that may be left out, on one recording: without the textbook's."""
    likelihood = MarginalLikelihood.of(linear)
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    return {effect.name: removable_forms(effect, inputs) for effect in catalogue.effects}


def removable_forms(effect: Effect, inputs: EffectInputs) -> tuple[str, ...]:
    """Names of all forms of an effect but the textbook's."""
    names = [*effect.forms(inputs, 0).named, *(curve.form for curve in effect.curves(inputs, 0))]
    return tuple(sorted(set(names) - {"", _textbook(effect)}))


def explained_shares(linear: LinearModel, effects: Sequence[Effect], place: str, change_m: Array) -> dict[str, float]:
    """How much of the square of a change (r, 3; machine's axes) each form, EFFECT/FORM, explains, at a place.

    Where an effect has no such place, at the best of its own; curves there at the place that its columns explain best.
    """
    shift = linear.whiten_shift(change_m[linear.rows])
    likelihood = MarginalLikelihood.of(replace(linear, residual=shift))
    total = float(np.sum(shift * likelihood.weighted_residual))
    if not total > 0.0:
        return {}
    inputs, out = inputs_of_recording(likelihood, periodograms(likelihood)), dict[str, float]()
    for effect in effects:
        textbook, names = _textbook(effect), effect.places(linear.machine)
        best = (-1.0, 0)
        for index in [names.index(place)] if place in names else range(len(names)):
            built = effect.forms(inputs, index)
            columns = likelihood.information_and_score(built.contributions)
            for form, share in shares_of_sets(built, columns, total, textbook).items():
                name = f"{effect.name}/{form}"
                out[name] = max(out.get(name, 0.0), share)
            of_sets = (_explained(columns, basis_set.columns) for basis_set in built.sets)
            best = max(best, (max(of_sets, default=0.0), index))
        for curve in effect.curves(inputs, best[1]) if names else ():
            if curve.form in ("", textbook):
                continue
            fit = fit_curves(likelihood, (curve,), effect.size.low, effect.size.high)
            if fit is not None:
                name, value = f"{effect.name}/{curve.form}", likelihood.information_and_score(fit.contributions[:1])
                out[name] = max(out.get(name, 0.0), _explained(value, (0,)) / total)
    return out


def shares_of_sets(built: BasisSets, columns: InformationAndScore, total: float, textbook: str) -> dict[str, float]:
    """The shares by form that basis sets explain of a change of a total square.

    A form counts by itself, and together with the main columns of its set where these do not explain it already.
    """
    out: dict[str, float] = {}

    def note(names: set[str], share: float) -> None:
        for name in names - {"", textbook}:
            out[name] = max(out.get(name, 0.0), share)

    for basis_set in built.sets:
        main = basis_set.main
        of_main = {built.named[c] for c in main}
        by_main = _explained(columns, main) / total
        if "" not in of_main:
            note(of_main, by_main)
        for form in {built.named[c] for c in basis_set.columns} - of_main:
            departure = tuple(c for c in basis_set.columns if built.named[c] == form)
            note({form}, _explained(columns, departure) / total)
            if by_main <= LARGEST and "" not in of_main:
                note({form}, _explained(columns, (*main, *departure)) / total)
    return out


def _textbook(effect: Effect) -> str:
    return effect.textbook.form if effect.textbook else ""


def _explained(columns: InformationAndScore, chosen: Sequence[int]) -> float:
    """Square that some columns explain with their best coefficients."""
    pick = np.array(chosen, dtype=np.intp)
    values, vectors = np.linalg.eigh(columns.information[np.ix_(pick, pick)])
    informative = values > NEGLIGIBLE * max(float(values[-1]), 1e-300)
    along = vectors[:, informative].T @ columns.score[pick]
    return float(np.sum(along**2 / values[informative]))
