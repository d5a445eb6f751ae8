"""The section `[nuisance]` of a rig file, from a campaign of that rig in which nothing else is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.disturbance_levels import EstimatedLevel, EstimatedLevels, estimate_levels
from calibration.diagnosis.result import NONE
from calibration.identification.calibration import calibration_part
from calibration.recording.header import DeclaredLevels
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import drop_unclosed_readings

DIGITS = 2


def estimate_disturbances(recording: Recording) -> tuple[dict[str, Any], RenderableType]:
    """Levels for programs, and the section for the rig file. Raises InputError if the campaign is not quiet."""
    readings = drop_unclosed_readings(calibration_part(recording))
    undeclared = readings.file.model_copy(update={"nuisance": DeclaredLevels()})
    found = diagnose(replace(readings, file=undeclared))
    if found.verdict != NONE:
        raise InputError(
            f"{found.campaign}: not a quiet campaign, the diagnosis says '{found.verdict}', which would be taken for "
            "disturbances; remove the cause, measure again, and estimate from that campaign"
        )
    as_declared = diagnose(readings).verdict if readings.file.nuisance.model_fields_set else NONE
    levels, simulated = estimate_levels(readings), readings.file.simulated
    result = {"campaign": found.campaign, "simulated": simulated, "verdict_at_declared_levels": as_declared}
    result |= {
        "nuisance": _json(levels),
        "scatter": _entry(levels.scatter),
        "positioning_sd_m": levels.positioning_sd_m,
    }
    lines = [f"# from campaign {found.campaign}{', SIMULATED: not of a machine' if simulated else ''}"]
    if as_declared != NONE:
        lines.append(f"# at the levels that it declares the diagnosis says '{as_declared}',")
        lines.append("# which these would hide: use them only if nothing was wrong")
    return result, Text("\n".join([*_section(levels), *lines]))


def _json(levels: EstimatedLevels) -> dict[str, Any]:
    return {key: _entry(level) for key, level in levels.by_key.items()}


def _entry(level: EstimatedLevel) -> dict[str, Any]:
    return {"value": level.value, "low": level.low, "high": level.high, "told_by_readings": level.told}


def _section(levels: EstimatedLevels) -> list[str]:
    """Lines of TOML as they are pasted into a rig file; what the campaign does not tell stays undeclared."""
    lines = ["[nuisance]"]
    for key, level in levels.by_key.items():
        if level.told:
            lines.append(f"{key} = {level.value:.{DIGITS}g}  # 95 %: {level.low:.{DIGITS}g} to {level.high:.{DIGITS}g}")
        else:
            lines.append(f"# {key} is left at its default, {levels.prior[key]:.{DIGITS}g}: this campaign does not tell")
    scatter = levels.scatter
    lines.append(
        f"# readings scatter {scatter.value:.2f} times ({scatter.low:.2f} to {scatter.high:.2f}) as [station.accuracy] "
        "states"
    )
    if levels.positioning_sd_m > 0.0:
        off_um = 1e6 * levels.positioning_sd_m
        lines.append(f"# drives stand off by {off_um:.{DIGITS}g} um anew at each visit, which no key declares")
    return lines
