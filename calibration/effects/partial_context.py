"""A context of readings that do not say everything: whoever asks for what is not there is told why."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from typing import Any

from calibration.effects.context import ReadingContext


class NotRecorded(Exception):
    """An effect asked for a field that the readings do not say; its text is why."""


class PartialContext(ReadingContext):
    """A context whose fields that are not said raise NotRecorded; whatever is computed from one asks for it."""

    @classmethod
    def of(cls, context: ReadingContext, names: Collection[str]) -> PartialContext:
        """The same readings without those of the named fields that they do not say."""
        partial = cls(**{f.name: getattr(context, f.name) for f in fields(context)})
        object.__setattr__(partial, "_hidden", {name: why for name, why in context.not_said.items() if name in names})
        return partial

    def __len__(self) -> int:
        return len(self.drives)

    def __getattribute__(self, name: str) -> Any:
        hidden = object.__getattribute__(self, "__dict__").get("_hidden", {})
        if name in hidden:
            raise NotRecorded(hidden[name])
        return super().__getattribute__(name)
