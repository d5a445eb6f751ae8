"""The pages of the documentation, and what in them points to something else."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = tuple(
    sorted(
        path.relative_to(ROOT) for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")) if path.name.isascii()
    )
)
TOP_FOLDERS = ("benchmarks", "calibration", "docs", "drivers", "examples", "mock_devices", "pkm_rig", "tests")
FENCE = re.compile(r"^(\s*)(```|~~~).*?^\1\2\s*$", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
PATH = re.compile(rf"(?<![\w./-])(?:{'|'.join(TOP_FOLDERS)})(?:/[\w.*-]+)+/?")
MODULE = re.compile(rf"python -m ((?:{'|'.join(TOP_FOLDERS)})(?:\.\w+)+)")
HEADING = re.compile(r"^#{1,6}\s+(.*?)\s*#*$", re.MULTILINE)


def text_of(page: Path) -> str:
    """A page without its blocks of code and its comments."""
    return COMMENT.sub("", FENCE.sub("", (ROOT / page).read_text(encoding="utf-8")))


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """File (absolute) and anchor ("" without one) of every relative link of a page."""
    for target in LINK.findall(CODE.sub("", text_of(page))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        yield ((ROOT / page).parent / path if path else ROOT / page).resolve(), anchor


def paths_in_code(page: Path) -> Iterator[str]:
    """Paths below the top folders that a page names in `code`, and those of modules that it runs."""
    for code in CODE.findall(text_of(page)):
        yield from PATH.findall(code)
    for module in MODULE.findall((ROOT / page).read_text(encoding="utf-8")):
        path = module.replace(".", "/")
        yield f"{path}/__main__.py" if (ROOT / path).is_dir() else f"{path}.py"


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as web views of Markdown make them."""
    names: set[str] = set()
    for heading in HEADING.findall(text_of(page)):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").lower()
        name = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        number = 0
        while (numbered := f"{name}-{number}" if number else name) in names:
            number += 1
        names.add(numbered)
    return names
