"""What a page may ask for, and what each of it will move, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from calibration.base.errors import InputError
from calibration.machine.description import Machine
from pkm_rig.jobs.measure import planned_readings
from pkm_rig.rig.campaign_sections import CampaignFile
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.config import RigFile, with_visits_of
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.rig.visits_file import parse_visits

Kind = Literal[
    "check", "home", "home again", "interim test", "calibrate", "measure", "verify", "go on", "tables off",
    "tables rollback", "diagnose", "report",
]  # fmt: skip
WITH_SECOND_PRESS = frozenset(
    {"home", "home again", "interim test", "calibrate", "measure", "verify", "go on", "tables off", "tables rollback"}
)
NEED_RELEASE = WITH_SECOND_PRESS - {"interim test"}  # the telescope is no machine
NEED_CAMPAIGN = frozenset({"verify", "diagnose", "report"})
MOST_UPLOAD_BYTES = 1_000_000


@dataclass(frozen=True)
class Visits:
    """A campaign file that was uploaded or that a diagnosis has written: data, by its name."""

    name: str
    file: CampaignFile


@dataclass(frozen=True)
class Action:
    """Something that a page asks for. `campaign`: of the store; for `measure` and `calibrate` the one to go on with."""

    kind: Kind
    campaign: str | None = None
    visits: Visits | None = None
    new_setup: bool = False

    def __post_init__(self) -> None:
        """Raise InputError for an action that names no campaign where it needs one."""
        if self.campaign is None and (self.kind in NEED_CAMPAIGN or self.new_setup):
            raise InputError(f"{self.kind}: of which campaign?")


def read_visits(name: str, data: bytes, machine: Machine) -> Visits:
    """An uploaded campaign file (TOML or CSV), by the reader of the command line; InputError in one line."""
    if len(data) > MOST_UPLOAD_BYTES:
        raise InputError(f"{name}: {len(data)} bytes, more than {MOST_UPLOAD_BYTES}")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: byte {error.start} is not UTF-8") from error
    return Visits(name, parse_visits(name, text, machine))


def what_moves(action: Action, file: RigFile, machine: Machine) -> str:
    """What the second press sets in motion, or changes, for whoever gives it. InputError if it cannot be done."""
    drives = " and ".join(machine.drive_names)
    if action.kind == "interim test":
        return f"Only the telescope of {file.station.name} turns; no drive moves."
    if action.kind in ("tables off", "tables rollback"):
        what = (
            "are switched off" if action.kind == "tables off" else "go back to what was in use before the last change"
        )
        return f"No drive moves. The compensation tables in drives {drives} {what}, and the drives lose power."
    if action.kind == "go on":
        return f"Drives {drives} of {file.rig} get power and the campaign moves the machine on, as planned."
    if action.kind in ("home", "home again"):
        which = "all drives" if action.kind == "home again" else "each drive that has lost its reference"
        speeds = [f"{d.name} at up to {d.homing.speed_m_per_s * 1e3:g} mm/s" for d in file.drives if d.homing]
        places = ", ".join(speeds) or "the rig file says of none how"
        return f"Of {file.rig} {which}, one after the other, searches its mark: {places}."
    verifies = action.kind in ("calibrate", "verify")
    measures = action.kind in ("calibrate", "measure")
    chosen = file if action.visits is None else with_visits_of(file, action.visits.file, action.visits.name)
    blocks = calibration_blocks(machine, chosen.campaign) if measures else ()
    payloads = dict.fromkeys(
        [*(block.payload for block in blocks), *(chosen.campaign.verification_payloads if verifies else ())]
    )
    (left, right), (low, high) = machine.workspace[0], machine.workspace[1]
    speed = max(chosen.campaign.speeds_m_per_s)
    count = planned_readings_of(chosen, machine, verify=verifies, measure=measures)
    return (
        f"Drives {drives} of {file.rig} move its tool through the workspace, x {left * 1e3:.0f} mm to "
        f"{right * 1e3:.0f} mm, y {low * 1e3:.0f} mm to {high * 1e3:.0f} mm, at up to {speed:g} m/s, and the telescope "
        f"of {file.station.name} turns. Up to {count} readings. Payloads, one after the other: "
        f"{', '.join(file.payloads[n].name for n in payloads)}." + _corrected(file, machine, verifies=verifies)
    )


def _corrected(file: RigFile, machine: Machine, *, verifies: bool) -> str:
    if not verifies:
        return " Compensation is switched off."
    if uses_tables(file, machine):
        return " Compensation tables are written to all drives."
    return " This computer corrects the targets of its paths."


def planned_readings_of(file: RigFile, machine: Machine, *, verify: bool, measure: bool) -> int:
    """Number of readings of a new campaign of this rig file."""
    blocks = calibration_blocks(machine, file.campaign) if measure else ()
    return planned_readings(file.campaign, machine, blocks, verify=verify)
