"""Measurement folders: a machine measured by anything but reflectors, as plain files that any program can write.

docs/reference/measurements.md defines the format: measurements.toml, machine.toml, coordinates.csv and distances.csv.
A folder is untrusted input: data only, bounded in size, checked.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.csv_table import read_table, require_counts, write_table
from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.base.toml_file import parse_toml
from calibration.base.toml_text import to_toml
from calibration.instruments.distances import Distances
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import COORDINATES, Machine, parse_machine
from calibration.machine.equilibrium import workspace_middle
from calibration.model.parameters import KINDS, ParameterSet
from calibration.model.visits import Visits
from calibration.recording.measurement_conditions import checked_conditions, names_of, with_loads
from calibration.recording.measurement_header import MeasurementFile

HEADER, MACHINE, COORDINATE_TABLE, DISTANCE_TABLE = (
    "measurements.toml",
    "machine.toml",
    "coordinates.csv",
    "distances.csv",
)
COLUMNS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
TARGETS = tuple(f"target_{c}" for c in COLUMNS)
TRAVEL_MARGIN = 0.1  # of a drive's travel, by which a coordinate may lie beyond it


@dataclass(frozen=True)
class MeasuredMachine:
    """A machine with visits and what was measured of them.

    visits (v); number (v,): how distances.csv calls each; coordinates (v, 6), NaN where not measured; pairs (r, 2)
    rows of the visits (a single one, (r, 1), with a ball on the base) with distance_m (r,). conditions: what else is
    said of the visits, (v,) by column (`measurement_conditions`); sensors: those whose temperatures were recorded.
    """

    file: MeasurementFile
    machine: Machine
    visits: Visits
    number: Array
    coordinates: Array
    pairs: Array
    distance_m: Array
    conditions: Mapping[str, Array] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()

    def readings(self, *, instrument_unknowns: bool = True) -> tuple[Readings, ...]:
        """The readings of each kind; without instrument_unknowns an instrument has no unknowns but its frame."""
        out: list[Readings] = []
        if self.file.columns:
            chosen = sorted(COLUMNS.index(c) for c in self.file.columns)
            entries = [self.file.columns[COLUMNS[c]] for c in chosen]  # type: ignore[index]
            rows = np.flatnonzero(np.isfinite(self.coordinates[:, chosen[0]]))
            value = np.nan_to_num(self.coordinates[rows])
            sigma = np.tile([e.sd for e in entries], (len(rows), 1))
            offset = tuple(e.offset_u for e in entries) if instrument_unknowns else ()
            touched = ToolCoordinates(rows, tuple(chosen), value, sigma, self.file.own_frame, offset)
            if (bed := self.file.bed) is not None and instrument_unknowns:
                touched = replace(touched, bowl_u_m=bed.bowl_u_m, bowl_radius_m=bed.radius_m)
            out.append(touched)
        distances = self.file.distances
        if distances is not None:
            pairs = self.pairs.astype(np.intp)
            sigma = np.full(len(pairs), distances.sd_m)
            ball = distances.centre_m is not None
            out.append(
                Distances(
                    first=pairs[:, 0],
                    second=None if ball else pairs[:, 1],
                    distance_m=self.distance_m,
                    sigma_m=sigma,
                    centre_m=np.array(distances.centre_m) if ball else None,
                    centre_u_m=distances.centre_u_m if instrument_unknowns else 0.0,
                    length_u_m=distances.length_u_m if instrument_unknowns else 0.0,
                    scale_u=distances.scale_u if instrument_unknowns else 0.0,
                )
            )
        return tuple(out)

    def line_of(self, readings: Readings, row: int) -> tuple[str, str]:
        """File and line of one of the `readings`, and what it is of, for people."""
        if isinstance(readings, ToolCoordinates):
            visit = int(readings.visit[row])
            return f"{COORDINATE_TABLE} line {visit + 2}", f"visit {self.number[visit]:g}"
        visits = " to ".join(f"{number:g}" for number in self.number[self.pairs[row].astype(int)])
        return f"{DISTANCE_TABLE} line {row + 2}", f"distance, visit {visits}"

    def without(self, wrong: Sequence[NDArray[np.intp]]) -> MeasuredMachine:
        """The same without some rows of each of the `readings`."""
        coordinates, keep = self.coordinates.copy(), np.ones(len(self.distance_m), dtype=bool)
        for readings, rows in zip(self.readings(), wrong, strict=True):
            if isinstance(readings, ToolCoordinates):
                coordinates[readings.visit[rows]] = np.nan
            else:
                keep[rows] = False
        return replace(self, coordinates=coordinates, pairs=self.pairs[keep], distance_m=self.distance_m[keep])

    def parameters(self) -> ParameterSet:
        """The parameters to be fitted: the kinds that the file names, all if it names none."""
        return ParameterSet.of(self.machine, self.file.unknowns or KINDS)


def is_measurement_folder(folder: Path) -> bool:
    """Whether a folder says that it is one."""
    return (folder / HEADER).is_file()


def write_measurements(measured: MeasuredMachine, folder: Path) -> None:
    """Write the files of a folder that does not exist yet; floats round-trip."""
    if folder.exists():
        raise InputError(f"{folder}: exists already; choose another folder")
    machine, visits = measured.machine, measured.visits
    table = {"visit": measured.number}
    table |= {name: visits.drives[:, a] for a, name in enumerate(drive_columns(machine))}
    table |= {f"{sensor}_temperature_c": t for sensor, t in visits.temperatures_c.items()}
    table |= {name: visits.target_m[:, c] for c, name in enumerate(TARGETS)}
    table |= measured.conditions
    table |= {name: measured.coordinates[:, COLUMNS.index(name)] for name in measured.file.columns}
    files = {HEADER: to_toml(measured.file), MACHINE: machine.text, COORDINATE_TABLE: write_table(table)}
    if measured.file.distances is not None:
        names = ("first", "second")[: measured.pairs.shape[1]]
        pairs = {name: measured.number[measured.pairs[:, i].astype(int)] for i, name in enumerate(names)}
        files[DISTANCE_TABLE] = write_table({**pairs, "distance_m": measured.distance_m})
    try:
        folder.mkdir(parents=True)
        for name, content in files.items():
            with (folder / name).open("w", encoding="utf-8") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}; choose another folder") from error


def read_measurements(folder: Path) -> MeasuredMachine:
    """Read and check a measurement folder. Raises InputError, in one line, if it is invalid."""
    header = folder / HEADER
    file = parse_toml(read_text(header), MeasurementFile, str(header))
    machine = parse_machine(read_text(folder / MACHINE), str(folder / MACHINE))
    _check_names(file, machine, header)
    path = folder / COORDINATE_TABLE
    drives = drive_columns(machine)
    sensors = tuple(dict.fromkeys(machine.sensors.values()))
    warm = [f"{sensor}_temperature_c" for sensor in sensors]
    table = read_table(path, ["visit", *drives, *file.columns], [*warm, *TARGETS, *names_of(machine)], file.columns)
    number = require_counts(path, "visit", table["visit"])
    if len(np.unique(number)) != len(number):
        raise InputError(f"{path}: a visit's number occurs twice; number the visits 0, 1, 2 ...")
    n = len(number)
    positions = np.column_stack([table[name] for name in drives])
    _check_travel(path, machine, positions)
    target_columns = [name for name in TARGETS if name in table]
    if target_columns and len(target_columns) != len(TARGETS):
        raise InputError(f"{path}: of the six target columns some are missing; give all or none")
    target = (
        np.column_stack([table[c] for c in TARGETS]) if target_columns else np.tile(workspace_middle(machine), (n, 1))
    )
    reference = np.full(n, machine.reference_temperature_c)
    visits = Visits(
        positions,
        target,
        np.zeros(n),
        np.zeros((n, 3)),
        {sensor: table.get(f"{sensor}_temperature_c", reference) for sensor in sensors},
    )
    conditions = checked_conditions(path, machine, table)
    coordinates = np.full((n, 6), np.nan)
    for name in file.columns:
        coordinates[:, COLUMNS.index(name)] = table[name]
    _check_coordinates(path, file, machine, coordinates)
    pairs, distance = _distances(folder / DISTANCE_TABLE, file, machine, number)
    return MeasuredMachine(
        file,
        machine,
        with_loads(visits, conditions),
        number,
        coordinates,
        pairs,
        distance,
        conditions,
        tuple(sensor for sensor in sensors if f"{sensor}_temperature_c" in table),
    )


def drive_columns(machine: Machine) -> list[str]:
    """Names of the columns of the drives' coordinates."""
    kinds = zip(machine.drive_names, machine.drive_kinds, strict=True)
    return [f"{name}_actual_{'rad' if kind == 'crank' else 'm'}" for name, kind in kinds]


