"""recording.toml: with what a campaign was measured, and what is stated of the instruments.

The rig file shares these sections. docs/reference/recording.md defines them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from calibration.base.arrays import Array
from calibration.base.toml_file import Label, Section
from calibration.instruments.station_geometry import CertifiedLength, StationAccuracy
from calibration.model.payload import PayloadEntry
from calibration.recording.columns import Column, check_extra_columns, columns_of

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]


def _check_campaign(name: str) -> str:
    if name.lower().startswith(STORE_FILES):
        raise ValueError(f"a campaign's id does not begin with {' or '.join(STORE_FILES)}, as the files of a store do")
    return name


STORE_FILES = ("pkm-rig.", "pkm-rig-schema-")  # a campaign has a folder of its name beside them
CampaignId = Annotated[Name, AfterValidator(_check_campaign)]


# No instrument that measures is worse than this: what is beyond was written in another unit, and what is as good as
# unknown makes the equations singular.
MOST_SD_RAD, MOST_SD_M, MOST_SCALE = 0.01, 0.1, 0.01
MOST_DISTANCE_M, MOST_ANGLE_RAD = 1.0e3, 100.0  # as of the readings
Coordinate = Annotated[float, Field(ge=-MOST_DISTANCE_M, le=MOST_DISTANCE_M)]


class AccuracyEntry(Section):
    """What is stated of the station: standard deviations of a reading, standard uncertainty of its ranges."""

    angle_sd_rad: float = Field(gt=0.0, le=MOST_SD_RAD, description="Standard deviation of an angle.")
    range_sd_m: float = Field(gt=0.0, le=MOST_SD_M, description="Standard deviation of a distance.")
    range_constant_u_m: float = Field(
        gt=0.0, le=MOST_SD_M, description="Standard uncertainty of the constant of all distances."
    )
    range_scale_u: float = Field(
        ge=0.0, le=MOST_SCALE, description="Standard uncertainty of the scale of all distances."
    )
    drift_rad_per_sqrt_h: float = Field(
        gt=0.0, le=MOST_SD_RAD, default=3.0e-6, description="Drift of the frame's direction, as a random walk."
    )
    drift_of_level_rad_per_sqrt_h: float = Field(
        gt=0.0, le=MOST_SD_RAD, default=1.0e-6, description="Drift of the frame's level, as a random walk."
    )
    drift_m_per_sqrt_h: float = Field(
        gt=0.0, le=MOST_SD_M, default=1.0e-5, description="Drift of the frame's origin, as a random walk."
    )

    def to_station_accuracy(self) -> StationAccuracy:
        """For computation."""
        return StationAccuracy(self.angle_sd_rad, self.range_sd_m, self.range_constant_u_m, self.range_scale_u)


class StationEntry(Section):
    """The station: its rough place in the machine frame, its heading and its accuracy."""

    name: Label = Field(default="station", description="Name, for reports.")
    position_m: tuple[Coordinate, Coordinate, Coordinate] = Field(description="Rough position in the machine frame.")
    heading_rad: float = Field(
        ge=-MOST_ANGLE_RAD,
        le=MOST_ANGLE_RAD,
        default=0.0,
        description="Rough heading: 0 looks along -z of the machine, positive clockwise from above.",
    )
    accuracy: AccuracyEntry = Field(description="Stated accuracy.")


class LengthEntry(Section):
    """A certified distance between two floor nests."""

    nests: tuple[str, str] = Field(description="The two nests.")
    value_m: float = Field(gt=0.0, le=MOST_DISTANCE_M, description="Certified distance.")
    u_m: float = Field(gt=0.0, le=MOST_SD_M, description="Its standard uncertainty.")

    def to_certified_length(self) -> CertifiedLength:
        """For computation."""
        return CertifiedLength(self.nests, self.value_m, self.u_m)


MOST_SPEED_M_PER_S, MOST_DWELL_S = 2.0, 600.0  # that a rig may be asked for; of recordings that others made it is more
MOST_LEVEL_M, MOST_LEVEL_K = 1.0e-3, 5.0  # beyond these a level is in another unit, and would hide every effect


class DisturbanceLevels(Section):
    """Levels of ordinary disturbances, one standard deviation each."""

    drift_m: float = Field(ge=0.0, default=0.0, description="Drift of the station's frame in an hour, 3 m away.")
    reseat_m: float = Field(
        ge=0.0, default=0.0, description="Shift of a reflector, along each axis, when it is put back into its nest."
    )
    reversal_m: float = Field(ge=0.0, default=0.0, description="Half the reversal error of a drive.")
    temperature_k: float = Field(ge=0.0, default=0.0, description="Slow variation of a part about its sensor.")


class DeclaredLevels(DisturbanceLevels):
    """Declared levels of ordinary disturbances, one standard deviation each.

    What is not declared is not zero: defaults are those of an ordinary rig in a workshop, each within a factor of
    three. Zero has to be declared. What each level is of, and how a quiet campaign gives it:
    [disturbances.md](../explanation/disturbances.md).
    """

    drift_m: float = Field(
        ge=0.0,
        le=MOST_LEVEL_M,
        default=3.0e-6,
        description="Drift of the station's frame in an hour of rig time, a random walk: shift in all three "
        "directions, and rotation as it shows 3 m away.",
    )
    reseat_m: float = Field(
        ge=0.0,
        le=MOST_LEVEL_M,
        default=2.0e-6,
        description="Shift of a reflector, along each of the three axes, when it is put back into its nest: on "
        "platform and sliders anew at each exchange of the payload, in floor nests at each check.",
    )
    reversal_m: float = Field(
        ge=0.0,
        le=MOST_LEVEL_M,
        default=1.0e-6,
        description="Half the reversal error of a drive, along its own axis: half of what it is off between the two "
        "sides it comes from; constant over the campaign.",
    )
    temperature_k: float = Field(
        ge=0.0,
        le=MOST_LEVEL_K,
        default=0.02,
        description="Slow variation of a part about its sensor, of each strut and, in proportion to its travel, of "
        "each drive along its axis; in waves of 25 minutes and longer over the campaign.",
    )

    @model_serializer(mode="wrap")
    def _declared_keys(self, serialise: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A key that was not declared stays so when it is written and read: its prior is a wider one."""
        return {key: value for key, value in serialise(self).items() if key in self.model_fields_set}


