"""Copies of the working tree in temporary folders, in which code may be spoilt: the checkout is never touched."""

from __future__ import annotations

import fcntl
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Literal, TypeVar

ROOT = Path(__file__).parents[1]
PREFIX = "pkm-rig-copy-"
Ran = Literal["green", "red", "time-out"]
WAITING = 4.0
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

# Tests run in a session of their own, with whatever they start. Beside them waits a shell that reads from this pipe,
# which nobody writes to: it ends when this process does, by SIGKILL too, or by `_end_all_tests`, and takes them along.
_lifeline, _held_open = os.pipe()
_SHELL = (
    "exec 3<&0 </dev/null; (cat <&3; kill -KILL 0) >/dev/null 2>&1 & "
    'exec 3<&-; ulimit -S -t {limit_s}; exec "$@"'
)  # fmt: skip


@contextmanager
def copied_tree() -> Iterator[Path]:
    """A folder with what git knows of the working tree, as it is now. Removes copies whose process is gone, too."""
    _remove_forsaken()
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as folder, _owned(Path(folder)):
        tree = Path(folder)
        for name in known_files():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
        _compile(tree)
        yield tree


def _compile(tree: Path) -> None:
    """Compile everything once, found by its contents: a date does not tell two spoilt texts of one second apart."""
    command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "."]
    subprocess.run(command, cwd=tree, check=True)


def known_files() -> list[str]:
    """What git knows of the working tree and is there."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    return [name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


@contextmanager
def _owned(folder: Path) -> Iterator[None]:
    """Raises OSError if another process has it."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _remove_forsaken() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError), _owned(folder):
            shutil.rmtree(folder, ignore_errors=True)


def over_copies(
    jobs: int, items: Sequence[_Item], work: Callable[[Path, _Item], _Result]
) -> Iterator[tuple[_Item, _Result]]:
    """Work on items in so many copies of the tree, results in the order of the items. An interrupt ends the tests."""
    with ExitStack() as stack:
        trees: SimpleQueue[Path] = SimpleQueue()
        for _ in range(min(jobs, len(items))):
            trees.put(stack.enter_context(copied_tree()))

        def in_a_copy(item: _Item) -> _Result:
            tree = trees.get()
            try:
                return work(tree, item)
            finally:
                trees.put(tree)

        pool = stack.enter_context(ThreadPoolExecutor(jobs))
        try:
            with closing(pool.map(in_a_copy, items)) as results:
                yield from zip(items, results, strict=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            _end_all_tests()
            raise


def _end_all_tests() -> None:
    with suppress(OSError):
        os.close(_held_open)


def run_tests(tree: Path, tests: Sequence[str], limit_s: float, *options: str) -> tuple[Ran, str]:
    """Run tests of a copy until the first failure; the last lines tell which. Only collected tests count as green.

    The limit is processor time, so that other work on the computer ends no test; one that waits for ever has
    `WAITING` times as long. Raises RuntimeError if it cannot be run, or was killed by somebody else.
    """
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    quick = [
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        "--assert",
        "plain",
    ]  # half a second to two less before the first test
    pytest = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", *quick]
    with subprocess.Popen(
        ["sh", "-c", _SHELL.format(limit_s=math.ceil(limit_s)), "sh", *pytest, *options, *tests],
        cwd=tree,
        env=environment,
        stdin=_lifeline,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            said, _ = process.communicate(timeout=WAITING * limit_s)
        except subprocess.TimeoutExpired:
            return "time-out", f"not done in {WAITING * limit_s:g} s"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    if process.returncode == -signal.SIGXCPU:
        return "time-out", f"not done in {limit_s:g} s of processor time"
    lines = said.decode("utf-8", "replace").strip().splitlines()
    failed = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    last = (failed or lines or ["nothing was said"])[-1]
    if process.returncode not in (0, 1, 2) and not failed:
        raise RuntimeError(f"pytest ended with {process.returncode}: {last}")
    return ("red", last) if process.returncode else ("green", "all green")


def nearest_first(tree: Path, tests: Sequence[str], file: str) -> list[str]:
    """The test files of some folders, those first that name the module in `file`: most errors are found in seconds."""
    return sorted(test_files(tree, tests), key=lambda name: not names_module(tree, name, file))


def test_files(tree: Path, tests: Sequence[str]) -> list[str]:
    """The test files of some folders, and single ones."""
    files = [path for test in tests for path in (sorted((tree / test).rglob("test_*.py")) or [tree / test])]
    return [str(path.relative_to(tree)) for path in files]


def names_module(tree: Path, test: str, file: str) -> bool:
    """Whether a file of tests names the module in `file`."""
    return file.removesuffix(".py").replace("/", ".") in (tree / test).read_text(encoding="utf-8")


@contextmanager
def spoilt(path: Path, text: str) -> Iterator[None]:
    """Another text in a file of a copy; the former one is put back."""
    former = path.read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(former, encoding="utf-8")
