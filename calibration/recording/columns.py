"""The columns of a recording, each stated once: name, unit, kind, limits, whether it must be there, and its meaning.

From this table derive the order of the columns, the checks of their values, what the folder and the store write, and
the table in docs/reference/recording.md. Drives and part sensors have the same columns each under their own name;
a recording may declare further columns (`extra_columns`), whose unit is the end of their name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError

Kind = Literal["text", "count", "number"]
MISSING: Mapping[Kind, str | float] = {"text": "", "count": -1.0, "number": math.nan}
LARGEST_COUNT = 1e9
EXTRA_NAME = re.compile(r"[a-z][a-z0-9_]{0,99}")


@dataclass(frozen=True)
class Unit:
    """A unit by its symbol, and the largest absolute value in it that is plausible on a machine."""

    symbol: str
    largest: float = math.inf


# By the end of a column's name; of two that fit, the longer one counts.
UNITS: Mapping[str, Unit] = {
    "m": Unit("m", 1e3),
    "m2": Unit("m²", 1.0),
    "m_per_s": Unit("m/s", 1e3),
    "rad": Unit("rad", 1e2),
    "rad_per_s": Unit("rad/s", 1e3),
    "s": Unit("s", 1e11),
    "kg": Unit("kg", 1e5),
    "c": Unit("°C", 200.0),
    "k": Unit("K", 1e3),
    "hpa": Unit("hPa"),
    "percent": Unit("%"),
    "ppm": Unit("ppm"),
    "ratio": Unit("1"),
    "n": Unit("N", 1e7),
    "nm": Unit("N m", 1e7),
    "w": Unit("W", 1e7),
    "a": Unit("A", 1e5),
    "v": Unit("V", 1e5),
    "hz": Unit("Hz", 1e9),
    "pa": Unit("Pa", 1e9),
    "bar": Unit("bar", 1e4),
    "l_per_min": Unit("l/min", 1e5),
    "rpm": Unit("1/min", 1e6),
}


def unit_of(name: str) -> Unit | None:
    """The unit that a column's name ends in, None without one."""
    fitting = [suffix for suffix in UNITS if name == suffix or name.endswith(f"_{suffix}")]
    return UNITS[max(fitting, key=len)] if fitting else None


@dataclass(frozen=True)
class Column:
    """One column. A text is any text, a count a whole number, a number finite; each within its limits (inclusive).

    In a recording that has an optional column, a row without it holds MISSING of the column's kind.
    """

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    lowest: float = -math.inf
    largest: float = math.inf
    required: bool = True

    def array(self, rows: Sequence[Mapping[str, Any]]) -> Array:
        """The column's values (r,) from rows. Raises KeyError if a row lacks it and it is required."""
        values = [row[self.name] if self.required else row.get(self.name, MISSING[self.kind]) for row in rows]
        return np.array(values, dtype=str if self.kind == "text" else np.float64)

    def parse(self, cell: str) -> str | float:
        """The value of a cell of a CSV file. Raises ValueError if it is not a number and should be."""
        if self.kind == "text":
            return cell
        if not cell and not self.required:
            return MISSING[self.kind]
        return float(cell)

    def check(self, values: Array) -> None:
        """Raise InputError, naming the row, if a value is not finite, not a count or out of its limits."""
        if self.kind == "text":
            return
        missing = np.isnan(values) if not self.required and self.kind == "number" else np.zeros(len(values), dtype=bool)
        self._refuse(~np.isfinite(values) & ~missing, "is not finite; remove the row")
        if self.kind == "count":
            self._refuse((np.abs(values) > LARGEST_COUNT) | (values % 1.0 != 0.0), "is not a count")
        if self.lowest == 0.0:
            self._refuse(values < 0.0, "is negative; correct it, or put 0 where nobody recorded it")
        outside = np.flatnonzero((values < self.lowest) | (values > self.largest))
        if outside.size:
            value = values[outside[0]]
            raise InputError(f"row {outside[0] + 1}, column '{self.name}' = {value:g} is out of range; check its unit")

    def _refuse(self, wrong: NDArray[np.bool_], complaint: str) -> None:
        rows = np.flatnonzero(wrong)
        if rows.size:
            raise InputError(f"row {rows[0] + 1}, column '{self.name}' {complaint}")


