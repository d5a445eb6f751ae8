"""The rig file's `[recalibration]` as the settings of calibration intervals."""

from __future__ import annotations

import math

from calibration.intervals.drift import DriftSettings
from calibration.intervals.envelope import Envelope
from calibration.intervals.prediction import PredictionSettings
from calibration.intervals.sequential import SequentialPlan
from calibration.intervals.settings import IntervalSettings
from pkm_rig.rig.recalibration_sections import RecalibrationSettings

DAY_S = 86400.0


def interval_settings(section: RecalibrationSettings) -> IntervalSettings:
    """Settings for computation; InputError if they contradict one another."""
    check, drift, prediction = section.check, section.drift, section.prediction
    return IntervalSettings(
        calendar_s=section.longest_interval_days * DAY_S,
        operating_h=math.inf if section.operating_h is None else section.operating_h,
        temperature_k=section.temperature_k,
        slot_s=section.next_slot_days * DAY_S,
        probability=section.probability,
        check=SequentialPlan(check.looks, check.false_alarm, check.early_miss, check.size),
        envelope=Envelope(section.envelope.parameter_sigmas, section.envelope.table_m, section.envelope.error_m),
        drift=DriftSettings(drift.walk_per_sqrt_week, drift.per_k, drift.instrument, full_poses=check.looks[-1]),
        prediction=PredictionSettings(
            horizon_s=prediction.horizon_days * DAY_S,
            coverage=prediction.coverage,
            act_by=prediction.act_by,
            trend=prediction.trend,
            fastest_weeks=prediction.fastest_weeks,
        ),
    )
