"""A served mock rig with addresses and methods, for hardware-in-the-loop tests (docs/how-to/test-a-controller.md)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from mock_devices.rig import MockRig
from pkm_rig.rig.config import SHIPPED_RIGS, load_rig, mock_rig_path
from pkm_rig.virtual.mock_rig import TwinFiles, with_mock_options
from pkm_rig.virtual.new_rig import with_values
from pkm_rig.virtual.ownership import HOST, free_ports
from pkm_rig.virtual.served_rig import serve_mock_rig, tell

Address = tuple[str, int]


@dataclass(frozen=True)
class HilRig:
    """A running mock rig.

    station: host and port, GeoCOM in ASCII; drives: host and port of socketcand, `channel` and `node_ids` (name to node
    id) on it, CANopen CiA 402; plc: host and port, Modbus TCP, `unit`; rig_file: for the commands of pkm-rig.
    """

    station: Address
    drives: Address
    channel: str
    node_ids: dict[str, int]
    plc: Address
    unit: int
    rig_file: Path
    time_scale: float
    mock: MockRig

    def tell(self, line: str) -> str:
        """Carry out a line of docs/reference/mock.md. InputError in one line if it cannot be."""
        return tell(self.mock, line)

    def fault(self, fault: str) -> None:
        """Arm a fault, NAME@N, its operations counted from now on; `pkm-rig mock --list-faults` names them."""
        self.tell(f"fault {fault}")

    def clear_faults(self) -> None:
        """Have no fault strike any more."""
        self.tell("fault none")

    def effect(self, effect: str) -> None:
        """Have one more effect act from now on, as in `backlash=2e-5,place=left`."""
        self.tell(f"effect {effect}")

    def clear_effects(self) -> None:
        """Have no effect act any more."""
        self.tell("effect none")

    def payload(self, number: int) -> None:
        """Put a payload of the rig file on, at once."""
        self.tell(f"payload {number}")

    def warm(self, part: str, by_k: float) -> None:
        """Make struts, columns, base, platform or air warmer, at once."""
        self.tell(f"temperature {part} {by_k!r}")

    def interlock(self, name: Literal["guard", "stop", "power", "air"], *, good: bool) -> None:
        """Open or close an interlock of the PLC."""
        self.tell(f"interlock {name} {'good' if good else 'open'}")

    def move_station(self, dx_m: float, dy_m: float, dz_m: float, turn_rad: float = 0.0) -> None:
        """Knock the station, in the machine's frame."""
        self.tell(f"station move {dx_m!r} {dy_m!r} {dz_m!r} {turn_rad!r}")

    def restart_drive(self, name: str) -> None:
        """Switch a drive off and on."""
        self.tell(f"drive restart {name}")

    def replace_drive(self, name: str, more_m: float = 0.0) -> None:
        """Put another drive of the same make in its place: another serial number, empty banks, another count."""
        self.tell(f"drive replace {name} {more_m!r}")

    def recount_drive(self, name: str, more_m: float) -> None:
        """Have a drive count so much more, as after a reference that was taken elsewhere."""
        self.tell(f"drive recount {name} {more_m!r}")

    def knock_column(self, name: str, lean_rad: float, shift_m: float = 0.0) -> None:
        """Have a slider's column lean and stand elsewhere (planar machines)."""
        self.tell(f"column knock {name} {lean_rad!r} {shift_m!r}")

    def silence(self, device: Literal["plc", "can", "station"] | None) -> None:
        """Have one device fall silent, or none any more."""
        self.tell(f"silent {device or 'none'}")

    def status(self) -> dict[str, Any]:
        """Rig time, payload, effects, faults and the state of each drive."""
        found: dict[str, Any] = json.loads(self.tell("status"))
        return found


@contextmanager
def start_rig(
    folder: Path,
    machine: str = "planar4",
    effects: Sequence[str] = (),
    faults: Sequence[str] = (),
    seed: int = 1,
    *,
    time_scale: float = 1.0,
    rig: Path | None = None,
    twin: Path | None = None,
) -> Iterator[HilRig]:
    """Serve a mock rig on free ports of loopback for as long as the context lasts; its rig file is in `folder`.

    machine: a shipped one that has a mock rig, or another `rig` file; time_scale: rig seconds in a second of the
    computer; twin: folder of a twin that it has in place of a machine of its own. InputError for what cannot be.
    """
    source = rig or _shipped(machine)
    station, bus, plc = free_ports(3)
    values = {
        ("", "time_scale"): repr(float(time_scale)),
        ("station", "port"): json.dumps(f"socket://{HOST}:{station}"),
        ("can", "interface"): '"socketcand"',
        ("can", "host"): json.dumps(HOST),
        ("can", "port"): str(bus),
        ("plc", "transport"): '"tcp"',
        ("plc", "host"): json.dumps(HOST),
        ("plc", "port"): str(plc),
    }
    path = (folder if rig is None else rig.parent) / f"mock-{station}.toml"
    text = read_text(source)
    if "time_scale" not in text:
        text = f"time_scale = 1.0\n{text}"
    path.write_text(with_values(text, values), encoding="utf-8")
    try:
        file = with_mock_options(load_rig(path)[0], seed, effects)
        with serve_mock_rig(file, path, faults, None if twin is None else TwinFiles(twin)) as mock:
            yield HilRig(
                station=(HOST, station),
                drives=(HOST, bus),
                channel=file.can.channel,
                node_ids={drive.name: drive.node_id for drive in file.drives},
                plc=(HOST, plc),
                unit=file.plc.unit,
                rig_file=path,
                time_scale=time_scale,
                mock=mock,
            )
    finally:
        path.unlink(missing_ok=True)


def _shipped(machine: str) -> Path:
    if machine == "planar4":
        return mock_rig_path()
    path = SHIPPED_RIGS / f"demo-{machine}.toml"
    if not path.is_file():
        names = sorted(p.stem.removeprefix("demo-") for p in SHIPPED_RIGS.glob("demo-*.toml"))
        raise InputError(f"mock_rig: no mock rig of machine '{machine}'; there are planar4, {', '.join(names)}")
    return path
