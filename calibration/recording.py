"""A campaign as plain arrays and as a folder of plain files; docs/recording.md defines both completely.

A recording is hostile input: data only, bounded in size, every value checked before it is used.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from calibration.machine import Array, Machine, parse_machine
from calibration.station import CertifiedLength, StationAccuracy
from calibration.toml_file import InputError, Section, parse_toml, read_text

MAX_ROWS = 2_000_000
MAX_CSV_BYTES = 1_000_000_000
FORMAT = 1

PHASES = ("repeatability", "nests", "calibration", "verification_before", "verification_after")
TEXT_COLUMNS = ("uid", "phase", "smr")
COLUMNS: tuple[str, ...] = (
    *TEXT_COLUMNS,
    "sequence",
    "visit",
    "pose",
    "pass",
    "nest_check",
    "t_rig_s",
    "t_host_s",
    "t_u_s",
    "hz_rad",
    "v_rad",
    "slope_distance_m",
    "station",
    "face",
    "prism_constant_m",
    "ppm",
    "x_m",
    "y_m",
    "z_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_xz_m2",
    "cov_yy_m2",
    "cov_yz_m2",
    "cov_zz_m2",
    "samples",
    "target_x_m",
    "target_y_m",
    "target_z_m",
    "target_rx_rad",
    "target_ry_rad",
    "target_rz_rad",
    "speed_m_per_s",
    "dwell_s",
    "air_temperature_c",
    "pressure_hpa",
    "humidity_percent",
    "payload",
    "payload_mass_kg",
    "compensation",
    "flags",
)
DRIVE_COLUMNS = (
    "commanded_m",
    "actual_m",
    "following_error_m",
    "velocity_m_per_s",
    "torque_ratio",
    "direction",
)
LARGEST = {"m": 1e3, "rad": 1e2, "c": 200.0, "s": 1e11, "kg": 1e5, "m2": 1.0}


class PayloadEntry(Section):
    """A payload of the rig: mass and centre of mass in the platform frame with standard uncertainties."""

    name: str
    mass_kg: float = Field(ge=0.0)
    u_mass_kg: float = Field(ge=0.0, default=0.0)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    u_com_m: float = Field(ge=0.0, default=0.0)


class AccuracyEntry(Section):
    """What is stated of the station: standard deviations of a reading, standard uncertainty of its ranges."""

    angle_sd_rad: float = Field(gt=0.0)
    range_sd_m: float = Field(gt=0.0)
    range_constant_u_m: float = Field(gt=0.0)
    range_scale_u: float = Field(ge=0.0)
    drift_rad_per_sqrt_h: float = Field(gt=0.0, default=3.0e-6)
    drift_of_level_rad_per_sqrt_h: float = Field(gt=0.0, default=1.0e-6)
    drift_m_per_sqrt_h: float = Field(gt=0.0, default=1.0e-5)

    def stated(self) -> StationAccuracy:
        """For computation."""
        return StationAccuracy(self.angle_sd_rad, self.range_sd_m, self.range_constant_u_m, self.range_scale_u)


class StationEntry(Section):
    """The station: its rough place in the machine frame, its heading and its accuracy."""

    name: str = "station"
    position_m: tuple[float, float, float]
    heading_rad: float = 0.0
    accuracy: AccuracyEntry


class LengthEntry(Section):
    """A certified distance between two nests."""

    nests: tuple[str, str]
    value_m: float = Field(gt=0.0)
    u_m: float = Field(gt=0.0)

    def certified(self) -> CertifiedLength:
        """For computation."""
        return CertifiedLength(self.nests, self.value_m, self.u_m)


class NuisanceEntry(Section):
    """Declared levels of nuisance effects on this rig, one standard deviation each; zero if not declared."""

    drift_m: float = Field(ge=0.0, default=0.0)
    reseat_m: float = Field(ge=0.0, default=0.0)
    reversal_m: float = Field(ge=0.0, default=0.0)
    temperature_k: float = Field(ge=0.0, default=0.0)


class RecordingFile(Section):
    """recording.toml."""

    format: Literal[1]
    campaign: str
    rig: str
    created: str
    software: str
    drives: tuple[str, ...]
    sensors: tuple[str, ...]
    station: StationEntry
    nest_length: LengthEntry | None = None
    nest_limit_m: float = Field(gt=0.0)
    payloads: tuple[PayloadEntry, ...]
    nuisance: NuisanceEntry = NuisanceEntry()
    columns: dict[str, str] = Field(default_factory=dict)


@dataclass(frozen=True)
class Recording:
    """One campaign: its description, the nominal machine, and named columns of equal length.

    Numbers are float64 arrays, TEXT_COLUMNS arrays of str. Units are the suffix of a column's name.
    """

    file: RecordingFile
    machine: Machine
    columns: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.columns["t_rig_s"])

    def __getitem__(self, name: str) -> Array:
        try:
            return self.columns[name]
        except KeyError:
            raise InputError(f"recording {self.file.campaign}: no column '{name}'; this analysis needs it") from None

    def rows(self, *phases: str) -> Recording:
        """The rows of some phases."""
        keep = np.isin(np.asarray(self.columns["phase"], dtype=str), phases)
        return Recording(self.file, self.machine, {name: c[keep] for name, c in self.columns.items()})

    @property
    def positions_m(self) -> Array:
        """Measured points (r, 3) in the station's frame."""
        return np.stack([self[c] for c in ("x_m", "y_m", "z_m")], axis=1)

    @property
    def covariances_m2(self) -> Array:
        """Their covariances (r, 3, 3)."""
        out = np.empty((len(self), 3, 3))
        for i, j, name in (
            (0, 0, "xx"),
            (0, 1, "xy"),
            (0, 2, "xz"),
            (1, 1, "yy"),
            (1, 2, "yz"),
            (2, 2, "zz"),
        ):
            out[:, i, j] = out[:, j, i] = self[f"cov_{name}_m2"]
        return out

    def drives(self, quantity: str) -> Array:
        """One quantity of all drives (r, d), for example 'actual_m'."""
        return np.stack([self[f"{name}_{quantity}"] for name in self.file.drives], axis=1)

    def temperatures_c(self) -> dict[str, Array]:
        """Part temperatures by sensor, (r,) each."""
        return {name: self[f"{name}_temperature_c"] for name in self.file.sensors}

    def targets_m(self) -> Array:
        """Commanded poses (r, 6)."""
        names = ("target_x_m", "target_y_m", "target_z_m", "target_rx_rad", "target_ry_rad", "target_rz_rad")
        return np.stack([self[c] for c in names], axis=1)

    def payload_com_m(self) -> Array:
        """Centre of mass of the payload that was on (r, 3)."""
        known = np.array([p.com_m for p in self.file.payloads])
        return known[self["payload"].astype(int)]


