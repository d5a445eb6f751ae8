"""A plugin of pytest: which lines each test function executes, and how long it takes, into the file `--lines-to`.

Lines that are executed while a module is imported, or where a fixture of more than one test is set up, are those of the
file of tests. What is cached is forgotten before each test, so that not only the first one executes it. Lines of other
threads count as those of the test that is running; those of other processes are not seen.
"""

from __future__ import annotations

import functools
import gc
import json
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import coverage
import pytest

_OURS = ("drivers", "calibration", "tests")
_coverage = coverage.Coverage(data_file=None, config_file=False, include=["drivers/*", "calibration/*"])
_seconds: Counter[str] = Counter()
_now = ""
_caches: list[Any] = []


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--lines-to", type=Path)
    _coverage.start()


def pytest_collection_finish() -> None:
    _caches.extend(
        one
        for one in gc.get_objects()
        if type(one) is functools._lru_cache_wrapper and str(one.__module__).startswith(_OURS)
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    for cache in _caches:
        cache.cache_clear()
    _switch(function_of(item.nodeid))
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
    if fixturedef.scope == "function":
        return (yield)
    former = _now
    _switch("")
    try:
        return (yield)
    finally:
        _switch(former)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _seconds[function_of(report.nodeid)] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    _coverage.stop()
    data = _coverage.get_data()
    lines: dict[str, dict[str, list[int]]] = {function: {} for function in ["", *_seconds]}
    for path in sorted(data.measured_files()):
        file = str(Path(path).relative_to(session.config.rootpath))
        for line, functions in sorted(data.contexts_by_lineno(path).items()):
            for function in functions:
                lines[function].setdefault(file, []).append(line)
    session.config.getoption("--lines-to").write_text(json.dumps({"seconds": _seconds, "lines": lines}))


def function_of(test: str) -> str:
    """A test without its parameters, whose texts may depend on what a mutant changes."""
    return test.partition("[")[0]


def _switch(context: str) -> None:
    global _now  # noqa: PLW0603 - hooks have no other place in common
    _now = context
    _coverage.switch_context(context)
