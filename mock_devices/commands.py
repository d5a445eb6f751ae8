"""What an operator may do to a running mock rig, one line each (docs/reference/mock.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Literal, cast, get_args

from mock_devices.drives.mock_drive import DriveServer
from mock_devices.faults import parse_fault
from mock_devices.lasting_state import Knock
from mock_devices.rig import MockRig

Device = Literal["plc", "can", "station"]

USAGE = {
    "station move": "station move DX DY DZ [TURN]",
    "drive restart": "drive restart NAME",
    "drive replace": "drive replace NAME [METRES]",
    "drive recount": "drive recount NAME METRES",
    "column knock": "column knock NAME LEAN [SHIFT]",
    "silent": "silent plc|can|station|none",
    "fault": "fault NAME@N|none",
    "effect": "effect NAME=VALUE[,place=...,variant=...]|none",
    "payload": "payload NUMBER",
    "temperature": "temperature struts|columns|base|platform|air KELVIN",
    "interlock": "interlock guard|stop|power|air open|good",
    "release": "release on|off",
    "acknowledge": "acknowledge",
    "automatic": "automatic on|off",
    "program": "program start [NUMBER]|stop",
    "status": "status",
}
_FARTHEST_M = 100.0
_MOST_K = 100.0
_MOST_OFF = 0.1
INTERLOCKS = {"guard": 0, "stop": 1, "power": 2, "air": 3}


def execute(mock: MockRig, line: str) -> str:
    """Carry out one line; returns what to answer. Raises ValueError in one line for one that cannot be."""
    words = line.split()
    for name, action in _ACTIONS.items():
        if words[: len(name.split())] == name.split():
            return action(mock, words[len(name.split()) :])
    raise ValueError(f"unknown: {line.strip()[:60]!r}; there is {'; '.join(USAGE.values())}")


def _move_station(mock: MockRig, words: list[str]) -> str:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 4) or not all(math.isfinite(n) and abs(n) <= _FARTHEST_M for n in numbers):
        raise ValueError(f"metres in the machine's frame, and radians clockwise from above: {USAGE['station move']}")
    x, y, z, turn = [*numbers, 0.0][:4]
    mock.plant.move_station((x, y, z), turn)
    return f"the station stands {x:g} {y:g} {z:g} m farther, turned by {turn:g} rad"


def _restart_drive(mock: MockRig, words: list[str]) -> str:
    drives = {drive.axis_name: drive for drive in mock.drives}
    if len(words) != 1 or words[0] not in drives:
        raise ValueError(f"{USAGE['drive restart']}: NAME is one of {', '.join(drives)}")
    drives[words[0]].power_cycle()
    return f"drive {words[0]} was switched off and on"


def _replace_drive(mock: MockRig, words: list[str]) -> str:
    drive, (more_m,) = _named_drive(mock, words, "drive replace", 1)
    drive.replace(more_m)
    return f"drive {words[0]} was replaced; serial number {drive.serial}, no tables, counts {more_m:g} m more"


def _recount_drive(mock: MockRig, words: list[str]) -> str:
    if len(words) != 2:
        raise ValueError(USAGE["drive recount"])
    drive, (more_m,) = _named_drive(mock, words, "drive recount", 1)
    drive.recount(more_m)
    return f"drive {words[0]} counts {more_m:g} m more"


def _knock_column(mock: MockRig, words: list[str]) -> str:
    if len(words) < 2:
        raise ValueError(USAGE["column knock"])
    drive, (lean_rad, shift_m) = _named_drive(mock, words, "column knock", 2)
    mock.plant.knock(Knock(drive=drive.axis_name, lean_rad=lean_rad, shift_m=shift_m))
    return f"the column of {drive.axis_name} leans by {lean_rad:g} rad more and stands {shift_m:g} m farther"


def _named_drive(mock: MockRig, words: list[str], command: str, count: int) -> tuple[DriveServer, list[float]]:
    """A drive and up to `count` numbers after its name, zero where they are left out."""
    drives = {drive.axis_name: drive for drive in mock.drives}
    if not words or words[0] not in drives:
        raise ValueError(f"{USAGE[command]}: NAME is one of {', '.join(drives)}")
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = [math.nan]
    if len(numbers) > count or not all(abs(number) <= _MOST_OFF for number in numbers):
        raise ValueError(f"{USAGE[command]}, at most {_MOST_OFF:g} (m or rad)")
    return drives[words[0]], [*numbers, *[0.0] * (count - len(numbers))]


def _silence(mock: MockRig, words: list[str]) -> str:
    if len(words) != 1 or words[0] not in (*get_args(Device), "none"):
        raise ValueError(USAGE["silent"])
    mock.silence(None if words[0] == "none" else cast(Device, words[0]))
    return "all answer" if words[0] == "none" else f"{words[0]} is silent"


def _fault(mock: MockRig, words: list[str]) -> str:
    if words == ["none"]:
        mock.faults.clear()
        return "no fault strikes any more"
    if len(words) != 1:
        raise ValueError(USAGE["fault"])
    mock.faults.arm([parse_fault(words[0])])
    return f"armed: {words[0]}, counted from now on"


def _effect(mock: MockRig, words: list[str]) -> str:
    if len(words) != 1:
        raise ValueError(USAGE["effect"])
    texts = [] if words == ["none"] else [*mock.effects, words[0]]
    mock.plant.set_effects(texts)
    mock.effects = tuple(texts)
    return f"effects: {', '.join(texts) or 'none'}"


def _payload(mock: MockRig, words: list[str]) -> str:
    if len(words) != 1 or not words[0].isascii() or not words[0].isdigit():
        raise ValueError(USAGE["payload"])
    mock.plant.put_on(int(words[0][:9]))
    return f"payload {mock.plant.payload}: {mock.plant.settings.payloads[mock.plant.payload].name}"


def _temperature(mock: MockRig, words: list[str]) -> str:
    try:
        name, by_k = words[0], float(words[1])
    except (IndexError, ValueError):
        raise ValueError(USAGE["temperature"]) from None
    if len(words) != 2 or not math.isfinite(by_k) or abs(by_k) > _MOST_K:
        raise ValueError(f"{USAGE['temperature']}, at most {_MOST_K:g}")
    mock.plant.thermal.heat(name, by_k)
    return f"{name}: {mock.plant.thermal.sensor_c(name, mock.plant.clock.now_s()):.2f} degC"


def _interlock(mock: MockRig, words: list[str]) -> str:
    if len(words) != 2 or words[0] not in INTERLOCKS or words[1] not in ("open", "good"):
        raise ValueError(USAGE["interlock"])
    mock.plc.set_interlock(INTERLOCKS[words[0]], words[1] == "good")
    return f"interlock {words[0]}: {words[1]}"


def _release(mock: MockRig, words: list[str]) -> str:
    if words not in (["on"], ["off"]):
        raise ValueError(USAGE["release"])
    mock.plc.state.set_release(words == ["on"])
    return f"the key switch is {words[0]}"


def _acknowledge(mock: MockRig, words: list[str]) -> str:
    if words:
        raise ValueError(USAGE["acknowledge"])
    mock.plc.state.acknowledge()
    return "acknowledged at the PLC"


def _automatic(mock: MockRig, words: list[str]) -> str:
    if words not in (["on"], ["off"]):
        raise ValueError(USAGE["automatic"])
    mock.plc.state.set_automatic(words == ["on"])
    return f"the automatic mode is {'granted' if words == ['on'] else 'not granted'}"


def _program(mock: MockRig, words: list[str]) -> str:
    if mock.player is None:
        raise ValueError("the mock has no program: it was started without --program")
    number = words[1].removeprefix("N") if len(words) == 2 else "0"
    if words[:1] not in (["start"], ["stop"]) or len(words) > 2 or not (number.isascii() and number.isdigit()):
        raise ValueError(USAGE["program"])
    if words[0] == "stop":
        mock.player.stop()
    else:
        mock.player.start(int(number[:9]) if len(words) == 2 else None)
    return f"program: {mock.player.state}, N{mock.player.visit}"


def _status(mock: MockRig, words: list[str]) -> str:
    if words:
        raise ValueError(USAGE["status"])
    t_s = mock.plant.clock.now_s()
    for drive in mock.drives:
        drive.with_axis(lambda axis: axis.refresh())
    drives = {
        drive.axis_name: {
            "moving": drive.is_moving(t_s),
            "powered": drive.axis.powered,
            "referenced": drive.axis.homing.referenced,
            "compensation": drive.compensation.mode,
            "generation": drive.compensation.table.generation if drive.compensation.table else 0,
            "crc": drive.compensation.table.crc if drive.compensation.table else 0,
            "machine": drive.compensation.table.machine_id.hex() if drive.compensation.table else "",
            "serial": drive.serial,
        }
        for drive in mock.drives
    }
    told = {"effects": list(mock.effects), "faults": list(mock.faults.armed), "struck": list(mock.faults.struck)}
    if mock.player is not None:
        told["program"] = [mock.player.state, f"N{mock.player.visit}"]
    return json.dumps({"t_rig_s": t_s, "payload": mock.plant.payload, "drives": drives, **told})


_ACTIONS: dict[str, Callable[[MockRig, list[str]], str]] = {
    "station move": _move_station,
    "drive restart": _restart_drive,
    "drive replace": _replace_drive,
    "drive recount": _recount_drive,
    "column knock": _knock_column,
    "silent": _silence,
    "fault": _fault,
    "effect": _effect,
    "payload": _payload,
    "temperature": _temperature,
    "interlock": _interlock,
    "release": _release,
    "acknowledge": _acknowledge,
    "automatic": _automatic,
    "program": _program,
    "status": _status,
}