def _check_names(file: MeasurementFile, machine: Machine, header: Path) -> None:
    parameter_names = ParameterSet.of(machine).names
    for quantity in file.quantities:
        if strange := [name for name in quantity.of if name not in parameter_names]:
            raise InputError(
                f"{header}: quantity '{quantity.name}' names the unknown parameter '{strange[0][:60]}'; correct it"
            )
    for what, kinds in (("unknowns", file.unknowns), ("former.unknowns", file.former and file.former.unknowns)):
        if kinds and not len(ParameterSet.of(machine, kinds)):
            raise InputError(f"{header}: {what}: the machine has no such parameter; name other kinds")


def _check_travel(path: Path, machine: Machine, positions: Array) -> None:
    slack = TRAVEL_MARGIN * (machine.travel[:, 1] - machine.travel[:, 0])
    outside = (positions < machine.travel[:, 0] - slack) | (positions > machine.travel[:, 1] + slack)
    if np.any(outside):
        row, drive = np.argwhere(outside)[0]
        raise InputError(
            f"{path}: line {row + 2}, drive {machine.drive_names[drive]}: {positions[row, drive]:g} is outside its "
            "travel; use metres and radians, or correct the travel in machine.toml"
        )


def _check_coordinates(path: Path, file: MeasurementFile, machine: Machine, coordinates: Array) -> None:
    if not file.columns:
        return
    chosen = sorted(COLUMNS.index(c) for c in file.columns)
    there = np.isfinite(coordinates[:, chosen])
    if wrong := np.flatnonzero(np.any(there, axis=1) & ~np.all(there, axis=1)).tolist():
        raise InputError(f"{path}: line {wrong[0] + 2}: some coordinates are empty; give all of a visit or none")
    if not np.any(there):
        raise InputError(f"{path}: no visit has a measured coordinate; remove [columns] from {HEADER}")
    if unfree := [c for c in chosen if c not in machine.dof and not file.own_frame]:
        raise InputError(
            f"{path}: {COORDINATES[unfree[0]]} is measured, but the machine is not free in it; leave it out"
        )
    if file.own_frame:
        return
    room = np.max(machine.workspace[:3, 1] - machine.workspace[:3, 0])
    for c in (c for c in chosen if c < 3):
        low, high = machine.workspace[c]
        far = np.flatnonzero((coordinates[:, c] < low - room) | (coordinates[:, c] > high + room))
        if far.size:
            raise InputError(
                f"{path}: line {far[0] + 2}, column '{COLUMNS[c]}': {coordinates[far[0], c]:g} is far outside the "
                "workspace; use metres, or correct the workspace in machine.toml"
            )