def column_names(drives: Sequence[str], sensors: Sequence[str]) -> tuple[str, ...]:
    """All columns of a rig, in order."""
    by_drive = tuple(f"{drive}_{quantity}" for drive in drives for quantity in DRIVE_COLUMNS)
    return (*COLUMNS, *by_drive, *(f"{sensor}_temperature_c" for sensor in sensors))


def make_recording(file: RecordingFile, machine: Machine, rows: Sequence[Mapping[str, float | str]]) -> Recording:
    """A recording from row dictionaries; InputError if a column is missing or a value is not fit."""
    names = column_names(file.drives, file.sensors)
    columns: dict[str, Array] = {}
    for name in names:
        try:
            values = [row[name] for row in rows]
        except KeyError:
            raise InputError(f"recording {file.campaign}: a row lacks '{name}'") from None
        columns[name] = np.array(values, dtype=str if name in TEXT_COLUMNS else np.float64)
    recording = Recording(file, machine, columns)
    _check(recording)
    return recording


def write_folder(recording: Recording, folder: Path) -> None:
    """Write recording.toml, machine.toml and readings.csv; floats round-trip. The folder must not exist."""
    if folder.exists():
        raise InputError(f"{folder}: exists already; choose another folder")
    folder.mkdir(parents=True)
    names = list(recording.columns)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in range(len(recording)):
        writer.writerow([_cell(recording.columns[name][row]) for name in names])
    for name, content in (
        ("recording.toml", _to_toml(recording.file)),
        ("machine.toml", recording.machine.text),
        ("readings.csv", text.getvalue()),
    ):
        with (folder / name).open("w", encoding="utf-8") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())


