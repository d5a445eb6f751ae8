"""Runs any program on one recording, shut in: it sees itself, Python, the system's libraries and the recording.

The same jail as that of the check on withheld cases: a mount namespace and no network, else Landlock. The recording has
a random name. A program that prints no answer, fails or takes too long has answered wrongly, and why is kept.
"""

from __future__ import annotations

import json
import os
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.gapbench.answer import Answer, NotAnAnswer, read_answer
from benchmarks.withheld import jail
from benchmarks.withheld.jail import NAMESPACES, UNSEALED
from benchmarks.withheld.sealed_diagnoser import ONE_CORE, SYSTEM, WAYS, WHEELS, NotSealed, secret_paths

INSIDE = Path(__file__).parent / "inside.py"
OUTPUT_BYTES = 4_000_000
WAITS = 5.0  # by the clock, for each second on its core: others may be at work on the computer
PROGRAM = "/program"  # where a program's own folder is seen
SCRATCH = "/scratch"  # where it may write, in a namespace
PYTHON = os.path.realpath(sys.executable)
PROBE = """
import json, os, sys
found = []
for path in sys.argv[1:]:
    try:
        os.listdir(path) if os.path.isdir(path) else os.close(os.open(path, os.O_RDONLY))
        found.append(path)
    except OSError:
        pass
print(json.dumps(found))
"""


@dataclass(frozen=True)
class Entry:
    """A program. command: words, {folder} for the recording, {program} for its own folder; show: further paths that it
    sees. home: its own folder. A command that begins with PYTHON finds modules there, and the installed packages.
    """

    name: str
    command: tuple[str, ...]
    show: tuple[Path, ...] = ()
    home: Path | None = None


@dataclass(frozen=True)
class Tried:
    """What came of one recording: an answer, or a line on why there is none; seconds by the clock."""

    answer: Answer | None
    failure: str
    seconds: float


@dataclass(frozen=True)
class _Ended:
    status: int | None  # None: it took too long
    printed: str
    complaint: str
    seconds: float


class Trial:
    """Runs entries in one way of shutting in, '' for the first that the system allows. limit_s: time on the core (at
    least 1 s), and WAITS times that by the clock. Raises NotSealed."""

    def __init__(self, way: str = "", limit_s: float = 120.0) -> None:
        self.limit_s = limit_s
        self.way = way or _first_way(limit_s)

    def run(self, entry: Entry, files: Mapping[str, str]) -> Tried:
        """The answer to one recording, given as texts by name."""
        ended = _run(entry, entry.command, files, self.way, self.limit_s)
        if ended.status is None:
            failure = f"was not done after {WAITS * self.limit_s:g} s by the clock and was ended"
        elif ended.status < 0:
            limits = f"{self.limit_s:g} s on its core, 4 MB of output"
            failure = f"was ended by {signal.Signals(-ended.status).name} (limits: {limits})"
        elif ended.status:
            failure = f"ended with status {ended.status}: {_last_line(ended.complaint)}"
        else:
            try:
                return Tried(read_answer(ended.printed), "", ended.seconds)
            except NotAnAnswer as error:
                failure = str(error)
        return Tried(None, failure, ended.seconds)

    def prove(self, entry: Entry) -> None:
        """A planted reader in the place of an entry opens nothing that it must not; raises NotSealed."""
        if self.way == UNSEALED:
            return
        WHEELS.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=WHEELS) as planted:
            truth = Path(planted) / "truth.json"
            truth.write_text("{}", encoding="utf-8")
            paths = [str(path) for path in (*secret_paths(), truth)]
            through = [f"/proc/{of}/root{path}" for path in paths for of in ("1", "self", str(os.getpid()))]
            command = (PYTHON, "-c", PROBE, *paths, *through)
            ended = _run(entry, command, {}, self.way, self.limit_s)
        if ended.status != 0:
            raise NotSealed(f"{entry.name} cannot be shut in by {self.way}: {_last_line(ended.complaint)}")
        if opened := json.loads(ended.printed):
            raise NotSealed(f"{entry.name} could open {opened[0]}; nothing is scored. Show it less, or move it")


def entry_of(text: str, show: tuple[Path, ...]) -> Entry:
    """An entry from NAME=COMMAND; files that the command names are shown. Raises ValueError, one line."""
    name, _, command = text.partition("=")
    words = [word.replace("{python}", PYTHON) for word in shlex.split(command)]
    if not name.strip() or not words or not any("{folder}" in word for word in words):
        raise ValueError(f"--program '{text}': give NAME=COMMAND, with {{folder}} where the recording's folder goes")
    program = shutil.which(words[0])
    if program is None:
        raise ValueError(f"--program '{text}': there is no program '{words[0]}'; give its whole path")
    if (
        os.path.realpath(program) == PYTHON
    ):  # that of the checkout's environment is a link, and the checkout is not seen
        program = PYTHON
    files = [Path(word).absolute() for word in words[1:] if Path(word).is_file()]
    words = [program, *(str(Path(word).absolute()) if Path(word).is_file() else word for word in words[1:])]
    shown = (Path(program), *files, *(path.absolute() for path in show))
    for path in shown:
        if not path.exists():
            raise ValueError(f"--show '{path}' does not exist; name a file or a folder that the program needs")
        if any(path.is_relative_to(secret) or secret.is_relative_to(path) for secret in secret_paths()):
            raise ValueError(
                f"{path} is part of the checkout, or holds it, and the cases are made there; copy it elsewhere"
            )
    return Entry(name.strip(), tuple(words), shown)


