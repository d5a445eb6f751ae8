"""The correction that a format carries: the smallest, or with more drives than coordinates one that strains less.

A free part is nearly linear in the commanded coordinates, and of some tens of micrometres. Where a format's tables hold
it, the struts strain one another as little as where this computer corrects; where they do not, what they leave of
it moves the tool. So it is in the files where it makes the predicted tool worse by no more than it may make it less
certain (docs/decisions/0027-internal-force.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.correction import Correction, ToolError
from calibration.compensation.decomposition import Loss, corrections_at
from calibration.compensation.formats.control import ControlFiles
from calibration.compensation.free_part import MOST_GROWTH, FreePart, strut_forces
from calibration.compensation.limits import check_size_and_slope
from calibration.compensation.remaining_error import RemainingError
from calibration.identification.fit import Fit
from calibration.machine.description import Machine
from calibration.model.operating_conditions import OperatingConditions

FORCE_POSES = 100
Build = Callable[[Correction], ControlFiles]


@dataclass(frozen=True)
class FileCorrection:
    """A correction, what a format makes of it, and what that leaves; free: the part that takes away internal force."""

    correction: Correction
    made: ControlFiles
    loss: Loss
    remaining: RemainingError
    free: FreePart | None = None

    @classmethod
    def of(cls, machine: Machine, error: ToolError, box: Array, build: Build, free: FreePart | None) -> FileCorrection:
        """By the format that `build` makes. InputError for what the control cannot take."""
        correction = Correction.sampled(machine, error, box, None if free is None else free.at)
        made = build(correction)
        check = correction.check
        check_size_and_slope(machine, made.tables, check.drives)
        loss = Loss.of(made.tables, check.drives, check.correction)
        corrected = check.drives + corrections_at(made.tables, check.drives)
        return cls(correction, made, loss, RemainingError.of(machine, error, check, corrected), free)

    def or_with(self, machine: Machine, error: ToolError, build: Build, free: FreePart) -> FileCorrection:
        """The one with this free part, if the format holds it; else this one."""
        try:
            other = FileCorrection.of(machine, error, self.correction.box, build, free)
        except InputError:  # larger than the control takes
            return self
        pairs = zip(self.remaining.changes.values(), other.remaining.changes.values(), strict=True)
        holds = all(
            new.after <= max((1.0 + MOST_GROWTH) * old.after, MOST_GROWTH * old.before) for (old, _), (new, _) in pairs
        )
        return other if holds else self

    def forces_n(self, fit: Fit, conditions: OperatingConditions) -> dict[str, float]:
        """Predicted forces of the struts (RMS), before and after."""
        check = self.correction.check
        target, drives = check.target_m[:FORCE_POSES], check.drives[:FORCE_POSES]
        corrected = drives + corrections_at(self.made.tables, drives)
        before, after = (
            float(np.sqrt(np.mean(strut_forces(fit, conditions, q, target) ** 2))) for q in (drives, corrected)
        )
        return {"before": before, "after": after}
