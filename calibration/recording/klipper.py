"""The calibration block that Klipper stores in printer.cfg for a linear delta, as a neutral description.

Read are: the stored parameters ([printer], [stepper_a] to [stepper_c]), the points probed and the distances measured
([delta_calibrate]). Lines that begin with `#*#` are the block that SAVE_CONFIG writes; they override the others. The
file is untrusted input: bounded, data only; [include] is not followed and nothing but these sections is kept.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.plain_file import read_text

TOWERS = ("a", "b", "c")
ANGLES_DEG = {"a": 210.0, "b": 330.0, "c": 90.0}
MAX_READINGS = 1000
MAX_STEPS = 1e9
_SECTION = re.compile(r"\[([^\]]*)\]")
_OPTION = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)\s*[:=](.*)")
_WANTED = re.compile(r"printer|delta_calibrate|stepper_[abc]|tmc\w* stepper_[abc]")
_HEIGHT = re.compile(r"(manual_)?height(\d{1,4})")
_DISTANCE = re.compile(r"distance(\d{1,4})")
_Options = dict[str, dict[str, str]]


@dataclass(frozen=True)
class Tower:
    """Stored parameters of one tower.

    angle_rad: its place around the machine; endstop_m: height of the tool in the middle when the endstop triggers;
    step_m: travel of the carriage per microstep.
    """

    angle_rad: float
    arm_m: float
    endstop_m: float
    step_m: float


@dataclass(frozen=True)
class DeltaPrinter:
    """A linear delta as configured by its owner. Steps count the distance of each carriage below its endstop.

    radius_m: horizontal reach of the arms with the tool in the middle; probed_radius_m: of the circle that was probed.
    height_m (h,) with height_steps (h, 3); distance_m (r,) between first_steps (r, 3) and second_steps (r, 3).
    """

    radius_m: float
    probed_radius_m: float
    towers: tuple[Tower, ...]
    height_m: Array
    height_steps: Array
    distance_m: Array
    first_steps: Array
    second_steps: Array

    @property
    def step_m(self) -> Array:
        """Travel per step of the three carriages (3,)."""
        return np.array([t.step_m for t in self.towers])

    @property
    def endstop_height_m(self) -> Array:
        """Heights (3,) of the arms' upper joints at the endstops: endstop + sqrt(arm^2 - radius^2)."""
        return np.array([t.endstop_m + math.sqrt(t.arm_m**2 - self.radius_m**2) for t in self.towers])


def read_printer(path: Path) -> DeltaPrinter:
    """Read a printer.cfg; InputError in one line if it holds no calibration of a linear delta."""
    return parse_printer(read_text(path), str(path))


def parse_printer(text: str, source: str) -> DeltaPrinter:
    """The same from the text; messages begin with `source`."""
    options, includes = _options(text)
    file = _PrinterConfig(source, options, " (files that it includes are not read: join them)" if includes else "")
    kinematics = options.get("printer", {}).get("kinematics", "delta")
    if kinematics != "delta":
        raise InputError(f"{source}: kinematics is '{kinematics[:40]}'; only a linear delta can be imported")
    radius = file.length("printer", "delta_radius")
    towers = tuple(_tower(file, name) for name in TOWERS)
    for name, tower in zip(TOWERS, towers, strict=True):
        if tower.arm_m <= radius:
            raise InputError(f"{source}: [stepper_{name}] arm_length is not longer than delta_radius; correct them")
    _require_separate_towers(towers, source)
    block = options.get("delta_calibrate", {})
    heights = [key for key in block if _HEIGHT.fullmatch(key)]
    distances = [key for key in block if _DISTANCE.fullmatch(key)]
    if not heights:
        raise InputError(
            f"{source}: [delta_calibrate] holds no height0; run DELTA_CALIBRATE and SAVE_CONFIG first{file.hint}"
        )
    if len(heights) + len(distances) > MAX_READINGS:
        raise InputError(f"{source}: [delta_calibrate] holds more than {MAX_READINGS} readings")
    section = "delta_calibrate"
    return DeltaPrinter(
        radius_m=radius,
        probed_radius_m=file.length(section, "radius", 0.8 * radius),
        towers=towers,
        height_m=np.array([file.number(section, key, 1e4) for key in heights]) / 1e3,
        height_steps=np.array([file.steps(f"{key}_pos") for key in heights]),
        distance_m=np.array([file.length(section, key) for key in distances]),
        first_steps=np.array([file.steps(f"{key}_pos1") for key in distances]).reshape(-1, 3),
        second_steps=np.array([file.steps(f"{key}_pos2") for key in distances]).reshape(-1, 3),
    )


