"""Profiles of drive makes: the manufacturer objects of a drive's table bank, and what the make lacks.

A profile is a small TOML file (docs/reference/drive-objects.md). Objects are written "0x2100:01 u8".
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from drivers.can.drive_object import DriveObject

_FORMATS = {"u8": "<B", "u16": "<H", "u32": "<I", "i8": "<b", "i16": "<h", "i32": "<i", "domain": ""}
_OBJECT = re.compile(r"0x([0-9A-Fa-f]{4}):([0-9A-Fa-f]{2}) (\w+)")
_LONGEST = 20_000
_COMPENSATION = ("mode", "activate", "active", "crc", "generation", "valid", "payload")
_BANK = ("image", "crc", "generation", "payload", "status")


@dataclass(frozen=True)
class BankObjects:
    """Objects of one of the two banks."""

    image: DriveObject
    crc: DriveObject
    generation: DriveObject
    payload: DriveObject
    status: DriveObject


@dataclass(frozen=True)
class CompensationObjects:
    """Objects of the compensation and of its banks 1 and 2; the partner's command and velocity arrive by RPDO2.

    `trial`: time-out of a trial in ms; None if the drive cannot end one by itself. `by_direction`: it reads images of
    version 2, which have a value for each direction of motion.
    """

    mode: DriveObject
    activate: DriveObject
    active: DriveObject
    crc: DriveObject
    generation: DriveObject
    valid: DriveObject
    payload: DriveObject
    partner_command: DriveObject
    partner_velocity: DriveObject
    banks: tuple[BankObjects, BankObjects]
    trial: DriveObject | None = None
    by_direction: bool = False


@dataclass(frozen=True)
class DriveCapabilities:
    """What a drive of some make can do, as its profile tells without any device.

    `table_bank`: it stores compensation tables and applies them. `homing`: it can be homed by this software and says
    whether that succeeded. `referenced_flag`: it says whether its position is referenced. `cyclic_position`: it has
    cyclic synchronous position mode. `watchdog`: it stops by itself when the master's heartbeat stays away. `trial`: it
    then ends the use of a table that was not verified yet. `tables_by_direction`: its tables may have a value for each
    direction of motion.
    """

    table_bank: bool
    homing: bool
    referenced_flag: bool
    cyclic_position: bool
    watchdog: bool
    trial: bool
    tables_by_direction: bool


@dataclass(frozen=True)
class DriveProfile:
    """What a make of drive has.

    `factor_group`: 0x608F, 0x6091 and 0x6092 give its units. `watchdog`: it can watch the master (0x1016, 0x6007).
    `referenced`: object whose masked bits are all set while the position is referenced; None if it cannot be lost.
    `home_offset_sign`: 1 if the position on the mark is the home offset 0x607C, -1 if it is its negative.
    `homing`, `cyclic_position`: it has the modes 6 and 8. `compensation` is None if there is no table bank.
    """

    name: str
    factor_group: bool = True
    watchdog: bool = True
    referenced: DriveObject | None = None
    referenced_mask: int = 0
    home_offset_sign: int = 1
    compensation: CompensationObjects | None = None
    homing: bool = True
    cyclic_position: bool = True

    @property
    def capabilities(self) -> DriveCapabilities:
        """What a drive of this make can do, without asking one."""
        return DriveCapabilities(
            table_bank=self.compensation is not None,
            homing=self.homing and self.referenced is not None,
            referenced_flag=self.referenced is not None,
            cyclic_position=self.cyclic_position,
            watchdog=self.watchdog,
            trial=self.compensation is not None and self.compensation.trial is not None,
            tables_by_direction=self.compensation is not None and self.compensation.by_direction,
        )


def load_profile(source: str, folder: Path | None = None) -> DriveProfile:
    """A shipped profile by its name, or a file `*.toml` (relative to `folder`).

    Raises ValueError in one line if it cannot be read or is not a profile.
    """
    try:
        text = _read_plain_file((folder or Path()) / source) if source.endswith(".toml") else _read_shipped(source)
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"drive profile {source}: cannot be read: {error}") from error
    return parse_profile(text, source)


def _read_plain_file(path: Path) -> str:
    """The text of a plain file, of which no more is read than a profile may have; raises OSError."""
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError("not a plain file")
        return file.read(_LONGEST + 1).decode("utf-8")


def parse_profile(text: str, where: str = "profile") -> DriveProfile:
    """Read a profile; raises ValueError in one line."""
    if len(text) > _LONGEST:
        raise ValueError(f"drive profile {where}: longer than {_LONGEST} characters")
    try:
        return _profile(tomllib.loads(text))
    except (ValueError, RecursionError, _NotAProfile) as error:
        raise ValueError(f"drive profile {where}: {' '.join(str(error).split())}") from None


class _NotAProfile(Exception):
    pass


@lru_cache
def _read_shipped(name: str) -> str:
    folder = resources.files("drivers.drives") / "profiles"
    names = sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml"))
    if name not in names:
        raise ValueError(f"drive profile '{name}' is not shipped; use one of {', '.join(names)}, or a file *.toml")
    return (folder / f"{name}.toml").read_text(encoding="utf-8")


def _profile(table: Mapping[str, Any]) -> DriveProfile:
    keys = {"name", "factor_group", "watchdog", "referenced", "home_offset_sign", "homing", "cyclic_position"}
    _require_only_keys(table, keys | {"compensation"}, "profile")
    sign = _require_type(table.get("home_offset_sign", 1), int, "home_offset_sign")
    if sign not in (1, -1):
        raise _NotAProfile(f"home_offset_sign: 1 or -1 required, not {sign}")
    referenced = table.get("referenced")
    if referenced is not None:
        _require_only_keys(referenced, {"object", "mask"}, "referenced")
    return DriveProfile(
        name=_require_type(table.get("name"), str, "name"),
        factor_group=_require_type(table.get("factor_group", True), bool, "factor_group"),
        watchdog=_require_type(table.get("watchdog", True), bool, "watchdog"),
        referenced=None if referenced is None else _object(referenced.get("object"), "referenced.object"),
        referenced_mask=0 if referenced is None else _require_type(referenced.get("mask"), int, "referenced.mask"),
        home_offset_sign=sign,
        homing=_require_type(table.get("homing", True), bool, "homing"),
        cyclic_position=_require_type(table.get("cyclic_position", True), bool, "cyclic_position"),
        compensation=None if "compensation" not in table else _compensation(table["compensation"]),
    )


def _compensation(table: Any) -> CompensationObjects:
    others = {"partner_command", "partner_velocity", "banks", "trial", "by_direction"}
    _require_only_keys(table, {*_COMPENSATION, *others}, "compensation")
    banks = table.get("banks")
    if not isinstance(banks, list) or len(banks) != 2:
        raise _NotAProfile("compensation.banks: two are required")
    for number, bank in enumerate(banks, start=1):
        _require_only_keys(bank, set(_BANK), f"bank {number}")
    first, second = (
        BankObjects(**{key: _object(bank.get(key), f"bank {number} {key}") for key in _BANK})
        for number, bank in enumerate(banks, start=1)
    )
    named = {key: _object(table.get(key), f"compensation {key}") for key in _COMPENSATION}
    named["activate"] = _object(table.get("activate"), "activate bank", reads_back=False)
    return CompensationObjects(
        **named,
        partner_command=_object(table.get("partner_command"), "partner's command"),
        partner_velocity=_object(table.get("partner_velocity"), "partner's velocity"),
        banks=(first, second),
        trial=_object(table["trial"], "time-out of a trial") if "trial" in table else None,
        by_direction=_require_type(table.get("by_direction", False), bool, "compensation.by_direction"),
    )


def _object(text: Any, name: str, *, reads_back: bool = True) -> DriveObject:
    match = _OBJECT.fullmatch(text) if isinstance(text, str) else None
    if match is None or match[3] not in _FORMATS:
        raise _NotAProfile(f"{name}: {text!r:.40} is not an object such as '0x2100:01 u8'")
    return DriveObject(int(match[1], 16), int(match[2], 16), _FORMATS[match[3]], name, reads_back)


def _require_only_keys(table: Any, keys: set[str], where: str) -> None:
    if not isinstance(table, dict):
        raise _NotAProfile(f"{where}: a table is required")
    unknown = sorted(set(table) - keys)
    if unknown:
        raise _NotAProfile(f"{where}: unknown key '{unknown[0]}'")


def _require_type(value: Any, kind: type[Any], name: str) -> Any:
    if type(value) is not kind:
        raise _NotAProfile(f"{name}: {kind.__name__} required, not {value!r:.40}")
    return value
