"""The structure of certificates of 3.3.0 by the schema of 3.2.1: between the two the D-SI has changed, the DCC has not.

D-SI elements are left aside here, whatever is in them; the test on the results as they are written looks at those.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

pytest.importorskip("lxml")
pytest.importorskip("xmlschema")

import xmlschema

from pkm_rig.certificate.content import Replaced
from pkm_rig.certificate.dcc import certificate_xml
from pkm_rig.certificate.keys import load_key
from pkm_rig.certificate.signature import sign
from tests.pkm_rig.certificate.certificates import content, data, key_and_certificate, pem_files, unsigned

SCHEMAS = os.environ.get("PKM_RIG_DCC_SCHEMAS")  # a folder with PTB's schema files, which are not part of this project
if SCHEMAS is None or not (Path(SCHEMAS) / "dcc-3.2.1.xsd").is_file():
    pytest.skip("PKM_RIG_DCC_SCHEMAS names no folder with dcc-3.2.1.xsd", allow_module_level=True)

ANYTHING = (
    '<xs:complexType name="{}"><xs:sequence>'
    '<xs:any minOccurs="0" maxOccurs="unbounded" processContents="skip"/></xs:sequence></xs:complexType>'
)
ELEMENTS = ("real", "list", "hybrid", "complex", "constant", "realListXMLList")


@pytest.fixture(scope="module")
def schema(tmp_path_factory):
    units = tmp_path_factory.mktemp("schema") / "SI_Format.xsd"
    types = "".join(ANYTHING.format(name) for name in ("realQuantityType", "realListXMLListType"))
    elements = "".join(f'<xs:element name="{name}" type="si:realQuantityType"/>' for name in ELEMENTS)
    units.write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:si="https://ptb.de/si" '
        f'targetNamespace="https://ptb.de/si" elementFormDefault="qualified">{types}{elements}</xs:schema>',
        encoding="utf-8",
    )
    signatures = Path(importlib.util.find_spec("signxml").origin).parent / "schemas" / "xmldsig-core-schema.xsd"

    def local(url):
        return str(units if "SI_Format" in url else signatures if "xmldsig" in url else url)

    return xmlschema.XMLSchema(str(Path(SCHEMAS) / "dcc-3.2.1.xsd"), allow="local", uri_mapper=local)


def complaints(schema, xml):
    return [f"{e.path}: {e.reason}" for e in schema.iter_errors(xml.replace(b"3.3.0", b"3.2.1").decode())]


@pytest.mark.parametrize("language", ["en", "de"])
def test_plain_amended_refused_and_not_traceable_ones(schema, language):
    replaced = Replaced("amended", "PKM-rig-1-0", "cd" * 32, "x")
    for found in (data(), data() | {"decision": "refused"}, data(traceable=False, not_traceable=["station: lapsed"])):
        for replaces in (None, replaced):
            assert complaints(schema, certificate_xml(content(found, language=language, replaces=replaces))) == []


def test_a_signed_one(schema, tmp_path):
    signed = sign(unsigned(), load_key(*pem_files(tmp_path, "signer", *key_and_certificate()), lambda _: ""))
    assert complaints(schema, signed) == []
    assert complaints(schema, signed.replace(b"dcc:statements", b"dcc:statement5")) != []
