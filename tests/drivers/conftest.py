"""A bench of mock drives."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.drivers.drive_bench import Open, benches


@pytest.fixture
def opened() -> Iterator[Open]:
    yield from benches()
