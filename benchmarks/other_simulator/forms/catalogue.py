"""All forms, and which of them each archive has."""

from __future__ import annotations

from benchmarks.other_simulator.forms import (
    columns,
    drives,
    eighth_drives,
    eighth_machine,
    eighth_readings,
    eighth_struts,
    fifth_drives,
    fifth_machine,
    fifth_readings,
    fifth_struts,
    fourth_drives,
    fourth_machine,
    fourth_readings,
    guides,
    ninth_drives,
    ninth_machine,
    ninth_readings,
    ninth_struts,
    outside_eighth,
    outside_fifth,
    outside_first,
    outside_fourth,
    outside_ninth,
    outside_second,
    outside_seventh,
    outside_sixth,
    outside_tenth,
    outside_third,
    rig,
    screws,
    seventh_drives,
    seventh_machine,
    seventh_readings,
    seventh_struts,
    sixth_drives,
    sixth_machine,
    sixth_readings,
    sixth_struts,
    station,
    struts,
    tenth_drives,
    tenth_machine,
    tenth_readings,
    tenth_struts,
    third_drives,
    third_machine,
    third_readings,
)
from benchmarks.other_simulator.forms.form import Form

FIRST, SECOND, SPACE, THIRD = "first", "second", "space", "third"
FOURTH, FIFTH, SIXTH, SEVENTH, EIGHTH, NINTH = "fourth", "fifth", "sixth", "seventh", "eighth", "ninth"
TENTH = "tenth"
ARCHIVES = (FIRST, SECOND, SPACE, THIRD, FOURTH, FIFTH, SIXTH, SEVENTH, EIGHTH, NINTH, TENTH)
OUTSIDE = "outside"
# The order is part of the draws.
EFFECTS = (
    "link_thermal_growth", "link_stiffness", "joint_clearance", "column_thermal_growth", "foundation_settling",
    "column_compliance", "screw_thermal_growth", "backlash", "friction_windup", "screw_cumulative_error",
    "screw_periodic_error", "encoder_interpolation", "guide_straightness", "guide_angular", "axis_coupling",
    "servo_settling", "drive_scale", "tracker_drift", "refraction", "smr_reseat", "latency", "expansion_coefficient",
    "payload", "tables_left_on",
)  # fmt: skip
OF_FIRST = 3  # forms of each effect in the modules of the first two archives; the others are of the second

# The first two archives share modules; each later one has its own.
_FIRST_TWO: dict[str, tuple[Form, ...]] = {
    **struts.FORMS, **columns.FORMS, **screws.FORMS, **drives.FORMS, **guides.FORMS, **station.FORMS, **rig.FORMS,
}  # fmt: skip
# Forms by the archive that alone has them, and by effect; that in space borrows those of the first two.
_OWN: dict[str, dict[str, tuple[Form, ...]]] = {
    FIRST: {effect: forms[:OF_FIRST] for effect, forms in _FIRST_TWO.items()} | {OUTSIDE: outside_first.FORMS},
    SECOND: {effect: forms[OF_FIRST:] for effect, forms in _FIRST_TWO.items()} | {OUTSIDE: outside_second.FORMS},
    THIRD: {**third_machine.FORMS, **third_drives.FORMS, **third_readings.FORMS, OUTSIDE: outside_third.FORMS},
    FOURTH: {**fourth_machine.FORMS, **fourth_drives.FORMS, **fourth_readings.FORMS, OUTSIDE: outside_fourth.FORMS},
    FIFTH: {
        **fifth_struts.FORMS, **fifth_machine.FORMS, **fifth_drives.FORMS, **fifth_readings.FORMS,
        OUTSIDE: outside_fifth.FORMS,
    },
    SIXTH: {
        **sixth_struts.FORMS, **sixth_machine.FORMS, **sixth_drives.FORMS, **sixth_readings.FORMS,
        OUTSIDE: outside_sixth.FORMS,
    },
    SEVENTH: {
        **seventh_struts.FORMS, **seventh_machine.FORMS, **seventh_drives.FORMS, **seventh_readings.FORMS,
        OUTSIDE: outside_seventh.FORMS,
    },
    EIGHTH: {
        **eighth_struts.FORMS, **eighth_machine.FORMS, **eighth_drives.FORMS, **eighth_readings.FORMS,
        OUTSIDE: outside_eighth.FORMS,
    },
    NINTH: {
        **ninth_struts.FORMS, **ninth_machine.FORMS, **ninth_drives.FORMS, **ninth_readings.FORMS,
        OUTSIDE: outside_ninth.FORMS,
    },
    TENTH: {
        **tenth_struts.FORMS, **tenth_machine.FORMS, **tenth_drives.FORMS, **tenth_readings.FORMS,
        OUTSIDE: outside_tenth.FORMS,
    },
}  # fmt: skip
_SOURCES = {archive: (archive,) for archive in _OWN} | {SPACE: (FIRST, SECOND)}

FORMS = {
    effect: {one.name: one for forms in _OWN.values() for one in forms[effect]} for effect in (*EFFECTS, OUTSIDE)
}  # fmt: skip


def names_of_forms(effect: str, archive: str) -> list[str]:
    """Forms of an effect that an archive may have: only that in space shares any with others."""
    return [one.name for source in _SOURCES[archive] for one in _OWN[source][effect]]
