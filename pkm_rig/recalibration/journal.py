"""What a run ends in, beside the store: a JSON line, the PLC's registers, and one notification command."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drivers.errors import DeviceError
from pkm_rig.recalibration.situation import Situation, days_until
from pkm_rig.rig.recalibration_sections import PlcWords
from pkm_rig.rig.rig import Rig
from pkm_rig.store.place import store_folder

NOTIFY_LIMIT_S = 60.0
NONE_IN_SIGHT = 0xFFFF
STATE_WORDS = {"fit": 0, "due": 1, "out of tolerance": 2}


def journal_path(out: Path, rig: str) -> Path:
    """The file with one JSON line a run; each rig has its own, so that two do not disturb each other."""
    return store_folder(out) / f"recalibration-{rig}.jsonl"


def write_line(out: Path, rig: str, entry: Mapping[str, Any]) -> str:
    """Append a run's line to the journal, in one write; the line."""
    line = json.dumps(dict(entry), allow_nan=False)
    with journal_path(out, rig).open("a", encoding="utf-8") as stream:
        stream.write(line + "\n")
    return line


def last_entry(out: Path, rig: str) -> dict[str, Any]:
    """The journal's last line; nothing where there is none, or where it was cut off."""
    path = journal_path(out, rig)
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    try:
        entry = json.loads(lines[-1]) if lines else {}
    except ValueError:
        return {}
    return entry if isinstance(entry, dict) else {}


def send_notification(command: Sequence[str], line: str, notify: Callable[[str], None]) -> bool:
    """Run the command with the line on stdin, without a shell; whether it went well. What goes wrong is said only."""
    if not command:
        return True
    try:
        done = subprocess.run(
            list(command), input=line + "\n", text=True, timeout=NOTIFY_LIMIT_S, check=False, capture_output=True
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        notify(f"recalibration.notify: {command[0]}: {error}")
        return False
    if done.returncode:
        notify(f"recalibration.notify: {command[0]} ended with status {done.returncode}: {done.stderr.strip()[:200]}")
    return done.returncode == 0


def is_automatic(rig: Rig, words: PlcWords) -> bool:
    """Whether the PLC grants the automatic mode; where it has no such register, nobody has to. Raises DeviceError."""
    return words.automatic is None or rig.plc.read_word(words.automatic) == 1


def tell_plc(rig: Rig, words: PlcWords, situation: Situation, *, alarm: bool, notify: Callable[[str], None]) -> None:
    """Write state, days left and alarm where the rig file names registers; a PLC that refuses is said only."""
    days = days_until(situation.verdict.due_utc_s, situation.now_utc_s)
    values = {
        words.state: STATE_WORDS[situation.state],
        words.days_left: NONE_IN_SIGHT if days is None else min(int(days), NONE_IN_SIGHT - 1),
        words.alarm: int(alarm),
    }
    try:
        for address, value in values.items():
            if address is not None:
                rig.plc.write_word(address, value)
    except DeviceError as error:
        notify(str(error))
