"""What a campaign would do, without any device: its visits, the way between them, and how long it would take."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.led_path import approach_point, straight_path, tool_coordinates
from pkm_rig.results.dry_run import STATION_S, DryRun, DryVisit
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.led_motion import is_led, side_of
from pkm_rig.rig.schedule import Block, PlannedVisit, calibration_blocks

SETTLE_S = 0.4  # of the drives after each of the two motions of a visit
PAYLOAD_S = 60.0  # assumed for a change of payload


def dry_run(file: RigFile, machine: Machine) -> DryRun:
    """The calibration's visits in their order. Raises InputError as the campaign itself would."""
    blocks = calibration_blocks(machine, file.campaign, file.station.position_m)
    on = [smr.on for smr in machine.smrs]
    moving, floor = sum(part != "floor" for part in on), on.count("floor")
    visits: list[DryVisit] = []
    t_s, moving_s, measuring_s, readings = 0.0, 0.0, 0.0, 0
    before: PlannedVisit | None = None
    for block in blocks:
        t_s += PAYLOAD_S if visits else 0.0
        for number, visit in enumerate(block.visits):
            if number % file.campaign.nest_every_visits == 0:
                nests_s = floor * STATION_S * file.campaign.readings_per_nest**0.5
                t_s, measuring_s, readings = t_s + nests_s, measuring_s + nests_s, readings + floor
            way_s = way_duration_s(file, machine, before, visit)
            points_s = moving * STATION_S * file.campaign.readings_per_smr**0.5
            t_s += way_s + visit.dwell_s
            visits.append(_dry_visit(machine, len(visits), block, visit, way_s, t_s))
            t_s += points_s
            moving_s, measuring_s, readings = moving_s + way_s, measuring_s + points_s, readings + moving
            before = visit
    return DryRun(
        machine=machine.name,
        coordinates=tuple(COORDINATES[c] for c in machine.commanded),
        motion="led" if is_led(machine, file.campaign) else "profile",
        visits=tuple(visits),
        moving_s=moving_s,
        measuring_s=measuring_s,
        total_s=t_s,
        readings=readings,
    )


def _dry_visit(machine: Machine, number: int, block: Block, visit: PlannedVisit, way_s: float, t_s: float) -> DryVisit:
    commanded = tool_coordinates(machine, visit.target_m[None])[0]
    return DryVisit(
        number,
        visit.pose,
        block.payload,
        tuple(float(c) for c in commanded),
        visit.direction,
        visit.speed_m_per_s,
        way_s,
        t_s,
    )


def way_duration_s(file: RigFile, machine: Machine, before: PlannedVisit | None, visit: PlannedVisit) -> float:
    """Duration of the way from a visit to the approach point of the next one and from there to its pose."""
    settings = file.campaign
    if is_led(machine, settings):
        end = tool_coordinates(machine, visit.target_m[None])[0]
        side = side_of(machine, visit.target_m, visit.direction, settings.approach_m)
        near = approach_point(machine, end, side, settings.approach_m)
        start = near if before is None else tool_coordinates(machine, before.target_m[None])[0]
        speed, acceleration = visit.speed_m_per_s, settings.acceleration_m_per_s2
        ways = ((start, near), (near, end))
        period_s = file.can.sync_period_s
        led = [straight_path(machine, a, b, speed, acceleration, period_s).duration_s for a, b in ways]
        return sum(led) + 2.0 * SETTLE_S
    near_m = visit.drives_m - np.array(visit.direction) * settings.approach_m
    start_m = near_m if before is None else before.drives_m
    return sum(_profile_s(settings.acceleration_m_per_s2, visit.speed_m_per_s, b - a) + SETTLE_S
               for a, b in ((start_m, near_m), (near_m, visit.drives_m)))  # fmt: skip


def _profile_s(acceleration: float, speed: float, way: Array) -> float:
    """Duration of the longest of trapezoidal motions."""
    length = float(np.max(np.abs(way), initial=0.0))
    peak = min(speed, (length * acceleration) ** 0.5)
    return length / peak + peak / acceleration if peak else 0.0