def _distances(path: Path, file: MeasurementFile, machine: Machine, number: Array) -> tuple[Array, Array]:
    """Rows of the visits of each distance, and the distances; none where the file states none."""
    if file.distances is None:
        if path.exists():
            raise InputError(f"{path}: {HEADER} has no [distances] for it; state their sd_m")
        return np.zeros((0, 2)), np.zeros(0)
    ball = file.distances.centre_m is not None
    names = ["first"] if ball else ["first", "second"]
    table = read_table(path, [*names, "distance_m"])
    order = np.argsort(number)
    pairs = np.empty((len(table["distance_m"]), len(names)))
    for i, name in enumerate(names):
        visit_numbers = require_counts(path, name, table[name])
        rows_found = order[np.minimum(np.searchsorted(number[order], visit_numbers), len(number) - 1)]
        if (strange := np.flatnonzero(number[rows_found] != visit_numbers)).size:
            raise InputError(
                f"{path}: line {strange[0] + 2}: there is no visit {visit_numbers[strange[0]]:g} in {COORDINATE_TABLE}"
            )
        pairs[:, i] = rows_found
    if not ball and (same := np.flatnonzero(pairs[:, 0] == pairs[:, 1])).size:
        raise InputError(f"{path}: line {same[0] + 2}: a distance from a visit to itself; name two visits")
    room = 2.0 * np.linalg.norm(machine.workspace[:3, 1] - machine.workspace[:3, 0])
    distance = table["distance_m"]
    wrong = np.flatnonzero((distance <= 0.0) | ((distance > room) & (not ball)))
    if wrong.size:
        raise InputError(
            f"{path}: line {wrong[0] + 2}: {distance[wrong[0]]:g} is no distance within the workspace; use metres"
        )
    return pairs, distance
