"""What was found of an axis as a model: it predicts the gap of any recording of the same drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.axis.effects import Law
from calibration.axis.signals import Signals
from calibration.base.arrays import Array


@dataclass(frozen=True)
class AxisModel:
    """Coefficients (k,) of laws, and the scale of the second position about a middle of the travel."""

    scale: float
    middle: float
    laws: tuple[tuple[Law, int], ...]
    coefficients: Array

    def gap(self, signals: Signals) -> Array:
        """The gap (n,) over the motion of a recording, but for the offset of its second position."""
        out = self.scale * (signals.position - self.middle)
        for (law, number), coefficient in zip(self.laws, self.coefficients.tolist(), strict=True):
            columns = law(signals)
            out = out + coefficient * (columns if columns.ndim == 1 else columns[:, number])
        return np.asarray(out)

    def shrink(self, signals: Signals) -> tuple[float, float, float]:
        """RMS of a recording's gap without and with the model, its own offset taken off, and the shrink."""
        before, after = float(np.std(signals.gap)), float(np.std(signals.gap - self.gap(signals)))
        return before, after, 1.0 - after / max(before, 1e-300)
