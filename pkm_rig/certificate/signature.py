"""Signs a certificate: one enveloped signature over the whole document, at its end (XML Signature, W3C 2008)."""

from __future__ import annotations

import base64
import importlib.util
from typing import Any

from calibration.base.errors import InputError
from pkm_rig.certificate.keys import SigningKey
from pkm_rig.certificate.xml_form import MISSING, SIGNATURE, canonical, parse

C14N = "http://www.w3.org/TR/2001/REC-xml-c14n-20010315"


def require_signxml() -> None:
    """InputError with one line where signxml is not installed."""
    if importlib.util.find_spec("signxml") is None:
        raise InputError(MISSING)


def sign(data: bytes, key: SigningKey) -> bytes:
    """The certificate with its signature, in the one form. InputError for a certificate that is signed already."""
    require_signxml()
    from signxml.algorithms import SignatureConstructionMethod  # noqa: PLC0415
    from signxml.signer import XMLSigner  # noqa: PLC0415  # of an extra

    root = parse(data, "certificate")
    if next(root.iter(f"{{{SIGNATURE}}}Signature"), None) is not None:
        raise InputError("certificate: signed already; make a new one")
    signer = XMLSigner(
        method=SignatureConstructionMethod.enveloped,
        signature_algorithm=key.algorithm,
        digest_algorithm="sha256",
        c14n_algorithm=C14N,
    )
    signed = signer.sign(root, key=key.private, cert=[key.certificate])
    return canonical(in_one_form(signed, key.certificate_der))


def in_one_form(root: Any, certificate_der: bytes) -> Any:
    """The signature's texts without spaces, and of the key only the signer's certificate: nothing else can vary."""
    found = root.find(f"{{{SIGNATURE}}}Signature")
    value = found.find(f"{{{SIGNATURE}}}SignatureValue")
    value.text = base64.b64encode(base64.b64decode(value.text)).decode("ascii")
    info = found.find(f"{{{SIGNATURE}}}KeyInfo")
    for child in list(info):
        info.remove(child)
    info.text = None
    held = info.makeelement(f"{{{SIGNATURE}}}X509Data")
    info.append(held)
    one = held.makeelement(f"{{{SIGNATURE}}}X509Certificate")
    one.text = base64.b64encode(certificate_der).decode("ascii")
    held.append(one)
    for element in (found, value, info):
        element.tail = None
    found.text = None
    return root
