"""Sections of the rig file that say how the devices are reached: station, CAN bus, drives and PLC."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from calibration.base.toml_file import Section
from calibration.recording.header import StationEntry
from drivers.drives.homing import HomingParameters


class StationConnection(StationEntry):
    """The station: where it stands, how it is reached, and what it measures with.

    Distance mode and prism type have GeoCOM's names. The prism constant is set after the type, whose own constant it
    replaces.
    """

    port: str = Field(default="", description="Serial port (`/dev/ttyUSB0`, `COM3`) or `socket://host:port`.")
    baudrate: int = Field(gt=0, default=115200, description="Speed of a serial port in baud.")
    reply_timeout_s: float = Field(gt=0.0, default=5.0, description="Longest wait for the reply to a request.")
    motion_timeout_s: float = Field(gt=0.0, default=30.0, description="Longest wait for turning, aiming or measuring.")
    edm_mode: Literal["single_standard", "single_fast", "average_ir", "precise_ir"] = Field(
        default="single_standard", description="Mode of the distance meter."
    )
    prism_type: Literal["round", "mini", "user1", "user2", "user3", "minizero", "user"] = Field(
        default="mini", description="Type of the reflectors."
    )
    prism_constant_m: float = Field(
        gt=-0.2, lt=0.2, default=0.0, description="Prism constant of the reflectors; 0 for a bare SMR."
    )


class CanConnection(Section):
    """The CAN bus of the drives."""

    interface: Literal["embedded", "virtual", "socketcand", "socketcan", "slcan"] = Field(
        description="Interface of python-can; `embedded` is the in-process bus of the embedded mock rig."
    )
    channel: str = Field(default="can0", description="Channel: a network interface, or the serial port of an adapter.")
    host: str = Field(default="127.0.0.1", description="Host of the socketcand server.")
    port: int = Field(default=29536, description="Port of the socketcand server.")
    bitrate: int = Field(default=1_000_000, description="Bit rate that an slcan adapter is set to, in bit/s.")
    master_node_id: int = Field(ge=1, le=127, default=127, description="Node id of this computer's heartbeat.")
    sync_period_s: float = Field(
        ge=0.001, le=0.1, default=0.004, description="Time between two SYNCs of a machine that is led along paths."
    )


MOVING_HOMING_METHODS = (33, 34)


class HomingEntry(Section):
    """How a drive that has lost its reference is homed.

    Other methods of CiA 402 run to switches, farther than one drive of a parallel machine may go while the others
    stand.
    """

    method: Literal[33, 34, 35, 37] = Field(
        description="Method of CiA 402: 33 to the next index below, 34 to the next index above, 35 or 37 on the spot."
    )
    position_m: float | None = Field(
        default=None, description="Position of the drive at that mark, within the machine's travel."
    )
    position_rad: float | None = Field(default=None, description="The same of a crank, whose position is an angle.")
    speed_m_per_s: float = Field(
        gt=0.0, le=0.05, default=HomingParameters.speed_m_per_s, description="Speed of the search."
    )
    acceleration_m_per_s2: float = Field(
        gt=0.0, le=5.0, default=HomingParameters.acceleration_m_per_s2, description="Acceleration of the search."
    )
    limit_s: float = Field(gt=0.0, default=HomingParameters.limit_s, description="Time after which homing has failed.")
    tolerance_m: float = Field(
        gt=0.0,
        le=0.01,
        default=HomingParameters.tolerance_m,
        description="Largest overrun past the mark while braking.",
    )
    speed_rad_per_s: float | None = Field(
        gt=0.0, le=0.05, default=None, description="Of a crank: speed of the search; 0.002 without it."
    )
    acceleration_rad_per_s2: float | None = Field(
        gt=0.0, le=5.0, default=None, description="Of a crank: acceleration of the search; 0.1 without it."
    )
    tolerance_rad: float | None = Field(
        gt=0.0, le=0.01, default=None, description="Of a crank: largest overrun past the mark; 0.001 without it."
    )

    @property
    def position(self) -> float:
        """Position at the mark, in m, or of a crank in rad."""
        given = self.position_rad if self.position_m is None else self.position_m
        return 0.0 if given is None else given

    @property
    def parameters(self) -> HomingParameters:
        """What the drive is told, in m, or of a crank in rad."""
        return HomingParameters(
            method=self.method,
            position_m=self.position,
            speed_m_per_s=self.speed_rad_per_s or self.speed_m_per_s,
            acceleration_m_per_s2=self.acceleration_rad_per_s2 or self.acceleration_m_per_s2,
            limit_s=self.limit_s,
            tolerance_m=self.tolerance_rad or self.tolerance_m,
        )

    @property
    def keys_in_other_unit(self) -> list[str]:
        """The keys in the file whose unit does not go with that of the position."""
        wrong = ("_m", "_m_per_s", "_m_per_s2") if self.position_m is None else ("_rad", "_rad_per_s", "_rad_per_s2")
        return sorted(key for key in self.model_fields_set if key.endswith(wrong) and getattr(self, key) is not None)

    @model_validator(mode="after")
    def _one_position(self) -> HomingEntry:
        if (self.position_m is None) == (self.position_rad is None):
            raise ValueError("homing: give position_m, or of a crank position_rad")
        return self


class DriveEntry(Section):
    """One servo drive."""

    name: str = Field(description="Name of the drive in the machine file.")
    profile: str = Field(
        default="pkm-mock",
        description="Drive profile: the name of a shipped one, or a file beside the rig file.",
    )
    node_id: int = Field(ge=1, le=127, description="Address on the CAN bus.")
    vendor_id: int = Field(description="Vendor id that the drive must report (0x1018:01).")
    product_code: int = Field(description="Product code that the drive must report (0x1018:02).")
    metres_per_increment: float | None = Field(
        gt=0.0, default=None, description="Travel of one increment of the drive's position, of a slider or leg."
    )
    radians_per_increment: float | None = Field(
        gt=0.0, default=None, description="Angle of one increment of the drive's position, of a crank."
    )
    torque_limit_ratio: float | None = Field(
        gt=0.0,
        le=10.0,
        default=None,
        description="Largest torque over the rated one (0x6072) that is set while the machine is led along paths.",
    )
    homing: HomingEntry | None = Field(default=None, description="How the drive is homed; only `pkm-rig home` does it.")

    @property
    def per_increment(self) -> float:
        """Travel in metres, or of a crank the angle in radians, of one increment."""
        return self.metres_per_increment or self.radians_per_increment or 0.0

    @model_validator(mode="after")
    def _one_unit(self) -> DriveEntry:
        if (self.metres_per_increment is None) == (self.radians_per_increment is None):
            raise ValueError(
                f"drives: {self.name}: give metres_per_increment (slider, leg) or radians_per_increment (crank)"
            )
        return self


class RegisterEntry(Section):
    """A register of the PLC, or its address alone; what is left out is as in the default map."""

    address: int = Field(ge=0, le=0xFFFF, description="Address of the first word.")
    type: Literal["u16", "i16", "u32", "i32", "f32"] | None = Field(default=None, description="Type of the number.")
    order: Literal["ABCD", "CDAB", "BADC", "DCBA"] | None = Field(
        default=None, description="Order of the bytes of a 32-bit number."
    )
    scale: float | None = Field(default=None, description="Factor from the register's number to its unit.")
    unit: Literal["degC", "K", "hPa", "mbar", "Pa", "kPa", "%", "1"] | None = Field(
        default=None, description="Unit of the scaled number."
    )
    low: float | None = Field(default=None, description="Smallest valid value, in degC, hPa or %.")
    high: float | None = Field(default=None, description="Largest valid value, in degC, hPa or %.")
    stale_s: float | None = Field(
        gt=0.0, default=None, description="A value unchanged for so long is old; none: the heartbeat decides."
    )


class ReadingEntry(Section):
    """A further analogue register, recorded with each reading as a column of its own."""

    name: str = Field(description="Name of the column; it ends in its unit, as in `coolant_temperature_c`.")
    meaning: str = Field(default="", max_length=200, description="What it is, for whoever reads the recording.")
    address: int = Field(ge=0, le=0xFFFF, description="Address of the first word.")
    type: Literal["u16", "i16", "u32", "i32", "f32"] = Field(default="f32", description="Type of the number.")
    order: Literal["ABCD", "CDAB", "BADC", "DCBA"] = Field(
        default="ABCD", description="Order of the bytes of a 32-bit number."
    )
    scale: float = Field(default=1.0, description="Factor from the register's number to the unit of the name.")
    offset: float = Field(default=0.0, description="Added after scaling, in the unit of the name.")
    low: float = Field(description="Smallest valid value, in the unit of the name.")
    high: float = Field(description="Largest valid value, in the unit of the name.")
    stale_s: float | None = Field(
        gt=0.0, default=None, description="A value unchanged for so long is old; none: the heartbeat decides."
    )


class PlcConnection(Section):
    """The PLC: how it is reached and which registers it has."""

    transport: Literal["tcp", "tls", "rtu"] = Field(default="tcp", description="Modbus TCP, Modbus TCP in TLS, or RTU.")
    host: str = Field(default="127.0.0.1", description="Host, for TCP and TLS.")
    port: int = Field(default=502, description="Port, for TCP and TLS; of TLS usually 802.")
    ca_file: str | None = Field(default=None, description="TLS: certificate that signs the PLC's.")
    certificate_file: str | None = Field(default=None, description="TLS: our own certificate, if the PLC asks for one.")
    key_file: str | None = Field(default=None, description="TLS: the key of our own certificate.")
    serial_port: str | None = Field(default=None, description="RTU: the serial port.")
    baudrate: int = Field(gt=0, default=115_200, description="RTU: speed in baud.")
    parity: Literal["N", "E", "O"] = Field(default="E", description="RTU: none, even or odd.")
    stop_bits: Literal[1, 2] = Field(default=1, description="RTU: stop bits.")
    unit: int = Field(ge=0, le=247, default=1, description="Modbus unit id.")
    reply_timeout_s: float = Field(
        gt=0.0, default=0.5, description="Longest wait for a reply; a failed read is repeated once on a new connection."
    )
    without: tuple[Literal["interlocks_inverted", "master_heartbeat", "master_seen", "simulated"], ...] = Field(
        default=(), description="Registers of the default map that the PLC does not have."
    )
    registers: dict[str, RegisterEntry] = Field(default_factory=dict, description="Changes to the default map.")
    readings: tuple[ReadingEntry, ...] = Field(
        default=(), max_length=40, description="Further registers that are recorded with each reading."
    )
    interlocks: dict[str, Annotated[int, Field(ge=0, le=15)]] = Field(
        default_factory=dict, description="Name and bit of each interlock, in place of the default four."
    )

    @field_validator("registers", mode="before")
    @classmethod
    def _addresses(cls, registers: object) -> object:
        if not isinstance(registers, dict):
            return registers
        return {name: {"address": entry} if isinstance(entry, int) else entry for name, entry in registers.items()}

    def extra_columns(self) -> dict[str, str]:
        """Columns of the recording for the further registers, name to meaning."""
        return {entry.name: entry.meaning or f"register {entry.address} of the PLC" for entry in self.readings}

    @model_validator(mode="after")
    def _complete(self) -> PlcConnection:
        if self.transport == "tls" and self.ca_file is None:
            raise ValueError("plc: TLS needs ca_file, the certificate that signs the PLC's")
        if self.transport == "rtu" and self.serial_port is None:
            raise ValueError("plc: RTU needs serial_port")
        if len(self.extra_columns()) != len(self.readings):
            raise ValueError("plc: two readings have the same name")
        return self