def _first_way(limit_s: float) -> str:
    nothing = Entry("nothing", (PYTHON, "-c", ""))
    for way in WAYS:
        ended = _run(nothing, nothing.command, {}, way, limit_s)
        if ended.status == 0:
            return way
    raise NotSealed(
        f"programs cannot be shut in here: neither {' nor '.join(WAYS)} ({_last_line(ended.complaint)}); use a "
        "Linux that allows user namespaces or Landlock, or --unsealed for development"
    )


def _run(entry: Entry, command: tuple[str, ...], files: Mapping[str, str], way: str, limit_s: float) -> _Ended:
    """One start of a command as an entry sees it."""
    inside = way == NAMESPACES
    with tempfile.TemporaryDirectory(prefix="gapbench-") as outside:
        scratch, empty, printed = (Path(outside) / name for name in ("root", "empty", "printed"))
        scratch.mkdir()
        empty.mkdir()
        seen = _Seen(inside)
        starter, jailer = seen.at(INSIDE, "/gapbench/inside.py"), seen.at(Path(jail.__file__), "/gapbench/jail.py")
        packages = seen.at(Path(sysconfig.get_path("purelib")), "/packages")
        home = "" if entry.home is None else seen.at(entry.home, PROGRAM)
        if inside:
            seen.at(empty, SCRATCH)
        for path in (*map(Path, (*SYSTEM, "/usr", "/bin", sys.base_prefix)), *entry.show):
            seen.at(path, str(path))
        folder = "/recording" if inside else str(scratch)
        environment = dict.fromkeys(ONE_CORE, "1") | {"LANG": "C.UTF-8", "PATH": "/usr/bin:/bin"}
        environment |= dict.fromkeys(("HOME", "TMPDIR"), SCRATCH if inside else str(scratch))
        if command[0] == PYTHON:
            environment |= {"PYTHONPATH": ":".join(filter(None, (home, packages))), "PYTHONDONTWRITEBYTECODE": "1"}
        config: dict[str, Any] = {
            "jail": jailer, "way": way, "folder": folder, "scratch": SCRATCH, "cpu_s": max(int(limit_s), 1),
            "output_bytes": OUTPUT_BYTES, "environment": environment,
            "program": [word.replace("{program}", home) for word in command],
        }  # fmt: skip
        outer = {
            "way": way, "show": seen.pairs, "folder": folder, "root": str(scratch), "environment": environment,
            "program": [PYTHON, "-I", "-S", starter, json.dumps(config)],
        }  # fmt: skip
        order = json.dumps({"name": secrets.token_hex(8), "files": dict(files)})
        started = time.monotonic()
        with printed.open("w+b") as out, tempfile.TemporaryFile() as complaints:
            process = subprocess.Popen(
                [PYTHON, "-I", "-S", jail.__file__, json.dumps(outer)],
                stdin=subprocess.PIPE, stdout=out, stderr=complaints, cwd="/", start_new_session=True,
            )  # fmt: skip
            try:
                process.communicate(order.encode(), timeout=WAITS * limit_s)
                status: int | None = process.returncode
            except subprocess.TimeoutExpired:
                status = None
            finally:
                _end(process)
            seconds = time.monotonic() - started
            out.seek(0)
            complaints.seek(0)
            texts = [file.read(OUTPUT_BYTES).decode("utf-8", "replace") for file in (out, complaints)]
    return _Ended(status, texts[0], texts[1], seconds)


class _Seen:
    """Paths outside, each with its path inside; what lies below another one is seen with it."""

    def __init__(self, inside: bool) -> None:
        self.pairs: list[tuple[str, str]] = []
        self._inside = inside

    def at(self, path: Path, target: str) -> str:
        """Where a path is seen: at the target where there is a file system of one's own."""
        target = target if self._inside else str(path)
        above = any(Path(target).is_relative_to(there) and path.is_relative_to(here) for here, there in self.pairs)
        if path.exists() and not above:
            self.pairs.append((str(path), target))
        return target


def _end(process: subprocess.Popen[bytes]) -> None:
    """With all that it has started, which is a session of its own."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1][:200] if lines else "it said nothing on standard error"
