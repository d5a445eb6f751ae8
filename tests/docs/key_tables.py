"""Writes the pages that list the keys of the project's TOML files, from the models that check them.

    python -m tests.docs.key_tables

What a key means, its limits and its default stand in the model alone; a test holds the pages equal to what this writes.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from calibration.base.toml_file import Section
from calibration.machine.machine_file import MachineFile
from calibration.recording.header import RecordingFile
from pkm_rig.rig.campaign_sections import CampaignFile
from pkm_rig.rig.config import RigFile
from tests.docs.pages import ROOT

FOLDER = ROOT / "docs" / "reference"
SCALARS = {float: "number", int: "whole number", str: "text", bool: "true or false", date: "date"}
HEAD = """Written by `python -m tests.docs.key_tables` from the models that check the file. Units are the last part of a
key's name. A key without a default must be given; an unknown key is refused."""


@dataclass(frozen=True)
class Page:
    """A page: its name, its title, what is said before the tables, and the model of the file."""

    name: str
    title: str
    about: str
    model: type[Section]


PAGES = (
    Page(
        "rig-file.md",
        "The rig file, key by key",
        "How the devices are reached, what is mounted and what a campaign does. Registers of the PLC:\n"
        "[plc.md](plc.md); drive profiles and homing: [drive-objects.md](drive-objects.md). An example for a mock rig\n"
        "on real transports is [mock-rig.toml](../../examples/mock-rig.toml).",
        RigFile,
    ),
    Page(
        "campaign-file.md",
        "The campaign file, key by key",
        "Visits for `pkm-rig measure --campaign FILE`; `pkm-rig diagnose` writes such files. A table in CSV does as "
        "well, by the\nend `.csv` of its name: a row a visit, a column for each commanded coordinate, named as in "
        "[recordings](recording.md)\n(`target_x_m`, `target_rz_rad` ...), and if wanted `payload`, `speed_m_per_s`, "
        "`dwell_s` and the sides of all drives,\n`NAME_direction`, 1 or -1.",
        CampaignFile,
    ),
    Page(
        "machine-file.md",
        "The machine file, key by key",
        "Frames, signs, branches and formulas: [machine.md](machine.md).",
        MachineFile,
    ),
    Page(
        "recording-header.md",
        "recording.toml, key by key",
        "The header of a recording folder; its readings: [recording.md](recording.md).",
        RecordingFile,
    ),
)


def write(page: Page) -> str:
    """The text of a page."""
    parts = [f"# {page.title}", page.about, HEAD]
    for path, model, many in _sections(page.model, "", many=False):
        parts.append(f"## {_heading(path, model, many)}")
        parts.append(inspect.cleandoc(model.__doc__ or ""))
        parts.append(_table(model))
    return "\n\n".join(parts) + "\n"


def _heading(path: str, model: type[Section], many: bool) -> str:
    if not path:
        return "Top level"
    kind = _kind(model)
    return (f"`[[{path}]]`" if many else f"`[{path}]`") + (f' with `kind = "{kind}"`' if kind else "")


def _sections(model: type[Section], path: str, *, many: bool) -> Iterator[tuple[str, type[Section], bool]]:
    """Path, model and whether it is a list, of a section and of those in it."""
    yield path, model, many
    for name, field in model.model_fields.items():
        for inner, repeated, named in _models(field.annotation):
            inner_path = f"{path}.{name}" if path else name
            yield from _sections(inner, f"{inner_path}.NAME" if named else inner_path, many=repeated)


def _kind(model: type[Section]) -> str | None:
    """The value of `kind` that selects a model, if there is just one."""
    field = model.model_fields.get("kind")
    values = () if field is None else get_args(field.annotation)
    return values[0] if len(values) == 1 else None


def _models(annotation: Any) -> Iterator[tuple[type[Section], bool, bool]]:
    """Models in an annotation: the model, whether it is one of a list, whether it is one of a table by name."""
    if inspect.isclass(annotation) and issubclass(annotation, Section):
        yield annotation, False, False
        return
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        inner = inner[:1]
    seen: list[type[Section]] = []
    for part in inner:
        for model, repeated, named in _models(part):
            if model not in seen:
                seen.append(model)
                yield model, repeated or origin is tuple, named or origin is dict


def _table(model: type[Section]) -> str:
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for name, field in model.model_fields.items():
        if not field.description:
            raise ValueError(f"{model.__name__}.{name} has no description")
        rows.append(f"| `{name}` | {_value(field)} | {_default(field)} | {field.description} |")
    return "\n".join(rows)


def _value(field: FieldInfo) -> str:
    text = _type(field.annotation)
    limits = _limits(field.metadata)
    return f"{text}{limits}"


def _type(annotation: Any) -> str:
    """An annotation in words."""
    if annotation in SCALARS:
        return SCALARS[annotation]
    if inspect.isclass(annotation) and issubclass(annotation, Section):
        return "section"
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        words = _type(inner[0]) + _limits(inner[1:])
    elif origin is Literal:
        words = ", ".join(f"`{value}`" for value in inner)
    elif origin in (Union, types.UnionType):
        words = ", or ".join(dict.fromkeys(_type(part) for part in inner if part is not type(None)))
    elif origin is dict:
        words = f"table of {_plural(_type(inner[1]))} by name"
    elif origin is tuple:
        words = _tuple(inner)
    else:
        raise TypeError(f"no words for {annotation}")
    return words


def _tuple(inner: Sequence[Any]) -> str:
    """A list of anything, or of so many."""
    one = _type(inner[0])
    if inner[-1] is Ellipsis:
        return "sections" if one == "section" else f"list of {_plural(one)}"
    return f"{len(inner)} {_plural(one)}"


def _plural(words: str) -> str:
    for singular in ("section", "number", "text"):
        words = words.replace(singular, f"{singular}s", 1) if words.startswith(singular) else words
    if words.startswith("whole number"):
        words = words.replace("whole number", "whole numbers", 1)
    return words.replace("list of", "lists of")


def _limits(metadata: Sequence[Any]) -> str:
    """Limits of a number or of a list's length, in words."""
    words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    items = []
    for item in metadata:
        if isinstance(item, FieldInfo):
            items.append(_limits(item.metadata).removeprefix(", "))
        items += [f"{word} {_number(getattr(item, key))}" for key, word in words.items() if hasattr(item, key)]
        if hasattr(item, "min_length"):
            items.append(f"{item.min_length} or more")
        if hasattr(item, "max_length"):
            items.append(f"at most {item.max_length}")
        if getattr(item, "pattern", None):
            items.append("letters, digits and `._-`")
    return "".join(f", {part}" for part in items if part)


def _number(value: float) -> str:
    return f"{value:.12g}" if isinstance(value, float) else f"{value}"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return ""
    value = field.get_default(call_default_factory=True)
    if value is None or value in ((), {}, ""):
        return "none"
    if isinstance(value, Section):
        return "its own"
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(part) for part in value)}]"
    return repr(value)


def main() -> None:
    """Write all pages."""
    for page in PAGES:
        path: Path = FOLDER / page.name
        path.write_text(write(page), encoding="utf-8")


if __name__ == "__main__":
    main()
