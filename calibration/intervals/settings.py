"""Settings of calibration intervals, as `[recalibration]` of a rig file states them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from calibration.base.errors import InputError
from calibration.intervals.decision import PROBABILITY
from calibration.intervals.drift import DriftSettings
from calibration.intervals.envelope import Envelope
from calibration.intervals.prediction import PredictionSettings
from calibration.intervals.sequential import SequentialPlan


@dataclass(frozen=True)
class IntervalSettings:
    """When calibration is due. A rule whose limit is infinite never says due.

    calendar_s: longest interval; operating_h: most hours of operation between calibrations; temperature_k: largest
    difference from the calibration's temperature; slot_s: time to the next occasion to calibrate; probability: of
    the statements of conformity.
    """

    calendar_s: float = 365.0 * 86400.0
    operating_h: float = math.inf
    temperature_k: float = 4.0
    slot_s: float = 7.0 * 86400.0
    probability: float = PROBABILITY
    check: SequentialPlan = field(default_factory=SequentialPlan)
    drift: DriftSettings = field(default_factory=DriftSettings)
    prediction: PredictionSettings = field(default_factory=PredictionSettings)
    envelope: Envelope = field(default_factory=Envelope)

    def __post_init__(self) -> None:
        sizes = (self.calendar_s, self.operating_h, self.temperature_k, self.slot_s)
        if not all(size > 0.0 for size in sizes):
            raise InputError("[recalibration]: intervals and limits must be above zero")
        if not math.isfinite(self.slot_s):
            raise InputError("[recalibration]: the time to the next slot must be finite")
        if self.drift.full_poses != self.check.looks[-1]:
            raise InputError("[recalibration]: drift.full_poses must be the last of check.looks")
