"""Started by `jail.py`, already shut in: takes a recording, then becomes the program that is tried.

    python -I -S inside.py CONFIG

CONFIG is JSON: `jail` (path of jail.py), `way`, `folder` (where the recording goes), `scratch` (a folder that the
program may write to, where there are namespaces; else it may write nowhere), `cpu_s`, `output_bytes`, `program` (words;
{folder} stands for the recording), `environment`. Name and files of the recording are JSON on standard input. Standard
library only.
"""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import sys
from types import ModuleType
from typing import Any


def main() -> None:
    """Write the recording down, give up what may be given up, become the program."""
    config: dict[str, Any] = json.loads(sys.argv[1])
    order = json.loads(sys.stdin.read())
    jail = _loaded(config["jail"])
    if config["way"] == jail.NAMESPACES:
        jail._mount("tmpfs", config["scratch"], "tmpfs", jail._NO_SUID | jail._NO_DEV)
    with jail.receive(config["way"], config["folder"], order["name"], order["files"]) as folder:
        for kind, limit in ((resource.RLIMIT_CPU, config["cpu_s"]), (resource.RLIMIT_FSIZE, config["output_bytes"])):
            resource.setrlimit(kind, (limit, limit))
        os.dup2(os.open("/dev/null", os.O_RDONLY), 0)
        program = [word.replace("{folder}", str(folder)) for word in config["program"]]
        os.execve(program[0], program, config["environment"])


def _loaded(path: str) -> ModuleType:
    """By its path: its folder cannot be listed from here."""
    spec = importlib.util.spec_from_file_location("jail", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, OSError) as error:
        print(f"inside: {error}", file=sys.stderr)
        sys.exit(3)
