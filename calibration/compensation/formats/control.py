"""What a control can hold, what is ordered of a format, and what it gives: the terms that all formats share."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.correction import Correction
from calibration.compensation.decomposition import DriveTables
from calibration.machine.description import Machine

READ_BY_LINUXCNC = "LinuxCNC 2.9 of Debian 12, not in real time and without a machine: try it with the axes held"
NODES_OF_TWO, NODES_OF_MORE = 65, 17  # along a drive; more drives leave fewer samples for a node


@dataclass(frozen=True)
class Control:
    """A control's limits, in its own units (mm or degrees); None: it has none that is documented.

    tables: how many; points: of one table; total_points: of all; largest: correction in all; steepest: its change a
    unit of travel; axis_name: pattern of an axis' name.
    """

    name: str
    title: str
    tables: int | None
    points: int
    total_points: int | None = None
    largest: float | None = None
    steepest: float | None = None
    axis_name: str = r"[A-Za-z][A-Za-z0-9]{0,15}"


@dataclass(frozen=True)
class Order:
    """What is to be written: the correction, for which control, the names of its axes, one a drive, and notes.

    notes: lines that say where the correction comes from; plain text.
    """

    correction: Correction
    control: Control
    axes: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.correction.machine

    @property
    def count(self) -> int:
        """Number of drives."""
        return len(self.machine.drive_names)

    @property
    def nodes(self) -> int:
        """How many nodes a table over one drive gets."""
        return min(self.control.points, NODES_OF_TWO if self.count == 2 else NODES_OF_MORE)

    def scale(self, drive: int) -> float:
        """A drive's unit at the control, mm or degrees, for one of ours, m or rad."""
        return 180.0 / np.pi if self.machine.drive_kinds[drive] == "crank" else 1e3

    def unit(self, drive: int) -> str:
        """Its name."""
        return "degrees" if self.machine.drive_kinds[drive] == "crank" else "mm"


@dataclass(frozen=True)
class ControlFiles:
    """Files (name to text), the tables as the control will read them, rounding included, and how many it needs."""

    files: Mapping[str, str]
    tables: tuple[DriveTables, ...]
    needed: int


@dataclass(frozen=True)
class TableFormat:
    """A format of tables.

    sign: what the control does with a value. read_by: vendor's software that has read such a file, None if none has.
    default_axes: names for a machine's drives, None where they have to be given.
    """

    name: str
    title: str
    controls: tuple[Control, ...]
    holds: str
    sign: str
    interpolation: str
    read_by: str | None
    build: Callable[[Order], ControlFiles]
    default_axes: Callable[[Machine], tuple[str, ...]] | None

    def control(self, name: str | None) -> Control:
        """A control by its name, the first one without; InputError if there is none."""
        for control in self.controls:
            if name in (None, control.name):
                return control
        known = ", ".join(control.name for control in self.controls)
        raise InputError(f"format {self.name}: no control '{name}'; known: {known}")

    @property
    def trial(self) -> str:
        """Whether the vendor's software has read such a file, in one sentence."""
        if self.read_by is None:
            return f"No software of the vendor has read a {self.title} file of ours yet: try it with the axes held."
        return f"Read by {self.read_by}."


def axis_names(form: TableFormat, control: Control, given: str | None, machine: Machine) -> tuple[str, ...]:
    """The control's names of the drives' axes, in the order of the machine file; InputError where they cannot be."""
    drives = machine.drive_names
    if given is None:
        if form.default_axes is None:
            raise InputError(
                f"format {form.name}: give the control's names of the axes with --axes, one for each of "
                f"{', '.join(drives)}, for example --axes {','.join('XYZUVWAB'[: len(drives)])}"
            )
        return form.default_axes(machine)
    names = tuple(name.strip() for name in given.split(","))
    if len(names) != len(drives) or len(set(names)) != len(names):
        raise InputError(
            f"--axes {given}: give {len(drives)} different names, one for each of {', '.join(drives)}, with commas"
        )
    for name in names:
        if not re.fullmatch(control.axis_name, name):
            raise InputError(f"--axes: '{name}' is no name of an axis at {control.title}; it takes {control.axis_name}")
    return names


def check_control(order: Order, tables: tuple[DriveTables, ...], needed: int, points: list[int]) -> None:
    """InputError unless the control can hold the tables and takes their corrections; points: of each table."""
    control = order.control
    if control.tables is not None and needed > control.tables:
        raise InputError(f"{control.title} has {control.tables} tables, {needed} are needed; choose another control")
    if points and max(points) > control.points:
        raise InputError(f"{control.title} takes {control.points} points a table, {max(points)} are needed")
    if control.total_points is not None and sum(points) > control.total_points:
        raise InputError(f"{control.title} takes {control.total_points} points in all, {sum(points)} are needed")
    for drive, own in enumerate(tables):
        name, unit, scale = order.axes[drive], order.unit(drive), order.scale(drive)
        largest = float(np.max(np.abs(own.at(order.correction.fitted.drives)))) * scale
        if control.largest is not None and largest > control.largest:
            raise InputError(
                f"axis {name}: a correction of {largest:.4f} {unit}; {control.title} takes {control.largest:g} {unit}"
            )
        slope = float(np.max(np.abs(slopes(own, order.correction.fitted.drives))))
        if control.steepest is not None and slope > control.steepest:
            raise InputError(
                f"axis {name}: the correction changes by {slope:.4f} a unit of travel; {control.title} takes "
                f"{control.steepest:g}"
            )


def slopes(tables: DriveTables, drives: Array) -> Array:
    """Changes (n, d) of a drive's correction with each drive, at drive positions (n, d)."""
    out = np.empty_like(drives)
    for j in range(drives.shape[1]):
        step = 1e-4 * float(np.ptp(drives[:, j]))
        ahead = drives.copy()
        ahead[:, j] += step
        behind = drives.copy()
        behind[:, j] -= step
        out[:, j] = (tables.at(ahead) - tables.at(behind)) / (2.0 * step)
    return out


def fixed(value: float, decimals: int = 6) -> str:
    """A number with fixed decimals; no negative zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def comment_lines(order: Order, form_lines: tuple[str, ...], mark: str) -> list[str]:
    """Notes and what the format says of itself, as comments."""
    return [f"{mark} {line}" for line in (*order.notes, *form_lines)]
