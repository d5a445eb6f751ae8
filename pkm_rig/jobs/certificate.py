"""`pkm-rig certificate`: a campaign's certificate, numbered once and for all, and the check of one."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from pkm_rig.certificate.content import VERSIONS, Change, Content, Replaced, Version, make_content, require_complete
from pkm_rig.certificate.dcc import certificate_xml
from pkm_rig.certificate.keys import SigningKey
from pkm_rig.certificate.page import certificate_page
from pkm_rig.certificate.schemas import check_rules, check_schema
from pkm_rig.certificate.signature import require_signxml, sign
from pkm_rig.certificate.xml_form import parse
from pkm_rig.jobs.report import report_source
from pkm_rig.report.report_json import report_json
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.results.report_source import ReportSource
from pkm_rig.rig.config import RigFile
from pkm_rig.store.place import campaign_folder
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredEvent

ISSUED = "certificate"  # event of a campaign: a number was used


@dataclass(frozen=True)
class Wanted:
    """What certificate is wanted. key: opens the key to sign with; replaces: change, number and reason."""

    version: Version = "3.3.0"
    schemas: Path | None = None
    key: Callable[[], AbstractContextManager[SigningKey]] | None = None
    replaces: tuple[Change, str, str] | None = None


def parse_version(name: str) -> Version:
    """A version of the DCC; InputError if it is not written."""
    if name not in VERSIONS:
        raise InputError(f"--dcc {name}: not written; use {' or '.join(VERSIONS)}")
    return name


def issue(
    store: Store,
    campaign: str,
    out: Path,
    wanted: Wanted,
    rig_file: RigFile | None = None,
    *,
    outcome: CampaignOutcome | None = None,
    today: date | None = None,
) -> dict[str, Any]:
    """Write the certificate of a verified campaign and its page; its summary (docs/reference/json.md).

    The number is stored before the file is written, so that it is never used again. InputError, and nothing written,
    where something mandatory is missing, the schema or a rule is broken, or what is simulated was to be signed.
    `outcome`: the verification's, where it is known already.
    """
    source = report_source(store, campaign, outcome, rig_file=rig_file)
    _require_signable(source, wanted)
    data = report_json(source)
    require_complete(data["identity"], wanted.version)
    issued = store.events(campaign, ISSUED)
    section = source.certificate
    assert section is not None  # require_complete has refused it
    content = make_content(
        data,
        f"{section.prefix}-{campaign}-{len(issued) + 1}",
        wanted.version,
        section.language,
        _replaced(issued, wanted.replaces),
        today or datetime.now(UTC).date(),
    )
    return _write(store, content, wanted, campaign_folder(out, campaign))


def _write(store: Store, content: Content, wanted: Wanted, folder: Path) -> dict[str, Any]:
    xml = certificate_xml(content)
    schema, rules = check_schema(xml, content.version, wanted.schemas), check_rules(xml)
    with wanted.key() if wanted.key is not None else nullcontext() as key:
        signed = xml if key is None else sign(xml, key)
    path, page = folder / f"{content.number}.xml", folder / f"{content.number}.html"
    if path.exists() or page.exists():
        raise InputError(f"{path}: there already; move it away, numbers are not used twice")
    digest = hashlib.sha256(signed).hexdigest()
    store.add_event(
        content.campaign,
        ISSUED,
        {
            "number": content.number,
            "dcc": content.version,
            "sha256": digest,
            "signed": key is not None,
            "change": None if content.replaces is None else content.replaces.change,
            "replaces": None if content.replaces is None else content.replaces.number,
            "why": None if content.replaces is None else content.replaces.why,
        },
    )
    folder.mkdir(parents=True, exist_ok=True)
    _write_new(path, signed)
    _write_new(page, certificate_page(parse(signed, str(path))).encode("utf-8"))
    return {
        "campaign": content.campaign,
        "simulated": content.simulated,
        "number": content.number,
        "dcc": content.version,
        "certificate": str(path),
        "page": str(page),
        "sha256": digest,
        "signed": key is not None,
        "traceable": bool(content.identity["traceable"]),
        "schema": schema,
        "rules": rules,
    }


def _require_signable(source: ReportSource, wanted: Wanted) -> None:
    if wanted.key is None:
        return
    require_signxml()
    if source.header.simulated:
        raise InputError(f"certificate: campaign {source.campaign} is simulated; what is simulated is never signed")
    if wanted.version == "3.0.0":
        raise InputError("certificate: version 3.0.0 has no place for a signature; sign one of 3.3.0")


def _replaced(issued: list[StoredEvent], replaces: tuple[Change, str, str] | None) -> Replaced | None:
    """The certificate that is replaced, as it is stored. InputError if it was not issued, or replaced already."""
    if replaces is None:
        return None
    change, number, why = replaces
    former = next((event.data for event in issued if event.data["number"] == number), None)
    if former is None:
        known = ", ".join(str(event.data["number"]) for event in issued) or "none"
        raise InputError(f"certificate: no certificate {number} of this campaign; issued: {known}")
    successor = next((event.data["number"] for event in issued if event.data["replaces"] == number), None)
    if successor is not None:
        raise InputError(f"certificate: {number} was replaced by {successor} already; replace that one")
    return Replaced(change, number, str(former["sha256"]), why)


def _write_new(path: Path, data: bytes) -> None:
    """Write a file that is not there yet."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(data)
