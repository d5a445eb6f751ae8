"""Recordings of one axis alone: command, motor, second position and torque over time, as plain files.

docs/reference/axis-recording.md defines the format: axis.toml and samples.csv. A folder is untrusted input: data only,
bounded in size, checked. All that comes out is SI.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.csv_table import read_table, write_table
from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.base.toml_file import parse_toml
from calibration.base.toml_text import to_toml
from calibration.recording.axis_header import FORCES, LINEAR, ROTARY, SECONDS, TORQUES, AxisFile
from calibration.recording.axis_wrong_samples import without_wrong_samples

HEADER, SAMPLES = "axis.toml", "samples.csv"
PAGE = "docs/reference/axis-recording.md"
NEEDED, OPTIONAL = ("time", "motor_position", "second_position"), ("command", "torque")
LEAST_SAMPLES = 200
UNEVEN = 0.1  # of the mean step, by which a step of time may differ
LARGEST_POSITION, LARGEST_TORQUE, LONGEST_S = 1e6, 1e12, 1e7
FOLLOWS = (0.5, 2.0)  # slope of the second position over the motor's, outside of which they are of different sides


@dataclass(frozen=True)
class AxisRecording:
    """Evenly sampled signals (n,) of one axis in SI units: s, rad or m, Nm or N.

    motor, second: positions on the load's side. torque: on the load's side where the header has the ratio.
    """

    file: AxisFile
    time_s: Array
    motor: Array
    second: Array
    command: Array | None = None
    torque: Array | None = None

    @property
    def step_s(self) -> float:
        """Time between two samples."""
        return float(self.time_s[-1] - self.time_s[0]) / (len(self.time_s) - 1)


def is_axis_folder(folder: Path) -> bool:
    """Whether a folder says that it is one."""
    return (folder / HEADER).is_file()


def read_axis_folder(folder: Path) -> AxisRecording:
    """Read and check the recording of an axis. Raises InputError, in one line, if it is invalid."""
    header = folder / HEADER
    file = parse_toml(read_text(header), AxisFile, str(header))
    path = folder / SAMPLES
    table = read_table(path, NEEDED, OPTIONAL, page=PAGE)
    if ("torque" in table) != (file.torque_unit is not None):
        missing = "torque_unit and torque_side" if "torque" in table else f"column 'torque' in {SAMPLES}"
        raise InputError(f"{header}: torque is there without {missing}; give both or none ({PAGE})")
    positions = (ROTARY if file.kind == "rotary" else LINEAR)[file.position_unit]
    time_s = (table["time"] - table["time"][0]) * SECONDS[file.time_unit]  # of whatever clock
    _check_time(path, time_s)
    motor, second = table["motor_position"] * positions, table["second_position"] * positions
    command = table["command"] * positions if "command" in table else None
    for name, column in (("motor_position", motor), ("second_position", second), ("command", command)):
        _check_size(path, name, column, LARGEST_POSITION, file.unit)
    torque = None
    if file.torque_unit is not None:
        torque = table["torque"] * (TORQUES | FORCES)[file.torque_unit]
        if file.torque_side == "motor" and file.ratio is not None:
            torque = torque * file.ratio
        _check_size(path, "torque", torque, LARGEST_TORQUE, "Nm or N")
    _check_motion(path, time_s, motor, second)
    return AxisRecording(file, time_s, motor, second, command, torque)


def write_axis_folder(file: AxisFile, columns: dict[str, Array], folder: Path) -> None:
    """Write a folder that does not exist yet: columns (n,) of samples.csv in the units of the header.

    Raises InputError if it exists or cannot be written.
    """
    if folder.exists():
        raise InputError(f"{folder}: exists already; choose another folder")
    try:
        folder.mkdir(parents=True)
        for name, content in ((HEADER, to_toml(file)), (SAMPLES, write_table(columns))):
            with (folder / name).open("w", encoding="utf-8") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}; choose another folder") from error


def _check_time(path: Path, time_s: Array) -> None:
    if len(time_s) < LEAST_SAMPLES:
        raise InputError(f"{path}: {len(time_s)} samples; it needs at least {LEAST_SAMPLES}")
    _check_size(path, "time", time_s, LONGEST_S, "s after the first")
    steps = np.diff(time_s)
    if (back := np.flatnonzero(steps <= 0.0)).size:
        raise InputError(f"{path}: line {back[0] + 3}: time does not rise; remove what was recorded twice")
    usual = float(np.median(steps))  # a gap would change the mean
    if (uneven := np.flatnonzero(np.abs(steps - usual) > UNEVEN * usual)).size:
        raise InputError(
            f"{path}: line {uneven[0] + 3}: a step of {steps[uneven[0]]:.3g} s among steps of {usual:.3g} s; "
            "record at an even rate without gaps, or cut the recording there"
        )


def _check_size(path: Path, name: str, column: Array | None, most: float, unit: str) -> None:
    if column is not None and (large := np.flatnonzero(np.abs(column) > most)).size:
        raise InputError(f"{path}: line {large[0] + 2}, column '{name}': more than {most:g} {unit}; check the unit")


def _check_motion(path: Path, time_s: Array, motor: Array, second: Array) -> None:
    centred = motor - motor.mean()
    if not float(centred @ centred) > 0.0 or float(np.ptp(motor)) <= 1e-12 * float(np.max(np.abs(motor))):
        raise InputError(f"{path}: the motor stands still; record a motion")
    if np.array_equal(motor, second):
        raise InputError(f"{path}: the second position is the motor's, value by value; record a second one")
    mended, of_second, _ = without_wrong_samples(time_s, motor, second)
    centred = mended - mended.mean()
    slope = float(centred @ of_second) / float(centred @ centred)
    if not FOLLOWS[0] < slope < FOLLOWS[1]:
        raise InputError(
            f"{path}: the second position moves {slope:.3g} times as far as the motor's; state both on the load's side "
            "in one unit, with one sign"
        )
