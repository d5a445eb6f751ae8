"""Sizes of modules and functions, in lines, of a revision or of the work tree.

`python -m benchmarks.code_sizes [REVISION ...]` prints a table for each revision (any name that git knows), without
one for the work tree. All lines count, also comments, docstrings and empty ones; a function counts from its `def`,
a nested one also in the one around it. The test data and `__init__.py` files of one line are left out.
"""

from __future__ import annotations

import argparse
import ast
import io
import statistics
import subprocess
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("calibration", "drivers", "mock_devices", "pkm_rig", "tests")
LEFT_OUT = "tests/data/"
HEADER = (
    "| folder | modules | median | 90 % | largest module | functions | median | 90 % | largest function |",
    "| --- | --: | --: | --: | --- | --: | --: | --: | --- |",
)


@dataclass
class Sizes:
    """Lines of each module and of each function of a folder, by name."""

    modules: dict[str, int] = field(default_factory=dict)
    functions: dict[str, int] = field(default_factory=dict)

    def add(self, path: str, text: str) -> None:
        """Count a module and its functions."""
        lines = len(text.splitlines())
        if lines <= 1:
            return
        self.modules[path] = lines
        for name, size in _functions(ast.parse(text), ""):
            self.functions[f"{path}: {name}"] = size


def _functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, int]]:
    for child in ast.iter_child_nodes(node):
        name = prefix
        if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            name = f"{prefix}{child.name}"
            if not isinstance(child, ast.ClassDef) and child.end_lineno is not None:
                yield name, child.end_lineno - child.lineno + 1
            name += "."
        yield from _functions(child, name)


def sizes_by_folder(files: Iterator[tuple[str, str]]) -> dict[str, Sizes]:
    """Sizes from paths and texts of files."""
    sizes = {folder: Sizes() for folder in FOLDERS}
    for path, text in files:
        folder = path.partition("/")[0]
        if folder in sizes and not path.startswith(LEFT_OUT):
            sizes[folder].add(path, text)
    return sizes


def files_of_revision(revision: str) -> Iterator[tuple[str, str]]:
    """Paths and texts of the Python files of a revision."""
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        for member in tar:
            stream = tar.extractfile(member) if member.name.endswith(".py") else None
            if stream is not None:
                yield member.name, stream.read().decode("utf-8")


def files_of_work_tree() -> Iterator[tuple[str, str]]:
    """Paths and texts of the Python files on disk."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def table(sizes: dict[str, Sizes]) -> list[str]:
    """A table in Markdown, one row a folder."""
    return [*HEADER, *(_row(folder, s) for folder, s in sizes.items() if s.modules)]


def _row(folder: str, sizes: Sizes) -> str:
    return f"| {folder} | {_cells(sizes.modules, folder)} | {_cells(sizes.functions, folder)} |"


def _cells(lines: dict[str, int], folder: str) -> str:
    if not lines:
        return "0 | | |"
    name = max(lines, key=lambda key: lines[key])
    ordered = sorted(lines.values())
    upper = ordered[int(0.9 * (len(ordered) - 1))]
    largest = f"{lines[name]} `{name.removeprefix(folder + '/')}`"
    return f"{len(ordered)} | {statistics.median(ordered):.0f} | {upper} | {largest}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.code_sizes", description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs="*", metavar="REVISION")
    for revision in parser.parse_args(arguments).revisions or [None]:
        files = files_of_work_tree() if revision is None else files_of_revision(revision)
        print(f"{revision or 'work tree'}\n")
        print("\n".join(table(sizes_by_folder(files))) + "\n")


if __name__ == "__main__":
    main()
