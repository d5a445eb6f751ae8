"""What certificates state, in both versions, and the checks before one is written."""

from __future__ import annotations

import os
from decimal import Decimal
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("lxml")

from calibration.base.errors import InputError
from pkm_rig.certificate.content import MANDATORY, Replaced, make_content
from pkm_rig.certificate.dcc import certificate_xml
from pkm_rig.certificate.page import certificate_page, quantities_of
from pkm_rig.certificate.schemas import check_rules, check_schema
from pkm_rig.certificate.xml_form import parse
from tests.pkm_rig.certificate.certificates import content, data

SCHEMAS = os.environ.get("PKM_RIG_DCC_SCHEMAS")  # a folder with PTB's schema files, which are not part of this project
NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
WRITTEN = [  # value, unit, U of FIGURES: by hand, U up to two digits
    ("0", r"\kilogram", None),
    ("31.0", r"\micro\metre", "4.4"),
    ("57.5", r"\micro\metre", None),
    ("34.6", r"\micro\radian", "6.1"),
    ("6.9", r"\micro\metre", "1.7"),
    ("57.5", r"\micro\metre", None),
    ("34.6", r"\micro\radian", "6.1"),
    ("10", r"\micro\metre", None),
    ("31.0", r"\micro\metre", "4.4"),
]


def texts(xml, path):
    return [element.text for element in ElementTree.fromstring(xml).iterfind(path, NAMES)]


@pytest.mark.parametrize(
    ("version", "uncertainty"),
    [
        ("3.3.0", "si:measurementUncertaintyUnivariate/si:expandedMU/si:valueExpandedMU"),
        ("3.0.0", "si:expandedUnc/si:uncertainty"),
    ],
)
def test_results_are_written_with_unit_u_and_k(version, uncertainty):
    xml = certificate_xml(content(version=version))
    reals = ElementTree.fromstring(xml).findall(".//dcc:results//si:real", NAMES)
    found = [
        (r.findtext("si:value", None, NAMES), r.findtext("si:unit", None, NAMES), r.findtext(uncertainty, None, NAMES))
        for r in reals
    ]
    assert found == WRITTEN
    assert set(texts(xml, ".//si:coverageFactor")) == {"2"}
    assert set(texts(xml, ".//si:coverageProbability")) == {"0.95"}
    assert texts(xml, ".//dcc:uniqueIdentifier") == ["PKM-rig-1-1"]
    assert ElementTree.fromstring(xml).get("schemaVersion") == version


@pytest.mark.parametrize("version", ["3.3.0", "3.0.0"])
@pytest.mark.parametrize("language", ["en", "de"])
def test_the_page_is_made_of_the_xml_alone(version, language):
    xml = certificate_xml(content(version=version, language=language))
    root = parse(xml, "c")
    page = certificate_page(root)
    for value, _, expanded in WRITTEN:
        assert f">{value}<" in page
        assert expanded is None or f">{expanded}<" in page
    assert [(q["value"], q["unit"], q["expanded"]) for q in quantities_of(root)][4:] == WRITTEN
    assert "Metrology Ltd &amp; &lt;Co&gt;" in page
    assert ("Kalibrierschein" in page) == (language == "de")
    assert "abababab" in page


@pytest.mark.parametrize("version", ["3.3.0", "3.0.0"])
def test_a_program_finds_a_result_by_its_marks_whatever_the_language(version):
    asked = {
        "pkmrig_positionRms pkmrig_beforeAdjustment": "31.0",
        "pkmrig_positionRms pkmrig_afterAdjustment": "6.9",
        "pkmrig_rotationRms pkmrig_beforeAdjustment": "34.6",
        "pkmrig_limit": "10",
    }
    for language in ("en", "de"):
        found = quantities_of(parse(certificate_xml(content(version=version, language=language)), "c"))
        for marks, value in asked.items():
            assert [q["value"] for q in found if set(marks.split()) <= set((q["marks"] or "").split())] == [value]


@pytest.mark.parametrize("language", ["en", "de"])
def test_what_is_measured_u_and_what_the_results_relate_to_are_stated(language):
    stated = texts(certificate_xml(content(language=language)), ".//dcc:declaration/dcc:content")
    for words in (("40 verification poses", "40 Prüfposen"), ("k = 2", "k = 2"), ("relate only", "beziehen sich nur")):
        assert sum(words[language == "de"] in text for text in stated) == 1
    older = texts(certificate_xml(content(version="3.0.0")), ".//dcc:declaration/dcc:content")
    assert "date of issue: 2026-11-23" in older  # which has no other place for it


@pytest.mark.parametrize("field", MANDATORY)
def test_each_mandatory_field_that_is_missing_is_named(field):
    with pytest.raises(InputError, match=field) as refused:
        content(data(**{field.replace(".", "__"): None}))
    assert "nothing was written" in str(refused.value)


