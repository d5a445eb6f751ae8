"""Every block of the tutorial runs, in order, and prints what the page says but for the numbers."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

PAGE = ROOT / "docs" / "tutorial" / "first-calibration.md"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAME = re.compile(r"[Ss]ave this as `([\w.-]+)`")
NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")
SIGNS = {"±": "+-", "µ": "u", "°": "deg"}  # as a terminal that has them shows them


@dataclass(frozen=True)
class Ran:
    """What the tutorial's blocks printed."""

    folder: Path
    shell: str
    python: str


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")) if kind == language]


def words(text: str) -> list[str]:
    """Words of a text without its numbers and signs."""
    for sign, plain in SIGNS.items():
        text = text.replace(sign, plain)
    return NUMBER.sub("", text).split()


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> Ran:
    folder = tmp_path_factory.mktemp("tutorial")
    page = PAGE.read_text(encoding="utf-8")
    for block in BLOCK.finditer(page):
        if block[1] == "toml":
            names = NAME.findall(page[: block.start()])
            (folder / names[-1]).write_text(block[2], encoding="utf-8")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}

    def run(*command: str) -> str:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=600
        )
        assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
        return done.stdout

    shell = run("bash", "-euo", "pipefail", "-c", "\n".join(blocks("sh")))
    python = run(sys.executable, "-W", "error", "-c", "\n".join(blocks("python")))
    return Ran(folder, shell, python)


def test_the_commands_write_what_the_page_names(ran):
    assert (ran.folder / "runs" / "pkm-rig.sqlite").is_file()
    assert list((ran.folder / "runs").glob("first-*/report.html"))
    assert {path.name for path in (ran.folder / "recording").iterdir()} >= {"recording.toml", "readings.csv"}


@pytest.mark.parametrize("number", range(len(blocks("text"))))
def test_what_the_page_shows_is_what_is_printed(ran, number):
    shown = words(blocks("text")[number])
    printed = words(ran.shell + ran.python)
    assert any(printed[i : i + len(shown)] == shown for i in range(len(printed))), shown
