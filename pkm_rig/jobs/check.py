"""Check of a connected rig: identities, units, capabilities, interlocks and every obstacle to a campaign."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, in_plane_u_m


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
                "metres_per_increment": drive.metres_per_increment,
                "limits_m": list(drive.limits_m),
                "heartbeat": drive.heartbeat().value,
                "capabilities": asdict(drive.profile.capabilities),
            }
            for drive in rig.drives.drives
        },
        "interlocks": dict(state.interlocks),
        "payload": state.payload,
        "temperatures_c": dict(state.temperatures_c),
        "in_plane_u_m": in_plane_u_m(rig.file, rig.machine),
        "problems": check_rig(rig),
    }