class SessionEntry(Section):
    """One process' work on the campaign."""

    number: int = Field(ge=1, description="From 1.")
    command: str = Field(default="", description="Command that measured.")
    why: str = Field(default="", description="How it ended: finished, interrupted, refused, failed or killed.")
    first_sequence: int = Field(description="Number of its first reading.")
    begin_rig_s: float = Field(description="Rig time at its begin.")
    end_rig_s: float = Field(description="Rig time at its end.")
    begin_utc_s: float | None = Field(default=None, description="Unix time at its begin, where it is known.")
    end_utc_s: float | None = Field(default=None, description="Unix time at its end, where it is known.")
    time: Literal["measured", "repaired", "unknown"] = Field(
        default="measured",
        description="The time since the session before: `measured`, `repaired` where rig time had begun anew, or "
        "`unknown`; no effect of time is then used across it.",
    )


Nodes = Annotated[tuple[Annotated[float, Field(ge=-1.0e3, le=1.0e3)], ...], Field(min_length=2, max_length=64)]
Correction = Annotated[float, Field(ge=-1.0, le=1.0)]


class KnownTable(Section):
    """A compensation table that is kept for the machine, active or not: metres that are added to a drive's command,
    bilinear between its nodes, held at the edge beyond them."""

    generation: int = Field(ge=1, description="Generation that the table belongs to; it has at most one a drive.")
    drive: Name = Field(description="Drive that it corrects.")
    own_m: Nodes = Field(description="Nodes of that drive's commanded coordinate, rising.")
    partner: Name | None = Field(default=None, description="Drive whose commanded coordinate it depends on as well.")
    partner_m: Nodes | None = Field(default=None, description="Nodes of the partner's commanded coordinate, rising.")
    corrections_m: tuple[tuple[Correction, ...], ...] = Field(
        description="Corrections: a list for each own node, with one value for each node of the partner, or one alone."
    )

    @model_validator(mode="after")
    def _check_grid(self) -> Self:
        if (self.partner is None) != (self.partner_m is None):
            raise ValueError("'partner' and 'partner_m' go together")
        if self.partner == self.drive:
            raise ValueError("'partner' is the drive itself")
        for nodes in (self.own_m, self.partner_m or (0.0,)):
            if np.any(np.diff(nodes) <= 0.0):
                raise ValueError("the nodes of a table rise")
        columns = len(self.partner_m or (0.0,))
        if len(self.corrections_m) != len(self.own_m) or any(len(row) != columns for row in self.corrections_m):
            raise ValueError(f"'corrections_m' holds {len(self.own_m)} lists of {columns}, one value a node")
        return self

    def at_nodes_m(self, own_m: Array, partner_m: Array) -> Array:
        """Corrections (n, 3) of a control that does not interpolate, at coordinates (n,) of the drive and its partner:
        of the node of the drive below and above, and of those of both drives below."""
        corrections = np.array(self.corrections_m)
        row, up = _cell(self.own_m, own_m)
        column, along = _cell(self.partner_m or (0.0,), partner_m)
        beside = np.minimum(column + 1, corrections.shape[1] - 1)
        below, above = row + (up >= 1.0), row + (up > 0.0)
        of_node = [(1.0 - along) * corrections[r, column] + along * corrections[r, beside] for r in (below, above)]
        return np.column_stack([*of_node, corrections[below, np.where(along >= 1.0, beside, column)]])

    def correction_m(self, own_m: Array, partner_m: Array) -> Array:
        """Corrections (n,) at commanded coordinates (n,) of the drive and of its partner."""
        corrections = np.array(self.corrections_m)
        row, up = _cell(self.own_m, own_m)
        column, along = _cell(self.partner_m or (0.0,), partner_m)
        beside = np.minimum(column + 1, corrections.shape[1] - 1)
        low, high = ((1.0 - along) * corrections[r, column] + along * corrections[r, beside] for r in (row, row + 1))
        return np.asarray((1.0 - up) * low + up * high)