def test_spaces_are_no_statement_and_none_stand_about_one():
    with pytest.raises(InputError, match=r"machine\.serial"):
        content(data(machine__serial="  "))
    xml = certificate_xml(content(data(machine__serial=" 00  42 ")))
    assert "00 42" in texts(xml, ".//dcc:item/dcc:identifications/dcc:identification/dcc:value")


def test_all_that_is_missing_is_named_at_once_and_addresses_of_mail_only_where_the_version_needs_them():
    with pytest.raises(
        InputError, match=r"laboratory\.name, laboratory\.city, laboratory\.country, customer\.name, customer\.city"
    ):
        content(data(laboratory=None, customer=None))
    without = data(customer__email=None)
    assert content(without)
    with pytest.raises(InputError, match=r"customer\.email"):
        content(without, version="3.0.0")


def test_a_campaign_without_a_verdict_has_no_certificate():
    with pytest.raises(InputError, match="no result: measured"):
        make_content(data() | {"payloads": [], "state": "measured"}, "n", "3.3.0", "en", None, None)


@pytest.mark.parametrize(
    ("after_um", "conformity", "said"),
    [
        (6.9, "pass", "below its limit"),
        (9.0, "noPass", "not shown"),
        (11.0, "noPass", "not shown"),
        (11.8, "fail", "above its limit"),
    ],
)
def test_conformity_is_stated_with_a_guard_band(after_um, conformity, said):
    found = data()
    found["payloads"][0]["after"] = found["payloads"][0]["after"] | {"position_rms_m": after_um * 1e-6}
    xml = certificate_xml(content(found))
    assert texts(xml, ".//dcc:conformity") == [conformity]
    assert texts(xml, ".//dcc:statement/dcc:norm") == ["JCGM 106:2012, 8.3.2"]
    assert any(said in text for text in texts(xml, ".//dcc:declaration/dcc:content"))


def test_not_traceable_means_no_statement_of_conformity():
    xml = certificate_xml(content(data(traceable=False, not_traceable=["station: lapsed"])))
    assert texts(xml, ".//dcc:conformity") == []
    assert texts(xml, ".//dcc:traceable") == ["false"]
    stated = texts(xml, ".//dcc:declaration/dcc:content")
    assert "not traceable: station: lapsed" in stated
    assert "payload none: no statement of conformity" in stated


@pytest.mark.parametrize(("decision", "taken_back"), [("accepted", False), ("refused", True), ("not decided", True)])
def test_what_was_tried_only_is_not_called_the_state_as_left(decision, taken_back):
    stated = texts(certificate_xml(content(data() | {"decision": decision})), ".//dcc:declaration/dcc:content")
    assert any("not the state as left" in text for text in stated) == taken_back
    assert any("no statement of conformity" in text for text in stated) == taken_back


def test_where_the_host_corrects_it_says_so():
    found = data() | {"tables_as_found": None, "tables_as_left": None, "back_end": "host"}
    stated = texts(certificate_xml(content(found)), ".//dcc:declaration/dcc:content")
    assert any("by the program that leads the drives" in text for text in stated)
    assert not any("None" in text for text in stated)


def test_simulated_is_in_title_and_statement_and_accredited_only_where_it_is_configured():
    xml = certificate_xml(content(data(traceable=False, not_traceable=["simulated"]) | {"simulated": True}))
    assert texts(xml, ".//dcc:measurementResult/dcc:name/dcc:content")[0].startswith("SIMULATED: ")
    stated = texts(xml, ".//dcc:declaration/dcc:content")
    assert stated[0].startswith("SIMULATED")
    assert "Not an accredited certificate" in stated
    assert "SIMULATED" in certificate_page(parse(xml, "c")).split("</title>")[0]
    accredited = texts(certificate_xml(content(data(accreditation="DAkkS D-K-1"))), ".//dcc:declaration/dcc:content")
    assert "DAkkS D-K-1" in accredited
    assert "Not an accredited certificate" not in accredited


@pytest.mark.parametrize("change", ["amended", "substituted"])
def test_one_that_replaces_another_names_it_with_its_hash_and_the_reason(change):
    xml = certificate_xml(content(replaces=Replaced(change, "PKM-rig-1-0", "cd" * 32, "wrong place")))
    assert texts(xml, ".//dcc:typeOfChange") == [change]
    assert texts(xml, ".//dcc:replacedUniqueIdentifier") == texts(xml, ".//dcc:referralID") == ["PKM-rig-1-0"]
    assert texts(xml, ".//dcc:previousReport/dcc:value") == ["cd" * 32]
    assert "Replaces PKM-rig-1-0; reason: wrong place" in texts(xml, ".//dcc:declaration/dcc:content")
    older = certificate_xml(content(version="3.0.0", replaces=Replaced(change, "PKM-rig-1-0", "cd" * 32, "x")))
    assert texts(older, ".//dcc:typeOfChange") == []
    assert texts(older, ".//dcc:referralID") == ["PKM-rig-1-0"]


# --- schemas and rules

HEAD = (
    '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:si="https://ptb.de/si" '
    'elementFormDefault="qualified" '
)
ANY = '<xs:any processContents="lax" namespace="##any" minOccurs="0" maxOccurs="unbounded"/>'


