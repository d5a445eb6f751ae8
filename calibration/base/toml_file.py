"""Reading checked TOML: data only, unknown keys refused, every complaint one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from calibration.base.errors import InputError, printable
from calibration.base.plain_file import read_text
from calibration.base.text_bounds import check_toml_text


class Section(BaseModel):
    """A table of a TOML file: frozen, finite numbers only, no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _check_label(text: str) -> str:
    if not 0 < len(text) <= LONGEST_LABEL:
        raise ValueError(f"a name has 1 to {LONGEST_LABEL} characters")
    if printable(text) != text:
        raise ValueError("a name holds no control characters")
    return text


def _check_cell(text: str) -> str:
    if text.startswith(("=", "+", "-", "@")):
        raise ValueError("a name that stands in tables does not begin with = + - @: spreadsheets would compute it")
    return text


LONGEST_LABEL = 200
SHOWN = 40  # characters of a value in a complaint
Label = Annotated[str, AfterValidator(_check_label)]  # a name that people read
CellLabel = Annotated[Label, AfterValidator(_check_cell)]  # the same, where it stands in CSV files too
AnySection = TypeVar("AnySection", bound=Section)


def parse_toml(text: str, model: type[AnySection], name: str) -> AnySection:
    """Check a TOML text against a model; messages begin with `name`."""
    check_toml_text(text, name)
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: not TOML: {error}") from error
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{name}: {_first_complaint(error)}") from error


def read_toml(path: Path, model: type[AnySection]) -> AnySection:
    """Read and check a TOML file."""
    return parse_toml(read_text(path), model, str(path))


def _first_complaint(error: ValidationError) -> str:
    """One complaint in one line: a key that is not known first, since a misspelt key is missing elsewhere."""
    complaints = error.errors()
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])
    where = ".".join(str(part) for part in first["loc"])
    more = f" (and {len(complaints) - 1} more)" if len(complaints) > 1 else ""
    if first["type"] == "extra_forbidden":
        return f"unknown key '{where}'; remove it or correct its spelling{more}"
    if first["type"] == "missing":
        return f"no key '{where}'; add it{more}"
    message = str(first["msg"]).replace("\n", " ").removeprefix("Value error, ")
    if message.startswith("Input should "):
        given = printable(repr(first["input"]))
        shown = given if len(given) <= SHOWN else f"{given[:SHOWN]}..."
        message = f"{shown} should {message.removeprefix('Input should ')}; correct it"
    return f"'{where}': {message}{more}" if where else f"{message}{more}"
