"""The campaign as Bluesky plans: warm-up, repeatability, nest checks, payload blocks, verification.

A plan only says what happens; devices do it, the store keeps each reading before the next message is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bluesky.plan_stubs as bps
import numpy as np
from bluesky.utils import Msg

from calibration.base.arrays import Array
from calibration.instruments.station_geometry import across_line_of_sight
from drivers.errors import DrivesMoved
from pkm_rig.errors import CampaignRefused
from pkm_rig.rig.devices import MachineDevice, PayloadDevice, ReadingTags, StationDevice, WaitDevice
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import Block, PlannedVisit

Plan = Generator[Msg, Any, Any]
MEASURED_ANEW = "visit_measured_anew"
_AIMED, _MEASURED = "aimed", "measured"  # groups of messages that are waited for


@dataclass
class CampaignDevices:
    """The devices of one campaign and what the plans share.

    `note` keeps an event in the store. `stored` holds (phase, pose, pass, SMR) of readings of an earlier run of the
    campaign, which are not taken again.
    """

    rig: Rig
    tags: ReadingTags
    machine: MachineDevice
    payload: PayloadDevice
    station: StationDevice
    wait: WaitDevice
    progress: Callable[[int, str], None]
    note: Callable[[str, dict[str, Any]], None]
    first_nests: dict[str, Array]
    stored: set[tuple[str, int, int, str]] = field(default_factory=set)

    def smrs(self, *on: str) -> list[str]:
        """Names of the reflectors on some parts."""
        return [smr.name for smr in self.rig.machine.smrs if smr.on in on]


def prepare(devices: CampaignDevices, blocks: Sequence[Block]) -> Plan:
    """Warm-up and repeatability check: before anything is measured that counts."""
    first, second = [visit for block in blocks for visit in block.visits][:2]
    yield from bps.abs_set(devices.payload, 0, wait=True)
    yield from _warm_up(devices, [first, second])
    yield from nest_check(devices)
    yield from _repeatability(devices, first)


def calibration(devices: CampaignDevices, blocks: Sequence[Block]) -> Plan:
    """All blocks, a nest check before, between and after."""
    for block in blocks:
        yield from bps.abs_set(devices.payload, block.payload, wait=True)
        yield from visits(devices, block, "calibration", devices.smrs("platform", "slider"))


def verification(devices: CampaignDevices, block: Block, phase: str) -> Plan:
    """One block of verification poses with the compensation as it is now."""
    yield from visits(devices, block, phase, devices.smrs("platform"))


def visits(devices: CampaignDevices, block: Block, phase: str, smrs: Sequence[str]) -> Plan:
    """Visit after visit; each reading is kept before the next move; nests at start, end and every few visits."""
    every = devices.rig.file.campaign.nest_every_visits
    yield from nest_check(devices)
    for number, visit in enumerate(block.visits):
        if number and number % every == 0:
            yield from nest_check(devices)
        yield from _visit(devices, visit, phase, smrs)
    yield from nest_check(devices)


def nest_check(devices: CampaignDevices) -> Plan:
    """Measure the floor nests; a shift beyond the limit is measured again, then the campaign ends.

    The readings since the last good check are in the store and stay out of every analysis.
    """
    limit = devices.rig.file.campaign.nest_limit_m
    for attempt in range(2):
        devices.tags.nest_check += 1
        shift = 0.0
        for nest in devices.smrs("floor"):
            position = yield from _read(devices, "nests", nest)
            start = devices.first_nests.setdefault(nest, position)
            shift = max(shift, float(np.linalg.norm(across_line_of_sight(position - start, start))))
        if shift <= limit:
            return
        if attempt:
            raise CampaignRefused(
                f"nest check: a floor nest moved {shift * 1e6:.0f} um (limit {limit * 1e6:.0f} um); "
                "secure the station's stand and start again; readings since the last good check are not used"
            )


def _visit(devices: CampaignDevices, visit: PlannedVisit, phase: str, smrs: Sequence[str]) -> Plan:
    """One visit; where the drives have moved during it, it is measured anew as a whole, once.

    The readings of the visit that was given up stay in the store; those in place of them name it (`replaces_visit`).
    """
    missing = [smr for smr in smrs if (phase, visit.pose, visit.pass_, smr) not in devices.stored]
    if not missing:
        return
    try:
        yield from _read_all(devices, visit, phase, missing)
    except DrivesMoved as error:
        tags = devices.tags
        devices.note(MEASURED_ANEW, {"visit": tags.visit_number, "reason": str(error)})
        tags.replaces_visit = tags.visit_number
        try:
            yield from _read_all(devices, visit, phase, missing)
        finally:
            tags.replaces_visit = -1


def _read_all(devices: CampaignDevices, visit: PlannedVisit, phase: str, smrs: Sequence[str]) -> Plan:
    yield from bps.abs_set(devices.machine, visit, wait=True)
    for smr in smrs:
        yield from _read(devices, phase, smr)


def _read(devices: CampaignDevices, phase: str, smr: str) -> Plan:
    """One reading, kept before anything else happens. Raises DrivesMoved, without a reading.

    In bluesky's messages, not its plan stubs: each call of a stub records a stack, some 10,000 times a campaign.
    """
    devices.tags.phase = phase
    yield Msg("checkpoint")
    yield Msg("set", devices.station, smr, group=_AIMED)
    yield Msg("wait", None, group=_AIMED)
    yield Msg("trigger", devices.station, group=_MEASURED)
    yield Msg("wait", None, group=_MEASURED)
    if devices.station.moved is not None:
        raise devices.station.moved
    yield Msg("create", None, name="primary")
    yield Msg("read", devices.station)
    yield Msg("save")
    yield Msg("checkpoint")
    devices.progress(1, phase)
    return devices.station.last_position_m


def _warm_up(devices: CampaignDevices, between: Sequence[PlannedVisit]) -> Plan:
    """Move between two poses until no part's temperature changes faster than the limit."""
    settings = devices.rig.file.campaign
    started = devices.rig.clock.now_s()
    history: list[tuple[float, dict[str, float]]] = []
    while True:
        state = devices.rig.supervisor.state()
        history.append((devices.rig.clock.now_s(), dict(state.temperatures_c)))
        rate = _fastest_rate(history[-6:])
        if rate is not None and rate <= settings.warm_up_rate_k_per_h:
            return
        if devices.rig.clock.now_s() - started >= settings.warm_up_max_s:
            raise CampaignRefused(
                f"warm-up: parts still change {rate or 0.0:.2f} K/h after {settings.warm_up_max_s / 60.0:.0f} min "
                f"(limit {settings.warm_up_rate_k_per_h:g} K/h); let the machine warm up longer"
            )
        devices.progress(0, "warm-up")
        for visit in between:
            yield from bps.abs_set(devices.machine, replace(visit, dwell_s=0.0), wait=True)
        yield from bps.abs_set(devices.wait, settings.warm_up_step_s, wait=True)


