"""Orders to a process that answers each with one line of JSON."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from typing import Any


def exchange(process: subprocess.Popen[str], order: Mapping[str, Any]) -> dict[str, Any] | None:
    """The answer to an order; None if the process has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(json.dumps(order) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
    except BrokenPipeError:
        line = ""
    if not line:
        return None
    answer: dict[str, Any] = json.loads(line)
    return answer
