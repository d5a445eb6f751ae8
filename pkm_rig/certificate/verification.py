"""Checks a signed certificate: one signature, at its place, over all of it, by the signer that was named."""

from __future__ import annotations

import base64
import binascii
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from pkm_rig.certificate.keys import load_certificate, require_valid_now
from pkm_rig.certificate.signature import require_signxml
from pkm_rig.certificate.xml_form import SIGNATURE, canonical, parse


@dataclass(frozen=True)
class Checked:
    """A certificate that is as it was signed. root: what the signature covers, and nothing else.

    trusted: whether the signer was checked too; signer: the subject of its certificate.
    """

    root: Any
    signer: str
    trusted: bool


class NotIntact(InputError):
    """The certificate is not as somebody signed it, or the signer is another one."""


def check(data: bytes, name: str, *, signer: Path | None = None, ca: Path | None = None) -> Checked:
    """Check a certificate against the signer's own certificate, or one that issued it (`ca`, PEM).

    Raises NotIntact where anything is wrong, whatever it is; InputError for files that cannot be read.
    """
    require_signxml()
    from cryptography import x509  # noqa: PLC0415  # of an extra

    root = parse(data, name)
    held = _only_signature(root, name)
    try:
        certificate = x509.load_der_x509_certificate(held)
        subject = certificate.subject.rfc4514_string()
    except ValueError as error:
        raise NotIntact(f"{name}: the signer's certificate in it is damaged") from error
    if signer is not None:
        expected = load_certificate(signer)
        if expected != certificate:
            raise NotIntact(f"{name}: signed by {subject}, which is not {signer}")
    elif ca is not None:
        _require_issued(certificate, ca, name)
    if signer is not None or ca is not None:
        require_valid_now(certificate, name)
    covered = _verify(data, certificate, name)
    _require_all_covered(root, covered, name)
    return Checked(covered, subject, signer is not None or ca is not None)


def _only_signature(root: Any, name: str) -> bytes:
    """The signer's certificate in the one signature, which ends the document and has the one form."""
    found = list(root.iter(f"{{{SIGNATURE}}}Signature"))
    if not found:
        raise NotIntact(f"{name}: not signed")
    if len(found) > 1 or found[0].getparent() is not root or root[-1] is not found[0] or found[0].tail:
        raise NotIntact(f"{name}: its signature is not the only one at the end; it does not cover all of the document")
    parts = [child.tag.rpartition("}")[2] for child in found[0]]
    path = ".//{%s}X509Certificate"
    texts = [element.text or "" for element in found[0].iterfind(path % SIGNATURE)]
    value = found[0].findtext(f"{{{SIGNATURE}}}SignatureValue") or ""
    if parts != ["SignedInfo", "SignatureValue", "KeyInfo"] or len(texts) != 1:
        raise NotIntact(f"{name}: its signature is not in the form that pkm-rig writes")
    try:
        exact = [base64.b64decode(text, validate=True) for text in (value, texts[0])]
    except (binascii.Error, ValueError) as error:
        raise NotIntact(f"{name}: its signature is damaged") from error
    if [base64.b64encode(part).decode("ascii") for part in exact] != [value, texts[0]]:
        raise NotIntact(f"{name}: its signature is not in the form that pkm-rig writes")
    _require_bare_key_info(found[0], name)
    return exact[1]


def _require_bare_key_info(found: Any, name: str) -> None:
    """Only the certificate's text stands in what the signature does not cover itself."""
    info = found.find(f"{{{SIGNATURE}}}KeyInfo")
    chain = [info, *info.iterdescendants()]
    tags = [element.tag.rpartition("}")[2] for element in chain]
    stray = [element for element in (found, *chain) if element.attrib or (element is not found and element.tail)]
    loose = [element.text for element in (found, *chain[:-1])] + [child.tail for child in found]
    value = found.find(f"{{{SIGNATURE}}}SignatureValue")
    if tags != ["KeyInfo", "X509Data", "X509Certificate"] or stray or any(loose) or value.attrib:
        raise NotIntact(f"{name}: its signature is not in the form that pkm-rig writes")


def _verify(data: bytes, certificate: Any, name: str) -> Any:
    from signxml.verifier import SignatureConfiguration, XMLVerifier  # noqa: PLC0415  # of an extra

    config = SignatureConfiguration(location="./", expect_references=1)
    try:
        result: Any = XMLVerifier().verify(data, x509_cert=certificate, expect_config=config)
    except Exception as error:  # of any library below, whatever it is: nothing was shown
        said = " ".join(str(error).split())[:120]
        raise NotIntact(f"{name}: changed after it was signed, or signed with another key ({said})") from error
    return result.signed_xml


def _require_all_covered(root: Any, covered: Any, name: str) -> None:
    """What the signature covers is the whole document but for the signature itself."""
    rest = parse(canonical(root), name)
    rest.remove(rest[-1])
    if covered is None or canonical(covered) != canonical(rest):
        raise NotIntact(f"{name}: its signature does not cover all of the document")


def _require_issued(certificate: Any, ca: Path, name: str) -> None:
    """The signer's certificate was issued by one of a file's, whose time is not over."""
    from cryptography import x509  # noqa: PLC0415
    from cryptography.exceptions import InvalidSignature as WrongSignature  # noqa: PLC0415

    try:
        issuers = x509.load_pem_x509_certificates(read_text(ca).encode())
    except ValueError as error:
        raise InputError(f"--ca {ca}: no certificates in PEM") from error
    for issuer in issuers:
        try:
            certificate.verify_directly_issued_by(issuer)
        except (ValueError, TypeError, WrongSignature):
            continue
        if not _may_issue(issuer):
            continue
        require_valid_now(issuer, str(ca))
        return
    raise NotIntact(f"{name}: signed by {certificate.subject.rfc4514_string()}, whose certificate {ca} did not issue")


def _may_issue(issuer: Any) -> bool:
    from cryptography import x509  # noqa: PLC0415

    try:
        return bool(issuer.extensions.get_extension_for_class(x509.BasicConstraints).value.ca)
    except x509.ExtensionNotFound:
        return False
