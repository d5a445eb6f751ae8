"""The result of a check of the rig, for people."""

from __future__ import annotations

from typing import Any

from pkm_rig.report.terminal import results


def _increment(drive: dict[str, Any]) -> str:
    if "radians_per_increment" in drive:
        return f"{drive['radians_per_increment'] * 1e9:g} nrad"
    return f"{drive['metres_per_increment'] * 1e9:g} nm"


def print_check(check_result: dict[str, Any]) -> None:
    """Identities, capabilities, interlocks and whether a campaign may start."""
    if check_result["simulated_devices"]:
        results.print(f"simulated: {', '.join(check_result['simulated_devices'])}")
    station = check_result["station"]
    results.print(
        "station: not known" if station is None else f"station: {station['name']}, serial {station['serial']}"
    )
    for name, drive in check_result["drives"].items():
        results.print(
            f"drive {name}: node {drive['node_id']}, serial {drive['serial']}, "
            f"{_increment(drive)} an increment, heartbeat {drive['heartbeat']}"
        )
        able = [what.replace("_", " ") for what, can in drive["capabilities"].items() if can]
        results.print(f"  can: {', '.join(able) or 'move only'}")
    for name, good in check_result["interlocks"].items():
        results.print(f"interlock {name}: {'good' if good else 'OPEN'}")
    results.print(f"payload: {check_result['payload']}")
    results.print(f"predicted in-plane uncertainty of a visit: {check_result['in_plane_u_m'] * 1e6:.1f} um")
    floor, error = check_result["noise_floor"], check_result["expected_error"]
    results.print(
        f"predicted noise floor: {floor['position_m'] * 1e6:.1f} um, {floor['rotation_rad'] * 1e6:.1f} urad; error "
        f"expected by the tolerances: {error['position_m'] * 1e6:.1f} um, {error['rotation_rad'] * 1e6:.1f} urad",
        soft_wrap=True,
    )
    if check_result["bus_load"] is not None:
        results.print(f"motion: led by SYNC, which loads the CAN bus to {check_result['bus_load']:.0%} at most")
    if check_result["problems"]:
        results.print("not fit")
    elif check_result["back_end"] == "host":
        results.print("fit for a campaign; this computer corrects its targets")
    elif all(drive["capabilities"]["table_bank"] for drive in check_result["drives"].values()):
        results.print("fit for a campaign")
    else:
        results.print("fit to measure and identify; its drives store no compensation tables")
