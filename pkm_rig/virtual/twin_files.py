"""The rig's twin as files: twin.json beside its machine.toml. Data only, checked as hostile input when read."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.base.text_bounds import parse_json
from calibration.diagnosis.twin.folder_twin import FolderTwin
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.catalogue import load_catalogue
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.recording import Recording

TWIN_FOLDER, TWIN_NAME, MACHINE_NAME = "twin", "twin.json", "machine.toml"
FOLDER_TWIN_NAME, PREDICTED_NAME = "folder-twin.json", "predicted.csv"
FORMAT = 1
MAX_TWIN_BYTES = 100_000_000  # a campaign of MAX_ROWS readings has less


def write_twin(twin: Twin, recording: Recording, folder: Path) -> None:
    """Write a twin and the nominal machine that it is built on, over an earlier one. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MACHINE_NAME).write_text(recording.machine.text, encoding="utf-8")
    content = {"format": FORMAT, "campaign": recording.file.campaign, "twin": twin.to_data()}
    (folder / TWIN_NAME).write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")


def write_folder_twin(twin: FolderTwin, measured: MeasuredMachine, folder: Path) -> None:
    """Write a measurement folder's twin over an earlier one: its machine.toml, folder-twin.json with the unknowns as
    they are with the effects in the model, predicted.csv. It serves no devices. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MACHINE_NAME).write_text(measured.machine.text, encoding="utf-8")
    content = {
        "format": FORMAT,
        "calibration": measured.file.name,
        "effects": [{"effect": effect, "place": place} for effect, place in twin.effects],
        "unknowns": {name: {"value": v, "u": u, "unit": unit} for name, (v, u, unit) in twin.unknowns.items()},
    }
    (folder / FOLDER_TWIN_NAME).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with (folder / PREDICTED_NAME).open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["of", "unit", "sd", "read", "by_machine", "by_twin"])
        columns = (twin.sigma, twin.read, twin.by_machine, twin.by_twin)
        rows.writerows(zip(twin.of, twin.unit, *(column.tolist() for column in columns), strict=True))


def find_twin(what: str, out: Path) -> Path:
    """The folder of a twin: of a campaign's id, or that folder itself; InputError if there is none."""
    for folder in (Path(what), out / what / TWIN_FOLDER):
        if (folder / TWIN_NAME).is_file():
            return folder
        if (folder / FOLDER_TWIN_NAME).is_file():
            raise InputError(f"{folder}: the twin of a measurement folder predicts its readings and serves no devices")
    raise InputError(f"no twin of '{what}' in {out}; make one with `pkm-rig diagnose {what} --add`")


def read_twin(folder: Path, effects: Sequence[Path] = ()) -> Twin:
    """Read and check a twin; InputError in one line if it is invalid. effects: files of user-defined effects."""
    path = folder / TWIN_NAME
    content = parse_json(read_text(path, MAX_TWIN_BYTES), str(path))
    if not isinstance(content, dict) or content.get("format") != FORMAT or "twin" not in content:
        raise InputError(f"{path}: not a twin of format {FORMAT}; write it anew with `pkm-rig diagnose --add`")
    try:
        return Twin.from_data(read_text(folder / MACHINE_NAME), content["twin"], load_catalogue(tuple(effects)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
