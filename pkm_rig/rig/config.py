"""The rig file: how to reach the devices, what is mounted where, what a campaign does. Data, never code."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from calibration.base.errors import InputError
from calibration.base.toml_file import Section, read_toml
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.model.payload import PayloadEntry
from calibration.recording.columns import check_extra_columns
from calibration.recording.header import DeclaredLevels, DisturbanceLevels, LengthEntry, Name
from drivers.drives.drive_profile import DriveProfile, load_profile
from pkm_rig.rig.campaign_sections import MOST_DRIVES, CampaignFile, CampaignSettings, Limits
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.rig.device_sections import (
    MOVING_HOMING_METHODS,
    CanConnection,
    DriveEntry,
    PlcConnection,
    StationConnection,
)
from pkm_rig.rig.led_rows import require_drives_agree
from pkm_rig.rig.recalibration_sections import CertificateEntry, RecalibrationSettings
from pkm_rig.store.place import Address

PART_SENSORS = ("struts", "columns", "base", "platform")  # of the PLC, beside the air's
TABLE_DRIVES = 2  # each drive interpolates its table over its own position and its one partner's
SHIPPED_RIGS = Path(__file__).parent / "data"
EMBEDDED = "embedded"  # the name of the embedded mock rig where a rig file is asked for


class MockSection(Section):
    """The simulated machine and its devices; read by `pkm-rig mock` and the embedded rig only."""

    seed: int = Field(ge=0, default=1, description="Seed of the true machine and of the noise.")
    error_scale: float = Field(ge=0.0, default=1.0, description="Factor on the true geometric errors.")
    effects: tuple[str, ...] = Field(
        default=(), max_length=20, description="Unmodelled effects, written as for `pkm-rig mock --effect`."
    )
    nuisance: DisturbanceLevels = Field(
        default=DisturbanceLevels(), description="Disturbances that the mock really has, whatever the rig declares."
    )
    noise_tails: float = Field(
        ge=0.0, default=0.0, description="Degrees of freedom of Student's t of the noise, above 2; 0 is normal noise."
    )
    temperature_sensor_bias_k: float = Field(
        ge=0.0, default=0.0, description="Standard deviation of the temperature sensors' constant errors."
    )
    temperature_programme: tuple[tuple[float, float], ...] = Field(
        default=(), max_length=100, description="Corners of a swing of the shop's temperature: rig time in s, kelvin."
    )
    steady_temperatures: bool = Field(
        default=False, description="Nothing of machine and air warms up or wanders: what is measured knows no time."
    )
    encoders: Literal["absolute", "incremental"] = Field(
        default="absolute", description="Drives with incremental encoders have to be homed first."
    )
    plc_certificate_file: str | None = Field(default=None, description="Certificate of the mock PLC, for TLS.")
    plc_key_file: str | None = Field(default=None, description="Key of that certificate.")


class RigFile(Section):
    """A rig: its machine, its devices, what is mounted and what a campaign does."""

    rig: Name = Field(description="Name of the rig.")
    store: Address | None = Field(
        default=None,
        description="Address of a PostgreSQL server's database that has the store, as in "
        "`postgresql://rig@host/campaigns`, without a password; left out, a file in `--out`.",
    )
    machine: str = Field(description="Name of a shipped machine, or a machine file beside the rig file.")
    time_scale: float | None = Field(
        gt=0.0, default=None, description="Rig seconds in a second of host time; only for mocks, 1 if left out."
    )
    station: StationConnection = Field(description="The station.")
    nest_length: LengthEntry | None = Field(
        default=None, description="A certified distance; without one the range constant is only the certificate's."
    )
    can: CanConnection = Field(description="The CAN bus.")
    drives: tuple[DriveEntry, ...] = Field(
        min_length=1, max_length=MOST_DRIVES, description="The drives, in the order of the machine file."
    )
    plc: PlcConnection = Field(description="The PLC.")
    payloads: tuple[PayloadEntry, ...] = Field(
        min_length=1, description="What may be mounted on the platform; number 0 is no payload."
    )
    nuisance: DeclaredLevels = Field(default=DeclaredLevels(), description="Declared levels of disturbances.")
    campaign: CampaignSettings = Field(default=CampaignSettings(), description="What a campaign measures.")
    limits: Limits = Field(default=Limits(), description="When the rig is refused or stopped.")
    certificates: tuple[CertificateEntry, ...] = Field(
        default=(), max_length=100, description="Certificates of what is measured with."
    )
    recalibration: RecalibrationSettings = Field(
        default=RecalibrationSettings(), description="When the machine is calibrated again."
    )
    certificate: CertificateSection | None = Field(default=None, description="For reports and certificates.")
    mock: MockSection | None = Field(default=None, description="Settings of the mock.")

    @model_validator(mode="after")
    def _consistent(self) -> RigFile:
        if self.campaign.visits and self.campaign.targets:
            raise ValueError("campaign: give targets or visits, not both")
        payload_numbers = {*self.campaign.verification_payloads, self.campaign.loaded_payload}
        payload_numbers |= {visit.payload for visit in self.campaign.visits}
        if max(payload_numbers) >= len(self.payloads):
            raise ValueError(f"campaign: payload {max(payload_numbers)} is not in [[payloads]] (0 is no payload)")
        if unverified := sorted(set(self.campaign.accept_below_m) - set(self.campaign.verification_payloads)):
            raise ValueError(
                f"campaign.accept_below_m: payload {unverified[0]} is not in verification_payloads; add it there"
            )
        masses = [p.mass_kg for p in self.payloads]
        if len(set(masses)) != len(masses):
            raise ValueError("payloads: two have the same mass, by which the drives tell their tables apart")
        if self.payloads[0].mass_kg != 0.0:
            raise ValueError("payloads: the first one must be no payload (mass_kg = 0)")
        if len({d.node_id for d in self.drives}) != len(self.drives):
            raise ValueError("drives: two drives have the same node_id")
        operating_time = self.recalibration.operating_time
        if operating_time is not None and operating_time not in {r.name for r in self.plc.readings}:
            raise ValueError(
                f"recalibration.operating_time: '{operating_time}' is not in [[plc.readings]]; add it there"
            )
        if operating_time is not None and not operating_time.endswith("_s"):
            raise ValueError("recalibration.operating_time: the reading's name ends in _s, it is in seconds")
        if self.can.master_node_id in {d.node_id for d in self.drives}:
            raise ValueError("can: master_node_id is that of a drive")
        return self


def with_visits_of(rig: RigFile, campaign_file: CampaignFile, name: str) -> RigFile:
    """The rig file with the visits of a campaign file, which was read by `name`, for its own poses; InputError if it
    lacks their payload.
    """
    section = campaign_file.campaign
    visits = section.visits
    most = max(visit.payload for visit in visits)
    if most >= len(rig.payloads):
        raise InputError(f"{name}: payload {most} is not in the rig file's [[payloads]]; add it there")
    campaign = rig.campaign.model_copy(update={"visits": visits, "made_for": section.made_for, "targets": ()})
    return rig.model_copy(update={"campaign": campaign})


def load_rig(path: Path) -> tuple[RigFile, Machine]:
    """Read a rig file and its machine; InputError in one line if they are invalid.

    `machine` names a shipped machine or a file beside the rig file.
    """
    rig = read_toml(path, RigFile)
    machine = load_machine(machine_path(rig, path))
    names = [d.name for d in rig.drives]
    if names != list(machine.drive_names):
        raise InputError(
            f"{path}: drives {', '.join(names)} do not match the machine's {', '.join(machine.drive_names)}"
        )
    _check_units(rig, machine, path)
    if rig.campaign.compensation == "drive-tables" and machine.drive_kinds != ("slider",) * TABLE_DRIVES:
        raise InputError(
            f"{path}: campaign.compensation: tables in the drives fit machines with two sliders; {machine.name} has "
            f"{len(names)} drives ({', '.join(sorted(set(machine.drive_kinds)))}): use 'host'"
        )
    profiles = [drive_profile(d, path) for d in rig.drives]
    if len({p.compensation is None for p in profiles}) > 1:
        raise InputError(f"{path}: drives: a machine is compensated by all of its drives or by none")
    for drive, profile, (low_m, high_m) in zip(rig.drives, profiles, machine.travel, strict=True):
        if drive.homing is not None:
            _check_homing(drive, profile, (low_m, high_m), machine, path)
    if all(drive.homing is not None for drive in rig.drives):
        places = np.array([drive.homing.position for drive in rig.drives if drive.homing is not None])
        try:
            require_drives_agree(machine, places)
        except InputError as error:
            raise InputError(f"{path}: homing: {error}") from error
    if rig.nest_length is not None:
        for nest in rig.nest_length.nests:
            if machine.smr(nest).on != "floor":
                raise InputError(f"{path}: nest_length names '{nest}', which is not a floor nest")
    try:
        check_extra_columns(names, PART_SENSORS, rig.plc.extra_columns(), machine.rotary_drives)
    except ValueError as error:
        raise InputError(f"{path}: plc.readings: {error}") from error
    return rig, machine


def _check_units(rig: RigFile, machine: Machine, path: Path) -> None:
    """A crank counts in radians, any other drive in metres: the wrong key is refused by the drive's name."""
    for drive, kind in zip(rig.drives, machine.drive_kinds, strict=True):
        if kind == "crank" and drive.radians_per_increment is None:
            raise InputError(
                f"{path}: drives: {drive.name} is a crank, its coordinate is an angle: give radians_per_increment, not "
                "metres_per_increment"
            )
        if kind != "crank" and drive.metres_per_increment is None:
            raise InputError(
                f"{path}: drives: {drive.name} is a {kind}, its coordinate is a length: give metres_per_increment, not "
                "radians_per_increment"
            )
        homing = drive.homing
        if homing is not None and (homing.position_rad is not None) != (kind == "crank"):
            key, other = ("position_rad", "position_m") if kind == "crank" else ("position_m", "position_rad")
            raise InputError(f"{path}: drives: {drive.name}: homing: a {kind} has {key}, not {other}; correct it")
        if homing is not None and homing.keys_in_other_unit:
            unit = "rad" if kind == "crank" else "m"
            raise InputError(
                f"{path}: drives: {drive.name}: homing: {homing.keys_in_other_unit[0]}: a {kind} is homed in {unit}; "
                "correct the key"
            )


