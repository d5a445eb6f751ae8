"""Names of version 0.1 that users' effect files may still use."""

from __future__ import annotations


def former_name(current: str) -> property:
    """A read-only attribute that stands for another attribute or method of the same object."""
    return property(lambda owner: getattr(owner, current), doc=f"The name of `{current}` in version 0.1.")