def _options(text: str) -> tuple[_Options, bool]:
    """Sections of interest with their options, stored ones last, and whether other files are included."""
    sections_by_origin: dict[bool, _Options] = {False: {}, True: {}}
    section: dict[bool, str | None] = {False: None, True: None}
    includes = False
    for raw in text.removeprefix("\ufeff").splitlines():
        stored = raw.startswith("#*#")
        line = raw[3:].removeprefix(" ") if stored else raw
        line = re.split(r"#|(?:^|\s);", line, maxsplit=1)[0].rstrip()
        if not line or line[0].isspace():
            continue  # indented lines continue the previous value, which is not used here
        if heading := _SECTION.match(line):
            name = " ".join(heading[1].split())
            includes |= name.startswith("include ")
            section[stored] = name if _WANTED.fullmatch(name) else None
        elif (option := _OPTION.fullmatch(line)) and (name := section[stored] or ""):
            sections_by_origin[stored].setdefault(name, {})[option[1].lower()] = option[2].strip()
    merged = {name: dict(values) for name, values in sections_by_origin[False].items()}
    for name, values in sections_by_origin[True].items():
        merged.setdefault(name, {}).update(values)
    return merged, includes


@dataclass(frozen=True)
class _PrinterConfig:
    """Numbers of the file, in SI, with complaints that say where."""

    source: str
    options: Mapping[str, Mapping[str, str]]
    hint: str

    def text(self, section: str, key: str) -> str | None:
        return self.options.get(section, {}).get(key)

    def number(self, section: str, key: str, limit: float, default: float | None = None) -> float:
        """As it is written; at most `limit` either way."""
        text = self.text(section, key)
        if text is None:
            if default is None:
                raise InputError(f"{self.source}: [{section}] {key} is missing{self.hint}")
            return default
        return self._finite(text, f"[{section}] {key}", limit)

    def length(self, section: str, key: str, default_m: float | None = None) -> float:
        """A positive length in mm, as metres."""
        length_m = round(self.number(section, key, 1e4, None if default_m is None else 1e3 * default_m) / 1e3, 12)
        if length_m <= 0.0:
            raise InputError(f"{self.source}: [{section}] {key} is not a positive length; correct it")
        return length_m

    def positive(self, section: str, key: str, default: float | None = None) -> float:
        """A positive number."""
        number = self.number(section, key, 1e6, default)
        if number <= 0.0:
            raise InputError(f"{self.source}: [{section}] {key} is not positive; correct it")
        return number

    def steps(self, key: str) -> list[float]:
        """A stable position: steps of the three towers."""
        text = self.text("delta_calibrate", key)
        if text is None:
            raise InputError(f"{self.source}: [delta_calibrate] {key} is missing; run DELTA_CALIBRATE again")
        cells = text.split(",", 3)
        if len(cells) != 3:
            raise InputError(f"{self.source}: [delta_calibrate] {key} is not three numbers; run DELTA_CALIBRATE again")
        return [self._finite(cell, f"[delta_calibrate] {key}", MAX_STEPS) for cell in cells]

    def _finite(self, text: str, where: str, limit: float) -> float:
        try:
            number = float(text)
        except ValueError:
            raise InputError(f"{self.source}: {where}: {text.strip()[:40]!r} is not a number; correct it") from None
        if not abs(number) <= limit:
            raise InputError(f"{self.source}: {where}: {number:g} is out of range; correct it")
        return number


def _tower(file: _PrinterConfig, name: str) -> Tower:
    section = f"stepper_{name}"

    def section_with(key: str) -> str:
        """Towers b and c take from tower a what is not said of them."""
        return section if file.text(section, key) is not None else "stepper_a"

    return Tower(
        angle_rad=math.radians(file.number(section, "angle", 1e3, ANGLES_DEG[name])),
        arm_m=file.length(section_with("arm_length"), "arm_length"),
        endstop_m=file.number(section_with("position_endstop"), "position_endstop", 1e4) / 1e3,
        step_m=_step_m(file, name),
    )


def _step_m(file: _PrinterConfig, name: str) -> float:
    """Travel per microstep: rotation_distance / (full steps * microsteps * gear ratio), or the older step_distance."""
    section = f"stepper_{name}"
    if file.text(section, "rotation_distance") is None and file.text(section, "step_distance") is not None:
        return file.length(section, "step_distance")
    holders = [s for s in (section, *file.options) if s.endswith(section) and file.text(s, "microsteps") is not None]
    microsteps = file.positive(holders[0] if holders else section, "microsteps")
    per_turn = file.positive(section, "full_steps_per_rotation", 200.0) * microsteps * _gear_ratio(file, section)
    return file.length(section, "rotation_distance") / per_turn


def _gear_ratio(file: _PrinterConfig, section: str) -> float:
    """Product of ratios such as '57:11, 2:1'; 1 if none is given."""
    text = file.text(section, "gear_ratio")
    ratio = 1.0
    for pair in [] if text is None else text.split(",", 10):
        try:
            driven, driving = (float(part) for part in pair.split(":"))
            ratio *= driven / driving
        except (ValueError, ZeroDivisionError):
            ratio = math.nan
    if not 1e-6 < ratio < 1e6:
        raise InputError(f"{file.source}: [{section}] gear_ratio is not a ratio such as 57:11; correct it")
    return ratio


def _require_separate_towers(towers: tuple[Tower, ...], source: str) -> None:
    for i in range(3):
        apart = abs(math.remainder(towers[i].angle_rad - towers[i - 1].angle_rad, 2.0 * math.pi))
        if apart < math.radians(20.0):
            raise InputError(
                f"{source}: towers {TOWERS[i - 1]} and {TOWERS[i]} are within 20 degrees; correct their angles"
            )