def _check_homing(
    drive: DriveEntry, profile: DriveProfile, travel: tuple[float, float], machine: Machine, path: Path
) -> None:
    homing, unit = drive.homing, "rad" if drive.radians_per_increment is not None else "m"
    if homing is None:
        return
    if profile.referenced is None:
        raise InputError(
            f"{path}: drives: {drive.name}: [drives.homing] needs a profile with [referenced]; without it a homing "
            "that broke off would pass for one that went well"
        )
    if not travel[0] <= homing.position <= travel[1]:
        raise InputError(
            f"{path}: drives: {drive.name}: homing.position_{unit} = {homing.position:g} is outside the machine's "
            f"travel of {travel[0]:g} {unit} to {travel[1]:g} {unit}; correct it"
        )
    if machine.redundantly_actuated and homing.method in MOVING_HOMING_METHODS:
        raise InputError(
            f"{path}: drives: {drive.name}: homing method {homing.method} moves one drive while the others stand, "
            f"which strains {machine.name}: it has {len(machine.drive_names)} drives for {len(machine.commanded)} "
            "commanded coordinates; use 35 or 37, or absolute encoders"
        )


def drive_profile(drive: DriveEntry, rig_path: Path) -> DriveProfile:
    """The profile of a drive's make; InputError if there is none such."""
    try:
        return load_profile(drive.profile, rig_path.parent)
    except ValueError as error:
        raise InputError(f"{rig_path}: {error}") from error


