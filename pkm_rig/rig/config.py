"""The rig file: how to reach the devices, what is mounted where, what a campaign does. Data, never code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from calibration.base.errors import InputError
from calibration.base.toml_file import Section, read_toml
from calibration.compensation.tables import GRID_MARGIN_M
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.model.payload import PayloadEntry
from calibration.recording.header import LengthEntry, Name, NuisanceEntry, StationEntry
from drivers.drives.drive_profile import DriveProfile, load_profile
from drivers.drives.homing import Homing

Speed = Annotated[float, Field(gt=0.0, le=2.0)]
Dwell = Annotated[float, Field(ge=0.0, le=600.0)]
PayloadNumber = Annotated[int, Field(ge=0)]
MOST_VISITS, MOST_DRIVES = 2000, 12


class StationConnection(StationEntry):
    """The station's line, a serial port (`/dev/ttyUSB0`, `COM3`) or `socket://host:port`, and what it measures with.

    Distance mode and prism type by GeoCOM's names; the constant is set after the type, whose own it replaces.
    """

    port: str = ""
    baudrate: int = Field(gt=0, default=115200)
    reply_timeout_s: float = Field(gt=0.0, default=5.0)
    motion_timeout_s: float = Field(gt=0.0, default=30.0)
    edm_mode: Literal["single_standard", "single_fast", "average_ir", "precise_ir"] = "single_standard"
    prism_type: Literal["round", "mini", "user1", "user2", "user3", "minizero", "user"] = "mini"
    prism_constant_m: float = Field(gt=-0.2, lt=0.2, default=0.0)


class CanConnection(Section):
    """The bus; `embedded` is the in-process bus of the embedded mock rig."""

    interface: Literal["embedded", "virtual", "socketcand", "socketcan", "slcan"]
    channel: str = "can0"
    host: str = "127.0.0.1"
    port: int = 29536
    bitrate: int = 1_000_000
    master_node_id: int = Field(ge=1, le=127, default=127)


class HomingEntry(Section):
    """How a drive is homed that has lost its reference: to the next index below (33) or above (34), or where it stands.

    `position_m` is the drive's position there. Other methods of CiA 402 run to switches, farther than one drive of a
    parallel machine may go while the others stand.
    """

    method: Literal[33, 34, 35, 37]
    position_m: float
    speed_m_per_s: float = Field(gt=0.0, le=0.05, default=Homing.speed_m_per_s)
    acceleration_m_per_s2: float = Field(gt=0.0, le=5.0, default=Homing.acceleration_m_per_s2)
    limit_s: float = Field(gt=0.0, default=Homing.limit_s)
    tolerance_m: float = Field(gt=0.0, le=0.01, default=Homing.tolerance_m)


class DriveEntry(Section):
    """One servo drive; its name is that of a drive in the machine file.

    `profile` names a shipped profile of its make, or a file beside the rig file (docs/reference/drive-objects.md).
    """

    name: str
    profile: str = "pkm-mock"
    node_id: int = Field(ge=1, le=127)
    vendor_id: int
    product_code: int
    metres_per_increment: float = Field(gt=0.0)
    homing: HomingEntry | None = None


class RegisterEntry(Section):
    """A register of the PLC; what is left out is as in the map (docs/reference/plc.md). A number is its address."""

    address: int = Field(ge=0, le=0xFFFF)
    type: Literal["u16", "i16", "u32", "i32", "f32"] | None = None
    order: Literal["ABCD", "CDAB", "BADC", "DCBA"] | None = None
    scale: float | None = None
    unit: Literal["degC", "K", "hPa", "mbar", "Pa", "kPa", "%", "1"] | None = None
    low: float | None = None
    high: float | None = None
    stale_s: float | None = Field(gt=0.0, default=None)


class PlcConnection(Section):
    """The PLC: `host` and `port` for TCP and TLS, `serial_port` for RTU. `registers` changes the default map."""

    transport: Literal["tcp", "tls", "rtu"] = "tcp"
    host: str = "127.0.0.1"
    port: int = 502
    ca_file: str | None = None
    certificate_file: str | None = None
    key_file: str | None = None
    serial_port: str | None = None
    baudrate: int = Field(gt=0, default=115_200)
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 1
    unit: int = Field(ge=0, le=247, default=1)
    reply_timeout_s: float = Field(gt=0.0, default=0.5)
    without: tuple[Literal["interlocks_inverted", "master_heartbeat", "master_seen"], ...] = ()
    registers: dict[str, RegisterEntry] = Field(default_factory=dict)
    interlocks: dict[str, Annotated[int, Field(ge=0, le=15)]] = Field(default_factory=dict)

    @field_validator("registers", mode="before")
    @classmethod
    def _addresses(cls, registers: object) -> object:
        if not isinstance(registers, dict):
            return registers
        return {name: {"address": entry} if isinstance(entry, int) else entry for name, entry in registers.items()}

    @model_validator(mode="after")
    def _complete(self) -> PlcConnection:
        if self.transport == "tls" and self.ca_file is None:
            raise ValueError("plc: TLS needs ca_file, the certificate that signs the PLC's")
        if self.transport == "rtu" and self.serial_port is None:
            raise ValueError("plc: RTU needs serial_port")
        return self


class VisitEntry(Section):
    """One visit of a campaign that says them one by one; `target` in the commanded coordinates of the tool, m and rad.

    direction: side that each drive comes from, +1 from below, -1 from above; all from below if left out. Speed and
    dwell are the first of the campaign's if left out.
    """

    target: tuple[float, ...] = Field(min_length=1, max_length=6)
    direction: tuple[Literal[-1, 1], ...] = Field(default=(), max_length=MOST_DRIVES)
    payload: PayloadNumber = 0
    speed_m_per_s: Speed | None = None
    dwell_s: Dwell | None = None


class CampaignSettings(Section):
    """What a campaign measures; durations in rig time.

    `targets` are visited in drawn order from both sides with and without payload; `visits` as they stand here.
    """

    seed: int = Field(ge=0, default=1)
    calibration_poses: int = Field(ge=6, default=40)
    targets: tuple[tuple[float, ...], ...] = Field(default=(), max_length=1000)
    visits: tuple[VisitEntry, ...] = Field(default=(), max_length=MOST_VISITS)
    loaded_payload: int = Field(ge=1, default=2)
    readings_per_smr: int = Field(ge=1, le=20, default=1)
    readings_per_nest: int = Field(ge=1, le=20, default=5)
    two_face: bool = False
    speeds_m_per_s: tuple[Speed, Speed] = (0.5, 0.25)
    acceleration_m_per_s2: float = Field(gt=0.0, le=50.0, default=2.0)
    approach_m: float = Field(gt=0.0, lt=GRID_MARGIN_M, default=0.010)
    dwells_s: tuple[Dwell, Dwell] = (2.0, 4.0)
    warm_up_max_s: float = Field(ge=0.0, default=1800.0)
    warm_up_step_s: float = Field(gt=0.0, default=60.0)
    warm_up_rate_k_per_h: float = Field(gt=0.0, default=2.0)
    repeatability_visits: int = Field(ge=3, default=5)
    repeatability_limit_m: float = Field(gt=0.0, default=40e-6)
    nest_every_visits: int = Field(ge=1, default=5)
    nest_limit_m: float = Field(gt=0.0, default=80e-6)
    verification_poses: int = Field(ge=30, default=40)
    verification_payloads: tuple[PayloadNumber, ...] = Field(min_length=1, default=(0, 1))
    payload_timeout_s: float = Field(gt=0.0, default=3600.0)


class Limits(Section):
    """When to refuse, and how old or wrong what the station knows of the air may become between two points.

    `atmosphere_ppm`: 0.1 ppm is what 0.1 K or 0.4 hPa do by the stations' own formula, 0.3 um in 3 m.
    """

    in_plane_u_m: float = Field(gt=0.0, default=15e-6)
    heartbeat_s: float = Field(gt=0.0, default=2.0)
    drive_watchdog_s: float = Field(ge=1.0, le=60.0, default=1.5)
    poll_period_s: float = Field(ge=0.005, le=0.1, default=0.01)
    plc_heartbeat_s: float = Field(gt=0.0, default=2.0)
    atmosphere_age_s: float = Field(gt=0.0, default=300.0)
    atmosphere_ppm: float = Field(gt=0.0, default=0.1)
    interlocks: tuple[str, ...] = (
        "guard closed",
        "emergency stop released",
        "drive power on",
        "air pressure",
    )


class MockSection(Section):
    """For `pkm-rig mock` and the embedded rig only: the seed of the truth and of the noise, and what is wrong with it.

    `effects` are texts as of `pkm-rig mock --effect` (docs/reference/mock-effects.md); `nuisance` is the wander that
    it really has, whatever the rig declares. `noise_tails`: degrees of freedom of Student's t, 0 for normal noise.
    Drives with incremental encoders have to be homed first. The certificate and key are the PLC's, where it is
    reached by TLS.
    """

    seed: int = Field(ge=0, default=1)
    error_scale: float = Field(ge=0.0, default=1.0)
    effects: tuple[str, ...] = Field(default=(), max_length=20)
    nuisance: NuisanceEntry = NuisanceEntry()
    noise_tails: float = Field(ge=0.0, default=0.0)
    temperature_sensor_bias_k: float = Field(ge=0.0, default=0.0)
    temperature_programme: tuple[tuple[float, float], ...] = Field(default=(), max_length=100)
    encoders: Literal["absolute", "incremental"] = "absolute"
    plc_certificate_file: str | None = None
    plc_key_file: str | None = None


class RigFile(Section):
    """The whole rig file."""

    rig: Name
    machine: str
    time_scale: float | None = Field(gt=0.0, default=None)
    station: StationConnection
    nest_length: LengthEntry | None = None
    can: CanConnection
    drives: tuple[DriveEntry, DriveEntry]
    plc: PlcConnection
    payloads: tuple[PayloadEntry, ...] = Field(min_length=1)
    nuisance: NuisanceEntry = NuisanceEntry()
    campaign: CampaignSettings = CampaignSettings()
    limits: Limits = Limits()
    mock: MockSection | None = None

    @model_validator(mode="after")
    def _consistent(self) -> RigFile:
        if self.campaign.visits and self.campaign.targets:
            raise ValueError("campaign: give targets or visits, not both")
        wanted = {*self.campaign.verification_payloads, self.campaign.loaded_payload}
        wanted |= {visit.payload for visit in self.campaign.visits}
        if max(wanted) >= len(self.payloads):
            raise ValueError(f"campaign: payload {max(wanted)} is not in [[payloads]] (0 is no payload)")
        masses = [p.mass_kg for p in self.payloads]
        if len(set(masses)) != len(masses):
            raise ValueError("payloads: two have the same mass, by which the drives tell their tables apart")
        if self.payloads[0].mass_kg != 0.0:
            raise ValueError("payloads: the first one must be no payload (mass_kg = 0)")
        if len({d.node_id for d in self.drives}) != len(self.drives):
            raise ValueError("drives: two drives have the same node_id")
        if self.can.master_node_id in {d.node_id for d in self.drives}:
            raise ValueError("can: master_node_id is that of a drive")
        return self


class VisitsSection(Section):
    """The visits of a campaign file."""

    visits: tuple[VisitEntry, ...] = Field(min_length=1, max_length=MOST_VISITS)


class CampaignFile(Section):
    """A campaign file: the visits that a rig is to make, and nothing else of it."""

    campaign: VisitsSection


def with_visits(rig: RigFile, path: Path) -> RigFile:
    """The rig file with the visits of a campaign file in place of its own poses; InputError if they do not fit."""
    visits = read_toml(path, CampaignFile).campaign.visits
    most = max(visit.payload for visit in visits)
    if most >= len(rig.payloads):
        raise InputError(f"{path}: payload {most} is not in the rig file's [[payloads]]; add it there")
    campaign = rig.campaign.model_copy(update={"visits": visits, "targets": ()})
    return rig.model_copy(update={"campaign": campaign})


def load_rig(path: Path) -> tuple[RigFile, Machine]:
    """Read a rig file and its machine; InputError in one line if they are not fit.

    `machine` names a shipped machine or a file beside the rig file.
    """
    rig = read_toml(path, RigFile)
    machine = load_machine(machine_path(rig, path))
    names = [d.name for d in rig.drives]
    if names != list(machine.drive_names):
        raise InputError(
            f"{path}: drives {', '.join(names)} do not match the machine's {', '.join(machine.drive_names)}"
        )
    profiles = [drive_profile(d, path) for d in rig.drives]
    if len({p.compensation is None for p in profiles}) > 1:
        raise InputError(f"{path}: drives: a machine is compensated by all of its drives or by none")
    for drive, profile, (low_m, high_m) in zip(rig.drives, profiles, machine.travel, strict=True):
        if drive.homing is not None:
            _check_homing(drive.name, drive.homing.position_m, profile, (low_m, high_m), path)
    if rig.nest_length is not None:
        for nest in rig.nest_length.nests:
            if machine.smr(nest).on != "floor":
                raise InputError(f"{path}: nest_length names '{nest}', which is not a floor nest")
    return rig, machine


def _check_homing(
    name: str, position_m: float, profile: DriveProfile, travel_m: tuple[float, float], path: Path
) -> None:
    if profile.referenced is None:
        raise InputError(
            f"{path}: drives: {name}: [drives.homing] needs a profile with [referenced]; without it a homing that "
            "broke off would pass for one that went well"
        )
    if not travel_m[0] <= position_m <= travel_m[1]:
        raise InputError(
            f"{path}: drives: {name}: homing.position_m = {position_m:g} is outside the machine's travel of "
            f"{travel_m[0]:g} m to {travel_m[1]:g} m; correct it"
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


def embedded_rig_path() -> Path:
    """The rig file of the embedded mock rig."""
    return Path(__file__).parent / "data" / "embedded.toml"
