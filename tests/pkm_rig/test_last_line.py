"""The last line on stderr is the message, whatever libraries have to say meanwhile and afterwards."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import asyncio, logging, sys
sys.argv = ["pkm-rig", "show", "nothing", "--out", "none"]
from pkm_rig.cli import main
try:
    main()
finally:
    for name, line in {lines!r}:
        logging.getLogger(name).error(line)
    loop = asyncio.new_event_loop()
    task = loop.create_task(asyncio.sleep(9.0))
    loop.call_exception_handler({{"message": "Task was destroyed but it is pending!", "task": task}})
    task.cancel()
    loop.run_until_complete(asyncio.gather(task, return_exceptions=True))
    loop.close()
"""
LINES = [
    ("can.socketcand", "Got incomplete message => waiting for more data"),
    ("can.notifier", "traceback"),
    ("canopen.network", "noise"),
    ("pymodbus.logging", "Repeating...."),
    ("bluesky.RE", "Run aborted"),
    ("asyncio", "Task exception was never retrieved"),
    ("matplotlib.font_manager", "findfont"),
]


@pytest.mark.parametrize("lines", [[], LINES], ids=["quiet", "noisy"])
def test_libraries_say_nothing_after_it(lines, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(lines=lines)],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("pkm-rig: there is no store")
    assert done.stdout == ""
