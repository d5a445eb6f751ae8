"""One campaign in memory: named columns of numbers, checked before anything uses them.

The store, a recording folder and other people's programs all produce this; every analysis takes it.
docs/reference/recording.md defines the columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array, RowSelection
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.recording.header import RecordingFile

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
OPTIONAL_COLUMNS = ("edm_mode", "prism_type")  # settings of the station, which earlier recordings do not tell
MISSING = -1.0
DRIVE_COLUMNS = (
    "commanded_m",
    "actual_m",
    "following_error_m",
    "velocity_m_per_s",
    "torque_ratio",
    "direction",
)
COUNTS = ("sequence", "visit", "pose", "pass", "nest_check", "samples", "payload")
MIN_DISTANCE_M = 0.1
LARGEST_COUNT = 1e9
LARGEST = {"m": 1e3, "rad": 1e2, "c": 200.0, "s": 1e11, "kg": 1e5, "m2": 1.0}


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
        return self.take(np.isin(np.asarray(self.columns["phase"], dtype=str), phases))

    def take(self, rows: RowSelection) -> Recording:
        """Some of the rows, by a mask (r,), indices or a slice."""
        return Recording(self.file, self.machine, {name: c[rows] for name, c in self.columns.items()})

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
    """All columns that a recording of a rig must have, in order."""
    by_drive = tuple(f"{drive}_{quantity}" for drive in drives for quantity in DRIVE_COLUMNS)
    return (*COLUMNS, *by_drive, *(f"{sensor}_temperature_c" for sensor in sensors))


def make_recording(file: RecordingFile, machine: Machine, rows: Sequence[Mapping[str, float | str]]) -> Recording:
    """A recording from row dictionaries; InputError if a column is missing or a value is not fit.

    It has those of OPTIONAL_COLUMNS that some row has; rows without them count as not known.
    """
    if file.drives != machine.drive_names:
        raise InputError(
            f"recording {file.campaign}: drives {', '.join(file.drives)} are not the machine's "
            f"{', '.join(machine.drive_names)}"
        )
    names = column_names(file.drives, file.sensors)
    columns: dict[str, Array] = {}
    for name in names:
        try:
            values = [row[name] for row in rows]
        except KeyError:
            raise InputError(f"recording {file.campaign}: a row lacks '{name}'") from None
        columns[name] = np.array(values, dtype=str if name in TEXT_COLUMNS else np.float64)
    for name in OPTIONAL_COLUMNS:
        if any(name in row for row in rows):
            columns[name] = np.array([row.get(name, MISSING) for row in rows], dtype=np.float64)
    recording = Recording(file, machine, columns)
    for check in (_check_numbers, _check_counts, _check_geometry, _check_names):
        check(recording)
    return recording


def _input_error(recording: Recording, text: str) -> InputError:
    return InputError(f"recording {recording.file.campaign}: {text}")


def _check_numbers(recording: Recording) -> None:
    """Finite, and within a plausible range of their unit."""
    if len(recording) == 0:
        raise _input_error(recording, "no readings")
    for column, values in recording.columns.items():
        if column in TEXT_COLUMNS:
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise _input_error(recording, f"row {bad[0] + 1}, column '{column}' is not finite; remove the row")
        limit = LARGEST.get(column.rsplit("_", 1)[-1], math.inf)
        wild = np.flatnonzero(np.abs(values) > limit)
        if wild.size:
            value = values[wild[0]]
            raise _input_error(
                recording, f"row {wild[0] + 1}, column '{column}' = {value:g} is out of range; check its unit"
            )


def _check_counts(recording: Recording) -> None:
    """Whole numbers where something is counted."""
    for column in (*COUNTS, *(name for name in OPTIONAL_COLUMNS if name in recording.columns)):
        wrong = np.flatnonzero((np.abs(recording[column]) > LARGEST_COUNT) | (recording[column] % 1.0 != 0.0))
        if wrong.size:
            raise _input_error(recording, f"row {wrong[0] + 1}, column '{column}' is not a count")
    if np.any(recording["samples"] < 1.0):
        raise _input_error(recording, "'samples' below 1; every reading is the mean of at least one")


def _check_geometry(recording: Recording) -> None:
    """Points away from the station, targets near the workspace, proper covariances."""
    if np.any(np.linalg.norm(recording.positions_m, axis=1) < MIN_DISTANCE_M):
        raise _input_error(recording, "a point lies at the station itself; check x_m, y_m and z_m")
    moves = recording.machine.commanded[recording.machine.commanded < 3]
    box_m = recording.machine.workspace[moves]
    far = np.abs(recording.targets_m()[:, moves] - box_m.mean(axis=1))
    if np.any(far > 2.0 * np.ptp(box_m, axis=1)):
        raise _input_error(recording, "a commanded pose lies far outside the workspace; check its unit")
    smallest = np.linalg.eigvalsh(recording.covariances_m2)[:, 0]
    if np.any(smallest <= 0.0):
        raise _input_error(recording, f"row {int(np.argmin(smallest)) + 1} has no proper covariance")


def _check_names(recording: Recording) -> None:
    """Readings that stand once, known phases, reflectors and payloads, the payloads' masses as listed."""
    uids, counts = np.unique(np.asarray(recording["uid"]), return_counts=True)
    if np.any(counts > 1):
        raise _input_error(recording, f"reading '{uids[np.argmax(counts)]}' stands twice; keep one")
    for phase in sorted(set(recording["phase"].tolist()) - set(PHASES)):
        raise _input_error(recording, f"unknown phase '{phase}'; known: {', '.join(PHASES)}")
    known = {smr.name for smr in recording.machine.smrs}
    for smr in sorted(set(recording["smr"].tolist()) - known):
        raise _input_error(recording, f"SMR '{smr}' is not in its machine file")
    payload = recording["payload"]
    if np.any((payload < 0) | (payload >= len(recording.file.payloads))):
        raise _input_error(recording, "a payload number is not in its list of payloads")
    listed = np.array([p.mass_kg for p in recording.file.payloads])[payload.astype(int)]
    if np.any(np.abs(listed - recording["payload_mass_kg"]) > 1e-6):
        raise _input_error(recording, "payload_mass_kg contradicts [[payloads]]; correct one of them")
