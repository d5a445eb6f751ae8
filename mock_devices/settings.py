"""Settings of a mock rig. None of them is a true error: those are drawn from the seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mock_devices.effects.base import EffectChoice
from mock_devices.known_tables import KnownTable

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Payload:
    """A payload as its data sheet states it; the true one differs by draws of its standard uncertainties."""

    name: str
    mass_kg: float
    com_m: Vector3 = (0.0, 0.0, 0.0)
    u_mass_kg: float = 0.0
    u_com_m: float = 0.0


@dataclass(frozen=True)
class InstrumentProfile:
    """Accuracy of the station, standard deviations. The drift values are amplitudes over some hours."""

    angle_sd_rad: float = 2.4e-6
    range_sd_m: float = 1.0e-4
    range_constant_u_m: float = 1.0e-4
    range_scale_u: float = 1.0e-6
    drift_about_vertical_rad: float = 3.0e-6
    drift_of_level_rad: float = 1.0e-6
    drift_m: float = 1.0e-5
    collimation_rad: float = 1.0e-6
    vertical_index_rad: float = 1.0e-6


@dataclass(frozen=True)
class DisturbanceLevels:
    """Ordinary disturbances of a rig at their declared level, one standard deviation each (`[nuisance]`)."""

    drift_m: float = 0.0
    reseat_m: float = 0.0
    reversal_m: float = 0.0
    temperature_k: float = 0.0


DEFAULT_PAYLOADS = (
    Payload("none", 0.0),
    Payload("plate 200 kg", 200.0, (0.0, -0.2, 0.0), 0.2, 0.002),
    Payload("plates 400 kg", 400.0, (0.0, -0.2, 0.0), 0.4, 0.002),
)


@dataclass(frozen=True)
class PlcReading:
    """A further analogue register of the mock PLC: the true temperature of a part plus `offset_k`, in degC.

    `part` is "air" or a part with a sensor (struts, columns, base, platform). `type` f32 is two words, high word first;
    i16 is one word that counts `scale` degC. `address` is one that is free: 37 to 59.
    """

    name: str
    address: int
    part: str = "base"
    offset_k: float = 0.0
    type: Literal["f32", "i16"] = "f32"
    scale: float = 0.1


@dataclass(frozen=True)
class MockSettings:
    """Settings of a mock rig.

    `error_scale` multiplies the drawn geometric errors (lengths, joints, tilts, drive scales), not the
    stiffness, the mounting of the reflectors or the instrument. `payloads[n]` is number n of the PLC.
    `station_heading_rad` turns the zero direction, clockwise seen from above, away from -z of the machine.
    `effects` are what a calibrated model does not contain, `nuisance` the ordinary disturbances. `noise_tails`: degrees
    of freedom of Student's t of the readings' noise, of the same variance (0: normal). `rest_friction`: whether every
    drive keeps friction in its torque after a stop, as one whose screw it winds up does. `temperature_programme`:
    corners (rig time, kelvin) of a change of the shop's temperature. `steady_temperatures`: nothing warms up, nothing
    wanders with time, air and sensors neither. `clock_jitter_s` is the noise of time stamps in
    recordings. Without `absolute_encoders` the drives have no reference after power-on. `plc_readings` are further
    registers of the PLC, for example the temperature of a coolant. `known_tables` are on record for the machine and
    stated in its recordings, whatever the drives use. `start_s`: rig time at which this mock begins as a
    later one of the same machine: its readings have other noise.
    """

    seed: int = 1
    start_s: float = 0.0
    error_scale: float = 1.0
    payloads: tuple[Payload, ...] = DEFAULT_PAYLOADS
    initial_payload: int = 0
    operator_time_s: float = 60.0
    instrument: InstrumentProfile = InstrumentProfile()
    station_position_m: Vector3 = (0.0, 0.3, 3.2)
    station_heading_rad: float = 0.0
    certificate_sd_m: float = 2.0e-6
    air_temperature_c: float = 21.5
    temperature_sensor_sd_k: float = 0.005
    warm_up_time_constant_s: float = 900.0
    effects: tuple[EffectChoice, ...] = ()
    nuisance: DisturbanceLevels = DisturbanceLevels()
    noise_tails: float = 0.0
    rest_friction: bool = False
    temperature_sensor_bias_k: float = 0.0
    clock_jitter_s: float = 0.0
    temperature_programme: tuple[tuple[float, float], ...] = ()
    steady_temperatures: bool = False
    absolute_encoders: bool = True
    plc_readings: tuple[PlcReading, ...] = ()
    known_tables: tuple[KnownTable, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError for impossible settings."""
        if not 0 <= self.initial_payload < len(self.payloads):
            raise ValueError(f"there is no payload {self.initial_payload}")
        if self.seed < 0 or self.error_scale < 0.0:
            raise ValueError("seed and error_scale must not be negative")
        if self.noise_tails and self.noise_tails <= 2.0:
            raise ValueError("noise_tails must be above 2 (or 0 for normal noise)")
