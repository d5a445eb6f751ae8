"""A rig file for one more mock rig on this computer: the same rig on free ports."""

from __future__ import annotations

import json
import re
from pathlib import Path

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from pkm_rig.rig.config import load_rig
from pkm_rig.virtual.ownership import free_ports

_SECTION = re.compile(r"\s*\[+\s*([A-Za-z_.]+)\s*\]+")
_KEY = re.compile(r"\s*([A-Za-z_]+)\s*=")


def write_new_rig(source: Path, target: Path, *, anywhere: bool) -> None:
    """Write `source` as `target`, with ports that are free now and terminals beside it; comments stay.

    InputError if `target` exists, or is in another folder than files that `source` names (unless `anywhere`).
    """
    if target.exists():
        raise InputError(f"{target} exists; serve it with `pkm-rig mock --rig {target}`, or name another file")
    if not anywhere and target.resolve().parent != source.resolve().parent:
        raise InputError(f"{target}: put it beside {source}, whose machine and profiles may be files there")
    can_port, plc_port = free_ports(2)
    values = {
        ("station", "port"): json.dumps(str(target.resolve().with_suffix(".station"))),
        ("can", "interface"): '"socketcand"',
        ("can", "host"): '"127.0.0.1"',
        ("can", "port"): str(can_port),
        ("plc", "host"): '"127.0.0.1"',
        ("plc", "port"): str(plc_port),
    }
    if load_rig(source)[0].plc.transport == "rtu":
        values["plc", "serial_port"] = json.dumps(str(target.resolve().with_suffix(".plc")))
    text = with_values(read_text(source), values)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: {error.strerror}; name another file") from error
    load_rig(target)


def with_values(text: str, values: dict[tuple[str, str], str]) -> str:
    """A TOML text with other values of some keys, by section and key, each in one line; a missing key is added."""
    missing, section, lines = dict(values), "", []
    for line in text.splitlines():
        header, key = _SECTION.match(line), _KEY.match(line)
        if header:
            section = header[1]
            lines.append(line)
            present = {k for s, k in _keys(text) if s == section}
            lines += [f"{k} = {missing.pop((s, k))}" for s, k in list(missing) if s == section and k not in present]
        elif key and (section, key[1]) in values:
            lines.append(f"{key[1]} = {values[section, key[1]]}")
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _keys(text: str) -> list[tuple[str, str]]:
    section, keys = "", []
    for line in text.splitlines():
        if header := _SECTION.match(line):
            section = header[1]
        elif key := _KEY.match(line):
            keys.append((section, key[1]))
    return keys
