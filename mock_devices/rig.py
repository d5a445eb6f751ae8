"""The whole mock rig: one plant, one clock, and the servers of drives, PLC and station."""

from __future__ import annotations

import logging
import ssl
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import can

from mock_devices.can.socketcand_server import SocketCandServer
from mock_devices.can.sync_moments import SyncMoments
from mock_devices.clock import RigClock
from mock_devices.drives.drive_axis import DriveAxis
from mock_devices.drives.lasting_drive import drive_state, restore_drive
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from mock_devices.drives.table_bank import machine_id_of
from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.lasting_state import StateFile
from mock_devices.nc.correction import Correction
from mock_devices.nc.player import ProgramPlayer
from mock_devices.nc.program import Program
from mock_devices.plant.any_plant import make_plant
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plc.plc_server import PlcServer
from mock_devices.settings import MockSettings
from mock_devices.station.mock_station import MockStation
from mock_devices.station.station_server import PtyStationServer, StationServer, TcpStationServer

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MockPorts:
    """How the servers of a mock rig are reached. A port of 0 takes a free one.

    The station is on a pseudo terminal or on TCP at `station_port`, the PLC on Modbus `plc` at `plc_port`, with
    `plc_tls` as the context of TLS. Without `socketcand_port` there is no socketcand server.
    """

    host: str = "127.0.0.1"
    station: Literal["pty", "tcp"] = "pty"
    station_port: int = 0
    plc: Literal["tcp", "tls", "rtu"] = "tcp"
    plc_port: int = 0
    plc_tls: ssl.SSLContext | None = None
    socketcand_port: int | None = None