def own_schemas(folder, second="measurementResults", imported="v9.9.9"):
    """Two small schemas: of a certificate with two parts, and one that it imports from an address on the web."""
    (folder / "units").mkdir()
    (folder / "units" / "si.xsd").write_text(f'{HEAD} targetNamespace="https://ptb.de/si" version="9.9.9"></xs:schema>')
    parts = "".join(
        f'<xs:element name="{name}"><xs:complexType><xs:sequence>{ANY}</xs:sequence></xs:complexType></xs:element>'
        for name in ("administrativeData", second)
    )
    (folder / "any-name.xsd").write_text(
        f'{HEAD} targetNamespace="https://ptb.de/dcc" version="3.3.0">'
        f'<xs:import namespace="https://ptb.de/si" schemaLocation="https://ptb.de/si/{imported}/SI_Format.xsd"/>'
        f'<xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>{parts}</xs:sequence>'
        '<xs:anyAttribute processContents="skip"/></xs:complexType></xs:element></xs:schema>'
    )


def test_schemas_are_taken_from_the_folder_by_what_they_say_of_themselves(tmp_path):
    pytest.importorskip("xmlschema")
    xml = certificate_xml(content())
    assert check_schema(xml, "3.3.0", None).startswith("not checked")
    assert check_schema(xml, "3.3.0", tmp_path).startswith("not checked")
    own_schemas(tmp_path)
    assert check_schema(xml, "3.3.0", tmp_path) == "valid"
    assert "no schema of version 3.0.0" in check_schema(xml, "3.0.0", tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        check_schema(xml, "3.3.0", tmp_path / "missing")


def test_a_certificate_that_a_schema_forbids_is_refused(tmp_path):
    pytest.importorskip("xmlschema")
    own_schemas(tmp_path, second="somethingElse")
    with pytest.raises(InputError, match=r"not valid by any-name.xsd"):
        check_schema(certificate_xml(content()), "3.3.0", tmp_path)


def test_an_import_that_is_not_in_the_folder_is_not_fetched(tmp_path):
    pytest.importorskip("xmlschema")
    own_schemas(tmp_path, imported="v8.8.8")
    found = check_schema(certificate_xml(content()), "3.3.0", tmp_path)
    assert found.startswith("not checked")
    assert "v8.8.8" in found


def test_the_rules_of_the_dcc_are_kept_and_a_broken_one_is_named():
    pytest.importorskip("dcclib")
    assert check_rules(certificate_xml(content(language="de"))) == "valid"
    with pytest.raises(InputError, match="a rule of the DCC is broken"):
        check_rules(certificate_xml(content(data(measured=["2026-11-23", "2026-11-22"]))))


@pytest.mark.skipif(SCHEMAS is None, reason="PKM_RIG_DCC_SCHEMAS names no folder with the schemas of PTB")
def test_by_the_schemas_of_ptb_and_as_others_read_it(tmp_path, monkeypatch):
    toolkit = pytest.importorskip("dcc_json_toolkit")
    xml = certificate_xml(content(version="3.0.0", replaces=Replaced("amended", "PKM-rig-1-0", "cd" * 32, "x")))
    assert check_schema(xml, "3.0.0", Path(SCHEMAS)) == "valid"
    files = {path.name: path.read_text(encoding="utf-8") for path in Path(SCHEMAS).glob("*.xsd")}
    (tmp_path / "SI_Format.xsd").write_text(files["SI_Format-2.0.0.xsd"], encoding="utf-8")
    address = "https://ptb.de/si/v2.0.0/SI_Format.xsd"
    local = files["dcc-3.0.0.xsd"].replace(address, str(tmp_path / "SI_Format.xsd"))
    (tmp_path / "dcc.xsd").write_text(local, encoding="utf-8")
    (tmp_path / "cache").mkdir()
    monkeypatch.setattr("dcc_json_toolkit.cache.CACHE_DIR_PATH", tmp_path / "cache")
    schema = toolkit.DccSchema("3.0.0", schema_url=str(tmp_path / "dcc.xsd"))
    source = tmp_path / "certificate.xml"
    source.write_bytes(xml)
    assert schema.is_valid(str(source))
    found = list(reals(schema.to_dict(str(source))["dcc:measurementResults"]))[4:]
    read = [(Decimal(str(value)), unit, None if u is None else Decimal(str(u))) for value, unit, u in found]
    assert read == [(Decimal(value), unit, None if u is None else Decimal(u)) for value, unit, u in WRITTEN]


def reals(node):
    """(value, unit, U) of all quantities of a dictionary in order."""
    if isinstance(node, list):
        for one in node:
            yield from reals(one)
    elif isinstance(node, dict):
        if "si:value" in node:
            u = node.get("si:expandedUnc")
            yield node["si:value"], node["si:unit"], None if u is None else u["si:uncertainty"]
        else:
            for name, one in node.items():
                if not name.startswith("@"):
                    yield from reals(one)
