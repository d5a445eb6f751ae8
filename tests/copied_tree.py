"""A copy of the working tree in a temporary folder, in which code may be spoilt: the checkout is never touched."""

from __future__ import annotations

import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).parents[1]
Ran = Literal["green", "red", "time-out"]
WAITING = 10.0


@contextmanager
def copied_tree() -> Iterator[Path]:
    """A folder with what git knows of the working tree, as it is now."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    with tempfile.TemporaryDirectory(prefix="pkm-rig-copy-") as folder:
        tree = Path(folder)
        for name in listed.stdout.decode().split("\0"):
            if name and (ROOT / name).is_file():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, tree / name)
        yield tree


def run_tests(tree: Path, tests: Sequence[str], limit_s: float) -> tuple[Ran, str]:
    """Run tests of a copy until the first failure; the last lines tell which. Only collected tests count as green.

    The limit is processor time, so that other work on the computer ends no test; one that waits for ever has
    `WAITING` times as long.
    """
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    pytest = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--no-header", *tests]
    command = ["sh", "-c", f'ulimit -t {math.ceil(limit_s)}; exec "$@"', "sh", *pytest]
    with subprocess.Popen(
        command, cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    ) as process:
        try:
            said, _ = process.communicate(timeout=WAITING * limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)  # its own session: the tests and what they started
            process.communicate()
            return "time-out", f"not done in {WAITING * limit_s:g} s"
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        return "time-out", f"not done in {limit_s:g} s of processor time"
    lines = said.decode("utf-8", "replace").strip().splitlines()
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    last = (failed or lines or ["nothing was said"])[-1]
    if process.returncode not in (0, 1, 2):
        raise RuntimeError(f"pytest ended with {process.returncode}: {last}")
    return ("red", last) if process.returncode else ("green", "all green")


def nearest_first(tree: Path, tests: Sequence[str], file: str) -> list[str]:
    """The test files of some folders, those first that name the module in `file`: most errors are found in seconds."""
    files = [path for test in tests for path in (sorted((tree / test).rglob("test_*.py")) or [tree / test])]
    module = file.removesuffix(".py").replace("/", ".")
    far = {path: module not in path.read_text(encoding="utf-8") for path in files}
    return [str(path.relative_to(tree)) for path in sorted(files, key=lambda path: far[path])]


@contextmanager
def spoilt(path: Path, text: str) -> Iterator[None]:
    """Another text in a file of a copy; the former one is put back."""
    former = path.read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(former, encoding="utf-8")
