"""What a structure counts as: channel, coordinate and memory, and the effects that have these.

A new form of a known effect is still that effect: what a part does with one coordinate and one memory belongs to the
effects of docs/reference/effects.md that do the same, whatever the function. Where several do, each of them is right. A
structure that none of them has is outside. What could be taken for either is in neither table and is never drawn.
"""

from __future__ import annotations

Kind = tuple[str, str, str]

NONE, LAG, PLAY, ACCUMULATION = "none", "lag", "play", "accumulation"
MEMORIES = (NONE, LAG, PLAY, ACCUMULATION)

_WARM = ("column_thermal_growth", "screw_thermal_growth")
_SLOW = ("foundation_settling", "drive_scale", "column_thermal_growth")
_HEATED = ("screw_thermal_growth", "drive_scale", "column_thermal_growth")

KNOWN: dict[Kind, tuple[str, ...]] = {
    # a slider's position along its axis
    ("travel", "place", NONE): ("screw_cumulative_error",),
    ("travel", "partner", NONE): ("axis_coupling",),
    ("travel", "turn", NONE): ("screw_periodic_error",),
    ("travel", "grating", NONE): ("encoder_interpolation",),
    ("travel", "side", NONE): ("backlash",),
    ("travel", "side*place", NONE): ("backlash", "friction_windup"),
    ("travel", "side*load", NONE): ("backlash", "friction_windup"),
    ("travel", "side*dwell", NONE): ("servo_settling", "backlash"),
    ("travel", "side*speed", NONE): ("servo_settling", "friction_windup"),
    ("travel", "torque", NONE): ("friction_windup",),
    ("travel", "load", NONE): ("column_compliance", "friction_windup"),
    ("travel", "load", LAG): ("column_compliance", "friction_windup"),
    ("travel", "time", NONE): _SLOW,
    ("travel", "temperature", NONE): _WARM,
    ("travel", "temperature", LAG): _WARM,
    ("travel", "place", ACCUMULATION): ("screw_thermal_growth", *_SLOW),
    # the scale by which a drive counts
    ("scale", "time", NONE): ("drive_scale", *_WARM),
    ("scale", "temperature", NONE): _HEATED,
    ("scale", "temperature", LAG): _HEATED,
    ("scale", "place", ACCUMULATION): _HEATED,
    # a slider across its axis, and its rotation
    ("sideways", "place", NONE): ("guide_straightness",),
    ("sideways", "load", NONE): ("column_compliance",),
    ("sideways", "load", LAG): ("column_compliance",),
    ("sideways", "time", NONE): ("foundation_settling", "column_thermal_growth"),
    ("sideways", "temperature", NONE): ("column_thermal_growth", "foundation_settling"),
    ("sideways", "temperature", LAG): ("column_thermal_growth", "foundation_settling"),
    ("turn", "place", NONE): ("guide_angular",),
    ("turn", "load", NONE): ("column_compliance",),
    ("turn", "load", LAG): ("column_compliance",),
    ("turn", "time", NONE): ("foundation_settling", "column_thermal_growth"),
    ("turn", "temperature", NONE): ("column_thermal_growth", "foundation_settling"),
    # struts and their joints
    ("length", "time", NONE): ("link_thermal_growth",),
    ("length", "temperature", NONE): ("link_thermal_growth",),
    ("length", "temperature", LAG): ("link_thermal_growth",),
    ("length", "load", NONE): ("link_stiffness", "joint_clearance"),
    ("joint", "load", NONE): ("joint_clearance", "link_stiffness"),
    ("struts", "temperature", NONE): ("expansion_coefficient",),
    ("struts", "temperature", LAG): ("expansion_coefficient", "link_thermal_growth"),
    # what is measured, and with what
    ("reflector", "time", NONE): ("smr_reseat",),
    ("reflector", "load", NONE): ("smr_reseat",),
    ("reflector", "temperature", NONE): ("smr_reseat",),
    ("station", "time", NONE): ("tracker_drift",),
    ("station", "air", NONE): ("tracker_drift",),
    ("station", "air", LAG): ("tracker_drift",),
    ("light", "sight", NONE): ("refraction",),
    ("drives", "velocity", NONE): ("latency",),
    ("payload", "load", NONE): ("payload",),
}

OUTSIDE: tuple[Kind, ...] = (
    ("travel", "dwell", NONE),
    ("travel", "speed", NONE),
    ("travel", "way", NONE),
    ("travel", "place", LAG),
    ("travel", "place", PLAY),
    ("travel", "partner", LAG),
    ("travel", "partner", PLAY),
    ("scale", "dwell", NONE),
    ("scale", "speed", NONE),
    *(
        (channel, coordinate, NONE)
        for channel in ("sideways", "turn")
        for coordinate in ("side", "dwell", "speed", "way")
    ),
    *((channel, "place", memory) for channel in ("sideways", "turn") for memory in (LAG, PLAY)),
    *(
        (channel, coordinate, NONE)
        for channel in ("length", "joint")
        for coordinate in ("side", "dwell", "speed", "way")
    ),
    *((channel, "place", memory) for channel in ("length", "joint") for memory in (LAG, PLAY)),
    ("struts", "side", NONE),
    ("struts", "dwell", NONE),
    *(("reflector", coordinate, NONE) for coordinate in ("place", "partner", "side", "dwell", "speed", "way")),
    ("reflector", "place", PLAY),
    *(("station", coordinate, NONE) for coordinate in ("place", "side", "dwell", "speed")),
    *(("floor", coordinate, NONE) for coordinate in ("place", "side", "dwell", "speed")),
    ("floor", "place", PLAY),
    *(("force", coordinate, NONE) for coordinate in ("place", "side", "dwell", "speed", "time")),
    ("force", "place", PLAY),
    ("payload", "time", NONE),
    ("payload", "place", NONE),
    ("payload", "place", LAG),
    ("payload", "place", PLAY),
)


def names_of(kind: Kind) -> tuple[str, ...]:
    """The effects that a structure is a form of; empty if it is outside."""
    return KNOWN.get(kind, ())
