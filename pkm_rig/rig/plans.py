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

from calibration.instruments.station_geometry import across_line_of_sight
from calibration.reduction.reduction import CALIBRATION
from drivers.errors import DrivesMoved
from pkm_rig.errors import CampaignRefused, StationMoved
from pkm_rig.rig.control_watch import WatchedMachine
from pkm_rig.rig.devices import MachineDevice, ReadingTags, StationDevice, WaitDevice
from pkm_rig.rig.operator_devices import PayloadDevice, WaitingDevice
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import Block, PlannedVisit
from pkm_rig.rig.waiting import VisitBroken

Plan = Generator[Msg, Any, Any]
MEASURED_ANEW = "visit_measured_anew"
_AIMED, _MEASURED = "aimed", "measured"  # groups of messages that are waited for


@dataclass
class CampaignDevices:
    """The devices of one campaign and what the plans share.

    `note` keeps an event in the store. `nest_shift_m` says how far the last nest check there is off the first of its
    set-up, by the rule of every later analysis. `stored` holds (phase, pose, pass, SMR) of readings of an earlier run
    of the campaign, which are not taken again. `in_doubt`: visits, by pose and pass, of which nobody has seen that the
    machine stood until their end; they are measured anew.
    """

    rig: Rig
    tags: ReadingTags
    machine: MachineDevice | WatchedMachine
    payload: PayloadDevice
    station: StationDevice
    wait: WaitDevice
    progress: Callable[[int, str], None]
    note: Callable[[str, dict[str, Any]], None]
    waiting: WaitingDevice
    nest_shift_m: Callable[[], float]
    stored: set[tuple[str, int, int, str]] = field(default_factory=set)
    in_doubt: dict[tuple[int, int], int] = field(default_factory=dict)

    def missing(self, visit: PlannedVisit, phase: str, smrs: Sequence[str]) -> list[str]:
        """Reflectors that a visit has no stored reading of."""
        return [smr for smr in smrs if (phase, visit.pose, visit.pass_, smr) not in self.stored]

    def missing_of(self, blocks: Sequence[Block]) -> list[Block]:
        """The blocks of a calibration without the visits that are stored."""
        smrs = self.smrs("platform", "slider")
        parts = [tuple(v for v in block.visits if self.missing(v, CALIBRATION, smrs)) for block in blocks]
        return [replace(block, visits=part) for block, part in zip(blocks, parts, strict=True) if part]

    def smrs(self, *on: str) -> list[str]:
        """Names of the reflectors on some parts."""
        return [smr.name for smr in self.rig.machine.smrs if smr.on in on]


def prepare(devices: CampaignDevices, blocks: Sequence[Block]) -> Plan:
    """Warm-up and repeatability check: before anything is measured that counts."""
    first, second = [visit for block in blocks for visit in block.visits][:2]
    yield from put_on(devices, 0)
    yield from _until_done(devices, lambda: _warm_up(devices, [first, second]))
    yield from nest_check(devices)
    yield from _until_done(devices, lambda: _repeatability(devices, first))


def calibration(devices: CampaignDevices, blocks: Sequence[Block]) -> Plan:
    """What is missing of all blocks, a nest check before, between and after; a complete one needs no payload."""
    for block in devices.missing_of(blocks):
        yield from put_on(devices, block.payload)
        yield from visits(devices, block, CALIBRATION, devices.smrs("platform", "slider"))


def steady_temperatures(devices: CampaignDevices) -> Plan:
    """Wait until no part's temperature changes faster than the limit; nobody moves meanwhile."""
    yield from _until_done(devices, lambda: _warm_up(devices, ()))


def warm_up(devices: CampaignDevices, between: Sequence[PlannedVisit]) -> Plan:
    """Move between some visits until no part's temperature changes faster than the limit."""
    yield from _until_done(devices, lambda: _warm_up(devices, between))


def tie_setup(devices: CampaignDevices, block: Block) -> Plan:
    """Visit poses of earlier set-ups again, warmed up, all reflectors, between nest checks."""
    yield from put_on(devices, block.payload)
    yield from _until_done(devices, lambda: _warm_up(devices, block.visits[:2]))
    yield from visits(devices, block, "repeatability", devices.smrs("platform", "slider"))


def put_on(devices: CampaignDevices, payload: int) -> Plan:
    """Have a payload put on."""
    yield from _until_done(devices, lambda: _set(devices, devices.payload, payload))


def verification(devices: CampaignDevices, block: Block, phase: str) -> Plan:
    """One block of verification poses with the compensation as it is now."""
    yield from visits(devices, block, phase, devices.smrs("platform"))


def visits(
    devices: CampaignDevices, block: Block, phase: str, smrs: Sequence[str], *, nests_measured: bool = False
) -> Plan:
    """Visit after visit; each reading is kept before the next move; nests at start, end and every few visits.

    nests_measured: nothing has happened since the last nest check, which serves as the first.
    """
    every = devices.rig.file.campaign.nest_every_visits
    if not nests_measured:
        yield from nest_check(devices)
    for number, visit in enumerate(block.visits):
        if number and number % every == 0:
            yield from nest_check(devices)
        yield from _visit(devices, visit, phase, smrs)
    yield from nest_check(devices)


def _until_done(devices: CampaignDevices, part: Callable[[], Plan]) -> Plan:
    """A part of a campaign; it is made anew where the campaign had to wait during it."""
    while True:
        try:
            return (yield from part())
        except VisitBroken:
            yield from _wait_for_operator(devices)


def _wait_for_operator(devices: CampaignDevices) -> Plan:
    """Wait until the campaign may go on; again if an interlock opens as it does."""
    devices.progress(0, "waiting for operator")
    while True:
        yield from bps.abs_set(devices.waiting, None, wait=True)
        if not devices.waiting.asked():
            return


