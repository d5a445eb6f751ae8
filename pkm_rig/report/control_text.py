"""What was written for a control, in words."""

from __future__ import annotations

from typing import Any

from pkm_rig.report.terminal import results


def print_control_files(result: dict[str, Any]) -> None:
    """The files of a format, what they mean to the control, and what they leave."""
    before, after = (result["tool_position_rms_m"][key] * 1e6 for key in ("before", "after"))
    lines = [
        f"{result['format']} for {result['control']}, {result['payload_kg']:g} kg: {result['tables']} tables, "
        f"{result['removed_share']:.1%} of the corrections' RMS",
        f"predicted position error, RMS: {before:.1f} um without, {after:.2f} um with the tables",
        f"sign: {result['sign']}; interpolation: {result['interpolation']}",
        result["trial"],
    ]
    if result["uncertain_share"] > 0.0:
        lines.append(
            f"at {result['uncertain_share']:.0%} of the poses U (k = 2) exceeds the error that is corrected (hatched)"
        )
    if result["largest_change"] is not None:
        lines.append(f"largest change against what was written before: {result['largest_change'] * 1e6:.1f} um")
    axes = ", ".join(f"{name} is axis {entry['axis']}" for name, entry in result["drives"].items())
    lines += [f"axes: {axes}", f"files: {result['folder']}: {', '.join(result['files'])}"]
    for line in lines:
        results.print(line, soft_wrap=True)


def print_kinematics_files(result: dict[str, Any]) -> None:
    """The files with calibrated geometry, and what rigid parameters cannot carry."""
    lines = [
        f"{result['format']} for {result['control']}, {result['payload_kg']:g} kg: {result['parameters']} take "
        f"{result['removed_share']:.1%} of the corrections' RMS",
        result["trial"],
        "what rigid parameters cannot carry (single errors that they lack, stiffness, payload), predicted position "
        "error, RMS:",
    ]
    lines += [
        f"  at {mass} kg: {rms['before'] * 1e6:.1f} um without, {rms['after'] * 1e6:.2f} um with this geometry"
        for mass, rms in result["tool_position_rms_m"].items()
    ]
    lines.append(f"files: {result['folder']}: {', '.join(result['files'])}")
    for line in lines:
        results.print(line, soft_wrap=True)


def print_program(result: dict[str, Any]) -> None:
    """What an NC program visits and commands."""
    lines = [
        f"{result['visits']} visits, commanded as {', '.join(result['axes'])} ({result['coordinates']}, mm and degrees)"
    ]
    if result["first"]:
        numbers = ", ".join(map(str, result["first"]))
        lines.append(f"first poses {numbers}: the largest errors without correction; if they grow: sign or unit")
    lines.append(f"files: {result['program']}, {result['table']}")
    for line in lines:
        results.print(line, soft_wrap=True)


def print_comparison(result: dict[str, Any]) -> None:
    """The verdict on two campaigns, without and with the correction."""
    first = result["first_poses"]
    results.print(
        f"poses {', '.join(map(str, first['poses']))}, the largest errors without correction: "
        f"{first['before_m'] * 1e6:.1f} um without, {first['after_m'] * 1e6:.1f} um with it"
    )
    for payload in result["payloads"]:
        before, after = payload["before"], payload["after"]
        results.print(
            f"{payload['payload_kg']:g} kg, {before['n']} and {after['n']} visits: "
            f"{before['position_rms_m'] * 1e6:.1f} +- "
            f"{2e6 * before['u_position_rms_m']:.1f} um without, {after['position_rms_m'] * 1e6:.1f} +- "
            f"{2e6 * after['u_position_rms_m']:.1f} um with the correction (RMS, U with k = 2)"
        )
        results.print(f"  {payload['rule']}")
    results.print(result["frame"])
    results.print("accepted" if result["accepted"] else "refused")
