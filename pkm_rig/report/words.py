"""Headings, verdicts and fields of reports and certificates in English and German."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

Language = Literal["en", "de"]


class Words(NamedTuple):
    """One entry of the catalogue."""

    en: str
    de: str


CATALOGUE: dict[str, Words] = {
    # headings
    "report": Words("Calibration report", "Kalibrierbericht"),
    "certificate": Words("Calibration certificate", "Kalibrierschein"),
    "identity": Words("Identification", "Angaben zur Kalibrierung"),
    "result": Words("Result", "Ergebnis"),
    "found_left": Words("As found and as left", "Vorgefundener und hinterlassener Zustand"),
    "conditions": Words("Conditions", "Bedingungen"),
    "validity": Words("Where the tables hold", "Gültigkeitsbereich der Tabellen"),
    "validity_host": Words("Where the correction holds", "Gültigkeitsbereich der Korrektur"),
    "sessions": Words("Sessions", "Messabschnitte"),
    "left_out": Words("Readings left out", "Nicht verwendete Messwerte"),
    "maps": Words("Errors over the workspace", "Abweichungen im Arbeitsraum"),
    "poses": Words("Verification poses", "Prüfposen"),
    "rotation": Words("Rotation of the platform", "Verdrehung der Plattform"),
    "comparison": Words("Models beside one another", "Modelle im Vergleich"),
    "standard": Words("evaluated with the formulae of", "ausgewertet mit den Formeln der"),
    "residuals": Words("Residuals of the identification", "Residuen der Identifikation"),
    "diagnosis": Words("What the model leaves out", "Was das Modell nicht erfasst"),
    "parameters": Words("Parameters", "Parameter"),
    "budget": Words("Uncertainty budget", "Messunsicherheitsbudget"),
    "tables": Words("Tables written", "Geschriebene Tabellen"),
    "traceability": Words("Traceability", "Rückführung"),
    "instruments": Words("Instruments", "Messmittel"),
    "integrity": Words("Integrity of the data", "Unversehrtheit der Daten"),
    "terms": Words("Terms", "Begriffe"),
    "statements": Words("Statements", "Erklärungen"),
    "amendment": Words("Replaces", "Ersetzt"),
    # verdicts
    "accepted": Words("Accepted: the tables stay active", "Angenommen: die Tabellen bleiben aktiv"),
    "correction": Words("Correction by the host", "Korrektur durch den Rechner"),
    "accepted_host": Words("Accepted: the host's correction stays", "Angenommen: die Korrektur des Rechners bleibt"),
    "refused": Words("Refused", "Abgelehnt"),
    "not decided": Words("Not decided", "Nicht entschieden"),
    "measured": Words("Measured, not verified", "Gemessen, nicht verifiziert"),
    "imported": Words("Imported, not verified", "Importiert, nicht verifiziert"),
    "interrupted": Words("Interrupted", "Unterbrochen"),
    "failed": Words("Failed", "Fehlgeschlagen"),
    "running": Words("Running", "Läuft"),
    "conforms": Words("below its limit", "unter der Grenze"),
    "does not conform": Words("not shown to be below its limit", "nicht nachweislich unter der Grenze"),
    "exceeds": Words("above its limit", "über der Grenze"),
    "no conformity": Words("no statement of conformity", "keine Konformitätsaussage"),
    # fields
    "number": Words("number", "Nummer"),
    "date": Words("date", "Datum"),
    "issued": Words("date of issue", "Ausstellungsdatum"),
    "measured_on": Words("measured", "gemessen"),
    "campaign": Words("campaign", "Kampagne"),
    "machine": Words("machine", "Maschine"),
    "manufacturer": Words("manufacturer", "Hersteller"),
    "model": Words("model", "Typ"),
    "serial": Words("serial number", "Seriennummer"),
    "place": Words("place", "Standort"),
    "rig": Words("rig", "Prüfaufbau"),
    "station": Words("station", "Messstation"),
    "drives": Words("drives", "Antriebe"),
    "laboratory": Words("laboratory", "Laboratorium"),
    "customer": Words("customer", "Auftraggeber"),
    "operator": Words("responsible", "verantwortlich"),
    "procedure": Words("procedure", "Verfahren"),
    "software": Words("software", "Software"),
    "limit": Words("limit", "Grenzwert"),
    "due": Words("due", "fällig"),
    "not_stated": Words("not stated", "nicht angegeben"),
    "before": Words("before", "vorher"),
    "after": Words("after", "nachher"),
    "payload": Words("payload", "Nutzlast"),
    "decision": Words("decision", "Entscheidung"),
    "valid": Words("valid", "gültig"),
    "lapsed": Words("lapsed", "abgelaufen"),
    "unknown": Words("unknown", "unbekannt"),
    "traceable": Words("traceable", "rückgeführt"),
    "not_traceable": Words("not traceable", "nicht rückgeführt"),
    "not_accredited": Words("Not an accredited certificate", "Kein akkreditierter Kalibrierschein"),
    "simulated": Words(
        "SIMULATED: by simulated devices, not on a machine",
        "SIMULATED (simuliert): mit simulierten Geräten, nicht an einer Maschine",
    ),
    "position_error": Words("RMS position error of the tool point", "RMS-Positionsabweichung des Werkzeugpunkts"),
    "position_max": Words("largest position error", "größte Positionsabweichung"),
    "orientation_error": Words("RMS rotation error", "RMS-Verdrehung"),
    "noise_floor": Words("noise floor", "Rauschgrenze"),
    "temperature": Words("temperature", "Temperatur"),
    "pressure": Words("air pressure", "Luftdruck"),
    "humidity": Words("relative humidity", "relative Feuchte"),
    "reason": Words("reason", "Grund"),
    # heads of rows and columns
    "estimate": Words("estimate", "Schätzwert"),
    "type": Words("type", "Typ"),
    "distribution": Words("distribution", "Verteilung"),
    "degrees_of_freedom": Words("degrees of freedom", "Freiheitsgrade"),
    "sensitivity": Words("sensitivity", "Empfindlichkeit"),
    "adds": Words("adds", "Beitrag"),
    "share": Words("share", "Anteil"),
    "readings_used": Words("readings used", "verwendete Messwerte"),
    "range_constant": Words("range constant taken off", "abgezogene Additionskonstante"),
    "command": Words("command", "Befehl"),
    "ended": Words("ended", "beendet"),
    "from": Words("from", "von"),
    "to": Words("to", "bis"),
    "begun": Words("begun, UTC", "begonnen, UTC"),
    "reading": Words("reading", "Messwert"),
    "of": Words("of", "von Größe"),
    "off_by": Words("off by", "Abweichung"),
    "in_sigmas": Words("in its standard deviations", "in Standardabweichungen"),
    "instrument": Words("instrument", "Messmittel"),
    "reflector": Words("reflector", "Reflektor"),
    "on": Words("on", "an"),
    "readings": Words("readings", "Messwerte"),
    "mean": Words("mean", "Mittel"),
    "largest": Words("largest", "größter"),
    "effect": Words("effect", "Effekt"),
    "place_of_effect": Words("place", "Ort"),
    "size": Words("size", "Größe"),
    "probability": Words("probability", "Wahrscheinlichkeit"),
    "seen": Words("seen", "sichtbar"),
    "gap": Words("gap on withheld data", "Abweichung bei zurückgehaltenen Daten"),
    "gap_floor": Words("noise floor of the gap", "Rauschgrenze der Abweichung"),
    "shrink": Words("shrink", "Abnahme"),
    "share_over": Words("share of the gap over", "Anteil der Abweichung über"),
    "which": Words("which", "welche"),
    "interval": Words("interval", "Intervall"),
    "parameter": Words("parameter", "Parameter"),
    "deviation": Words("deviation", "Abweichung"),
    "tolerance": Words("tolerance", "Toleranz"),
    "unit": Words("unit", "Einheit"),
    "stated_accuracy": Words("stated accuracy of the station", "angegebene Genauigkeit der Messstation"),
    "certified_length": Words("certified length", "zertifizierte Länge"),
    "written_by": Words("report written by", "Bericht geschrieben von"),
    "as_found": Words("as found", "vorgefunden"),
    "as_left": Words("as left", "hinterlassen"),
    "deviations": Words("Deviations", "Abweichungen"),
    "standard_figures": Words("Figures of a standard", "Kennwerte einer Norm"),
    "bidirectional": Words("bidirectional", "beidseitig"),
    "cycles": Words("cycles", "Zyklen"),
    "accuracy_ap": Words("accuracy AP", "Genauigkeit AP"),
    "repeatability_rp": Words("repeatability RP", "Wiederholgenauigkeit RP"),
    "computed_for": Words("computed for", "berechnet für"),
    "largest_correction": Words("largest correction", "größte Korrektur"),
    "drive": Words("drive", "Antrieb"),
    "generation": Words("generation", "Generation"),
    "active": Words("active when verified", "aktiv bei der Prüfung"),
    "load": Words("load", "Last"),
    "pose": Words("pose", "Pose"),
    "unpredicted": Words("unpredicted part", "nicht vorhergesagter Teil"),
    "identification": Words("identification", "Identifikation"),
    "position": Words("position", "Position"),
    "turn": Words("rotation", "Verdrehung"),
    "together": Words("together", "zusammen"),
    "certificate_number": Words("certificate", "Kalibrierschein"),
    # parts whose temperature is measured
    "part of rig: air": Words("air", "Luft"),
    "part of rig: struts": Words("struts", "Streben"),
    "part of rig: columns": Words("columns", "Säulen"),
    "part of rig: base": Words("base", "Gestell"),
    "part of rig: platform": Words("platform", "Plattform"),
    "part of rig: slider": Words("slider", "Schlitten"),
    "part of rig: floor": Words("floor", "Boden"),
    # causes of readings left out, parts of a budget
    "left out: visit measured anew": Words("visit measured anew", "Position neu angefahren und gemessen"),
    "left out: failed nest check": Words("failed nest check", "Prüfung der Nester nicht bestanden"),
    "left out: flagged by the station": Words("flagged by the station", "von der Messstation beanstandet"),
    "left out: nest outlier": Words(
        "nest outlier: does not fit the other readings of the nests",
        "Ausreißer am Nest: passt nicht zu den anderen Messwerten der Nester",
    ),
    "left out: innovation gate": Words(
        "innovation gate: does not fit the other reflectors of its visit",
        "Innovationsschranke: passt nicht zu den anderen Reflektoren derselben Pose",
    ),
    "left out: model gate": Words(
        "model gate: does not fit the model that fits all others",
        "Modellschranke: passt nicht zum Modell, das zu allen anderen passt",
    ),
    "part: scatter": Words("scatter over the poses", "Streuung über die Posen"),
    "part: scale": Words(
        "scale of the station, times the reach of the poses", "Maßstab der Messstation, mal Reichweite der Posen"
    ),
    "part: setups": Words(
        "motions between set-ups of the station", "Bewegungen zwischen Aufstellungen der Messstation"
    ),
    # statements
    "by_host": Words(
        "after: corrected by the program that leads the drives; no table is in use in them",
        "nachher: vom Programm korrigiert, das die Antriebe führt; in ihnen ist keine Tabelle in Gebrauch",
    ),
    "taken_back": Words(
        "after: measured with tables that were tried and taken back; not the state as left",
        "nachher: gemessen mit Tabellen, die erprobt und zurückgenommen wurden; nicht der hinterlassene Zustand",
    ),
}

PHRASES: tuple[Words, ...] = (  # of what the program states in a field or as a verdict, between its numbers and names
    Words("nothing was activated", "nichts wurde aktiviert"),
    Words("the former tables come back", "die früheren Tabellen kommen zurück"),
    Words("the former tables", "die früheren Tabellen"),
    Words("no compensation, as before", "keine Kompensation, wie vorher"),
    Words("the tables stay", "die Tabellen bleiben"),
    Words("the correction stays", "die Korrektur bleibt"),
    Words("not decided, ", "nicht entschieden, "),
    Words("is within w of the limit", "liegt innerhalb w der Grenze"),
    Words("fall ", "Abnahme "),
    Words("after ", "nachher "),
    Words("limit ", "Grenze "),
    Words("no table in use", "keine Tabelle in Gebrauch"),
    Words("on all drives", "in allen Antrieben"),
    Words("generation ", "Generation "),
    Words("as the command asked for", "wie vom Befehl verlangt"),
    Words("not known: the change of tables was not ended;", "nicht bekannt: der Tabellenwechsel wurde nicht beendet;"),
    Words("` tells", "` sagt es"),
    Words("simulated: nothing was measured", "simuliert: es wurde nichts gemessen"),
    Words("no certificate of the station is stated", "kein Kalibrierschein der Messstation ist angegeben"),
    Words(
        "no certificate of the certified length is stated",
        "kein Kalibrierschein der zertifizierten Länge ist angegeben",
    ),
    Words("the station that measured has serial number", "die Station, die gemessen hat, hat die Seriennummer"),
    Words("no serial number is stated", "keine Seriennummer ist angegeben"),
    Words("stated is ", "angegeben ist "),
    Words("the day of measuring is not known", "der Tag der Messung ist nicht bekannt"),
    Words("its certificate was due on", "sein Kalibrierschein war fällig am"),
    Words("it was calibrated on", "es wurde kalibriert am"),
    Words("measured until", "gemessen bis"),
    Words("measured from", "gemessen ab"),
    Words("station: ", "Messstation: "),
    Words("nest_length: ", "zertifizierte Länge: "),
    Words("head of the campaign in the store", "Endwert der Hash-Kette der Kampagne"),
    Words("settings of the campaign", "Einstellungen der Kampagne"),
    Words("machine file", "Maschinendatei"),
    Words("readings used", "verwendete Messwerte"),
    Words("not chained", "nicht verkettet"),
    # the comparison with other models, readings left out, ends of sessions, a diagnosis without an effect
    Words("deformation-aware, one model for all payloads", "mit Verformung, ein Modell für alle Nutzlasten"),
    Words("this calibration", "diese Kalibrierung"),
    Words("rigid, redundant link left out", "starr, überzähliges Glied weggelassen"),
    Words("rigid, mean over what may be left out", "starr, Mittel über das, was weggelassen werden darf"),
    Words("rigid, closure leg by leg", "starr, Schließung Bein für Bein"),
    Words("rigid, equal-weight closure", "starr, Schließung mit gleichen Gewichten"),
    Words("one geometry", "eine Geometrie"),
    Words("refitted per payload", "je Nutzlast angepasst"),
    Words("no rigid identification predicts as well", "sagt keine starre Identifikation ebenso gut vorher"),
    Words("as good within", "ebenso gut bis auf"),
    Words("At ", "Bei "),
    Words("does not fit the other readings of the nests", "passt nicht zu den anderen Messwerten der Nester"),
    Words("does not fit the other reflectors of its visit", "passt nicht zu den anderen Reflektoren derselben Pose"),
    Words("does not fit the model that fits all others", "passt nicht zum Modell, das zu allen anderen passt"),
    Words("finished", "beendet"),
    Words("interrupted", "unterbrochen"),
    Words("failed", "fehlgeschlagen"),
    Words("killed", "abgebrochen"),
    Words("diagnosis: ", "Diagnose: "),
    Words("no effect beyond the model", "kein Effekt über das Modell hinaus"),
    Words("detection limit", "Nachweisgrenze"),
    Words("gap ", "Abweichung "),
    Words("on withheld data", "bei zurückgehaltenen Daten"),
    Words("noise floor", "Rauschgrenze"),
)
_ANY_PHRASE = re.compile("|".join(f"(?<![^\\W_]){re.escape(p.en)}" for p in sorted(PHRASES, key=lambda p: -len(p.en))))
_IN_GERMAN = {phrase.en: phrase.de for phrase in PHRASES}


def said(text: str, language: Language = "en") -> str:
    """What the program states, as it is in English; its phrases in German, names and numbers between them untouched."""
    return text if language == "en" else _ANY_PHRASE.sub(lambda found: _IN_GERMAN[found[0]], text)


def part_of_rig(name: str, language: Language = "en") -> str:
    """The name of a part whose temperature is measured; as it is where the catalogue lacks it."""
    key = f"part of rig: {name}"
    return word(key, language) if key in CATALOGUE else name


def word(key: str, language: Language = "en") -> str:
    """The word of a key; KeyError for one that the catalogue lacks."""
    return CATALOGUE[key].de if language == "de" else CATALOGUE[key].en
