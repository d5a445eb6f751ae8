"""The one form in which certificates are written: Canonical XML 1.0, UTF-8, without comments and declarations.

A file that is not byte for byte the canonical form of what it parses to is refused, before anything in it is believed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.base.plain_file import open_text

MOST_BYTES = 5_000_000
DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
SIGNATURE = "http://www.w3.org/2000/09/xmldsig#"
FORBIDDEN = (b"<!", b"<?")  # DTD, entities, comments, CDATA and processing instructions: our form has none
MISSING = "certificates need the extra [certificate]; install it with: pip install 'pkm-rig[certificate]'"


def etree() -> Any:
    """lxml.etree; InputError with one line where it is not installed."""
    try:
        from lxml import etree as found  # noqa: PLC0415  # of an extra
    except ImportError as error:
        raise InputError(MISSING) from error
    return found


def canonical(root: Any) -> bytes:
    """The bytes of an element in the one form."""
    data: bytes = etree().tostring(root, method="c14n", with_comments=False)
    return data


def parse(data: bytes, name: str) -> Any:
    """The root of a certificate from its bytes. InputError for another form, a DTD, an entity, or too many bytes."""
    if len(data) > MOST_BYTES:
        raise InputError(f"{name}: larger than {MOST_BYTES} bytes; not a certificate of pkm-rig")
    if any(mark in data for mark in FORBIDDEN):
        raise InputError(f"{name}: not in the form that pkm-rig writes (it has a declaration, a comment or an entity)")
    found = etree()
    parser = found.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = found.fromstring(data, parser)
        form = canonical(root)
    except (found.LxmlError, ValueError) as error:
        raise InputError(f"{name}: not XML ({' '.join(str(error).split())[:100]})") from error
    if form != data:
        raise InputError(f"{name}: not byte for byte the form that pkm-rig writes; it was changed or reformatted")
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise InputError(f"{name}: not a Digital Calibration Certificate")
    return root


def read_bytes(path: Path) -> bytes:
    """The bytes of a certificate; InputError for anything but a plain UTF-8 file of bounded size."""
    with open_text(path, MOST_BYTES) as stream:
        return stream.read().encode("utf-8")