def _text(name: str, meaning: str) -> Column:
    return Column(name, "text", meaning)


def _count(name: str, meaning: str, lowest: float = -LARGEST_COUNT) -> Column:
    return Column(name, "count", meaning, lowest=lowest, largest=LARGEST_COUNT)


def _number(name: str, meaning: str, lowest: float = -math.inf) -> Column:
    """A number in the unit that its name ends in, if it ends in one."""
    unit = unit_of(name) or Unit("")
    return Column(name, "number", meaning, unit.symbol, max(lowest, -unit.largest), unit.largest)


def rotary_quantity(name: str) -> str:
    """The name of a drive's quantity where its coordinate is an angle: 'actual_rad' for 'actual_m'."""
    for metres, radians in (("_m_per_s", "_rad_per_s"), ("_m", "_rad")):
        if name.endswith(metres):
            return name.removesuffix(metres) + radians
    return name


COLUMNS: tuple[Column, ...] = (
    _text("uid", "Unique name of the reading: up to 100 letters, digits, `.`, `_` and `-`; first a letter or a digit."),
    _text("phase", "`repeatability`, `nests`, `calibration`, `verification_before` or `verification_after`."),
    _text("smr", "Name of the reflector in the machine file."),
    _count("sequence", "Number of the reading in its campaign."),
    _count("visit", "Number of the visit: every arrival at a pose, approached anew."),
    _count("pose", "Number of the target within its phase; -1 without one."),
    _count("pass", "How often the target was visited before."),
    _count("nest_check", "Number of the last nest check begun; of a reading of a nest, the check that it belongs to."),
    _number("t_rig_s", "Rig time in the middle of the measurement."),
    _number("t_host_s", "Host time in the middle of the measurement."),
    _number("t_u_s", "Half the length of the measurement."),
    _number("hz_rad", "Horizontal angle, clockwise: mean of `samples`, reduced to face 1."),
    _number("v_rad", "Zenith angle: mean of `samples`, reduced to face 1."),
    _number("slope_distance_m", "Slope distance as the station gave it: mean of `samples`."),
    _count("station", "Number of the set-up: one more each time that the station was knocked, moved or set up anew."),
    _number("face", "1, 2, or 0 for the mean of both."),
    _number("prism_constant_m", "Prism constant with which the distance was measured."),
    _number("ppm", "Atmospheric correction with which the distance was measured."),
    _number("x_m", "The point in the station's frame: E = d sin V sin Hz."),
    _number("y_m", "N = d sin V cos Hz."),
    _number("z_m", "H = d cos V."),
    _number("cov_xx_m2", "Covariance of the point, random part, for the mean."),
    _number("cov_xy_m2", "Covariance of x and y."),
    _number("cov_xz_m2", "Covariance of x and z."),
    _number("cov_yy_m2", "Variance of y."),
    _number("cov_yz_m2", "Covariance of y and z."),
    _number("cov_zz_m2", "Variance of z."),
    _count("samples", "Number of single measurements averaged.", lowest=1.0),
    _number("target_x_m", "Commanded pose of the platform: x."),
    _number("target_y_m", "Commanded y."),
    _number("target_z_m", "Commanded z."),
    _number("target_rx_rad", "Commanded rotation vector: x."),
    _number("target_ry_rad", "Commanded rotation vector: y."),
    _number("target_rz_rad", "Commanded rotation vector: z."),
    _number("speed_m_per_s", "Speed of the approach.", lowest=0.0),
    _number("dwell_s", "Rig time since the target was reached.", lowest=0.0),
    _number("air_temperature_c", "Temperature of the air."),
    _number("pressure_hpa", "Pressure of the air."),
    _number("humidity_percent", "Relative humidity of the air."),
    _count("payload", "Number of the payload in `[[payloads]]`."),
    _number("payload_mass_kg", "Mass of the payload."),
    _number("compensation", "Generation of the active tables; 0 without tables."),
    _number("flags", "Number of warnings that the station gave with this reading, such as accuracy not guaranteed."),
)
# Each drive's columns, all read at one SYNC, begin with its name and an underscore.
DRIVE_COLUMNS: tuple[Column, ...] = (
    _number("commanded_m", "Commanded coordinate."),
    _number("actual_m", "Actual coordinate, in command coordinates."),
    _number("following_error_m", "Following error."),
    _number("velocity_m_per_s", "Velocity; below 1 mm/s (1 mrad/s) in each drive a reading is one at rest."),
    _number("torque_ratio", "Torque over rated torque."),
    _number("direction", "Side of the last approach: +1 from below, -1 from above."),
)
# Those of a rotary drive, such as a crank, are in radians.
ROTARY_COLUMNS: tuple[Column, ...] = tuple(
    _number(rotary_quantity(column.name), column.meaning) for column in DRIVE_COLUMNS
)
# Each part sensor's column begins with its name and an underscore.
SENSOR_COLUMNS: tuple[Column, ...] = (_number("temperature_c", "Temperature of a part."),)
OPTIONAL_COLUMNS: tuple[Column, ...] = tuple(
    replace(column, required=False)
    for column in (
        _count("edm_mode", "GeoCOM's number of the distance mode (2021), such as 2 for single standard."),
        _count("prism_type", "GeoCOM's number of the prism type (17009), such as 1 for mini."),
        _count(
            "replaces_visit", "The visit that this one was made in place of, whose readings are not used; -1 without."
        ),
        _number("t_utc_s", "Unix time (UTC) in the middle of the measurement."),
    )
)


