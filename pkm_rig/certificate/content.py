"""What a certificate states, from the data of a report; what is missing is named before anything is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any, Literal

from calibration.base.errors import InputError
from pkm_rig.certificate.quantities import Quantity, payload_quantities
from pkm_rig.report.sentences import sentence
from pkm_rig.report.words import Language, named, said, word

Version = Literal["3.3.0", "3.0.0"]
VERSIONS: tuple[Version, ...] = ("3.3.0", "3.0.0")
Change = Literal["amended", "substituted"]
MANDATORY = (  # ISO/IEC 17025:2017, 7.8.2.1, as far as it is not in the campaign itself
    "laboratory.name", "laboratory.city", "laboratory.country", "customer.name", "customer.city",
    "machine.manufacturer", "machine.serial", "operator", "procedure",
)  # fmt: skip
MANDATORY_BEFORE_3_3 = ("laboratory.email", "customer.email")


@dataclass(frozen=True)
class Replaced:
    """The certificate that another one amends or substitutes, why, and the SHA-256 of its file."""

    change: Change
    number: str
    sha256: str
    why: str


@dataclass(frozen=True)
class Statement:
    """A statement of a certificate; traceable and conformity where it is about them."""

    text: str
    traceable: bool | None = None
    conformity: Literal["pass", "fail", "noPass"] | None = None
    norm: str | None = None


@dataclass(frozen=True)
class Content:
    """A certificate before it is written. results: name of a payload to its quantities."""

    number: str
    version: Version
    language: Language
    issued: date
    identity: Mapping[str, Any]
    campaign: str
    simulated: bool
    software: str
    replaces: Replaced | None
    statements: tuple[Statement, ...]
    conditions: tuple[Quantity, ...]
    results: tuple[tuple[str, tuple[Quantity, ...]], ...]
    hashes: tuple[tuple[str, str], ...]

    @property
    def title(self) -> str:
        """The title; a simulated one says so."""
        title = f"{word('certificate', self.language)} {self.number}"
        return f"SIMULATED: {title}" if self.simulated else title


def require_complete(identity: Mapping[str, Any], version: Version) -> None:
    """InputError that names every mandatory field that is not stated."""
    needed = MANDATORY + (MANDATORY_BEFORE_3_3 if version == "3.0.0" else ())
    missing = [name for name in needed if not _stated(identity, name)]
    if identity["measured"] is None:
        missing.append("the day of measuring")
    if missing:
        raise InputError(
            f"certificate: not stated: {', '.join(missing)}; state them in [certificate] of the rig file, give it with "
            "--rig; nothing was written"
        )


def make_content(
    data: Mapping[str, Any], number: str, version: Version, language: Language, replaces: Replaced | None, issued: date
) -> Content:
    """The certificate of a verified campaign from the data of its report. InputError for one without a verdict."""
    if not data["payloads"]:
        raise InputError(
            f"certificate: campaign {data['campaign']} has no result: {data['state']}; verify it with "
            f"`pkm-rig verify {data['campaign']}`"
        )
    identity = data["identity"]
    require_complete(identity, version)
    return Content(
        number=number,
        version=version,
        language=language,
        issued=issued,
        identity=identity,
        campaign=data["campaign"],
        simulated=data["simulated"],
        software=data["software"],
        replaces=replaces,
        statements=_statements(data, language, replaces) + _issued(issued, version, language),
        conditions=_conditions(data["conditions"], language),
        results=payload_quantities(data, language),
        hashes=tuple(
            (said(entry["of"], language), said(entry["sha256"], language)) for entry in data["record"]["hashes"]
        ),
    )


def _stated(identity: Mapping[str, Any], name: str) -> bool:
    value: Any = identity
    for part in name.split("."):
        value = None if value is None else value[part]
    return value is not None and bool(str(value).strip())


def _statements(data: Mapping[str, Any], language: Language, replaces: Replaced | None) -> tuple[Statement, ...]:
    identity = data["identity"]
    out = []
    if data["simulated"]:
        out.append(Statement(word("simulated", language)))
    accreditation = identity["accreditation"]
    out.append(Statement(word("not_accredited", language) if accreditation is None else accreditation))
    traceable = bool(identity["traceable"])
    reasons = "" if traceable else f": {'; '.join(said(reason, language) for reason in identity['not_traceable'])}"
    out.append(Statement(word("traceable" if traceable else "not_traceable", language) + reasons, traceable=traceable))
    if data["tables_as_found"] is not None:
        found, left = (said(data[key], language) for key in ("tables_as_found", "tables_as_left"))
        out.append(Statement(f"{word('as_found', language)}: {found}; {word('as_left', language)}: {left}"))
    by_host = data.get("back_end") == "host"
    verdict = "accepted_host" if by_host and data["decision"] == "accepted" else data["decision"]
    out.append(Statement(f"{word('decision', language)}: {word(verdict, language)}"))
    if by_host:
        out.append(Statement(word("by_host", language)))
    if data["decision"] != "accepted":
        out.append(Statement(word("taken_back", language)))
    for payload in data["payloads"]:
        if payload["limit_m"] is not None:
            out.append(_conformity(payload, language, stated=traceable and data["decision"] == "accepted"))
    figures = data["payloads"][0]["after"]
    out.append(Statement(sentence("certificate: measurand", language, poses=figures["n"])))
    out.append(Statement(sentence("certificate: uncertainty", language, k=f"{data['coverage_factor']:g}")))
    out.append(Statement(sentence("certificate: scope", language)))
    if replaces is not None:
        out.append(
            Statement(f"{word('amendment', language)} {replaces.number}; {word('reason', language)}: {replaces.why}")
        )
    return tuple(out)


def _issued(issued: date, version: Version, language: Language) -> tuple[Statement, ...]:
    """The date of issue where the version has no place of its own for it."""
    return (Statement(f"{word('issued', language)}: {issued}"),) if version == "3.0.0" else ()


def _conformity(payload: Mapping[str, Any], language: Language, *, stated: bool) -> Statement:
    """Guarded acceptance against the stated limit; none where the result is not traceable, or not that of the machine
    as it was left.
    """
    name, limit_um = f"{word('payload', language)} {payload['name']}", payload["limit_m"] * 1e6
    if not stated:
        return Statement(f"{name}: {word('no conformity', language)}")
    after, guard = payload["after"]["position_rms_m"], payload["guard_band_m"]
    verdict: Literal["pass", "fail", "noPass"] = "pass" if after <= payload["limit_m"] - guard else "noPass"
    verdict = "fail" if after > payload["limit_m"] + guard else verdict
    said = word({"pass": "conforms", "fail": "exceeds", "noPass": "does not conform"}[verdict], language)
    return Statement(
        f"{name}: {said} ({limit_um:g} µm; w = U)", traceable=True, conformity=verdict, norm="JCGM 106:2012, 8.3.2"
    )


def _conditions(conditions: Mapping[str, Any], language: Language) -> tuple[Quantity, ...]:
    out = []
    for entry in conditions.get("temperatures", ()):
        what = f"{word('temperature', language)}, {named('part of rig: ', entry['name'], language)}"
        for end in ("low", "high"):
            name = f"{what}, {'min' if end == 'low' else 'max'}"
            out.append(Quantity(name, f"{entry[f'{end}_c']:.2f}", r"\degreecelsius"))
    if "pressure_hpa" in conditions:
        out.append(Quantity(word("pressure", language), f"{conditions['pressure_hpa']:.1f}", r"\hecto\pascal"))
        out.append(Quantity(word("humidity", language), f"{conditions['humidity_percent']:.0f}", r"\percent"))
    return tuple(out)