def read_folder(folder: Path) -> Recording:
    """Read and check a recording folder; InputError in one line if it is not fit."""
    file = parse_toml(read_text(folder / "recording.toml"), RecordingFile, str(folder / "recording.toml"))
    machine = parse_machine(read_text(folder / "machine.toml"), str(folder / "machine.toml"))
    path = folder / "readings.csv"
    try:
        if path.stat().st_size > MAX_CSV_BYTES:
            raise InputError(f"{path}: larger than {MAX_CSV_BYTES} bytes")
        with path.open(encoding="utf-8", newline="") as stream:
            return make_recording(file, machine, _parse_rows(stream, path, file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def _parse_rows(stream: io.TextIOBase, path: Path, file: RecordingFile) -> list[dict[str, float | str]]:
    reader = csv.reader(stream)
    try:
        header = next(reader, [])
        missing = [n for n in column_names(file.drives, file.sensors) if n not in header]
        if missing:
            raise InputError(f"{path}: no column '{missing[0]}'; see docs/recording.md")
        if len(set(header)) != len(header):
            raise InputError(f"{path}: a column stands twice in the header")
        rows: list[dict[str, float | str]] = []
        for number, cells in enumerate(reader, start=2):
            if len(cells) != len(header):
                raise InputError(f"{path}: line {number} has {len(cells)} cells, the header {len(header)}")
            if len(rows) >= MAX_ROWS:
                raise InputError(f"{path}: more than {MAX_ROWS} rows")
            rows.append(_row(header, cells, path, number))
    except csv.Error as error:
        raise InputError(f"{path}: not CSV: {error}") from error
    return rows


def _row(header: list[str], cells: list[str], path: Path, number: int) -> dict[str, float | str]:
    row: dict[str, float | str] = {}
    for name, cell in zip(header, cells, strict=True):
        if name in TEXT_COLUMNS:
            row[name] = cell
            continue
        try:
            row[name] = float(cell)
        except ValueError:
            raise InputError(f"{path}: line {number}, column '{name}': '{cell[:40]}' is not a number") from None
    return row


def _check(recording: Recording) -> None:
    """Values from outside: finite, within a plausible range of their unit, known names."""
    name = recording.file.campaign
    if len(recording) == 0:
        raise InputError(f"recording {name}: no readings")
    for column, values in recording.columns.items():
        if column in TEXT_COLUMNS:
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(f"recording {name}: row {bad[0] + 1}, column '{column}' is not finite; remove the row")
        limit = LARGEST.get(column.rsplit("_", 1)[-1], math.inf)
        wild = np.flatnonzero(np.abs(values) > limit)
        if wild.size:
            raise InputError(
                f"recording {name}: row {wild[0] + 1}, column '{column}' = {values[wild[0]]:g} is out of range; "
                "check its unit"
            )
    known = {smr.name for smr in recording.machine.smrs}
    for smr in sorted(set(recording["smr"].tolist())):
        if smr not in known:
            raise InputError(f"recording {name}: SMR '{smr}' is not in its machine file")
    payload = recording["payload"]
    if np.any((payload < 0) | (payload >= len(recording.file.payloads)) | (payload != np.floor(payload))):
        raise InputError(f"recording {name}: a payload number is not in its list of payloads")
    smallest = np.linalg.eigvalsh(recording.covariances_m2)[:, 0]
    if np.any(smallest <= 0.0):
        raise InputError(f"recording {name}: row {int(np.argmin(smallest)) + 1} has no proper covariance")


def _cell(value: object) -> str:
    if isinstance(value, np.str_ | str):
        return str(value)
    number = float(value)  # type: ignore[arg-type]
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _to_toml(section: Section) -> str:
    """TOML of nested sections: scalars first, then tables and arrays of tables."""
    lines: list[str] = []
    _emit(section.model_dump(exclude_none=True), "", lines)
    return "\n".join(lines) + "\n"


def _emit(table: Mapping[str, object], prefix: str, lines: list[str]) -> None:
    nested = {k: v for k, v in table.items() if isinstance(v, dict) or _is_table_array(v)}
    for key, value in table.items():
        if key not in nested:
            lines.append(f"{key} = {_toml_value(value)}")
    for key, value in nested.items():
        path = f"{prefix}{key}"
        if isinstance(value, dict):
            lines += ["", f"[{path}]"]
            _emit(value, path + ".", lines)
        else:
            assert isinstance(value, tuple | list)
            for item in value:
                lines += ["", f"[[{path}]]"]
                _emit(item, path + ".", lines)


def _is_table_array(value: object) -> bool:
    return isinstance(value, tuple | list) and bool(value) and all(isinstance(v, dict) for v in value)


def _toml_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return repr(value)
