"""Checks a certificate against schema files that lie in a folder, and against the rules of the DCC's Schematron.

Nothing is fetched: every import of a schema is taken from the folder, by its name space and version.
"""

from __future__ import annotations

import importlib.util
import logging
import re
from pathlib import Path
from typing import NamedTuple

from calibration.base.errors import InputError
from pkm_rig.certificate.xml_form import DCC, MISSING, SIGNATURE, etree

MOST_SCHEMA_BYTES = 2_000_000
NOT_CHECKED = "not checked"
VALID = "valid"


class SchemaFile(NamedTuple):
    """A schema file: its target name space and its version."""

    path: Path
    name_space: str
    version: str


def check_schema(data: bytes, version: str, folder: Path | None) -> str:
    """`valid`, or `not checked` and why, by the schema of that version in a folder. InputError if it is not valid."""
    if folder is None:
        return f"{NOT_CHECKED}: no folder of schemas was given"
    files = find_schemas(folder)
    main = next((f for f in files if f.name_space == DCC and f.version == version), None)
    if main is None:
        return f"{NOT_CHECKED}: {folder} has no schema of version {version}"
    if importlib.util.find_spec("xmlschema") is None:
        raise InputError(MISSING)
    import xmlschema  # noqa: PLC0415  # of an extra

    def local(url: str) -> str:
        return str(_local_file(url, main, files))

    try:
        schema = xmlschema.XMLSchema(str(main.path), allow="local", defuse="always", uri_mapper=local)
    except (xmlschema.XMLSchemaException, _NotThere, OSError, ValueError) as error:
        return f"{NOT_CHECKED}: {main.path.name}: {_one_line(error)}"
    wrong = next(schema.iter_errors(etree().fromstring(data)), None)
    if wrong is not None:
        raise InputError(f"certificate: not valid by {main.path.name}: {wrong.path}: {_one_line(wrong.reason)}")
    return VALID


def check_rules(data: bytes) -> str:
    """`valid` by the Schematron that dcclib has, or `not checked` and why. InputError where a rule is broken."""
    if importlib.util.find_spec("dcclib") is None:
        return f"{NOT_CHECKED}: {MISSING}"
    from dcclib.validation import SchematronValidator  # noqa: PLC0415  # of an extra

    logging.getLogger("dcclib").addHandler(logging.NullHandler())
    found = SchematronValidator.for_dcc().validate_str(data.decode("utf-8"))
    reports = [*found.failed_assertions, *found.successful_reports]
    broken = [report for report in reports if report.role in ("", "error", "fatal")]
    if broken:
        raise InputError(f"certificate: a rule of the DCC is broken: {_one_line(broken[0].text or broken[0].test)}")
    return VALID


def find_schemas(folder: Path) -> list[SchemaFile]:
    """Schema files of a folder and the folders in it, by what they say of themselves; InputError if it is none."""
    if not folder.is_dir():
        raise InputError(f"--schemas {folder}: no such folder; name the one with the schema files")
    out = []
    for path in sorted(folder.rglob("*.xsd"))[:200]:
        if not path.is_file() or path.stat().st_size > MOST_SCHEMA_BYTES:
            continue
        head = path.read_bytes()[:4000].decode("utf-8", "replace")
        tag = re.search(r"<(?:\w+:)?schema\b[^>]*>", head, re.DOTALL)
        if tag is None:
            continue
        name_space = re.search(r'targetNamespace\s*=\s*"([^"]*)"', tag[0])
        version = re.search(r'\bversion\s*=\s*"([^"]*)"', tag[0])
        out.append(SchemaFile(path, name_space[1] if name_space else "", version[1] if version else ""))
    return out


class _NotThere(ValueError):
    """An imported schema that the folder lacks."""


def _local_file(url: str, main: SchemaFile, files: list[SchemaFile]) -> Path | str:
    """The file of the folder for a schema's address, by the version in it; an address of the signature by its name."""
    if not url.startswith(("http:", "https:")):
        return url
    if "xmldsig" in url:
        found = [f for f in files if f.name_space == SIGNATURE] or [
            f for f in _signature_schemas() if f.name_space == SIGNATURE
        ]
    else:
        said = re.search(r"/v(\d+\.\d+\.\d+)/", url)
        wanted = said[1] if said else ""
        space = DCC if "/dcc/" in url else url.split("/v", maxsplit=1)[0]
        found = [f for f in files if f.name_space == space and f.version == wanted]
    if not found:
        raise _NotThere(f"the folder has no schema for {url}, which {main.path.name} imports")
    return found[0].path


def _signature_schemas() -> list[SchemaFile]:
    """The schema of signatures that signxml brings, where it is installed."""
    spec = importlib.util.find_spec("signxml")
    if spec is None or spec.origin is None:
        return []
    return find_schemas(Path(spec.origin).parent / "schemas")


def _one_line(text: object) -> str:
    return " ".join(str(text).split())[:200]
