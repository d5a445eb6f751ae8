"""The diagnosis of one drive alone, from a folder that holds its recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import RenderableType

from calibration.axis.diagnose import diagnose_axis
from calibration.recording.axis_recording import is_axis_folder, read_axis_folder
from pkm_rig.report.axis_json import axis_json
from pkm_rig.report.axis_text import describe_axis


def is_axis(what: str) -> bool:
    """Whether a path is a folder with the recording of an axis."""
    return is_axis_folder(Path(what))


def diagnose_folder(folder: Path) -> tuple[dict[str, Any], RenderableType]:
    """The diagnosis for programs and for people. Raises InputError."""
    diagnosis = diagnose_axis(read_axis_folder(folder))
    return axis_json(diagnosis), describe_axis(diagnosis)
