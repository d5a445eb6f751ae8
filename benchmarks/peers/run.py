"""Mocks and drivers against other people's programs. `make peers`; `make test` does not need it.

Fetches what the registries give into a folder (npm: canopen, modbus-serial; PyPI: pygeocom; Debian: mbpoll, libmodbus),
leaves out what is absent and says so. A LinuxCNC that is installed is run, as an ordinary user and without real time.
Exit status 1 if a check failed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.peers.linuxcnc_running import MOST_COMP_MM, MOST_M
from drivers.can.bus import open_bus
from drivers.can.can_line import CanLine
from drivers.can.drive_object import DriveObject
from drivers.can.sdo import SdoAccess
from drivers.drives.objects import PRODUCT, SERIAL, VENDOR
from drivers.errors import DeviceError
from drivers.plc.modbus_line import TcpLine
from drivers.plc.plc import Plc
from mock_devices.can.socketcand_server import SocketCandServer
from mock_devices.rig import MockPorts, MockRig
from mock_devices.settings import MockSettings
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import embedded_rig_path, load_rig, machine_path
from pkm_rig.virtual.embedded_bus import EmbeddedBus

HERE = Path(__file__).parent
DEBIAN = ("mbpoll", "libmodbus5", "libmodbus-dev")
PEER_NODE = 5
LINUXCNC_MODULES = Path("usr/lib/linuxcnc/modules")


@dataclass(frozen=True)
class Check:
    """One thing run_check against one peer; None: the peer is absent."""

    peer: str
    what: str
    ok: bool | None
    detail: str = ""


def main() -> int:
    """Fetch, try, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path(".peers"))
    folder: Path = parser.parse_args().folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    npm, debian, python = fetch_npm(folder), fetch_debian(folder), fetch_python(folder)
    linuxcnc = fetch_linuxcnc(folder)
    with mock_rig() as mock:
        tries: list[tuple[bool, str, str, Callable[[], list[Check]]]] = [
            (npm, "npm canopen", "as master", lambda: canopen_master(folder, mock)),
            (npm, "npm canopen", "as device", lambda: canopen_device(folder)),
            (python, "pygeocom", "as client", lambda: geocom_client(folder, mock)),
            (npm, "npm modbus-serial", "as client", lambda: modbus_client(folder, mock)),
            (debian, "mbpoll", "as client", lambda: mbpoll(folder, mock)),
            (npm, "npm modbus-serial", "as PLC", lambda: modbus_server(folder)),
            (debian, "libmodbus", "as PLC", lambda: libmodbus(folder)),
            (linuxcnc, "LinuxCNC's modules", "led by our geometry", lambda: linuxcnc_kinematics(folder)),
        ]
        checks = [
            check
            for is_available, peer, what, work in tries
            for check in (work() if is_available else [Check(peer, what, None, "could not be fetched")])
        ]
    checks += running_linuxcnc()
    for check in checks:
        verdict = {True: "ok", False: "FAILED", None: "absent"}[check.ok]
        print(f"{verdict:7} {check.peer:24} {check.what:44} {check.detail}".rstrip())
    return 1 if any(check.ok is False for check in checks) else 0


def fetch_npm(folder: Path) -> bool:
    """Install the packages of package.json into the folder; whether that worked."""
    for name in ("package.json", *(path.name for path in HERE.glob("*.cjs"))):
        shutil.copy(HERE / name, folder / name)
    if shutil.which("npm") is None or shutil.which("node") is None:
        return False
    command = ["npm", "install", "--no-fund", "--no-audit", "--ignore-scripts", "--omit=optional", "--silent"]
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True)
    if done.returncode != 0:
        return False
    built = list(folder.glob("node_modules/node-crc/build/Release/*.node"))
    if not built:  # canopen's own dependency, to be compiled here
        subprocess.run(["npm", "rebuild", "--silent", "node-crc"], cwd=folder, check=False, capture_output=True)
    return bool(list(folder.glob("node_modules/node-crc/build/Release/*.node")))


def fetch_python(folder: Path) -> bool:
    """Install pygeocom into the folder; whether that worked."""
    target = folder / "python"
    if not (target / "geocom").is_dir():
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*command, "--target", str(target), "pygeocom==0.2.0"], check=False, capture_output=True)
    return (target / "geocom").is_dir()


