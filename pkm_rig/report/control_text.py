"""What was written for a control, in words."""

from __future__ import annotations

from typing import Any

from pkm_rig.report.terminal import results


def print_control_files(result: dict[str, Any]) -> None:
    """The files of a format, what they mean to the control, and what they leave."""
    lines = [
        f"{result['format']} for {result['control']}, {result['payload_kg']:g} kg: {result['tables']} tables, "
        f"{result['removed_share']:.1%} of the corrections' RMS",
        *_remaining_lines(result["tool_position_rms_m"], result["tool_rotation_rms_rad"], "the tables"),
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
        "what rigid parameters cannot carry (single errors that they lack, stiffness, payload):",
    ]
    lines += [
        f"  at {mass} kg: {line}"
        for mass, position in result["tool_position_rms_m"].items()
        for line in _remaining_lines(position, result["tool_rotation_rms_rad"][mass], "this geometry")
    ]
    lines.append(f"files: {result['folder']}: {', '.join(result['files'])}")
    for line in lines:
        results.print(line, soft_wrap=True)


def _remaining_lines(position: dict[str, float] | None, rotation: dict[str, float] | None, what: str) -> list[str]:
    named = (("position", position, "um"), ("rotation", rotation, "urad"))
    return [
        f"predicted {name} error of the tool, RMS: {rms['before'] * 1e6:.1f} {unit} without, "
        f"{rms['after'] * 1e6:.2f} {unit} with {what}"
        for name, rms, unit in named
        if rms is not None
    ]


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