def _cell(nodes: tuple[float, ...], at: Array) -> tuple[NDArray[np.intp], Array]:
    """First node (n,) of the cell that holds each coordinate (n,), and how far (n,) across it, in [0, 1]."""
    if len(nodes) == 1:
        return np.zeros(len(at), dtype=np.intp), np.zeros(len(at))
    grid = np.array(nodes)
    first = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
    across = (at - grid[first]) / (grid[first + 1] - grid[first])
    return first, np.clip(across, 0.0, 1.0)


class RecordingFile(Section):
    """The header of a recording: the rig, its station and payloads, and the stated accuracies."""

    format: Literal[1] = Field(description="Version of the format.")
    campaign: CampaignId = Field(description="Id of the campaign; not that of a store's file (`pkm-rig.`...).")
    rig: Name = Field(description="Name of the rig.")
    created: str = Field(description="UTC, ISO 8601.")
    software: str = Field(description="Program that wrote the recording, with its version.")
    drives: tuple[Name, ...] = Field(description="Drives, in the order of the machine file.")
    rotary_drives: tuple[Name, ...] = Field(
        default=(), description="Those of them whose coordinate is an angle: their columns are in radians."
    )
    sensors: tuple[Name, ...] = Field(description="Temperature sensors of parts that are recorded.")
    station: StationEntry = Field(description="The station.")
    nest_length: LengthEntry | None = Field(default=None, description="A certified distance.")
    nest_limit_m: float = Field(
        gt=0.0, description="Shift of a nest across the line of sight at which a nest check has failed."
    )
    payloads: tuple[PayloadEntry, ...] = Field(min_length=1, description="What was mounted, by number from 0 (none).")
    nuisance: DeclaredLevels = Field(default=DeclaredLevels(), description="Declared levels of disturbances.")
    simulated: bool = Field(default=False, description="Whether a device that it was measured with was simulated.")
    drive_positions: Literal["read", "commanded"] = Field(
        default="read",
        description="Whether the drives' columns were read from them, or are what a program commands of a control that "
        "moved the machine, whose drives nobody read.",
    )
    extra_columns: dict[str, str] = Field(
        default_factory=dict,
        description="Further columns of the readings and what they are: part sensors, registers of the PLC. "
        "A name ends in its unit.",
    )
    sessions: tuple[SessionEntry, ...] = Field(
        default=(), max_length=10_000, description="The processes that measured, in order."
    )
    known_tables: tuple[KnownTable, ...] = Field(
        default=(),
        max_length=1000,
        description="Compensation tables that are kept for the machine, of all generations.",
    )
    columns: dict[str, str] = Field(
        default_factory=dict, description="Notes on columns of your own that are not read, by their names."
    )

    def column_table(self) -> tuple[Column, ...]:
        """All columns that the readings may have, in order."""
        return columns_of(self.drives, self.sensors, self.extra_columns, self.rotary_drives)

    @model_serializer(mode="wrap")
    def _without_later_keys(self, serialise: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Version 0.1, which does not know these keys, can still read recordings that need none of them."""
        data: dict[str, Any] = serialise(self)
        for key in ("rotary_drives", "extra_columns", "simulated", "nuisance", "sessions", "known_tables"):
            if not data.get(key):
                data.pop(key, None)
        if self.drive_positions == "read":
            data.pop("drive_positions", None)
        return data

    @model_validator(mode="after")
    def _check_extra_columns(self) -> Self:
        if stray := sorted(set(self.rotary_drives) - set(self.drives)):
            raise ValueError(f"'rotary_drives' names '{stray[0]}', the drives are {', '.join(self.drives)}")
        check_extra_columns(self.drives, self.sensors, self.extra_columns, self.rotary_drives)
        return self

    @model_validator(mode="after")
    def _check_known_tables(self) -> Self:
        seen = set()
        for table in self.known_tables:
            for drive in (table.drive, table.partner or table.drive):
                if drive not in self.drives:
                    raise ValueError(f"a known table is of '{drive}', the drives are {', '.join(self.drives)}")
            if (table.generation, table.drive) in seen:
                raise ValueError(f"two known tables of generation {table.generation} for '{table.drive}'; keep one")
            seen.add((table.generation, table.drive))
        return self


HOUR_S = 3600.0
DRIFT_LEVER_M = 3.0  # where the drift of a rig is declared
