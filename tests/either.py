"""For property tests: what something gives, or the line that it is refused with, so that both can be asserted on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def either(work: Callable[[], Result], *refusals: type[Exception]) -> tuple[Result | None, str | None]:
    """(result, None), or (None, line) for one of `refusals`, which must be one line."""
    try:
        return work(), None
    except refusals as error:
        line = str(error)
    assert line
    assert not any(ord(letter) < 32 or 0x7F <= ord(letter) < 0xA0 for letter in line), repr(line)
    return None, line
