"""Runs pytest again and again, each time in a fork of a process that has loaded everything but our own code.

Started as a script by `PytestServer`, so that nothing of `tests` is loaded either. A request is a line of JSON (folder,
arguments, limits), the answer another one (status, what was said). The tests run in a session of their own; when the
input ends, which it does however the other process ends, they and what they started are killed.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

LOADED = (
    "canopen", "coverage", "cryptography.x509", "filterpy.kalman", "geocompy", "hypothesis.strategies", "mpmath",
    "numpy", "pydantic", "pymodbus.client", "pymodbus.server", "pytest", "rich.console", "scipy.interpolate",
    "scipy.ndimage", "scipy.optimize", "scipy.stats", "serial", "trustme", "xdist.plugin",
)  # fmt: skip
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}  # a fork has only one


class PytestServer:
    """The process that is forked; one run at a time."""

    def __init__(self) -> None:
        environment = {**os.environ, **ONE_THREAD, "PYTHONDONTWRITEBYTECODE": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, folder: Path, arguments: Sequence[str], cpu_s: float, wall_s: float) -> tuple[int | None, str]:
        """The status, negative for a signal, None if `wall_s` is over; and what was said. Raises RuntimeError."""
        request = {"folder": str(folder), "arguments": list(arguments), "cpu_s": int(cpu_s) + 1, "wall_s": wall_s}
        try:
            print(json.dumps(request), file=self._process.stdin, flush=True)
            status, said = json.loads(self._process.stdout.readline())  # type: ignore[union-attr]
        except (OSError, ValueError) as error:
            raise RuntimeError("the server of pytest has ended") from error
        return status, said

    def close(self) -> None:
        """End what runs, and the server."""
        with suppress(OSError):
            self._process.stdin.close()  # type: ignore[union-attr]
        self._process.wait()


def serve(requests: IO[str], answers: IO[str]) -> None:
    """Answer requests until they end."""
    sys.path[:] = [path for path in sys.path if path != os.environ.get("PYTHONPATH")]
    for name in LOADED:
        with suppress(ImportError):
            importlib.import_module(name)
    gc.freeze()
    for line in iter(requests.readline, ""):
        request = json.loads(line)
        with tempfile.TemporaryFile() as said:
            child = os.fork()
            if child == 0:
                sys.exit(_run(request, said.fileno()))
            status = _status(child, requests, request["wall_s"])
            said.seek(0)
            print(json.dumps([status, said.read().decode("utf-8", "replace")]), file=answers, flush=True)


def _run(request: dict[str, Any], said: int) -> int:
    """In the fork: pytest, as if it had been started in the folder."""
    os.setsid()
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(said, 1)
    os.dup2(said, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (request["cpu_s"], resource.getrlimit(resource.RLIMIT_CPU)[1]))
    os.chdir(request["folder"])
    os.environ["PYTHONPATH"] = request["folder"]
    sys.path.insert(0, request["folder"])
    return int(importlib.import_module("pytest").main(request["arguments"]))


def _status(child: int, requests: IO[str], wall_s: float) -> int | None:
    """How it ended; None if it was not in time. Ends with it if nobody waits for that any more."""
    ended = os.pidfd_open(child)
    ready, _, _ = select.select([ended, requests], [], [], wall_s)
    os.close(ended)
    os.kill(child, signal.SIGKILL)
    with suppress(ProcessLookupError):  # it had no session yet
        os.killpg(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if ended not in ready and requests in ready:
        sys.exit(0)
    return os.waitstatus_to_exitcode(status) if ready else None


if __name__ == "__main__":
    serve(sys.stdin, sys.stdout)
