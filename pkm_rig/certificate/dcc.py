"""A certificate as XML of the Digital Calibration Certificate (PTB), versions 3.3.0 and 3.0.0."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pkm_rig.certificate.content import Content, Statement, Version
from pkm_rig.certificate.quantities import PROBABILITY, Quantity
from pkm_rig.certificate.xml_form import DCC, SI, canonical, etree
from pkm_rig.report.words import word

XSI = "http://www.w3.org/2001/XMLSchema-instance"


class _Writer:
    """Writes elements of the two name spaces, text in the certificate's language."""

    def __init__(self, content: Content) -> None:
        self.content = content
        self._etree = etree()

    def dcc(self, parent: Any, name: str, text: str | None = None, **attributes: str) -> Any:
        element = self._etree.SubElement(parent, f"{{{DCC}}}{name}", attributes)
        element.text = None if text is None else " ".join(text.split())
        return element

    def si(self, parent: Any, name: str, text: str | None = None) -> Any:
        element = self._etree.SubElement(parent, f"{{{SI}}}{name}")
        element.text = text
        return element

    def text(self, parent: Any, name: str, text: str) -> Any:
        """An element with a text in the certificate's language."""
        element = self.dcc(parent, name)
        self.dcc(element, "content", text, lang=self.content.language)
        return element

    def root(self) -> Any:
        name_spaces = {"dcc": DCC, "si": SI, "xsi": XSI}
        root = self._etree.Element(f"{{{DCC}}}digitalCalibrationCertificate", nsmap=name_spaces)
        root.set("schemaVersion", self.content.version)
        location = f"{DCC} {DCC}/v{self.content.version}/dcc.xsd"
        root.set(f"{{{XSI}}}schemaLocation", location)
        return root


def certificate_xml(content: Content) -> bytes:
    """The certificate, unsigned, in the one form that is written."""
    return canonical(certificate_tree(content))


def certificate_tree(content: Content) -> Any:
    """The certificate as an element."""
    writer = _Writer(content)
    root = writer.root()
    _administrative(writer, writer.dcc(root, "administrativeData"))
    _result(writer, writer.dcc(writer.dcc(root, "measurementResults"), "measurementResult"))
    return root


def _administrative(writer: _Writer, parent: Any) -> None:
    content, identity = writer.content, writer.content.identity
    software = writer.dcc(writer.dcc(parent, "dccSoftware"), "software")
    name, _, release = content.software.partition(" ")
    writer.text(software, "name", name)
    writer.dcc(software, "release", f"v{release}")
    _core(writer, writer.dcc(parent, "coreData"))
    item = writer.dcc(writer.dcc(parent, "items"), "item")
    machine = identity["machine"]
    writer.text(item, "name", machine["name"])
    writer.text(writer.dcc(item, "manufacturer"), "name", machine["manufacturer"])
    if machine["model"]:
        writer.dcc(item, "model", machine["model"])
    marks = [("manufacturer", "serial", machine["serial"]), ("owner", "place", machine["place"])]
    marks += [("other", "rig", identity["rig"])]
    marks += [("other", f"drives: {d['name']}", d["serial"]) for d in identity["drives"]]
    _identifications(writer, item, marks)
    _contact(writer, writer.dcc(writer.dcc(parent, "calibrationLaboratory"), "contact"), identity["laboratory"])
    person = writer.dcc(writer.dcc(parent, "respPersons"), "respPerson")
    writer.text(writer.dcc(person, "person"), "name", identity["operator"])
    writer.dcc(person, "mainSigner", "true")
    _contact(writer, writer.dcc(parent, "customer"), identity["customer"])
    statements = writer.dcc(parent, "statements")
    for statement in content.statements:
        _statement(writer, writer.dcc(statements, "statement"), statement)


def _core(writer: _Writer, parent: Any) -> None:
    content, identity = writer.content, writer.content.identity
    writer.dcc(parent, "countryCodeISO3166_1", identity["laboratory"]["country"])
    writer.dcc(parent, "usedLangCodeISO639_1", content.language)
    writer.dcc(parent, "mandatoryLangCodeISO639_1", content.language)
    writer.dcc(parent, "uniqueIdentifier", content.number)
    _identifications(writer, parent, [("calibrationLaboratory", "campaign", content.campaign)])
    first, last = identity["measured"]
    writer.dcc(parent, "beginPerformanceDate", first)
    writer.dcc(parent, "endPerformanceDate", last)
    writer.dcc(parent, "performanceLocation", identity["location"])
    newer = content.version != "3.0.0"
    if newer:
        writer.dcc(parent, "issueDate", content.issued.isoformat())
    if content.replaces is not None:
        replaces = content.replaces
        if newer:
            changed = writer.dcc(parent, "reportAmendedSubstituted")
            writer.dcc(changed, "typeOfChange", replaces.change)
            writer.dcc(changed, "replacedUniqueIdentifier", replaces.number)
        previous = writer.dcc(parent, "previousReport")
        writer.text(previous, "referral", replaces.change)
        writer.dcc(previous, "referralID", replaces.number)
        writer.dcc(previous, "procedure", "SHA-256")
        writer.dcc(previous, "value", replaces.sha256)


