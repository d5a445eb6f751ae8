"""The mock control's own reader of NC programs: the words of RS-274 that a program of visits needs, nothing else.

Known are N, G1 with F (millimetres, degrees, absolute), G4 P (seconds), M0, M2 and M30; G21, G90 and G94 are what holds
anyway. A comment that names a payload says which one the next stop is for; one that names the tool point says that the
words are X, Y, Z and the angles A, B, C of the tool, R = Rz(C) Ry(B) Rx(A), and not positions of drives.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

MOST_BYTES = 10_000_000
_COMMENT = re.compile(r"\(([^()]*)\)")
_WORD = re.compile(r"\s*([A-Z][0-9]?=|[A-Z])\s*([-+]?[0-9]*\.?[0-9]+)")
_PAYLOAD = re.compile(r"payload ([0-9]{1,4}):")
_OWN = frozenset("NGMFP")
_HOLDS = frozenset(("G21", "G90", "G94"))


class ProgramError(ValueError):
    """A program that the control does not read; says the line."""


@dataclass(frozen=True)
class Step:
    """One thing that the control does: `visit` is the last N before it, `words` a move's places in mm and degrees."""

    kind: Literal["move", "dwell", "stop"]
    visit: int
    words: tuple[float, ...] = ()
    feed_mm_per_min: float = 0.0
    dwell_s: float = 0.0
    payload: int | None = None


@dataclass(frozen=True)
class Program:
    """What the control does in order; `commands` says what the words of its moves are."""

    steps: tuple[Step, ...]
    axes: tuple[str, ...]
    commands: Literal["drives", "tool"]

    def begin_of(self, visit: int) -> int:
        """The step with which a visit begins. Raises ValueError for one that is not in the program."""
        for index, step in enumerate(self.steps):
            if step.visit == visit:
                return index
        raise ValueError(f"the program has no N{visit}")


def read_program(path: str | Path) -> Program:
    """Read a program. Raises ProgramError and OSError."""
    data = Path(path).read_bytes()
    if len(data) > MOST_BYTES:
        raise ProgramError(f"{path}: larger than {MOST_BYTES} bytes; no program of visits")
    try:
        return parse_program(data.decode("ascii"))
    except UnicodeDecodeError as error:
        raise ProgramError(f"{path}: not ASCII") from error
    except ProgramError as error:
        raise ProgramError(f"{path}: {error}") from None


def parse_program(text: str) -> Program:
    """Read a program's text. Raises ProgramError."""
    reader = _Reader()
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            reader.take(line)
        except ProgramError as error:
            raise ProgramError(f"line {number}: {error}") from None
        if reader.ended:
            break
    if not reader.ended:
        raise ProgramError("it does not end with M2 or M30; its end is missing")
    return Program(tuple(reader.steps), reader.axes, reader.commands)


class _Reader:
    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.axes: tuple[str, ...] = ()
        self.commands: Literal["drives", "tool"] = "drives"
        self.ended = False
        self._visit, self._payload = 0, -1

    def take(self, line: str) -> None:
        for comment in _COMMENT.findall(line):
            self._remark(comment)
        words = self._words(_COMMENT.sub(" ", line).strip())
        own = {name: value for name, value in words if name in _OWN and name not in "GM"}
        if "N" in own:
            self._visit = int(own["N"])
        places = [(name, value) for name, value in words if name not in _OWN]
        for code in [f"{name}{value:g}" for name, value in words if name in "GM"]:
            self._do(code, own, places)
        if places and not any(name == "G" for name, _ in words):
            raise ProgramError(f"{places[0][0]}: a place without G1")

    def _remark(self, comment: str) -> None:
        if "commanded are tool point" in comment:
            self.commands = "tool"
        if (found := _PAYLOAD.match(comment)) is not None:
            self._payload = int(found[1])

    def _words(self, text: str) -> list[tuple[str, float]]:
        words, at = [], 0
        while at < len(text):
            found = _WORD.match(text, at)
            if found is None:
                raise ProgramError(f"{text[at : at + 20].strip()!r} is no word of a program")
            words.append((found[1].rstrip("="), float(found[2])))
            at = found.end()
        return words

    def _do(self, code: str, own: dict[str, float], places: list[tuple[str, float]]) -> None:
        if code == "G1":
            self._move(own, places)
        elif code == "G4":
            self._add(Step("dwell", self._visit, dwell_s=self._positive(own, "P", "G4")))
        elif code == "M0":
            payload, self._payload = self._payload, -1
            self._add(Step("stop", self._visit, payload=None if payload < 0 else payload))
        elif code in ("M2", "M30"):
            self.ended = True
        elif code not in _HOLDS:
            raise ProgramError(f"{code} is not known here")

    def _move(self, own: dict[str, float], places: list[tuple[str, float]]) -> None:
        axes = tuple(name for name, _ in places)
        if not axes or axes != (self.axes or axes) or len(set(axes)) != len(axes):
            raise ProgramError(
                f"G1 of {', '.join(axes) or 'nothing'}; every move names the same axes in the same order"
            )
        self.axes = axes
        words = tuple(value for _, value in places)
        if not all(math.isfinite(value) for value in words):
            raise ProgramError("G1 to a place that is no number")
        self._add(Step("move", self._visit, words, feed_mm_per_min=self._positive(own, "F", "G1")))

    def _positive(self, own: dict[str, float], name: str, code: str) -> float:
        value = own.get(name, 0.0)
        if not (math.isfinite(value) and value > 0.0):
            raise ProgramError(f"{code} needs {name} above zero")
        return value

    def _add(self, step: Step) -> None:
        self.steps.append(step)
