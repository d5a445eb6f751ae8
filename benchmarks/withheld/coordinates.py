"""On which coordinate each effect of the plant truly depends (docs/reference/mock-effects.md), as kinds of shares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

KINDS = ("direction", "load", "speed", "dwell", "time", "temperature", "period", "drive", "region")

# By effect, or by effect and variant where a variant has another one. More than one: the effect is their product.
_TRUE: dict[str, tuple[str, ...]] = {
    "link_thermal_growth": ("time",),
    "link_thermal_growth/lagging": ("time", "temperature"),
    "column_thermal_growth": ("time",),
    "column_thermal_growth/lagging": ("time", "temperature"),
    "column_thermal_growth/motor_above": ("time", "drive"),
    "column_thermal_growth/rail_heat": ("time", "drive"),
    "screw_thermal_growth": ("time", "drive"),
    "backlash": ("direction",),
    "backlash/closing": ("direction", "dwell"),
    "backlash/position_width": ("direction", "drive"),
    "backlash/load_width": ("direction", "load"),
    "backlash/squeeze_film": ("direction", "dwell"),
    "friction_windup": ("direction", "load"),
    "friction_windup/palmgren": ("direction", "load", "speed"),
    "friction_windup/warming_grease": ("direction", "load", "time"),
    "friction_windup/thixotropic": ("direction", "time"),
    "screw_thermal_growth/fixed_bearing": ("time", "drive", "speed"),
    "column_compliance": ("load", "drive"),
    "link_stiffness": ("load", "drive"),
    "link_stiffness/joint_angle": ("load", "drive", "region"),
    "link_stiffness/fork_bearing": ("load", "drive", "region"),
    "link_stiffness/loosening": ("load", "drive", "time"),
    "joint_clearance": ("load", "drive", "region"),
    "joint_clearance/gravity_seated": ("drive",),
    "joint_clearance/oil_journal": ("dwell", "drive", "region"),
    "screw_cumulative_error": ("drive",),
    "screw_periodic_error": ("period",),
    "screw_periodic_error/bowed_screw": ("period", "drive"),
    "screw_periodic_error/slipping_balls": ("period", "time"),
    "encoder_interpolation": ("period",),
    "encoder_interpolation/coarse_count": ("period", "direction"),
    "guide_straightness": ("drive",),
    "guide_straightness/sine": ("drive", "period"),
    "guide_straightness/with_load": ("drive", "period"),
    "guide_straightness/gib_play": ("direction", "drive"),
    "guide_angular": ("drive",),
    "guide_angular/sine": ("drive", "period"),
    "guide_angular/with_load": ("drive", "period"),
    "guide_angular/gib_play": ("direction", "drive"),
    "foundation_settling": ("time",),
    "tracker_drift": ("time",),
    "tracker_drift/with_air": ("time", "temperature"),
    "refraction": ("region",),
    "refraction/warming": ("region", "time"),
    "refraction/cold_floor": ("region", "time"),
    "refraction/power_law": ("region", "temperature"),
    "refraction/index_fixed": ("region", "time", "temperature"),
    "refraction/index_late": ("region", "time", "temperature"),
    "smr_reseat": ("time",),
    "axis_coupling": ("drive",),
    "axis_coupling/product": ("drive", "region"),
    "axis_coupling/shared_beam": ("drive", "region"),
    "axis_coupling/elastic_bed": ("drive", "region"),
    "axis_coupling/crosstalk": ("drive", "region"),
    "axis_coupling/by_approach": ("direction", "speed"),
    "axis_coupling/cross_coupled": ("direction", "dwell"),
    "latency": ("speed",),
    "latency/filtering": ("speed", "dwell"),
    "latency/clock_skew": ("speed", "time"),
    "latency/queued": ("speed", "time"),
    "latency/clock_ageing": ("speed", "time"),
    "servo_settling": ("dwell", "speed"),
    "servo_settling/dry_friction": ("dwell", "direction"),
    "servo_settling/after_effect": ("dwell", "time"),
    "expansion_coefficient": ("temperature",),
    "expansion_coefficient/screws": ("temperature", "drive"),
    "expansion_coefficient/bimetal": ("temperature", "drive"),
    "expansion_coefficient/fibres": ("temperature", "drive"),
    "payload": ("load",),
    "payload/swapped": ("load", "time"),
    "payload/draining": ("load", "time"),
    "payload/hourglass": ("load", "time"),
    "payload/sloshing": ("load", "dwell", "speed"),
    "tables_left_on": ("drive", "region"),
    "tables_left_on/switched": ("drive", "region", "time"),
    "tables_left_on/bidirectional": ("drive", "region", "direction"),
    "tables_left_on/by_temperature": ("drive", "region", "temperature"),
    "drive_scale": ("time",),
    "drive_scale/scale_step": ("time", "drive"),
    "drive_scale/thermal_slip": ("temperature", "drive"),
    "drive_scale/wavelength": ("temperature", "drive"),
}


def true_kinds(effect: str, variant: str) -> tuple[str, ...]:
    """Kinds that are right for an effect; empty for one that is in no catalogue."""
    return _TRUE.get(f"{effect}/{variant}", _TRUE.get(effect, ()))


def first_kind(where: Sequence[dict[str, Any]]) -> str:
    """Kind of the largest share among KINDS; empty without any."""
    comparable = [share for share in where if share["kind"] in KINDS]
    return str(max(comparable, key=lambda share: share["share"])["kind"]) if comparable else ""
