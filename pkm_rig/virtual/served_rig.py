"""Serves a mock rig to other processes: on the rig file's ports, from and into a state file, told by lines of text."""

from __future__ import annotations

import itertools
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

import can

from calibration.base.errors import InputError
from mock_devices.can.faulty_bus import FaultyBus
from mock_devices.commands import execute
from mock_devices.control_port import ControlPort
from mock_devices.lasting_state import LastingStateError, RigState, StateFile, read_state
from mock_devices.nc.correction import Correction, read_correction
from mock_devices.nc.program import read_program
from mock_devices.rig import MockPorts, MockRig
from mock_devices.stepped_clock import SteppedClock
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import MockSection, RigFile, machine_path
from pkm_rig.rig.plc_connection import plc_line
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from pkm_rig.virtual.mock_rig import TwinFiles, fault_plan, settings_of, twin_plant
from pkm_rig.virtual.ownership import owned, require_free_port

MOST_OPERATOR_S = 3600.0
KEEP_S = 0.25  # host time between two writes of the state file, beside those at once for what must not be lost
_channels = itertools.count()
T = TypeVar("T")


@contextmanager
def serve_mock_rig(
    file: RigFile,
    rig_path: Path,
    faults: Sequence[str] = (),
    twin: TwinFiles | None = None,
    state_path: Path | None = None,
) -> Iterator[MockRig]:
    """Serve a mock rig to other processes, on the ports of the rig file, in scaled time; `twin`: one to serve.

    `faults` are NAME@N; on this side a step of time is one of the devices' clock. With `state_path` the rig begins as
    the state in this file says, if it exists, and keeps its own there. InputError if anything cannot be had.
    """
    port = file.station.port
    if not port:
        raise InputError(
            "rig file: station.port is empty; give a path for the mock's terminal or socket://127.0.0.1:PORT"
        )
    plan = fault_plan(faults)
    over_tcp, over_rtu = port.startswith("socket://"), file.plc.transport == "rtu"
    station_port = int(port.rsplit(":", 1)[1]) if over_tcp else 0
    with ExitStack() as stack:
        require_free_port("can.port", file.can.port)
        if not over_rtu:
            require_free_port("plc.port", file.plc.port)
        if over_tcp:
            require_free_port("station.port", station_port)
        state = _former_state(stack, file, state_path)
        scaled = ScaledClock(file.time_scale or 1.0, state.time_now_s(time.time(), file.time_scale or 1.0))
        stack.callback(scaled.close)
        clock = SteppedClock(scaled, plan)
        channel = f"served-{next(_channels)}"

        def bus() -> can.BusABC:
            return EmbeddedBus(channel, scaled)

        mock = MockRig(
            machine_path(file, rig_path),
            settings_of(file, rig_path),
            clock,
            bus,
            master_limit_s=file.limits.plc_heartbeat_s * scaled.time_scale,
            node_ids=tuple(drive.node_id for drive in file.drives),
            client_bus_factory=lambda: FaultyBus(bus(), plan),
            faults=plan,
            plant=None if twin is None else twin_plant(file, rig_path, twin, clock),
            ports=MockPorts(
                station="tcp" if over_tcp else "pty",
                station_port=station_port,
                plc_port=file.plc.port,
                plc=file.plc.transport,
                plc_tls=_server_certificate(file, rig_path),
                socketcand_port=file.can.port,
            ),
            state_file=None if state_path is None else StateFile(state_path, state, clock, time.time),
            effects=(file.mock or MockSection()).effects,
        )
        stack.enter_context(mock)
        if state_path is not None:
            stack.callback(_keep_state_from_time_to_time(mock))
        if not over_tcp:
            stack.enter_context(_link_terminal("station", Path(port), Path(mock.station_url)))
        if over_rtu and file.plc.serial_port:
            stack.enter_context(_link_terminal("PLC", Path(file.plc.serial_port), Path(mock.plc.serial_port)))
        yield mock


def tell(mock: MockRig, line: str) -> str:
    """Have a running mock rig carry out a line (docs/reference/mock.md); InputError in one line if it cannot."""
    try:
        return execute(mock, line)
    except ValueError as error:
        raise InputError(str(error)) from None


def load_program(mock: MockRig, program: Path, corrections: Sequence[str], operator_s: float | None) -> None:
    """Have the mock's own control lead its machine by a program, with corrections PAYLOAD=FOLDER; InputError."""
    if operator_s is not None and not 0.0 <= operator_s <= MOST_OPERATOR_S:
        raise InputError(f"--operator {operator_s:g}: give a time up to {MOST_OPERATOR_S:g} s")
    names = [part.name for part in mock.plant.parts]
    loaded: dict[int, Correction] = {}
    for text in corrections:
        number, _, folder = text.partition("=")
        if not (number.isascii() and number.isdigit() and folder):
            raise InputError(f"--correction {text}: give the payload's number and a folder, as 0=FOLDER")
        loaded[int(number[:9])] = _read_or_refuse("--correction", partial(read_correction, folder, names))
    read = _read_or_refuse("--program", lambda: read_program(program))
    _read_or_refuse(f"--program {program}:", lambda: mock.load_program(read, loaded, operator_s))


