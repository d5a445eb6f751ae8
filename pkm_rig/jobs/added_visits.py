"""Visits that join a campaign: which rig file may continue it, and how their poses are numbered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from calibration.reduction.figures import MIN_VISITS
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.device_sections import StationConnection
from pkm_rig.rig.schedule import Block
from pkm_rig.store.store import Store

SAME_TO_GO_ON = ("machine", "station", "campaign", "drives", "payloads", "nest_length", "plc")
NOT_MEASURED = (
    "on_interlock",
    "on_unseen",
)  # settings of a campaign that change neither its readings nor their verdict
SAME_OF_STATION = ("edm_mode", "prism_type", "prism_constant_m")  # older campaigns have the defaults

RigFile = Mapping[str, Any]  # as the campaign's settings are stored


def adds_visits(stored: RigFile, current: RigFile) -> bool:
    """Whether a rig file gives visits that it did not give when the campaign was begun."""
    visits = current["campaign"]["visits"]
    return bool(visits) and visits != stored["campaign"].get("visits")


def is_same_rig(stored: RigFile, current: RigFile, *, adds: bool) -> bool:
    """Whether a campaign may go on; where it `adds` visits, the poses need not be the same."""
    return all(
        _comparable_section(stored, key, adds) == _comparable_section(current, key, adds) for key in SAME_TO_GO_ON
    )


def _comparable_section(rig_file: RigFile, key: str, adds: bool) -> object:
    """A section of the rig file as far as it must be the same to continue a campaign."""
    section = rig_file.get(key) or {}
    if key == "plc":  # what is recorded of it; how it is reached may change
        return [reading["name"] for reading in section.get("readings") or []]
    if key == "station":  # its port and place may be others
        fields = StationConnection.model_fields
        return [section.get(name, fields[name].default) for name in SAME_OF_STATION]
    if key == "drives":  # how one is homed changes nothing that was measured
        return [{name: value for name, value in drive.items() if name != "homing"} for drive in section]
    if key != "campaign":
        return section
    section = {**CampaignSettings().model_dump(mode="json"), **section}  # older campaigns lack later settings
    ignored = {*NOT_MEASURED, *(("visits", "targets") if adds else ())}
    return {name: value for name, value in section.items() if name not in ignored}


def first_pose(store: Store, campaign: str, visits: list[Any]) -> int:
    """Number of the first pose of added visits: the one they have had before, or the first that is free."""
    for event in store.events(campaign, "added"):
        if event.data["visits"] == visits:
            return int(event.data["first_pose"])
    first = int(store.recording(campaign)["pose"].max()) + 1 if store.has_readings(campaign) else 0
    store.add_event(campaign, "added", {"visits": visits, "first_pose": first})
    return first


def renumber_poses(first: int, blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Blocks whose poses are counted from another number."""
    return tuple(
        replace(block, visits=tuple(replace(visit, pose=visit.pose + first) for visit in block.visits))
        for block in blocks
    )


def has_repeated_visits(blocks: Sequence[Block]) -> bool:
    """Whether some pose is visited three times from one side with one payload, as the noise floor needs."""
    counts = Counter((v.pose, v.direction, v.payload) for block in blocks for v in block.visits)
    return max(counts.values(), default=0) >= MIN_VISITS