def fetch_debian(folder: Path) -> bool:
    """Unpack Debian's packages into the folder, installing nothing; whether that worked."""
    if shutil.which("apt-get") is None or shutil.which("dpkg") is None:
        return False
    packages = folder / "deb"
    packages.mkdir(exist_ok=True)
    if not list(packages.glob("mbpoll*.deb")):
        done = subprocess.run(["apt-get", "download", *DEBIAN], cwd=packages, check=False, capture_output=True)
        if done.returncode != 0:
            return False
    for package in packages.glob("*.deb"):
        subprocess.run(["dpkg", "-x", str(package), str(folder / "debian")], check=True)
    return (folder / "debian" / "usr" / "bin" / "mbpoll").is_file()


def fetch_linuxcnc(folder: Path) -> bool:
    """Unpack LinuxCNC's package into the folder, installing nothing, and compile what its modules ask for."""
    if any(shutil.which(program) is None for program in ("apt-get", "dpkg", "cc")):
        return False
    packages = folder / "linuxcnc"
    packages.mkdir(exist_ok=True)
    if not list(packages.glob("*.deb")):
        subprocess.run(["apt-get", "download", "linuxcnc-uspace"], cwd=packages, check=False, capture_output=True)
    for package in packages.glob("*.deb"):
        subprocess.run(["dpkg", "-x", str(package), str(packages)], check=True)
    shim = ["cc", "-shared", "-fPIC", "-O1", "-o", str(packages / "shim.so"), str(HERE / "hal_shim.c")]
    compiled = subprocess.run(shim, check=False, capture_output=True).returncode == 0
    return compiled and (packages / LINUXCNC_MODULES / "genhexkins.so").is_file()


def linuxcnc_kinematics(folder: Path) -> list[Check]:
    """genhexkins and lineardeltakins as LinuxCNC has compiled them, with our pins and joints."""
    packages = folder / "linuxcnc"
    command = [sys.executable, "-m", "benchmarks.peers.linuxcnc_kinematics"]
    places = [str(packages / LINUXCNC_MODULES), str(packages / "shim.so")]
    done = subprocess.run([*command, *places], check=False, capture_output=True, text=True)
    if done.returncode != 0:
        return [Check("LinuxCNC's modules", "led by our geometry", False, done.stderr.strip().splitlines()[-1])]
    found = json.loads(done.stdout)
    hexapod, delta = found["genhexkins"], found["lineardeltakins"]
    detail = f"tool within {hexapod['position_m'] * 1e9:.2f} nm, {hexapod['rotation_rad'] * 1e9:.2f} nrad"
    good = hexapod["position_m"] < 1e-9
    return [
        Check("LinuxCNC's genhexkins", "leads a rigid hexapod", good, detail),
        Check(
            "LinuxCNC's lineardeltakins",
            "has our drives",
            delta["drives_m"] < 1e-9,
            f"within {delta['drives_m'] * 1e9:.2f} nm",
        ),
    ]


def running_linuxcnc() -> list[Check]:
    """A running LinuxCNC with our files: its joints, its pins and where they put a rigid hexapod."""
    peer = "LinuxCNC, running"
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.peers.linuxcnc_running"], check=False, capture_output=True, text=True
    )
    if done.returncode != 0:
        return [Check(peer, "our files", False, done.stderr.strip().splitlines()[-1])]
    found = json.loads(done.stdout)
    if "absent" in found:
        return [Check(peer, "our files", None, found["absent"])]
    checks = [
        Check(peer, f".comp of type {kind} moves joints, both ways", mm <= MOST_COMP_MM, f"within {mm:.1e} mm")
        for kind, mm in found["comp"].items()
    ]
    for form in ("genhexkins", "lineardeltakins"):
        off = found[form]
        same = off["pins"] == 0.0 and off["drives_m"] <= MOST_M
        checks.append(Check(peer, f"{form} has our pins and drives", same, f"within {off['drives_m'] * 1e9:.2f} nm"))
    hexapod = found["genhexkins"]
    detail = f"tool within {hexapod['position_m'] * 1e9:.2f} nm, {hexapod['rotation_rad'] * 1e9:.2f} nrad"
    return [*checks, Check(peer, "genhexkins leads a rigid hexapod", hexapod["position_m"] <= MOST_M, detail)]