def _read_or_refuse(option: str, read: Callable[[], T]) -> T:
    try:
        return read()
    except OSError as error:
        raise InputError(f"{option} {error.filename}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{option} {error}") from error


def _former_state(stack: ExitStack, file: RigFile, path: Path | None) -> RigState:
    mock = file.mock or MockSection()
    new = RigState(machine=file.machine, seed=mock.seed)
    if path is None:
        return new
    stack.enter_context(owned(path, "--state"))
    try:
        state = read_state(path) or new
    except LastingStateError as error:
        raise InputError(f"--state {error}") from error
    except OSError as error:
        raise InputError(f"--state {path}: {error.strerror}; name another file") from error
    if (state.machine, state.seed) != (new.machine, new.seed):
        raise InputError(
            f"--state {path}: of machine {state.machine}, seed {state.seed}, not {new.machine}, seed {new.seed}; "
            "name another file"
        )
    if state.plant is not None and state.plant.payload >= len(file.payloads):
        raise InputError(f"--state {path}: has payload {state.plant.payload}, which the rig file does not list")
    return state


def _keep_state_from_time_to_time(mock: MockRig) -> Callable[[], None]:
    """Positions and time go into the state file all the while; returns what ends that, with a last write."""
    ended = threading.Event()

    def keep() -> None:
        while not ended.wait(KEEP_S):
            mock.keep_state()

    thread = threading.Thread(target=keep, name="mock-state", daemon=True)
    thread.start()

    def end() -> None:
        ended.set()
        thread.join(timeout=5.0)
        mock.keep_state()

    return end


def _server_certificate(file: RigFile, rig_path: Path) -> ssl.SSLContext | None:
    if file.plc.transport != "tls":
        return None
    mock = file.mock or MockSection()
    if mock.plc_certificate_file is None or mock.plc_key_file is None:
        raise InputError("rig file: a mock PLC with TLS needs plc_certificate_file and plc_key_file in [mock]")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(rig_path.parent / mock.plc_certificate_file, rig_path.parent / mock.plc_key_file)
    except OSError as error:
        raise InputError(f"rig file: [mock] certificate: {error}") from error
    return context


@contextmanager
def _link_terminal(device: str, link: Path, terminal: Path) -> Iterator[None]:
    """Make the mock's pseudo-terminal reachable under the rig file's name; only a link is ever replaced."""
    with owned(link, f"{device} port"):
        if link.is_symlink():
            link.unlink()
        if link.exists() or not link.parent.is_dir():
            raise InputError(f"{device} port {link}: cannot be made a link to the mock's terminal; name another path")
        link.symlink_to(terminal)
        try:
            yield
        finally:
            link.unlink(missing_ok=True)


@contextmanager
def control_port(mock: MockRig, port: int, token: str) -> Iterator[ControlPort]:
    """Let programs of this computer change a running mock rig (docs/reference/mock.md); InputError if it is taken."""
    try:
        served = ControlPort(port, token, lambda line: execute(mock, line))
    except (OSError, ValueError) as error:
        raise InputError(f"--control {port}: {error}; choose another one") from error
    try:
        yield served
    finally:
        served.close()


def what_it_is(file: RigFile, mock: MockRig, twin: TwinFiles | None = None) -> list[str]:
    """Which machine is served, and what is wrong with it."""
    section = file.mock or MockSection()
    return [
        f"machine: {mock.plant.machine.name}, seed {section.seed}"
        + ("" if section.error_scale == 1.0 else f", errors {section.error_scale:g} times as large"),
        f"effects: {'; '.join(mock.effects) or 'none'}",
        f"faults:  {', '.join(mock.faults.armed) or 'none'}",
        f"twin:    {'none' if twin is None else twin.folder}",
    ]


def how_to_connect(file: RigFile, rig_path: Path, mock: MockRig) -> list[str]:
    """What to put into a rig file, or on a command line, to reach each device."""
    plc = plc_line(file.plc, Path()) if file.plc.transport == "rtu" else f"{mock.plc_address[0]}:{mock.plc_address[1]}"
    kind = file.plc.transport.upper()
    bus_host, bus_port = mock.socketcand_address
    return [
        f"station: GeoCOM on {file.station.port or mock.station_url}",
        f"drives:  CANopen nodes {', '.join(str(d.node_id) for d in file.drives)} "
        f"on socketcand {bus_host}:{bus_port}, channel {file.can.channel}",
        f"PLC:     Modbus {kind} {plc}, unit {file.plc.unit}",
        f"time:    {file.time_scale or 1.0:g} rig seconds a second",
        f"connect: --rig {rig_path}",
    ]
