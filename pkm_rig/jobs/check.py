"""Check of a connected rig: identities, units, capabilities, interlocks and every obstacle to a campaign."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from drivers.drives.bus_load import sync_load
from drivers.drives.servo_drive import ServoDrive
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.expected_error import expected_error
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, in_plane_u_m, predicted_floor


def check_devices(rig: Rig) -> dict[str, Any]:
    """Identities, units, capabilities, interlocks and problems of a connected rig (docs/reference/json.md)."""
    state = rig.supervisor.state()
    identity = rig.station.identity
    return {
        "simulated": bool(rig.simulated_devices),
        "simulated_devices": list(rig.simulated_devices),
        "station": None if identity is None else {"name": identity.name, "serial": identity.serial},
        "drives": {
            drive.name: {
                "node_id": drive.node_id,
                "serial": None if drive.identity is None else drive.identity.serial,
                **_units(drive, rotary=drive.name in rig.machine.rotary_drives),
                "heartbeat": drive.heartbeat().value,
                "capabilities": asdict(drive.profile.capabilities),
            }
            for drive in rig.drives.drives
        },
        "motion": "led" if rig.led else "profile",
        "bus_load": sync_load(len(rig.file.drives), rig.file.can.sync_period_s, rig.file.can.bitrate)
        if rig.led
        else None,
        "back_end": "drive-tables" if uses_tables(rig.file, rig.machine) else "host",
        "interlocks": dict(state.interlocks),
        "payload": state.payload,
        "temperatures_c": dict(state.temperatures_c),
        "in_plane_u_m": in_plane_u_m(rig.file, rig.machine),
        "noise_floor": asdict(predicted_floor(rig.file, rig.machine)),
        "expected_error": asdict(expected_error(rig.machine)),
        "problems": check_rig(rig),
    }


def _units(drive: ServoDrive, *, rotary: bool) -> dict[str, Any]:
    """Increment and limits of a drive, of a crank in radians."""
    increment, limits = ("radians_per_increment", "limits_rad") if rotary else ("metres_per_increment", "limits_m")
    return {increment: drive.metres_per_increment, limits: list(drive.limits_m)}
