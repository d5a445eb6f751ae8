"""All forms, and which of them each archive has."""

from __future__ import annotations

from benchmarks.other_simulator.forms import (
    columns,
    drives,
    guides,
    outside_first,
    outside_second,
    rig,
    screws,
    station,
    struts,
)
from benchmarks.other_simulator.forms.form import Form

FIRST, SECOND, SPACE = "first", "second", "space"
ARCHIVES = (FIRST, SECOND, SPACE)
OUTSIDE = "outside"
# The order is part of the draws.
EFFECTS = (
    "link_thermal_growth", "link_stiffness", "joint_clearance", "column_thermal_growth", "foundation_settling",
    "column_compliance", "screw_thermal_growth", "backlash", "friction_windup", "screw_cumulative_error",
    "screw_periodic_error", "encoder_interpolation", "guide_straightness", "guide_angular", "axis_coupling",
    "servo_settling", "drive_scale", "tracker_drift", "refraction", "smr_reseat", "latency", "expansion_coefficient",
    "payload", "tables_left_on",
)  # fmt: skip
OF_FIRST = 3  # forms of each effect; the others are of the second archive alone

_BY_EFFECT: dict[str, tuple[Form, ...]] = {
    **struts.FORMS, **columns.FORMS, **screws.FORMS, **drives.FORMS, **guides.FORMS, **station.FORMS, **rig.FORMS,
    OUTSIDE: outside_first.FORMS + outside_second.FORMS,
}  # fmt: skip
FORMS = {effect: {one.name: one for one in forms} for effect, forms in _BY_EFFECT.items()}


def names_of_forms(effect: str, archive: str) -> list[str]:
    """Forms of an effect that an archive may have: of the first and second none is in both."""
    names = [one.name for one in _BY_EFFECT[effect]]
    count = len(outside_first.FORMS) if effect == OUTSIDE else OF_FIRST
    return {FIRST: names[:count], SECOND: names[count:], SPACE: names}[archive]