@contextmanager
def mock_rig() -> Iterator[MockRig]:
    """A mock rig at time scale 1 with a socketcand server."""
    file, _ = load_rig(embedded_rig_path())
    clock = ScaledClock(1.0)

    def bus() -> EmbeddedBus:
        return EmbeddedBus("peers", clock)

    path = machine_path(file, embedded_rig_path())
    try:
        with MockRig(path, MockSettings(), clock, bus, ports=MockPorts(socketcand_port=0)) as mock:
            yield mock
    finally:
        clock.close()


def canopen_master(folder: Path, mock: MockRig) -> list[Check]:
    """Their master, our mock drive."""
    host, port = mock.socketcand_address
    return json_lines(
        "npm canopen as master",
        ["node", "canopen_master.cjs", host, str(port), "1"],
        folder,
        {"make a fault": mock.drives[0].inject_fault},
    )


def canopen_device(folder: Path) -> list[Check]:
    """Their device, our driver: on a bus of their own."""
    peer, clock = "npm canopen as device", ScaledClock(1.0)
    checks: list[Check] = []
    with ExitStack() as stack:
        stack.callback(clock.close)
        server = SocketCandServer(lambda: EmbeddedBus("peer device", clock))
        stack.callback(server.close)
        host, port = server.address
        stack.enter_context(serve_until_ready(["node", "canopen_device.cjs", host, str(port), str(PEER_NODE)], folder))
        line = stack.enter_context(CanLine(open_bus("socketcand", "can0", host, port)))
        sdo = SdoAccess(line, PEER_NODE, "peer", 2.0)

        def identity() -> bool:
            return [sdo.read(entry) for entry in (VENDOR, PRODUCT, SERIAL)] == [0xABCD, 0x1234, 77]

        def number() -> bool:
            entry = DriveObject(0x2001, 0, "<I", "number")
            sdo.write(entry, 4711)
            return sdo.read(entry) == 4711

        def long_object() -> bool:
            entry, data = DriveObject(0x2000, 0, "", "text"), bytes(range(1, 201)) * 3
            sdo.write_bytes(entry, data)
            return sdo.read_bytes(entry) == data

        def refused() -> bool:
            try:
                sdo.read(DriveObject(0x5555, 0, "<I", "nothing"))
            except DeviceError as error:
                return "no such object" in str(error)
            return False

        def heartbeat() -> bool:
            with line.received:
                line.received.wait_for(lambda: PEER_NODE in line.seen_nodes, 2.0)
            return PEER_NODE in line.seen_nodes

        for what, work in {
            "identity 0x1018": identity,
            "expedited SDO written and read back": number,
            "block transfer of 600 bytes both ways": long_object,
            "an unknown object is refused": refused,
            "heartbeat seen": heartbeat,
        }.items():
            checks.append(run_check(peer, what, work))
    return checks


def geocom_client(folder: Path, mock: MockRig) -> list[Check]:
    """Another GeoCOM client, our mock station."""
    nest = next(s for s in mock.plant.sightings(mock.plant.clock.now_s()) if s.name == "N1").polar
    command = [sys.executable, str(HERE / "geocom_client.py"), mock.station_url, str(nest.hz_rad), str(nest.v_rad)]
    return json_lines("pygeocom", command, folder, {}, {"PYTHONPATH": str(folder / "python")})


def modbus_client(folder: Path, mock: MockRig) -> list[Check]:
    """Their client, our mock PLC."""
    host, port = mock.plc_address
    return json_lines("npm modbus-serial", ["node", "modbus_client.cjs", host, str(port)], folder, {})


def mbpoll(folder: Path, mock: MockRig) -> list[Check]:
    """mbpoll reads and writes the mock PLC."""
    host, port = mock.plc_address
    command = [str(folder / "debian/usr/bin/mbpoll"), "-m", "tcp", "-p", str(port), "-a", "1", "-0", "-1", "-q"]

    def run(options: str, values: str = "") -> str:
        result = subprocess.run(
            [*command, *options.split(), host, *values.split()],
            check=False,
            capture_output=True,
            text=True,
            timeout=10.0,
            env=environment_with_libraries(folder),
        )
        return result.stdout + result.stderr

    def registers() -> bool:
        return "[1]: \t15" in run("-t 4 -r 0 -c 4")

    def floats() -> bool:
        words = run("-t 4:float -B -r 14 -c 1").split()
        return any(900.0 < float(word) < 1100.0 for word in words if word.replace(".", "", 1).isdigit())

    def command_taken() -> bool:
        run("-t 4 -r 31", "41 1 0")
        return "[34]: \t41" in run("-t 4 -r 34 -c 2")

    def refused() -> bool:
        return "Illegal data address" in run("-t 4 -r 4", "1")

    return [
        run_check("mbpoll", "registers read", registers),
        run_check("mbpoll", "a float, high word first", floats),
        run_check("mbpoll", "a command is taken", command_taken),
        run_check("mbpoll", "a write to a value is refused", refused),
    ]