class MockRig:
    """Starts everything on construction; `close`, or leaving the context, stops it.

    `bus_factory` gives each drive (and each socketcand client) a bus on the one CAN line; the rig shuts them down.
    Node ids default to 1, 2, ... in the order of the machine file. `master_limit_s` is how long the PLC waits for the
    master's heartbeat. `client_bus_factory` gives socketcand clients another kind of bus. The nodes in
    `without_blocks` have no SDO block transfer. `plant` is another one to serve, on the same clock. `faults`
    strike in all servers; those of the host's bus (can-...) belong to the code that makes that bus (`FaultyBus`).
    `effects`: those of the settings as they were written, to which more may be added while it runs.
    It begins with what `state_file` holds, as hardware does after a power failure, and keeps its own state there.
    """

    def __init__(
        self,
        machine_path: str | Path,
        settings: MockSettings,
        clock: RigClock,
        bus_factory: Callable[[], can.BusABC],
        *,
        ports: MockPorts | None = None,
        master_limit_s: float = 2.0,
        node_ids: tuple[int, ...] | None = None,
        without_blocks: tuple[int, ...] = (),
        client_bus_factory: Callable[[], can.BusABC] | None = None,
        faults: FaultPlan = NO_FAULTS,
        plant: BasePlant | None = None,
        state_file: StateFile | None = None,
        effects: tuple[str, ...] = (),
    ) -> None:
        ports = ports or MockPorts()
        self._state_file = state_file
        self.faults = faults
        self.effects = effects
        self._without_blocks = without_blocks
        self.strained: str | None = None  # what the machine did not bear, last
        self.player: ProgramPlayer | None = None  # of a control that leads the machine by itself
        self._machine_path = machine_path
        self.drives: tuple[DriveServer, ...] = ()
        self.plant = plant or make_plant(machine_path, settings, clock)
        nodes = node_ids or tuple(range(1, len(self.plant.parts) + 1))
        if len(nodes) != len(self.plant.parts):
            raise ValueError(f"{len(self.plant.parts)} drives, {len(nodes)} node ids")
        self._sync_moments = SyncMoments(clock)
        self._started = ExitStack()
        try:
            drives = []
            for index, node_id in enumerate(nodes):
                partner = nodes[1 - index] if len(nodes) == 2 else None
                drive = self._drive(index, node_id, partner, bus_factory(), clock)
                self._started.callback(drive.close)
                drives.append(drive)
            self.plant.attach(tuple(drives))
            self.drives = tuple(drives)
            self.plc = PlcServer(
                self.plant,
                ports.host,
                ports.plc_port,
                transport=ports.plc,
                tls=ports.plc_tls,
                faults=faults,
                master_limit_s=master_limit_s,
            )
            self._started.callback(self.plc.close)
            self._station = responder = MockStation(self.plant, faults)
            self._restore()
            self.station_server: StationServer = (
                PtyStationServer(responder, faults)
                if ports.station == "pty"
                else TcpStationServer(responder, ports.host, ports.station_port, faults=faults)
            )
            self._started.callback(self.station_server.close)
            self.socketcand: SocketCandServer | None = None
            if ports.socketcand_port is not None:
                self.socketcand = SocketCandServer(client_bus_factory or bus_factory, ports.host, ports.socketcand_port)
                self._started.callback(self.socketcand.close)
            self.keep_state()
        except BaseException:
            self.close()
            raise

    @property
    def station_url(self) -> str:
        """Path of the pty, or `socket://host:port`."""
        return self.station_server.url

    @property
    def plc_address(self) -> tuple[str, int]:
        """Host and port of the PLC."""
        return self.plc.address

    @property
    def socketcand_address(self) -> tuple[str, int]:
        """Host and port of the socketcand server. Raises ValueError without one."""
        if self.socketcand is None:
            raise ValueError("this mock rig serves no socketcand")
        return self.socketcand.address

    def load_program(
        self, program: Program, corrections: Mapping[int, Correction] | None = None, operator_s: float | None = None
    ) -> ProgramPlayer:
        """Have a control lead the machine by a program (`ProgramPlayer`). Raises ValueError for one that cannot be."""
        self.player = ProgramPlayer(
            self._machine_path,
            self.plant,
            self.drives,
            self.plant.clock,
            program,
            corrections=corrections,
            operator_s=operator_s,
        )
        return self.player

    def close(self) -> None:
        """Stop all servers, the last one first. May be called again."""
        self._started.close()

    def silence(self, device: Literal["plc", "can", "station"] | None) -> None:
        """Have one device fall silent, or none (any more)."""
        self.plc.silent = device == "plc"
        self.station_server.silent = device == "station"
        if self.socketcand is not None:
            self.socketcand.silent = device == "can"

    def keep_state(self) -> None:
        """Write what outlives the mock into its state file, if it has one."""
        if self._state_file is None:
            return
        for drive in self.drives:
            drive.with_axis(partial(self._keep_drive, drive.node_id))
        self._state_file.keep(plant=self.plant.state(), station=self._station.state())
        self._write_state(self._state_file)

    def _restore(self) -> None:
        if self._state_file is None:
            return
        state = self._state_file.state
        for drive in self.drives:
            if drive.node_id in state.drives:
                drive.with_axis(partial(restore_drive, state=state.drives[drive.node_id]))
                drive.identify()
        if state.plant is not None:
            self.plant.restore(state.plant)
        if state.station is not None:
            self._station.restore(state.station)
        self.plant.changed = self._plant_changed

    def _write_state(self, file: StateFile) -> None:
        try:
            file.write()
        except OSError as error:  # the rig goes on: only what would outlive it is old
            _log.warning("the mock's state is not kept: %s: %s", file.path, error.strerror)

    def _keep_drive(self, node_id: int, axis: DriveAxis) -> None:
        if self._state_file is not None:
            self._state_file.keep_drive(node_id, drive_state(axis, self.plant.clock.now_s()))

    def _drive_changed(self, node_id: int, axis: DriveAxis) -> None:
        if self._state_file is not None:
            self._keep_drive(node_id, axis)
            self._write_state(self._state_file)

    def _plant_changed(self) -> None:
        if self._state_file is not None:
            self._state_file.keep(plant=self.plant.state())
            self._write_state(self._state_file)

    def _watch_machine(self, t_s: float) -> None:
        """At a SYNC: where a strut bears more than it may all drives fault, as by a strain gauge's contact."""
        why = self.plant.overloaded(t_s) if self.drives else None
        if why is not None:
            self.strained = why
            for drive in self.drives:
                drive.strain()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _drive(self, index: int, node_id: int, partner: int | None, bus: can.BusABC, clock: RigClock) -> DriveServer:
        part = self.plant.parts[index]
        return DriveServer(
            node_id,
            MockAxis(
                name=part.name,
                partner_node_id=partner,
                machine_id=machine_id_of(self.plant.machine.name),
                travel_m=part.travel,
                start_m=part.home,
                is_first=index == 0,
                absolute_encoder=self.plant.settings.absolute_encoders,
                block_transfer=node_id not in self._without_blocks,
            ),
            bus,
            clock,
            changed=partial(self._drive_changed, node_id),
            load_kg=partial(self.plant.load_kg, index),
            watch=self._watch_machine if index == 0 and self.plant.can_be_strained else lambda _t_s: None,
            sync_moments=self._sync_moments,
            faults=self.faults,
        )
