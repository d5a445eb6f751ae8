from __future__ import annotations

import pytest

from tests.postgres_server import running_server


@pytest.fixture(scope="session")
def server():
    """A PostgreSQL server for all tests of a session; they are skipped, with the reason, where there can be none."""
    with running_server() as server:
        yield server