def machine_path(rig: RigFile, rig_path: Path) -> Path:
    """Where the machine file of a rig is."""
    if rig.machine.endswith(".toml"):
        return (rig_path.parent / rig.machine).resolve()
    return shipped_machine(rig.machine)


def rig_path(name: str | Path) -> Path:
    """The path of a rig file; "embedded" names the shipped one of the embedded mock rig."""
    return embedded_rig_path() if str(name) == EMBEDDED else Path(name)


def rig_name(path: Path) -> str:
    """The name of a rig, by which it is held in the store; InputError if its file is not valid."""
    return read_toml(path, RigFile).rig


def embedded_rig_path() -> Path:
    """The rig file of the embedded mock rig."""
    return SHIPPED_RIGS / "embedded.toml"


def demo_rig_path(machine: str | None) -> Path:
    """The rig file of a shipped machine's embedded mock rig; None is the default machine. InputError without one."""
    if machine is None or machine == load_embedded_machine():
        return embedded_rig_path()
    path = SHIPPED_RIGS / f"demo-{machine}.toml"
    if not path.is_file():
        names = sorted(p.stem.removeprefix("demo-") for p in SHIPPED_RIGS.glob("demo-*.toml"))
        raise InputError(
            f"there is no demo rig of machine '{machine}'; there is one of {', '.join(['planar4', *names])}"
        )
    return path


def load_embedded_machine() -> str:
    """Name of the default machine."""
    return read_toml(embedded_rig_path(), RigFile).machine


def mock_rig_path() -> Path:
    """The rig file of the mock rig that is served to other processes; examples/mock-rig.toml is the same."""
    return SHIPPED_RIGS / "mock-rig.toml"
