"""What a command on all campaigns found: a table for people, one object for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.text import Text

from pkm_rig.report.terminal import results
from pkm_rig.results.done import Done

HEADS = {
    "diagnose": ("verdict", "at", "value", "probability", "gap before", "gap after"),
    "identify": ("decided", "chi2/dof", "held-out", "bound", "left out"),
}


def fleet_json(command: str, found: Sequence[Done], skipped: Mapping[str, str]) -> dict[str, Any]:
    """One object (docs/reference/json.md)."""
    simulated = [done.result.get("simulated", False) for done in found if done.result is not None]
    return {
        "command": command,
        "simulated": bool(simulated) and all(simulated),
        "campaigns": [done.as_dict() for done in found],
        "done": sum(not done.failure for done in found),
        "kept": sum(done.kept for done in found),
        "failed": sum(bool(done.failure) for done in found),
        "skipped": dict(skipped),
    }


def print_fleet(result: dict[str, Any]) -> None:
    """A line a campaign, then how many."""
    command = result["command"]
    rows = [("campaign", "rig", *HEADS[command])]
    failed = []
    for entry in result["campaigns"]:
        if entry["failure"] is not None:
            failed.append(entry)
            continue
        columns = _diagnosed(entry["result"]) if command == "diagnose" else _identified(entry["result"])
        rows.append((entry["campaign"], entry["rig"], *columns))
    if len(rows) > 1:
        _columns(rows)
    for entry in failed:
        _print(f"{entry['campaign']}: FAILED: {entry['failure']}")
    for name, why in result["skipped"].items():
        _print(f"{name}: left out: {why}")
    kept = f", {result['kept']} of them before" if result["kept"] else ""
    _print(f"{result['done']} campaigns{kept}; {result['failed']} failed, {len(result['skipped'])} left out")


def _diagnosed(result: Mapping[str, Any]) -> tuple[str, ...]:
    gap = result["gap"]
    effect = result["effects"][0] if result["effects"] else None
    ends = (_micrometres(gap["before_m"]), _micrometres(gap["after_m"]))
    if effect is None:
        return (result["verdict"], "", "", _share(result["ranking"].get(result["verdict"])), *ends)
    value = "" if effect["value"] is None else f"{effect['value']:.3g} {effect['unit']}"
    return (result["verdict"], str(effect["place"] or ""), value, _share(effect["probability"]), *ends)


def _identified(result: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        f"{result['rank']} of {len(result['parameters'])}",
        f"{result['chi2_per_dof']:.2f}",
        _micrometres(result["held_out"]["position_rms_m"]),
        _micrometres(result["bound"]["position_rms_m"]),
        str(sum(result["dropped"].values())),
    )


def _micrometres(length_m: float | None) -> str:
    return "" if length_m is None else f"{length_m * 1e6:.1f} um"


def _share(probability: float | None) -> str:
    return "" if probability is None else f"{probability:.2f}"


def _columns(rows: Sequence[Sequence[str]]) -> None:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        _print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def _print(line: str) -> None:
    results.print(Text(line), soft_wrap=True)
