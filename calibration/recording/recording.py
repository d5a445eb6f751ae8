"""One campaign in memory: named columns of numbers, checked before anything uses them.

The store, a recording folder and other people's programs all produce this; every analysis takes it.
`columns` states them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array, RowSelection
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.recording.columns import rotary_quantity
from calibration.recording.header import RecordingFile

PHASES = ("repeatability", "nests", "calibration", "verification_before", "verification_after")
UID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")  # as it is shown in terminals and read by spreadsheets
MIN_DISTANCE_M = 0.1


@dataclass(frozen=True)
class Recording:
    """One campaign: its description, the nominal machine, and named columns of equal length.

    Numbers and counts are float64 arrays, texts arrays of str. Units are the end of a column's name.
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

    def row(self, number: int) -> dict[str, float | str]:
        """One reading by column; an optional number that it lacks is left out."""
        row = {name: column[number].item() for name, column in self.columns.items()}
        return {name: value for name, value in row.items() if isinstance(value, str) or math.isfinite(value)}

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
        """One quantity of all drives (r, d), for example 'actual_m': of a rotary drive that in radians."""
        rotary = self.file.rotary_drives
        names = [rotary_quantity(quantity) if name in rotary else quantity for name in self.file.drives]
        return np.stack([self[f"{drive}_{name}"] for drive, name in zip(self.file.drives, names, strict=True)], axis=1)

    def temperatures_c(self) -> dict[str, Array]:
        """Part temperatures by sensor, (r,) each."""
        return {name: self[f"{name}_temperature_c"] for name in self.file.sensors}

    def temperatures_of_parts_c(self) -> dict[str, Array]:
        """The same, if every part of the machine has its own. Raises InputError, naming the column that is missing."""
        for part, sensor in self.machine.sensors.items():
            if sensor not in self.file.sensors:
                raise _input_error(
                    self,
                    f"no column '{sensor}_temperature_c', by which the machine file has part '{part}' expand; add it "
                    f"and list '{sensor}' in 'sensors' of recording.toml, or give [expansion.{part}] another sensor",
                )
        return self.temperatures_c()

    def targets_m(self) -> Array:
        """Commanded poses (r, 6)."""
        names = ("target_x_m", "target_y_m", "target_z_m", "target_rx_rad", "target_ry_rad", "target_rz_rad")
        return np.stack([self[c] for c in names], axis=1)

    def payload_com_m(self) -> Array:
        """Centre of mass of the payload that was on (r, 3)."""
        by_payload = np.array([p.com_m for p in self.file.payloads])
        return by_payload[self["payload"].astype(int)]


def make_recording(file: RecordingFile, machine: Machine, rows: Sequence[Mapping[str, float | str]]) -> Recording:
    """A recording from row dictionaries. Raises InputError if a column is missing or a value is invalid.

    It has those optional columns that some row has; rows without them hold `columns.MISSING`.
    """
    if file.drives != machine.drive_names:
        raise InputError(
            f"recording {file.campaign}: drives {', '.join(file.drives)} are not the machine's "
            f"{', '.join(machine.drive_names)}"
        )
    if set(file.rotary_drives) != set(machine.rotary_drives):
        raise InputError(
            f"recording {file.campaign}: rotary_drives are {', '.join(file.rotary_drives) or 'none'}, the machine's "
            f"cranks {', '.join(machine.rotary_drives) or 'none'}; the columns of cranks are in radians, all others in "
            "metres"
        )
    columns: dict[str, Array] = {}
    table = [c for c in file.column_table() if c.required or any(c.name in row for row in rows)]
    for column in table:
        try:
            columns[column.name] = column.array(rows)
        except KeyError:
            raise InputError(f"recording {file.campaign}: a row lacks '{column.name}'") from None
    recording = Recording(file, machine, columns)
    if len(recording) == 0:
        raise _input_error(recording, "no readings")
    for column in table:
        try:
            column.check(columns[column.name])
        except InputError as error:
            raise _input_error(recording, str(error)) from None
    for check in (_check_geometry, _check_names, _check_setups, _check_times):
        check(recording)
    return recording