def _set(devices: CampaignDevices, device: Any, value: object) -> Plan:
    """Have a device do something. Raises VisitBroken before it if a pause is asked for, after it if it was broken."""
    _require(not devices.waiting.asked())
    yield from bps.abs_set(device, value, wait=True)
    _require(not devices.waiting.broken())


def _require(done: bool) -> None:
    if not done:
        raise VisitBroken


def nest_check(devices: CampaignDevices) -> Plan:
    """Measure the floor nests; a shift beyond the limit is measured again, then the campaign ends.

    The readings since the last good check are in the store and stay out of every analysis.
    """
    yield from _until_done(devices, lambda: _nest_check(devices))


def _nest_check(devices: CampaignDevices) -> Plan:
    number, sequence = devices.tags.nest_check, devices.tags.sequence
    try:
        yield from _measure_nests(devices)
    except VisitBroken:
        if devices.tags.sequence == sequence:  # readings before it need the number that follows theirs
            devices.tags.nest_check = number
        raise


def _measure_nests(devices: CampaignDevices) -> Plan:
    limit = devices.rig.file.campaign.nest_limit_m
    for attempt in range(2):
        devices.tags.nest_check += 1
        for nest in devices.smrs("floor"):
            yield from _read(devices, "nests", nest)
        shift = devices.nest_shift_m()
        devices.rig.observer.checked("nest shift", shift, limit, "m")
        if shift <= limit:
            return
        if attempt:
            raise StationMoved(
                f"nest check: a floor nest moved {shift * 1e6:.0f} um (limit {limit * 1e6:.0f} um); "
                "secure the station's stand and go on with --new-setup; readings since the last good check are not used"
            )


def _visit(devices: CampaignDevices, visit: PlannedVisit, phase: str, smrs: Sequence[str]) -> Plan:
    """One visit; where the drives have moved during it, it is measured anew as a whole, once; where the campaign had to
    wait during it, as often as that.

    The readings of the visit that was given up stay in the store; those in place of them name it (`replaces_visit`).
    """
    missing = devices.missing(visit, phase, smrs)
    if not missing:
        return
    tags = devices.tags
    replaced, has_moved = devices.in_doubt.pop((visit.pose, visit.pass_), -1), False
    while True:
        sequence, tags.replaces_visit = tags.sequence, replaced
        try:
            yield from _read_all(devices, visit, phase, missing)
        except VisitBroken:
            yield from _wait_for_operator(devices)
        except DrivesMoved as error:
            if has_moved:
                raise
            has_moved = True
            devices.note(MEASURED_ANEW, {"visit": tags.visit_number, "reason": str(error)})
        else:
            return
        finally:
            tags.replaces_visit = -1
        if tags.sequence > sequence:  # a visit without readings is nothing to replace
            replaced = tags.visit_number


def _read_all(devices: CampaignDevices, visit: PlannedVisit, phase: str, smrs: Sequence[str]) -> Plan:
    yield from _set(devices, devices.machine, visit)
    for smr in smrs:
        yield from _read(devices, phase, smr)
    if isinstance(devices.machine, WatchedMachine):
        yield from _set(devices, devices.machine.leaving, visit)


def _read(devices: CampaignDevices, phase: str, smr: str) -> Plan:
    """One reading, kept before anything else happens. Raises DrivesMoved and VisitBroken, without a reading.

    In bluesky's messages, not its plan stubs: each call of a stub records a stack, some 10,000 times a campaign.
    """
    devices.tags.phase = phase
    _require(not devices.waiting.asked())
    yield Msg("checkpoint")
    yield Msg("set", devices.station, smr, group=_AIMED)
    yield Msg("wait", None, group=_AIMED)
    _require(not devices.waiting.broken())
    yield Msg("trigger", devices.station, group=_MEASURED)
    yield Msg("wait", None, group=_MEASURED)
    _require(not devices.waiting.broken())
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
    yield from _set(devices, devices.wait, 0.0)
    while True:
        history.append((devices.rig.clock.now_s(), devices.wait.temperatures_c))
        rate = _fastest_rate(history[-6:])
        if rate is not None:
            devices.rig.observer.checked("warm-up", rate, settings.warm_up_rate_k_per_h, "K/h")
        if rate is not None and rate <= settings.warm_up_rate_k_per_h:
            return
        if devices.rig.clock.now_s() - started >= settings.warm_up_max_s:
            raise CampaignRefused(
                f"warm-up: parts still change {rate or 0.0:.2f} K/h after {settings.warm_up_max_s / 60.0:.0f} min "
                f"(limit {settings.warm_up_rate_k_per_h:g} K/h); let the machine warm up longer"
            )
        devices.progress(0, "warm-up")
        for visit in between:
            yield from _set(devices, devices.machine, replace(visit, dwell_s=0.0))
        yield from _set(devices, devices.wait, settings.warm_up_step_s)


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
        yield from _set(devices, devices.machine, visit)
        points.append((yield from _read(devices, "repeatability", smr)))
    mean = np.mean(points, axis=0)
    across = across_line_of_sight(np.array(points) - mean, mean)
    rms = float(np.sqrt(np.sum(across**2) / (len(points) - 1)))
    devices.rig.observer.checked("repeatability", rms, settings.repeatability_limit_m, "m")
    if rms > settings.repeatability_limit_m:
        raise CampaignRefused(
            f"repeatability: {rms * 1e6:.0f} um RMS over {len(points)} visits "
            f"(limit {settings.repeatability_limit_m * 1e6:.0f} um); look for vibration, play or a loose reflector"
        )
