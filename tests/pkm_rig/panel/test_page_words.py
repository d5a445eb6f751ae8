"""What jobs say, on the page: what to press, not what to type."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import calibration
import drivers
import pkm_rig
from pkm_rig.panel.page_words import AT_COMPUTER, on_page

PLACES = [
    *(Path(str(drivers.__file__)).parent).rglob("*.py"),
    *(Path(str(calibration.__file__)).parent / "reduction").glob("*.py"),
    *(Path(str(pkm_rig.__file__)).parent / "rig").glob("*.py"),
    *(Path(str(pkm_rig.__file__)).parent / "jobs").glob("*.py"),
    *(Path(str(pkm_rig.__file__)).parent / "store").rglob("*.py"),
]
NOT_OF_THE_PAGE = {  # what only commands do
    "compare.py", "control_files.py", "kinematics_files.py", "nc_program.py", "certificate.py", "health.py",
    "next_command.py", "campaign_file.py", "removal.py", "standard_visits.py", "dry_run.py", "partial.py",
    "verify_folders.py", "planning.py", "measured_machine.py", "history.py", "copies.py",
}  # fmt: skip
OPTION = re.compile(r"(?<![\w-])--[a-z]")
COMMAND = re.compile(r"pkm-rig (?!\d|X|or|is)[a-z]+")


def messages(path):
    """Texts of a module that hold an option or a command, X for each value; documentation is none."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documentation, parts = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            documentation.add(id(node.value))
        if isinstance(node, ast.keyword) and node.arg == "description":  # of a key of a file
            documentation |= {id(inner) for inner in ast.walk(node.value)}
        if isinstance(node, ast.JoinedStr):
            parts |= {id(value) for value in node.values}
    for node in ast.walk(tree):
        if id(node) in documentation or id(node) in parts:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(str(v.value) if isinstance(v, ast.Constant) else "X" for v in node.values)
        else:
            continue
        if not text.startswith("--") and (OPTION.search(text) or COMMAND.search(text)):  # an option that was typed
            yield text


FOUND = sorted({text for path in PLACES if path.name not in NOT_OF_THE_PAGE for text in messages(path)})


def test_there_are_messages_to_look_at():
    assert len(FOUND) > 12
    assert any("--new-setup" in text for text in FOUND)


@pytest.mark.parametrize("text", FOUND)
def test_no_message_names_an_option_without_saying_where_it_is_typed(text):
    said = on_page(text)
    assert AT_COMPUTER in said or not (OPTION.search(said) or COMMAND.search(said))


def test_most_of_them_say_what_to_press():
    pressed = [text for text in FOUND if AT_COMPUTER not in on_page(text)]
    assert len(pressed) > 0.6 * len(FOUND)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "nest check: a floor nest moved; secure the station's stand and go on with --new-setup; readings since",
            "secure the station's stand, then press Go on in a new set-up; readings since",
        ),
        ("campaign (operator): ended while it waited; go on with --resume", "press Go on with the campaign"),
        ("drive left (node 1): no reference; home the drive (pkm-rig home --rig RIG.toml)", "press Home what lost its"),
        ("no campaign 'x'; `pkm-rig list` shows what is there", "History shows what is there"),
        ("see `pkm-rig archive ID FILE`", "`pkm-rig archive ID FILE` at the panel's computer"),
        ("guard closed: open; close it", "guard closed: open; close it"),
        (
            "make one with `createdb --encoding=UTF8`",
            "make one with `createdb --encoding=UTF8` (at the panel's computer)",
        ),
        ("there already; give another folder with --out", "there already; have the panel started with another folder"),
    ],
)
def test_what_is_said_instead(line, said):
    assert said in on_page(line)
