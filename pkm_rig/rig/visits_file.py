"""Files that list visits in place of a rig file's poses: campaign files, and tables in CSV; data only, bounded."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from calibration.base.arrays import Array
from calibration.base.csv_table import parse_table, require_counts
from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from calibration.base.toml_file import parse_toml
from calibration.machine.description import COORDINATES, Machine
from pkm_rig.rig.campaign_sections import MOST_VISITS, CampaignFile, VisitEntry, VisitsSection
from pkm_rig.rig.config import RigFile, with_visits_of

FORMAT_PAGE = "docs/reference/campaign-file.md"
MAY_BE_LEFT_OUT = ("payload", "speed_m_per_s", "dwell_s")


def with_visits(rig: RigFile, path: Path, machine: Machine) -> RigFile:
    """The rig file with the visits of a file for its own poses; InputError if it lacks their payload."""
    return with_visits_of(rig, parse_visits(str(path), read_text(path), machine), str(path))


def parse_visits(name: str, text: str, machine: Machine) -> CampaignFile:
    """The visits of a campaign file from its text: CSV by the end of its name, else TOML. InputError in one line."""
    if not name.lower().endswith(".csv"):
        return parse_toml(text, CampaignFile, name)
    targets = [f"target_{COORDINATES[c]}_{'m' if c < 3 else 'rad'}" for c in machine.commanded]
    sides = [f"{drive}_direction" for drive in machine.drive_names]
    table = parse_table(
        io.StringIO(text), Path(name), targets, (*sides, *MAY_BE_LEFT_OUT), ("speed_m_per_s", "dwell_s"), FORMAT_PAGE
    )
    if len(table[targets[0]]) > MOST_VISITS:
        raise InputError(f"{name}: more than {MOST_VISITS} visits; split it")
    given = [side for side in sides if side in table]
    if given and given != sides:
        missing = next(side for side in sides if side not in table)
        raise InputError(f"{name}: no column '{missing}'; give the sides of all drives or of none, see {FORMAT_PAGE}")
    if "payload" in table:
        require_counts(Path(name), "payload", table["payload"])
    visits = [_visit(name, table, row, targets, given) for row in range(len(table[targets[0]]))]
    return CampaignFile(campaign=VisitsSection(visits=tuple(visits)))


def _visit(name: str, table: Mapping[str, Array], row: int, targets: list[str], sides: list[str]) -> VisitEntry:
    data: dict[str, Any] = {"target": tuple(float(table[column][row]) for column in targets)}
    data["direction"] = tuple(float(table[column][row]) for column in sides)
    data |= {key: float(table[key][row]) for key in MAY_BE_LEFT_OUT if key in table and np.isfinite(table[key][row])}
    try:
        return VisitEntry.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{name}: line {row + 2}, {first['loc'][0]}: {first['msg']}") from error
