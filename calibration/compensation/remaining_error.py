"""What a correction leaves of the tool's predicted error: the figure that says whether it is worth being written.

What is left of the drives' corrections does not say that. With more drives than commanded coordinates, and wherever
drives share a coordinate, small parts of several corrections add up at the tool: tables can hold most of each drive's
correction and leave the tool worse than it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.compensation.correction import Samples, ToolError
from calibration.machine.description import Machine

NEGLIGIBLE = 1e-7  # m or rad: the coarsest unit in which a format writes a correction


@dataclass(frozen=True)
class Change:
    """A quantity (RMS over poses, m or rad) without a correction and with it."""

    before: float
    after: float

    @classmethod
    def of(cls, before: Array, after: Array) -> Change:
        """Of errors (n, k) at the same poses."""
        rms = [float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) for error in (before, after)]
        return cls(*rms)

    @property
    def removed_share(self) -> float:
        """What is removed, as a share; below zero where it has grown, 1 where what is left is negligible."""
        return 1.0 if self.after <= NEGLIGIBLE else 1.0 - self.after / max(self.before, 1e-300)

    @property
    def as_json(self) -> dict[str, float]:
        """By name."""
        return {"before": self.before, "after": self.after}


@dataclass(frozen=True)
class RemainingError:
    """The tool's predicted errors without a correction and with it, in the coordinates that are commanded.

    position_m, rotation_rad: None where no translation, or no rotation, is commanded.
    """

    position_m: Change | None
    rotation_rad: Change | None

    @classmethod
    def of(cls, machine: Machine, error: ToolError, at: Samples, corrected: Array) -> RemainingError:
        """At the targets of some samples, with the drives where they are commanded and at `corrected` (n, d)."""
        before, after = error(at.drives, at.target_m), error(corrected, at.target_m)

        def change(columns: NDArray[np.intp]) -> Change | None:
            return Change.of(before[:, columns], after[:, columns]) if columns.size else None

        commanded = machine.commanded
        return cls(change(commanded[commanded < 3]), change(commanded[commanded > 2]))

    @property
    def changes(self) -> dict[str, tuple[Change, str]]:
        """What is commanded: position, rotation, each with the millionth of its unit in which it is printed."""
        named = {"position": (self.position_m, "um"), "rotation": (self.rotation_rad, "urad")}
        return {name: (change, unit) for name, (change, unit) in named.items() if change is not None}

    @property
    def in_words(self) -> str:
        """Both figures of each, for a line."""
        return "; ".join(
            f"{name} {change.before * 1e6:.1f} {unit} without, {change.after * 1e6:.2f} {unit} with it"
            for name, (change, unit) in self.changes.items()
        )
