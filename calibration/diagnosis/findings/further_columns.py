"""What to write down with the visits of a measurement folder, so that it shows more effects."""

from __future__ import annotations

from collections.abc import Mapping

from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.result import CampaignAddition

ADDS = {
    "t_s": "the time of each visit",
    "direction": "the side from which each drive came, with visits from both",
    "dwell_s": "the rest before each reading, with rests from 0.5 to 16 s",
    "torque": "the torque of each drive over its rated torque",
    "payload_kg": "the payload, with visits under two",
}
VISITS_MIN = 60.0  # a rough duration of measuring visits again: afterwards nobody knows


def further_columns(linear: LinearisedReadings, not_tested: Mapping[str, str]) -> tuple[CampaignAddition, ...]:
    """Columns that are missing, with the effects that are not tested for want of them; gains are not computed."""
    missing = linear.context.missing
    settled = {
        field: tuple(sorted(name for name, reason in not_tested.items() if reason == missing.get(field)))
        for field in ADDS
    }
    return tuple(
        CampaignAddition(missing[field].rsplit(" ", 1)[-1], ADDS[field], names, VISITS_MIN, 0.0, ())
        for field, names in settled.items()
        if names
    )
