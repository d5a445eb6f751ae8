"""The result of homing, for people."""

from __future__ import annotations

from typing import Any

from pkm_rig.report.terminal import results


def print_homing(homing_result: dict[str, Any]) -> None:
    """Which drives were homed, and where each is now."""
    for name, drive in homing_result["drives"].items():
        what = "homed" if drive["homed"] else "is referenced, not homed"
        unit = "m" if "position_m" in drive else "rad"
        results.print(f"drive {name}: {what}, is at {drive[f'position_{unit}']:.6f} {unit}")
    if homing_result["compensation_switched_off"]:
        results.print("compensation is off and stays off until tables are activated (verify, calibrate)")
