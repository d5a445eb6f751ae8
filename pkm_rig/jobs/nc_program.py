"""A campaign's visits as an NC program, for a machine whose control leads it: the station watches it stand."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError, printable
from calibration.base.rotation import rotation_matrix
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.led_path import approach_point, tool_coordinates
from calibration.model.payload import PayloadEntry
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.led_motion import is_led, side_of
from pkm_rig.rig.schedule import Block, PlannedVisit, calibration_blocks

TOOL_AXES = ("X", "Y", "Z", "A", "B", "C")
DRIVE_AXES = ("X", "Y", "Z", "A", "B", "C", "U", "V")
DECIMALS = 6
LONGEST_DWELL_S = 3600.0
SEEN_APART_S = 30.0  # at the approach point, where a pose is visited twice running: else nobody sees it leave


@dataclass(frozen=True)
class NcChoice:
    """What the program commands: the drives' positions or the tool's pose; axis names; M0, or a dwell in s, at each."""

    coordinates: str = "drives"
    axes: str | None = None
    dwell_s: float | None = None


@dataclass(frozen=True)
class Stop:
    """A visit with what is commanded for it and for its approach point: (a,) in mm and degrees."""

    number: int
    visit: PlannedVisit
    approach: Array
    place: Array


def write_program(
    file: RigFile, machine: Machine, path: Path, choice: NcChoice, first: Sequence[int] = ()
) -> dict[str, Any]:
    """Write a rig's visits as G-code and, beside it, as CSV; its summary (docs/reference/json.md).

    first: numbers of poses that are visited before all others. InputError for axes or a dwell that cannot be.
    """
    if choice.coordinates not in ("drives", "tool"):
        raise InputError(f"--coordinates {choice.coordinates}: use drives or tool")
    if choice.dwell_s is not None and not 0.0 < choice.dwell_s <= LONGEST_DWELL_S:
        raise InputError(f"--dwell {choice.dwell_s:g}: give a time up to {LONGEST_DWELL_S:g} s, or leave it out for M0")
    if choice.coordinates == "drives" and machine.redundantly_actuated:
        raise InputError(
            f"poses --nc: {machine.name} has {len(machine.drive_names)} drives for {len(machine.commanded)} commanded "
            "coordinates: led drive by drive it would be strained; use --coordinates tool"
        )
    names = axis_words(machine, choice)
    blocks = with_first_poses(calibration_blocks(machine, file.campaign, file.station.position_m), first)
    stops = list(_stops(machine, file, blocks, choice.coordinates))
    if path.suffix.lower() == ".csv":
        raise InputError(f"{path}: the CSV is written beside the program; name the program, for example visits.ngc")
    table = path.with_suffix(".csv")
    path.write_text(g_code(file, machine, blocks, stops, names, choice), encoding="ascii", newline="\n")
    table.write_text(visit_table(file, machine, stops, names), encoding="utf-8", newline="\n")
    return {
        "rig": file.rig,
        "machine": machine.name,
        "visits": len(stops),
        "coordinates": choice.coordinates,
        "axes": list(names),
        "first": [int(n) for n in first],
        "program": str(path),
        "table": str(table),
    }


def axis_words(machine: Machine, choice: NcChoice) -> tuple[str, ...]:
    """Letters of the commanded axes; InputError where they cannot be."""
    count = len(TOOL_AXES) if choice.coordinates == "tool" else len(machine.drive_names)
    if choice.axes is None:
        return TOOL_AXES if choice.coordinates == "tool" else DRIVE_AXES[:count]
    names = tuple(name.strip().upper() for name in choice.axes.split(","))
    if len(names) != count or len(set(names)) != count:
        raise InputError(f"--axes {choice.axes}: give {count} different names with commas")
    for name in names:
        if not re.fullmatch(r"[A-EH-LP-RU-Z][0-9]?=?", name):  # F, G, M, N, O, S and T are words of their own
            raise InputError(f"--axes: '{name}' is no axis word of an NC program; give letters such as X or Y1=")
    return names


def with_first_poses(blocks: Sequence[Block], first: Sequence[int]) -> tuple[Block, ...]:
    """The blocks with one visit of each of some poses moved to the very front, where there is no payload."""
    if not first:
        return tuple(blocks)
    opening = blocks[0]
    chosen = [next((v for v in opening.visits if v.pose == number), None) for number in first]
    if None in chosen:
        missing = first[chosen.index(None)]
        raise InputError(
            f"pose {missing}: the first block of the rig's campaign does not visit it; use the same rig file"
        )
    front = [v for v in chosen if v is not None]
    rest = [v for v in opening.visits if not any(v is f for f in front)]
    return (Block(opening.payload, (*front, *rest)), *blocks[1:])


def _stops(machine: Machine, file: RigFile, blocks: Sequence[Block], coordinates: str) -> Iterator[Stop]:
    approach_m = file.campaign.approach_m
    scale = np.array([180.0 / np.pi if kind == "crank" else 1e3 for kind in machine.drive_kinds])
    led = is_led(machine, file.campaign)
    for number, visit in enumerate((v for block in blocks for v in block.visits), start=1):
        if led or coordinates == "tool":
            side = side_of(machine, visit.target_m, visit.direction, approach_m) if led else visit.direction[0]
            commanded = tool_coordinates(machine, visit.target_m[None])
            before = nominal_poses(machine, approach_point(machine, commanded, side, approach_m))
            poses = np.vstack([before, visit.target_m[None]])
            places = _tool_words(machine, poses) if coordinates == "tool" else nominal_drives(machine, poses) * scale
        else:
            away = visit.drives_m - np.array(visit.direction) * approach_m
            places = np.vstack([away, visit.drives_m]) * scale
        yield Stop(number, visit, places[0], places[1])


def _tool_words(machine: Machine, poses: Array) -> Array:
    """Tool point in mm and A, B, C in degrees, R = Rz(C) Ry(B) Rx(A), of platform poses (n, 6)."""
    rotation = rotation_matrix(poses[:, 3:])
    point = poses[:, :3] + rotation @ machine.tool_point_m
    a = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    b = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    c = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.concatenate([point * 1e3, np.degrees(np.stack([a, b, c], axis=1))], axis=1)


def _ascii(text: str) -> str:
    """A text for a comment of an NC program: no brackets, which end it."""
    return printable(text).encode("ascii", "replace").decode("ascii").replace("(", "[").replace(")", "]")


def g_code(
    file: RigFile,
    machine: Machine,
    blocks: Sequence[Block],
    stops: Sequence[Stop],
    names: Sequence[str],
    choice: NcChoice,
) -> str:
    """The program (RS-274): millimetres, absolute, at each visit M0 or a dwell, M0 for each payload."""
    held = "M0 (measured; start goes on)" if choice.dwell_s is None else f"G4 P{choice.dwell_s:g}"
    what = "tool point and A, B, C" if choice.coordinates == "tool" else "drives"
    lines = [
        f"({_ascii(f'visits of rig {file.rig}, machine {machine.name}: {len(stops)}')})",
        f"({_ascii(f'commanded are {what}, without correction: {chr(44).join(names)} in mm and degrees')})",
        "(each visit: approach, place, stop; the station measures while it stands)",
        "G21 G90 G94",
    ]
    done, former = iter(stops), -1
    for block in blocks:
        lines.append(f"({_ascii(payload_text(file.payloads, block.payload))})")
        lines.append("M0 (put it on)" if file.payloads[block.payload].mass_kg else "M0 (no payload may be on)")
        for stop in (next(done) for _ in block.visits):
            feed = f"F{stop.visit.speed_m_per_s * 6e4:.0f}"
            lines.append(f"N{stop.number} (pose {stop.visit.pose}, pass {stop.visit.pass_})")
            lines.append(f"G1 {_words(names, stop.approach)} {feed}")
            if stop.visit.pose == former:
                lines.append(f"G4 P{SEEN_APART_S:g} (the same pose again: the station must see it leave)")
            lines.append(f"G1 {_words(names, stop.place)} {feed}")
            lines.append(held)
            former = stop.visit.pose
    return "\n".join([*lines, "M2", ""])


def payload_text(payloads: Sequence[PayloadEntry], number: int) -> str:
    """A payload in words."""
    return f"payload {number}: {payloads[number].name}, {payloads[number].mass_kg:g} kg"


def _words(names: Sequence[str], place: Array) -> str:
    return " ".join(f"{name}{value:.{DECIMALS}f}" for name, value in zip(names, place.tolist(), strict=True))


def visit_table(file: RigFile, machine: Machine, stops: Sequence[Stop], names: Sequence[str]) -> str:
    """The same as CSV: a row a visit, as the program commands it and in SI as the campaign plans it."""
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    units = ["rad" if kind == "crank" else "m" for kind in machine.drive_kinds]
    drives = [f"{name}_{unit}" for name, unit in zip(machine.drive_names, units, strict=True)]
    words = [name.rstrip("=") for name in names]
    head = ["visit", "pose", "pass", "payload", "payload_kg", *words, *(f"approach_{word}" for word in words), *drives]
    rows.writerow(head)
    for stop in stops:
        visit = stop.visit
        rows.writerow(
            [stop.number, visit.pose, visit.pass_, visit.payload, repr(file.payloads[visit.payload].mass_kg)]
            + [f"{value:.{DECIMALS}f}" for value in (*stop.place.tolist(), *stop.approach.tolist())]
            + [repr(float(q)) for q in visit.drives_m]
        )
    return stream.getvalue()
