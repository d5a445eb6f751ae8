"""A second position whose scale is far off what is stated of it: the scale is then estimated freely.

Under its prior a scale that is off would cost so much that an effect which rises with position, such as a weight's sine
over a short travel, were the likelier one, however badly it fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.axis.likelihood import AxisLikelihood
from calibration.axis.signals import Signals

FAR = 5.0  # standard uncertainties
FREE_U = 0.3  # of a scale that nothing is known of; a recording is refused from 0.5 on


@dataclass(frozen=True)
class Scale:
    """Scale of the second position against the motor's, less one, with its standard uncertainty, and the stated one."""

    value: float
    u: float
    stated_u: float

    @classmethod
    def of(cls, likelihood: AxisLikelihood, signals: Signals, stated_u: float) -> Scale:
        """That of a fitted model."""
        value = signals.slope + float(likelihood.coefficients[0]) * signals.scale_u
        return cls(value, float(np.sqrt(likelihood.covariance[0, 0])) * signals.scale_u, stated_u)

    @property
    def is_far(self) -> bool:
        """Whether it is no matter of its uncertainty."""
        return abs(self.value) > FAR * float(np.hypot(self.stated_u, self.u))

    @property
    def remark(self) -> str:
        """What to say of a scale that was estimated freely."""
        times = f"{abs(self.value) / self.stated_u:.0f} times its" if self.stated_u > 0.0 else "against a"
        return (
            f"the second position moves {1.0 + self.value:.7g} times as far as the motor's: its scale is off by "
            f"{self.value:.3g}, {times} stated uncertainty of {self.stated_u:g}, and was estimated freely; check ratio "
            "and units, or state second_scale_u"
        )


def with_free_scale(signals: Signals) -> Signals | None:
    """The signals with a scale of which nothing is known, where it is far from what is stated; else None."""
    centred = signals.position - signals.position.mean()
    slope = float(centred @ signals.gap) / max(float(centred @ centred), 1e-300)
    if abs(slope) <= signals.scale_u:
        return None
    free = replace(signals, gap=signals.gap - slope * centred, slope=slope, scale_u=FREE_U)
    return free if Scale.of(AxisLikelihood.of(free), free, signals.scale_u).is_far else None