def modbus_server(folder: Path) -> list[Check]:
    """Their PLC, our driver."""
    port = free_port()
    with serve_until_ready(["node", "modbus_server.cjs", str(port)], folder):
        return plc_checks("npm modbus-serial as PLC", port, without_function_23=True)


def libmodbus(folder: Path) -> list[Check]:
    """A PLC on libmodbus, compiled here, our driver."""
    compiler = shutil.which("cc")
    if compiler is None:
        return [Check("libmodbus", "as PLC", None, "no C compiler")]
    root, program, port = folder / "debian" / "usr", folder / "modbus_server", free_port()
    libraries = next(root.glob("lib/*/libmodbus.so.5")).parent
    command = [
        compiler,
        "-o",
        str(program),
        str(HERE / "modbus_server.c"),
        f"-I{root}/include/modbus",
        f"-L{libraries}",
    ]
    done = subprocess.run([*command, "-l:libmodbus.so.5"], check=False, capture_output=True, text=True)
    if done.returncode != 0:
        return [Check("libmodbus", "as PLC", False, done.stderr.splitlines()[0])]
    with serve_until_ready([str(program), str(port)], folder):
        return plc_checks("libmodbus as PLC", port)


def plc_checks(peer: str, port: int, *, without_function_23: bool = False) -> list[Check]:
    """Our driver on somebody's PLC; not every one knows function 23."""
    clock = ScaledClock(1.0)
    plc = Plc(TcpLine("127.0.0.1", port), clock=clock)
    if without_function_23:
        plc.map = replace(plc.map, master_heartbeat=None)

    def values() -> bool:
        state = plc.connect()
        state.require_safe()
        return abs(state.pressure_hpa - 1002.5) < 0.01 and abs(state.temperatures_c["air"] - 20.5) < 0.01

    def payload() -> bool:
        return plc.request_payload(2, 5.0).payload == 2

    try:
        what = "values, interlocks, heartbeat" + (" (without function 23)" if without_function_23 else "")
        return [run_check(peer, what, values), run_check(peer, "a command by its sequence word", payload)]
    finally:
        plc.close()
        clock.close()


def run_check(peer: str, what: str, work: Callable[[], bool]) -> Check:
    """A check by a function of ours."""
    try:
        return Check(peer, what, work())
    except (DeviceError, RuntimeError, OSError, subprocess.TimeoutExpired) as error:
        return Check(peer, what, False, str(error))


def json_lines(
    peer: str,
    command: list[str],
    folder: Path,
    when: dict[str, Callable[[], None]],
    environment: dict[str, str] | None = None,
) -> list[Check]:
    """Checks that a program prints, a JSON object a line; `when` it prints one of these, something is done."""
    checks = []
    environment = {**os.environ, **(environment or {})}
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True, env=environment) as program:
        assert program.stdout is not None
        for line in program.stdout:
            with suppress(json.JSONDecodeError):
                document = json.loads(line)
                if document["check"] in when:
                    when[document["check"]]()
                else:
                    checks.append(Check(peer, document["check"], document["ok"], document["detail"]))
    return checks or [Check(peer, "start", False, "it said nothing")]


@contextmanager
def serve_until_ready(command: list[str], folder: Path) -> Iterator[None]:
    """A program that prints a line when it is ready, ended afterwards."""
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, text=True, env=environment_with_libraries(folder)
    ) as program:
        assert program.stdout is not None
        program.stdout.readline()
        try:
            yield
        finally:
            program.terminate()


def environment_with_libraries(folder: Path) -> dict[str, str]:
    """The environment in which programs find the unpacked libraries."""
    folders = [str(path.parent) for path in (folder / "debian" / "usr").glob("lib/*/libmodbus.so.5")]
    return {**os.environ, "LD_LIBRARY_PATH": ":".join(folders)}


def free_port() -> int:
    """A port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    raise SystemExit(main())
