"""Lets the tests of this folder import its helper modules; a bench of mock drives."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_bench import Open, benches


@pytest.fixture
def opened() -> Iterator[Open]:
    yield from benches()