def _identifications(writer: _Writer, parent: Any, marks: list[tuple[str, str, Any]]) -> None:
    stated = [mark for mark in marks if mark[2] not in (None, "")]
    if not stated:
        return
    listed = writer.dcc(parent, "identifications")
    for issuer, name, value in stated:
        one = writer.dcc(listed, "identification")
        writer.dcc(one, "issuer", issuer)
        writer.dcc(one, "value", str(value))
        head, _, rest = name.partition(":")
        writer.text(one, "name", word(head, writer.content.language) + (f":{rest}" if rest else ""))


def _contact(writer: _Writer, parent: Any, party: Mapping[str, Any]) -> None:
    writer.text(parent, "name", party["name"])
    if party["email"]:
        writer.dcc(parent, "eMail", party["email"])
    location = writer.dcc(parent, "location")
    for name, key in (("city", "city"), ("countryCode", "country"), ("postCode", "postcode"), ("street", "street")):
        if party[key]:
            writer.dcc(location, name, party[key])


def _statement(writer: _Writer, parent: Any, statement: Statement) -> None:
    if statement.traceable is not None:
        writer.dcc(parent, "traceable", "true" if statement.traceable else "false")
    if statement.norm is not None:
        writer.dcc(parent, "norm", statement.norm)
    writer.text(parent, "declaration", statement.text)
    if statement.conformity is not None:
        writer.dcc(parent, "conformity", statement.conformity)


def _result(writer: _Writer, parent: Any) -> None:
    content, identity = writer.content, writer.content.identity
    writer.text(parent, "name", content.title)
    method = writer.dcc(writer.dcc(parent, "usedMethods"), "usedMethod")
    writer.text(method, "name", identity["procedure"])
    if identity["instruments"]:
        listed = writer.dcc(parent, "measuringEquipments")
        for entry in identity["instruments"]:
            one = writer.dcc(listed, "measuringEquipment")
            writer.text(one, "name", entry["model"] or entry["instrument"])
            marks = [("manufacturer", "serial", entry["serial"]), ("other", "number", entry["number"])]
            marks += [("other", "due", entry["due"]), ("other", "laboratory", entry["laboratory"])]
            _identifications(writer, one, marks)
    if content.conditions:
        listed = writer.dcc(parent, "influenceConditions")
        for condition in content.conditions:
            one = writer.dcc(listed, "influenceCondition")
            writer.text(one, "name", condition.name)
            _quantity(writer, writer.dcc(one, "data"), condition)
    results = writer.dcc(parent, "results")
    for name, quantities in content.results:
        one = writer.dcc(results, "result")
        writer.text(one, "name", name)
        data = writer.dcc(one, "data")
        for quantity in quantities:
            _quantity(writer, data, quantity)
    integrity = writer.dcc(results, "result")
    writer.text(integrity, "name", word("integrity", content.language))
    listed = writer.dcc(integrity, "data")
    for of, value in content.hashes:
        writer.text(listed, "text", f"SHA-256, {of}: {value}")


def _quantity(writer: _Writer, parent: Any, quantity: Quantity) -> None:
    element = writer.dcc(parent, "quantity", **({"refType": " ".join(quantity.marks)} if quantity.marks else {}))
    writer.text(element, "name", quantity.name)
    real = writer.si(element, "real")
    writer.si(real, "value", quantity.value)
    writer.si(real, "unit", quantity.unit)
    if quantity.expanded is not None and quantity.coverage_factor is not None:
        _uncertainty(writer, real, quantity.expanded, quantity.coverage_factor, writer.content.version)


def _uncertainty(writer: _Writer, real: Any, expanded: str, k: str, version: Version) -> None:
    if version == "3.0.0":
        parent, name = writer.si(real, "expandedUnc"), "uncertainty"
    else:
        parent, name = writer.si(writer.si(real, "measurementUncertaintyUnivariate"), "expandedMU"), "valueExpandedMU"
    writer.si(parent, name, expanded)
    writer.si(parent, "coverageFactor", k)
    writer.si(parent, "coverageProbability", PROBABILITY)
    writer.si(parent, "distribution", "normal")