def _input_error(recording: Recording, text: str) -> InputError:
    return InputError(f"recording {recording.file.campaign}: {text}")


def _check_geometry(recording: Recording) -> None:
    """Points away from the station, targets near the workspace, proper covariances."""
    if np.any(np.linalg.norm(recording.positions_m, axis=1) < MIN_DISTANCE_M):
        raise _input_error(recording, "a point lies at the station itself; check x_m, y_m and z_m")
    moves = recording.machine.commanded[recording.machine.commanded < 3]
    box_m = recording.machine.workspace[moves]
    at_pose = np.asarray(recording["phase"]) != "nests"  # a nest has no target
    far = np.abs(recording.targets_m()[at_pose][:, moves] - box_m.mean(axis=1))
    if np.any(far > 2.0 * np.ptp(box_m, axis=1)):
        raise _input_error(recording, "a commanded pose lies far outside the workspace; check its unit")
    smallest = np.linalg.eigvalsh(recording.covariances_m2)[:, 0]
    if np.any(smallest <= 0.0):
        raise _input_error(recording, f"row {int(np.argmin(smallest)) + 1} has no proper covariance")


def _check_setups(recording: Recording) -> None:
    """A visit is measured from one set-up of the station."""
    at_pose = np.asarray(recording["phase"]) != "nests"
    pairs = np.unique(np.column_stack([recording["visit"], recording["station"]])[at_pose], axis=0)
    twice = np.flatnonzero(np.diff(pairs[:, 0]) == 0.0)
    if twice.size:
        visit = int(pairs[twice[0], 0])
        raise _input_error(recording, f"visit {visit} has readings of two set-ups (station); number its visits apart")


def _check_times(recording: Recording) -> None:
    """Visits follow one another: where all are of one moment, the station's drift, which grows with time, would be
    taken for an effect."""
    t, visit = recording["t_rig_s"], recording["visit"]
    if np.ptp(t) == 0.0 and np.ptp(visit) > 0.0:
        raise _input_error(
            recording,
            f"column 't_rig_s' is {t[0]:g} in every row, but the readings are of several visits; give the time of each",
        )


def _check_names(recording: Recording) -> None:
    """Unique names of readings, known phases, reflectors and payloads, and masses of payloads as listed."""
    for row, name in enumerate(recording["uid"].tolist(), start=1):
        if not UID.fullmatch(name):
            raise _input_error(
                recording, f"row {row}, column 'uid': {name[:20]!r} has more than letters, digits, . _ -"
            )
    uids, counts = np.unique(np.asarray(recording["uid"]), return_counts=True)
    if np.any(counts > 1):
        raise _input_error(recording, f"reading '{uids[np.argmax(counts)]}' occurs twice; keep one")
    for phase in sorted(set(recording["phase"].tolist()) - set(PHASES)):
        raise _input_error(recording, f"unknown phase '{phase}'; known: {', '.join(PHASES)}")
    known_names = {smr.name for smr in recording.machine.smrs}
    for row, smr in enumerate(recording["smr"].tolist(), start=1):
        if smr not in known_names:
            raise _input_error(
                recording,
                f"row {row}: SMR '{smr[:20]}' is not in its machine file; correct its name, or add it there",
            )
    payload = recording["payload"]
    if (unlisted := np.flatnonzero((payload < 0) | (payload >= len(recording.file.payloads)))).size:
        row, number = unlisted[0], payload[unlisted[0]]
        raise _input_error(recording, f"row {row + 1}: payload {number:g} is not listed; add it to [[payloads]]")
    listed = np.array([p.mass_kg for p in recording.file.payloads])[payload.astype(int)]
    if (other := np.flatnonzero(np.abs(listed - recording["payload_mass_kg"]) > 1e-6)).size:
        raise _input_error(
            recording, f"row {other[0] + 1}: payload_mass_kg contradicts [[payloads]]; correct one of them"
        )
