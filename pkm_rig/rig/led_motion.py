"""Motion of a rig whose drives are led by SYNC: from where they stand along a path on which all agree."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.led_path import (
    approach_point,
    require_clear_ways,
    tool_coordinates,
)
from pkm_rig.rig.campaign_sections import CampaignSettings


def is_led(machine: Machine, settings: CampaignSettings) -> bool:
    """Whether the drives are led along paths, rather than each by its own profile."""
    needed = machine.redundantly_actuated or bool(machine.rotary_drives)
    return needed if settings.motion is None else settings.motion == "led"


def require_possible_motion(machine: Machine, settings: CampaignSettings) -> None:
    """Raise InputError where each drive's own profile would strain the machine, or has no unit for its speed."""
    if is_led(machine, settings):
        return
    if machine.redundantly_actuated:
        raise InputError(
            f"campaign.motion: {machine.name} has {len(machine.drive_names)} drives for {len(machine.commanded)} "
            "commanded coordinates: each on its own profile would strain it; use 'led', or leave it out"
        )
    if machine.rotary_drives:
        raise InputError(
            f"campaign.motion: drive {machine.rotary_drives[0]} of {machine.name} is a crank, speeds are in m/s: use "
            "'led', or leave it out"
        )


def led_sides(machine: Machine, target_m: Array, side: int, approach_m: float) -> tuple[int, ...]:
    """Side (d,) that each drive comes from on a led approach to a platform pose (6,); 0 counts as `side`."""
    commanded = tool_coordinates(machine, target_m[None])
    before = approach_point(machine, commanded, side, approach_m)
    drives = nominal_drives(machine, nominal_poses(machine, np.vstack([before, commanded])))
    return tuple(int(s) if s else side for s in np.sign(drives[1] - drives[0]))


def side_of(machine: Machine, target_m: Array, direction: tuple[int, ...], approach_m: float) -> int:
    """The side of an approach whose drives came from `direction`."""
    return 1 if led_sides(machine, target_m, 1, approach_m) == tuple(direction) else -1


def require_clear_campaign(
    machine: Machine,
    settings: CampaignSettings,
    visits: list[tuple[Array, int, float, tuple[float, float, float]]],
) -> None:
    """Check all ways of a campaign before anything moves: visits are platform pose (6,), side, payload and its centre.

    Raises InputError; see `require_clear_ways`.
    """
    if not visits:
        return
    target = tool_coordinates(machine, np.array([pose for pose, *_ in visits]))
    before = np.array(
        [
            approach_point(machine, at, side, settings.approach_m)
            for at, (_, side, *_) in zip(target, visits, strict=True)
        ]
    )
    last = np.vstack([before[:1], target[:-1]])
    ways = np.concatenate([np.stack([last, before], axis=1), np.stack([before, target], axis=1)])
    kg = np.array([kg for *_, kg, _ in visits])
    com = np.array([com for *_, com in visits])
    require_clear_ways(machine, ways, payload_kg=np.tile(kg, 2), payload_com_m=np.tile(com, (2, 1)))
