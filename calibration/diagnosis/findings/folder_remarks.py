"""What a reader has to know of the diagnosis of a measurement folder: what it rests on, what it cannot tell apart."""

from __future__ import annotations

from calibration.diagnosis.linear_folder import LinearFolder
from calibration.identification.estimators import identify
from calibration.identification.explanations import explanations, group_indistinguishable
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.measurement_folder import MeasuredMachine

FEW = 10.0  # degrees of freedom: below, residuals say little


def remarks_on_folder(linear: LinearFolder) -> tuple[str, ...]:
    """A line each."""
    return (*_freedom(linear), *_of_former_fit(linear.measured))


def _freedom(linear: LinearFolder) -> tuple[str, ...]:
    numbers, left = int(linear.rows.is_first.sum()), linear.degrees_of_freedom
    if left >= FEW:
        return ()
    return (
        f"{numbers} numbers were read, of which {numbers - left:.0f} follow the calibration's unknowns: what is left "
        f"({left:.1f} degrees of freedom) is no accuracy, and no share of it is given",
    )


def _of_former_fit(measured: MeasuredMachine) -> tuple[str, ...]:
    """Kinds of errors that the former fit left alone and that explain what it leaves alike, whatever their size."""
    former = measured.file.former
    if former is None:
        return ()
    parameters, readings = ParameterSet.of(measured.machine, former.unknowns), measured.readings()
    fit = identify(Model(parameters), measured.visits, measured.readings(instrument_unknowns=False), "least_squares")
    candidates = explanations(fit, Model(measured.parameters()), readings)
    groups = group_indistinguishable(candidates, sum(len(part) * part.width for part in readings))
    return tuple(
        f"not told apart by these readings, whatever their size: {', '.join(e.kind for e in group)}; each explains "
        "what the former fit leaves as well as the others, and sag and play may too"
        for group in groups
        if len(group) > 1
    )
