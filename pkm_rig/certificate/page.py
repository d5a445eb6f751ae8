"""The page of a certificate for people, from its XML alone: what is shown is what stands in the certificate."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from pkm_rig.certificate.xml_form import DCC, SI
from pkm_rig.report.sentences import sentence
from pkm_rig.report.words import Language, named, word

UNITS = {
    r"\micro\metre": "µm",
    r"\micro\radian": "µrad",
    r"\kilogram": "kg",
    r"\degreecelsius": "°C",
    r"\hecto\pascal": "hPa",
    r"\percent": "%",
}
NAMES = {"dcc": DCC, "si": SI}


def certificate_page(root: Any) -> str:
    """The page of a certificate from the root of its XML."""
    language: Language = "de" if root.findtext(".//dcc:usedLangCodeISO639_1", namespaces=NAMES) == "de" else "en"
    environment = Environment(
        loader=PackageLoader("pkm_rig.report", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    assert environment.loader is not None
    result = _one(root, "dcc:measurementResults/dcc:measurementResult")
    return environment.get_template("certificate.html").render(
        language=language,
        word=lambda key: word(key, language),
        style=Markup(environment.loader.get_source(environment, "style.css")[0]),
        title=_content(result, "dcc:name"),
        version=root.get("schemaVersion"),
        location=_location(root, language),
        of_page=sentence("certificate: page", language),
        core=_core(root),
        item=_item(root),
        parties=[
            ("laboratory", _party(_one(root, ".//dcc:calibrationLaboratory/dcc:contact"))),
            ("customer", _party(_one(root, ".//dcc:administrativeData/dcc:customer"))),
            ("operator", _content(root, ".//dcc:respPerson/dcc:person/dcc:name")),
            ("procedure", _content(result, "dcc:usedMethods/dcc:usedMethod/dcc:name")),
        ],
        statements=[_statement(s) for s in root.iterfind(".//dcc:statements/dcc:statement", NAMES)],
        instruments=[_marked(one) for one in result.iterfind("dcc:measuringEquipments/dcc:measuringEquipment", NAMES)],
        conditions=[q for one in result.iterfind(".//dcc:influenceCondition", NAMES) for q in _quantities(one)],
        results=[
            {
                "name": _content(one, "dcc:name"),
                "quantities": _quantities(one),
                "texts": [_content(t, ".") for t in one.iterfind("dcc:data/dcc:text", NAMES)],
            }
            for one in result.iterfind("dcc:results/dcc:result", NAMES)
        ],
    )


def quantities_of(root: Any) -> list[dict[str, str | None]]:
    """All quantities of a certificate in order: name, value, unit, U, k and marks, as they are written."""
    return _quantities(root)


def _one(parent: Any, path: str) -> Any:
    return parent.find(path, NAMES)


def _content(parent: Any, path: str) -> str:
    found = parent.find(path, NAMES)
    text = None if found is None else found.findtext("dcc:content", namespaces=NAMES)
    return text or ""


def _core(root: Any) -> dict[str, str]:
    names = ("uniqueIdentifier", "beginPerformanceDate", "endPerformanceDate", "issueDate", "performanceLocation")
    core = {name: root.findtext(f".//dcc:coreData/dcc:{name}", namespaces=NAMES) or "" for name in names}
    return core | {"replaces": root.findtext(".//dcc:previousReport/dcc:referralID", namespaces=NAMES) or ""}


def _location(root: Any, language: Language) -> str:
    return named("performed_at: ", _core(root)["performanceLocation"], language)


def _item(root: Any) -> list[tuple[str, str]]:
    item = _one(root, ".//dcc:items/dcc:item")
    rows = [("machine", _content(item, "dcc:name")), ("manufacturer", _content(item, "dcc:manufacturer/dcc:name"))]
    rows += [("model", item.findtext("dcc:model", namespaces=NAMES) or "")]
    return [row for row in rows if row[1]] + _identifications(item)


def _identifications(parent: Any) -> list[tuple[str, str]]:
    return [
        (_content(one, "dcc:name"), one.findtext("dcc:value", namespaces=NAMES) or "")
        for one in parent.iterfind("dcc:identifications/dcc:identification", NAMES)
    ]


def _marked(one: Any) -> str:
    marks = ", ".join(f"{name} {value}" for name, value in _identifications(one))
    return f"{_content(one, 'dcc:name')}: {marks}" if marks else _content(one, "dcc:name")


def _party(contact: Any) -> str:
    location = [element.text for element in contact.iterfind("dcc:location/*", NAMES)]
    parts = [_content(contact, "dcc:name"), *location, contact.findtext("dcc:eMail", namespaces=NAMES)]
    return ", ".join(part for part in parts if part)


def _statement(statement: Any) -> str:
    text = _content(statement, "dcc:declaration")
    norm = statement.findtext("dcc:norm", namespaces=NAMES)
    conformity = statement.findtext("dcc:conformity", namespaces=NAMES)
    return text + (f" [{conformity}; {norm}]" if conformity else "")


def _quantities(parent: Any) -> list[dict[str, str | None]]:
    out = []
    for quantity in parent.iter(f"{{{DCC}}}quantity"):
        unit = quantity.findtext("si:real/si:unit", namespaces=NAMES) or ""
        newer = quantity.findtext(".//si:valueExpandedMU", namespaces=NAMES)
        out.append({
            "name": _content(quantity, "dcc:name"),
            "value": quantity.findtext("si:real/si:value", namespaces=NAMES),
            "unit": unit,
            "shown_unit": UNITS.get(unit, unit),
            "expanded": newer or quantity.findtext(".//si:expandedUnc/si:uncertainty", namespaces=NAMES),
            "k": quantity.findtext(".//si:coverageFactor", namespaces=NAMES),
            "marks": quantity.get("refType"),
        })  # fmt: skip
    return out
