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
