"""One way to connect a rig, mock or real: every device, supervised while in use, left safe in the end."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import can

from calibration.machine.description import Machine
from drivers.can.bus import open_bus
from drivers.can.can_line import CanLine
from drivers.drives.drive_group import DriveGroup, GroupTiming
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from drivers.drives.table_bank import TableBank
from drivers.errors import DeviceError
from drivers.plc.plc import Plc, PlcTiming
from drivers.station.geocom import StationLine
from drivers.station.laser_tracker import EDMModeV2, LaserTracker, Prism
from drivers.station.station_setup import StationSettings
from pkm_rig.rig.clock import RigClock, ScaledClock
from pkm_rig.rig.config import TABLE_DRIVES, RigFile, drive_profile
from pkm_rig.rig.plc_connection import plc_line, register_map
from pkm_rig.rig.rig import PLC_POLL_S, Rig
from pkm_rig.rig.supervision import BEAT_PERIOD_S
from pkm_rig.rig.unread_drives import UnreadDrives

POLL_PERIOD_S = 0.05
LEAST_HOST_POLL_S = 0.002
SWITCH_S = 0.0005
GUARD_S = 1.0  # host time in which an answer has to come
EMBEDDED_GUARD_S = 20.0  # in one process a busy computer is no fault of the rig


@contextmanager
def connect_rig(
    file: RigFile,
    machine: Machine,
    clock: RigClock,
    bus_factory: Callable[[], can.BusABC] | None = None,
    *,
    rig_path: Path = Path("rig.toml"),
    guard_s: float | None = None,
    homing: bool = False,
) -> Iterator[Rig]:
    """Connect all devices, supervise them while in use, leave them stopped and without power.

    `bus_factory` replaces the bus of the rig file (embedded rig, tests); profiles of drives are looked for beside
    `rig_path`; `guard_s` is the host time in which every answer has to come (default: by the kind of rig).
    For `homing` drives may have lost their reference; they are then refused any other motion.
    """
    given_guard_s, guard_s = guard_s, _guard_s(file, guard_s)
    slow = file.time_scale or 1.0
    with ExitStack() as stack:
        plc = _connect_plc(stack, file, clock, rig_path, given_guard_s)
        bus = bus_factory() if bus_factory else open_bus(
            file.can.interface, file.can.channel, file.can.host, file.can.port, file.can.bitrate
        )  # fmt: skip
        line = CanLine(bus)
        stack.callback(line.close)
        line.watch_for_other_masters([drive.node_id for drive in file.drives], file.can.master_node_id)
        drives = _servo_drives(file, machine, line, clock, rig_path=rig_path, guard_s=guard_s)
        for drive in drives:
            stack.callback(drive.close)
            drive.connect(unreferenced=homing)
        group = DriveGroup(
            drives,
            clock,
            only_led=machine.redundantly_actuated,
            timing=GroupTiming(poll_period_s=max(POLL_PERIOD_S, LEAST_HOST_POLL_S * slow), pdo_timeout_s=guard_s),
        )
        banks = [TableBank(drive) for drive in drives if drive.profile.compensation is not None]
        tracker = _connect_station(stack, file, clock, given_guard_s)
        yield _supervised(stack, file, machine, clock, station=tracker, drives=group, banks=banks, plc=plc)


@contextmanager
def connect_watched_rig(
    file: RigFile, machine: Machine, clock: RigClock, *, rig_path: Path = Path("rig.toml"), guard_s: float | None = None
) -> Iterator[Rig]:
    """Connect station and PLC of a machine that its own control moves: the CAN line is not opened, no drive is read."""
    with ExitStack() as stack:
        plc = _connect_plc(stack, file, clock, rig_path, guard_s)
        tracker = _connect_station(stack, file, clock, guard_s)
        drives = UnreadDrives(clock)
        yield _supervised(stack, file, machine, clock, station=tracker, drives=drives, banks=[], plc=plc)


def _is_real(file: RigFile, given_guard_s: float | None) -> bool:
    """Whether the answers of real devices, or of a mock in another process, are waited for."""
    return given_guard_s is None and file.can.interface != "embedded"


def _guard_s(file: RigFile, given_guard_s: float | None) -> float:
    if given_guard_s is not None:
        return given_guard_s
    return EMBEDDED_GUARD_S if file.can.interface == "embedded" else GUARD_S


def _connect_plc(stack: ExitStack, file: RigFile, clock: RigClock, rig_path: Path, given_guard_s: float | None) -> Plc:
    slow, guard_s = file.time_scale or 1.0, _guard_s(file, given_guard_s)
    plc = Plc(
        plc_line(file.plc, rig_path),
        file.plc.unit,
        register_map(file.plc),
        clock,
        timing=PlcTiming(
            heartbeat_limit_s=file.limits.plc_heartbeat_s * slow,
            poll_period_s=PLC_POLL_S,
            reply_timeout_s=min(guard_s, file.plc.reply_timeout_s) if _is_real(file, given_guard_s) else guard_s,
            beat_period_s=BEAT_PERIOD_S * slow,
        ),
    )
    stack.callback(plc.close)
    plc.connect()
    return plc


def _connect_station(stack: ExitStack, file: RigFile, clock: RigClock, given_guard_s: float | None) -> LaserTracker:
    station = file.station
    if given_guard_s is not None:
        station = station.model_copy(update={"reply_timeout_s": given_guard_s, "motion_timeout_s": given_guard_s})
    tracker = LaserTracker(
        station.port,
        clock,
        name=station.name,
        settings=StationSettings(
            edm_mode=EDMModeV2[station.edm_mode.upper()],
            prism_type=Prism[station.prism_type.upper()],
            prism_constant_m=station.prism_constant_m,
        ),
        line=StationLine(
            baudrate=station.baudrate,
            reply_timeout_s=station.reply_timeout_s,
            motion_timeout_s=station.motion_timeout_s,
        ),
    )
    stack.callback(tracker.close)
    tracker.connect()
    return tracker


def _supervised(
    stack: ExitStack,
    file: RigFile,
    machine: Machine,
    clock: RigClock,
    *,
    station: LaserTracker,
    drives: DriveGroup,
    banks: Sequence[TableBank],
    plc: Plc,
) -> Rig:
    real_time = isinstance(clock, ScaledClock) and clock.time_scale == 1.0
    period_s = file.limits.poll_period_s if real_time else None
    if real_time:  # a thread that computes must not keep supervision from its turn for the usual 5 ms
        sys.setswitchinterval(SWITCH_S)
    rig = Rig(file, machine, clock, station=station, drives=drives, banks=banks, plc=plc, poll_period_s=period_s)
    stack.callback(_shut_down_safely, rig)
    rig.supervisor.start()
    return rig


def _shut_down_safely(rig: Rig) -> None:
    rig.supervisor.stop()
    with contextlib.suppress(DeviceError):
        rig.stop("the rig is being left")
    with contextlib.suppress(DeviceError):
        rig.drives.disable()
    for drive in rig.drives.drives:
        with contextlib.suppress(DeviceError):
            drive.require_heartbeat()  # a silent one would cost several time-outs
            drive.stop_master_watchdog()


def _servo_drives(
    file: RigFile, machine: Machine, line: CanLine, clock: RigClock, *, rig_path: Path, guard_s: float
) -> list[ServoDrive]:
    """The drives of the rig file on a line, not connected yet; time limits are those of its time scale."""
    slow = file.time_scale or 1.0
    timeouts = DriveTimeouts(
        sdo_s=guard_s,
        state_s=3.0 * slow,
        heartbeat_ms=min(60_000, round(1000 * slow)),
        heartbeat_late_s=file.limits.heartbeat_s * slow,
        heartbeat_lost_s=2.0 * file.limits.heartbeat_s * slow,
        master_lost_ms=min(60_000, round(1000 * file.limits.drive_watchdog_s * slow)),
    )
    nodes = [drive.node_id for drive in file.drives]
    partners = (nodes[1], nodes[0]) if len(nodes) == TABLE_DRIVES else (None,) * len(nodes)
    return [
        ServoDrive(
            line,
            entry.node_id,
            entry.name,
            clock,
            DriveExpectation(
                vendor=entry.vendor_id,
                product=entry.product_code,
                metres_per_increment=entry.per_increment,
                travel_m=(float(low_m), float(high_m)),
            ),
            profile=drive_profile(entry, rig_path),
            partner_node_id=partner,
            master_node_id=file.can.master_node_id,
            timeouts=timeouts,
        )
        for entry, partner, (low_m, high_m) in zip(file.drives, partners, machine.travel, strict=True)
    ]
