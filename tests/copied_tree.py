"""Copies of the working tree in temporary folders, in which code may be spoilt: the checkout is never touched."""

from __future__ import annotations

import fcntl
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

from tests.pytest_server import PytestServer

ROOT = Path(__file__).parents[1]
PREFIX = "pkm-rig-copy-"
Ran = Literal["green", "red", "time-out"]
WAITING = 4.0
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


class CopiedTree:
    """A copy in which tests are run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._server = PytestServer()

    def run(self, tests: Sequence[str], limit_s: float, *options: str) -> tuple[Ran, str]:
        """Run tests until the first failure; the last lines tell which. Only collected tests count as green.

        The limit is processor time, so that other work on the computer ends no test; one that waits for ever has
        `WAITING` times as long. Raises RuntimeError if it cannot be run, or was killed by somebody else.
        """
        arguments = ["-x", "-q", "-n", "0", "--no-header", "-p", "no:cacheprovider", "--assert", "plain"]
        status, said = self._server.run(self.path, [*arguments, *options, *tests], limit_s, WAITING * limit_s)
        if status is None:
            return "time-out", f"not done in {WAITING * limit_s:g} s"
        if status == -signal.SIGXCPU:
            return "time-out", f"not done in {limit_s:g} s of processor time"
        lines = said.strip().splitlines()
        failed = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
        last = (failed or lines or ["nothing was said"])[-1]
        if status not in (0, 2) and not failed:
            raise RuntimeError(f"pytest ended with {status}: {last}")
        return ("red", last) if status else ("green", "all green")

    def close(self) -> None:
        """End the tests that run."""
        self._server.close()


@contextmanager
def copied_tree() -> Iterator[CopiedTree]:
    """A folder with what git knows of the working tree, as it is now. Removes copies whose process is gone, too."""
    _remove_forsaken()
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as folder, _owned(Path(folder)):
        tree = Path(folder)
        tree.chmod(0o755)  # some tests become another user, who has to find the code
        for name in known_files():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
        _compile(tree)
        with closing(CopiedTree(tree)) as copy:
            yield copy


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
    jobs: int, items: Sequence[_Item], work: Callable[[CopiedTree, _Item], _Result]
) -> Iterator[tuple[_Item, _Result]]:
    """Work on items in so many copies of the tree, results in the order of the items. An interrupt ends the tests."""
    with ExitStack() as stack:
        copies = [stack.enter_context(copied_tree()) for _ in range(min(jobs, len(items)))]
        free: SimpleQueue[CopiedTree] = SimpleQueue()
        for copy in copies:
            free.put(copy)

        def in_a_copy(item: _Item) -> _Result:
            copy = free.get()
            try:
                return work(copy, item)
            finally:
                free.put(copy)

        pool = stack.enter_context(ThreadPoolExecutor(jobs))
        try:
            with closing(pool.map(in_a_copy, items)) as results:
                yield from zip(items, results, strict=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for copy in copies:
                copy.close()
            raise


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