def _fastest_rate(history: Sequence[tuple[float, dict[str, float]]]) -> float | None:
    """Largest rate of change in K/h over a few samples (least squares), None with fewer than four."""
    if len(history) < 4:
        return None
    t = np.array([time for time, _ in history]) / 3600.0
    t = t - t.mean()
    rates = [abs(float(t @ np.array([temps[name] for _, temps in history]) / (t @ t))) for name in history[0][1]]
    return max(rates)


def _repeatability(devices: CampaignDevices, visit: PlannedVisit) -> Plan:
    """Visit one pose several times, approached anew; the scatter across the line of sight must be small."""
    settings = devices.rig.file.campaign
    smr = devices.smrs("platform")[0]
    points = []
    for _ in range(settings.repeatability_visits):
        yield from bps.abs_set(devices.machine, visit, wait=True)
        points.append((yield from _read(devices, "repeatability", smr)))
    mean = np.mean(points, axis=0)
    across = across_line_of_sight(np.array(points) - mean, mean)
    rms = float(np.sqrt(np.sum(across**2) / (len(points) - 1)))
    if rms > settings.repeatability_limit_m:
        raise CampaignRefused(
            f"repeatability: {rms * 1e6:.0f} um RMS over {len(points)} visits "
            f"(limit {settings.repeatability_limit_m * 1e6:.0f} um); look for vibration, play or a loose reflector"
        )
