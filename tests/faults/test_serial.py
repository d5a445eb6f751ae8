"""Fifty faults drawn from a seed: each ends right or stops safely; a second run measures only what is missing."""

from __future__ import annotations

import pytest

from tests.faults.attempt import WRONG, attempt, reference
from tests.faults.drawn import drawn


@pytest.fixture(scope="module")
def wanted():
    return reference()


@pytest.mark.parametrize("fault", drawn("serial"), ids=str)
def test_a_fault(fault, wanted):
    result = attempt(fault, wanted)
    assert result.outcome != WRONG, result.detail
