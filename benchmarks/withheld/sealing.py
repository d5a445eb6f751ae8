"""Keeps the mock plant out of the process that diagnoses."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

FORBIDDEN = "mock_devices"
# Truths and results of batches that are done already; the recordings of another simulator with their truth.
SECRETS = ("truth.json", "truth.npz", "results.jsonl", "results.json", "recordings.tar.xz")


class SealBroken(RuntimeError):
    """Something asked for the plant. Not an ImportError: nobody shall take it for an optional module."""


class _Refusal(MetaPathFinder):
    """Refuses to import the plant and records the attempt."""

    was_attempted = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Never finds anything; raises SealBroken for the plant."""
        if fullname.partition(".")[0] == FORBIDDEN:
            self.was_attempted = True
            raise SealBroken(f"a diagnosis asked for {fullname}; it may read nothing but the recording")
        return None


_refusal = _Refusal()


def seal() -> None:
    """Make importing the plant or opening its files raise SealBroken from now on; neither may have happened before."""
    check()
    sys.meta_path.insert(0, _refusal)
    sys.addaudithook(_on_event)


def check() -> None:
    """Raise SealBroken if the plant was imported, or if that was attempted and the error suppressed."""
    imported = sorted(name for name in sys.modules if name.partition(".")[0] == FORBIDDEN)
    if imported or _refusal.was_attempted:
        what = f"{imported[0]} was imported" if imported else "the plant or a truth was asked for"
        raise SealBroken(f"{what} where only recordings may be read")


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open":
        return
    path = str(arguments[0])
    if f"/{FORBIDDEN}/" in path or path.endswith(SECRETS):
        _refusal.was_attempted = True
        raise SealBroken(f"a diagnosis opened {path}; it may read nothing but the recording")
