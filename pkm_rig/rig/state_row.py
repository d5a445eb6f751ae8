"""What a rig is like at a reading, as columns of a recording: drives, air, temperatures, payload."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.drives.servo_drive import DriveSample
from drivers.errors import PlcError
from drivers.plc.plc_registers import PlcState
from pkm_rig.rig.rig import Rig


def rig_state_row(rig: Rig, state: PlcState, drives: Sequence[DriveSample]) -> dict[str, float | str]:
    """Drives, air, temperatures and payload as columns of a recording."""
    row: dict[str, float | str] = {}
    for sample, drive in zip(drives, rig.file.drives, strict=True):
        unit = "m" if drive.radians_per_increment is None else "rad"
        row |= {
            f"{drive.name}_commanded_{unit}": sample.demand_m,
            f"{drive.name}_actual_{unit}": sample.position_m,
            f"{drive.name}_following_error_{unit}": sample.following_error_m,
            f"{drive.name}_velocity_{unit}_per_s": sample.velocity_m_per_s,
            f"{drive.name}_torque_ratio": sample.torque_fraction,
        }
    payload = state.payload
    mass_kg = rig.payload_mass_kg(payload)
    if payload is None or mass_kg is None:
        raise PlcError("PLC", "payload", "it is being changed", "measure when it is on")
    return row | {
        "payload": float(payload),
        "payload_mass_kg": mass_kg,
        "compensation": float(rig.compensation),
        "air_temperature_c": state.temperatures_c["air"],
        "pressure_hpa": state.pressure_hpa,
        "humidity_percent": 100.0 * state.humidity,
        **{f"{name}_temperature_c": state.temperatures_c[name] for name in rig.sensors},
        **{name: state.readings[name] for name in rig.extra_columns},
    }
