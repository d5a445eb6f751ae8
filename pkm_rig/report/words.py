"""Headings, verdicts and fields of reports and certificates in English and German."""

from __future__ import annotations

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
    "no conformity": Words("no statement of conformity", "keine Konformitätsaussage"),
    # fields
    "number": Words("number", "Nummer"),
    "date": Words("date", "Datum"),
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
    "by_host": Words(
        "after: corrected by the program that leads the drives; no table is in use in them",
        "nachher: vom Programm korrigiert, das die Antriebe führt; in ihnen ist keine Tabelle in Gebrauch",
    ),
    "taken_back": Words(
        "after: measured with tables that were tried and taken back; not the state as left",
        "nachher: gemessen mit Tabellen, die erprobt und zurückgenommen wurden; nicht der hinterlassene Zustand",
    ),
}


def word(key: str, language: Language = "en") -> str:
    """The word of a key; KeyError for one that the catalogue lacks."""
    return CATALOGUE[key].de if language == "de" else CATALOGUE[key].en