def columns_of(
    drives: Sequence[str],
    sensors: Sequence[str],
    extra: Mapping[str, str] | None = None,
    rotary: Collection[str] = (),
) -> tuple[Column, ...]:
    """All columns that a recording may have, in order: required ones, then optional ones.

    extra: further columns that the recording declares, name to meaning; `check_extra_columns` checks their names.
    rotary: those of the drives whose coordinate is an angle.
    """
    return (
        *COLUMNS,
        *(
            replace(c, name=f"{drive}_{c.name}")
            for drive in drives
            for c in (ROTARY_COLUMNS if drive in rotary else DRIVE_COLUMNS)
        ),
        *(replace(c, name=f"{sensor}_{c.name}") for sensor in sensors for c in SENSOR_COLUMNS),
        *(_number(name, meaning) for name, meaning in (extra or {}).items()),
        *OPTIONAL_COLUMNS,
    )


def column_names(
    drives: Sequence[str],
    sensors: Sequence[str],
    extra: Mapping[str, str] | None = None,
    rotary: Collection[str] = (),
) -> tuple[str, ...]:
    """Names of the columns that a recording must have, in order."""
    return tuple(c.name for c in columns_of(drives, sensors, extra, rotary) if c.required)


def check_extra_columns(
    drives: Sequence[str], sensors: Sequence[str], extra: Mapping[str, str], rotary: Collection[str] = ()
) -> None:
    """Raise ValueError, in one line, if a further column's name is taken, is no name or does not end in a unit."""
    own_names = {column.name for column in columns_of(drives, sensors, rotary=rotary)}
    for name in extra:
        if name in own_names:
            raise ValueError(f"column '{name}' is one of the recording's own; choose another name")
        if EXTRA_NAME.fullmatch(name) is None:
            raise ValueError(f"column '{name[:40]}' is no name; use small letters, digits and underscores")
        if unit_of(name) is None or name in UNITS:
            raise ValueError(f"column '{name}' does not end in a unit; known: _{', _'.join(UNITS)}")
