"""systemd units that run scheduled work: a service for one run, and the timer that starts it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calibration.base.errors import InputError

MINUTES = 15


def unit_texts(rig: str, command: Sequence[str]) -> dict[str, str]:
    """File name to text of service and timer for a rig; `command`: the words of one scheduled run, the program first.

    Status 10 (due) is a success of the unit; a run that was missed while the computer was off is made once after it.
    """
    name = f"pkm-rig-recalibrate-{rig}"
    service = f"""[Unit]
Description=Check and re-calibration of {rig} when they are due
After=network-online.target
Wants=network-online.target

[Service]
Type=oneshot
ExecStart={" ".join(_quoted(word) for word in command)}
SuccessExitStatus=10
TimeoutStartSec=infinity
KillSignal=SIGTERM
TimeoutStopSec=60
"""
    timer = f"""[Unit]
Description=Looks every {MINUTES} minutes whether {rig} is due

[Timer]
OnCalendar=*:0/{MINUTES}
Persistent=true
RandomizedDelaySec=30

[Install]
WantedBy=timers.target
"""
    return {f"{name}.service": service, f"{name}.timer": timer}


def write_units(texts: dict[str, str], folder: Path) -> list[Path]:
    """Write them into a folder that is there; InputError where one exists already with another text."""
    paths = [folder / name for name in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        if path.exists() and path.read_text(encoding="utf-8") != text:
            raise InputError(f"{path}: exists already and says something else; remove it, or choose another folder")
    for path, text in zip(paths, texts.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def _quoted(word: str) -> str:
    """A word of ExecStart: systemd expands % and $, and splits at spaces."""
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"' if not word or any(c in word for c in " \t'\"\\;") else escaped
