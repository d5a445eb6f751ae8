"""A machine's life as tables for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.text import Text

from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.terminal import results

PLAIN = ("created", "kind", "campaign")


def print_history(life: dict[str, Any]) -> None:
    """Calibrations, checks, events and periods in doubt of one rig."""
    _print(f"rig {life['rig']}, machine {life['machine']}")
    if life["former_machines"]:
        _print(f"its history began anew: before it was {', '.join(life['former_machines'])}")
    if life["tolerances"]:
        last = life["tolerances"][-1]
        _print(f"tolerance {micrometres(last['position_m'])} since {day(last['since'])}")
    _calibrations(life["calibrations"])
    _checks(life["checks"])
    if life["events"]:
        _print("events")
        for event in life["events"]:
            _print(f"  {moment(event['created'])}  {event_line(event)}")
    for period in life["in_doubt"]:
        _print(
            f"in doubt: work from {moment(period['since'])} to {moment(period['until'])}; {period['found_by']} found "
            f"{figure(period['error'])}"
        )
    if life.get("picture"):
        _print(f"picture: {life['picture']}")


def _calibrations(entries: Sequence[Mapping[str, Any]]) -> None:
    if not entries:
        _print("no calibration")
        return
    rows = [("calibration", "date, UTC", "extent", "verdict", "as found", "as left", "degC", "effects")]
    for entry in entries:
        rows.append(
            (
                entry["campaign"],
                moment(entry["created"]),
                entry["extent"],
                entry["verdict"],
                figure(entry["as_found"]),
                figure(entry["as_left"]),
                _temperature(entry["temperature_c"]),
                ", ".join(entry["effects"]) or "none",
            )
        )
    _columns(rows)


def _checks(entries: Sequence[Mapping[str, Any]]) -> None:
    if not entries:
        _print("no check")
        return
    rows = [("check", "date, UTC", "verdict", "error", "tolerance", "poses", "min", "degC")]
    for entry in entries:
        rows.append(
            (
                entry["id"],
                moment(entry["created"]),
                entry["verdict"],
                figure(entry["error"]),
                micrometres(entry["tolerance_m"]),
                str(entry["poses"]),
                f"{entry['duration_s'] / 60.0:.1f}",
                _temperature(entry["temperature_c"]),
            )
        )
    _columns(rows)


def _columns(rows: Sequence[Sequence[str]]) -> None:
    """Lines that stay whole however narrow the terminal is, as in `list`."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        _print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def event_line(event: Mapping[str, Any]) -> str:
    """An event in words."""
    kind, data = str(event["kind"]), {k: v for k, v in event.items() if k not in PLAIN}
    if kind == "drive replaced":
        return f"drive {data['part']} replaced: serial number {data['serial']}, before {data['former_serial']}"
    if kind == "station replaced":
        return f"station replaced: serial number {data['serial']}, before {data['former_serial']}"
    if "position_m" in data:
        return f"{kind}: {micrometres(data['position_m'])}"
    words = [f"{name} {value}" for name, value in data.items() if isinstance(value, (str, int, float)) and value != ""]
    return ", ".join([kind, *words])


def figure(error: Mapping[str, float] | None) -> str:
    """An error with its expanded uncertainty."""
    if error is None:
        return ""
    return f"{error['position_m'] * 1e6:.1f} um, U {COVERAGE_FACTOR * error['u_m'] * 1e6:.1f} um"


def micrometres(length_m: float) -> str:
    """A length in um."""
    return f"{length_m * 1e6:g} um"


def moment(created: str) -> str:
    """Date and minute of a row."""
    return created[:16].replace("T", " ")


def day(created: str) -> str:
    """Date of a row."""
    return created[:10]


def _temperature(temperature_c: float | None) -> str:
    return "" if temperature_c is None else f"{temperature_c:.1f}"


def _print(line: str) -> None:
    results.print(Text(line), soft_wrap=True)
