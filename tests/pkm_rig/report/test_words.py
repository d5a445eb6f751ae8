"""Headings, verdicts and fields in two languages, from one catalogue."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import pkm_rig.report.html as html_module
from calibration.model.parameters import KINDS
from calibration.reduction.budget import BudgetEntry
from calibration.reduction.figures import Figures
from calibration.reduction.left_out import BESIDE_CAUSES, DIAGNOSIS, GIANT, MODEL, NEST, VISIT
from pkm_rig.jobs.acceptance import decide
from pkm_rig.report.left_out_text import REASONS
from pkm_rig.report.sentences import SENTENCES
from pkm_rig.report.words import CATALOGUE, PHRASES, said, word

TEMPLATES = sorted((Path(html_module.__file__).parent / "templates").glob("*.html"))


def test_every_word_that_a_page_shows_is_from_the_catalogues():
    """No letters of their own but symbols, units and abbreviations that are the same in both languages."""
    same = re.compile(r"\b(SIMULATED|RMS|CRC|DCC|SHA-256|JCGM|ppm|µm|µrad|kg|hPa|min)\b|pkm-rig diagnose|0x607A")
    assert len(TEMPLATES) > 10
    for path in TEMPLATES:
        text = re.sub(r"\{\{.*?\}\}|\{%.*?%\}", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        text = re.sub(r"<[^>]+>", " ", text)
        own = re.findall(r"[A-Za-z]{2,}", same.sub(" ", text))
        assert own == [], path.name


def test_every_sentence_has_the_same_parts_in_both_languages_and_is_used():
    shown = "".join(path.read_text(encoding="utf-8") for path in TEMPLATES)
    assert {key.removeprefix("kind: ") for key in SENTENCES if key.startswith("kind: ")} == set(KINDS)
    for key, sentence in SENTENCES.items():
        parts = [sorted(re.findall(r"\{\w+\}", text)) for text in sentence]
        assert parts[0] == parts[1], key
        assert f"'{key}'" in shown or f'"{key}"' in shown or key.startswith(("certificate: ", "kind: "))
        assert sentence.en.strip()
        assert sentence.de.strip()


def test_every_word_has_two_languages_and_every_key_of_a_template_is_in_the_catalogue():
    templates = (Path(html_module.__file__).parent / "templates").glob("*.html")
    used = {key for path in templates for key in re.findall(r"word\('(\w[\w ]*)'\)", path.read_text(encoding="utf-8"))}
    assert len(used) > 80
    assert used <= set(CATALOGUE)
    assert all(entry.en.strip() and entry.de.strip() for entry in (*CATALOGUE.values(), *PHRASES))


def test_every_cause_of_a_reading_left_out_and_every_part_of_a_budget_has_its_words():
    gates = (NEST, VISIT, MODEL, GIANT, DIAGNOSIS, BESIDE_CAUSES)
    assert set(gates) == set(REASONS)
    assert all(said(reason, "de") != reason for reason in REASONS.values())
    for cause in (*gates, "visit measured anew", "failed nest check", "flagged by the station"):
        assert word(f"left out: {cause}", "de") != word(f"left out: {cause}")
    for part in get_args(get_type_hints(BudgetEntry)["quantity"]):
        assert word(f"part: {part}", "de") != word(f"part: {part}")


@pytest.mark.parametrize(
    ("text", "german"),
    [
        (
            "fall 24.1 um > U = 4.6 um; after 6.9 um <= limit 10.0 um - w, w = U = 1.7 um: the tables stay",
            "Abnahme 24.1 um > U = 4.6 um; nachher 6.9 um <= Grenze 10.0 um - w, w = U = 1.7 um: die Tabellen bleiben",
        ),
        (
            "after 9.0 um is within w of the limit 10.0 um, w = U: not decided, the former tables come back",
            "nachher 9.0 um liegt innerhalb w der Grenze 10.0 um, w = U: nicht entschieden, die früheren Tabellen "
            "kommen zurück",
        ),
        ("generation 3, CRC 0A1B2C3D on all drives", "Generation 3, CRC 0A1B2C3D in allen Antrieben"),
        ("station: its certificate was due on 2025-12-31, measured until 2026-01-01",
         "Messstation: sein Kalibrierschein war fällig am 2025-12-31, gemessen bis 2026-01-01"),
    ],
)  # fmt: skip
def test_what_the_program_states_is_said_in_german(text, german):
    assert said(text, "de") == german
    assert said(text) == text


@pytest.mark.parametrize("rotation", [False, True])
@pytest.mark.parametrize("after_um", [5.0, 9.5, 20.0, 40.0])
def test_no_english_word_is_left_in_a_rule(rotation, after_um):
    before = Figures(31e-6, 50e-6, 30e-6, 2e-6, 2e-6, 40)
    after = replace(before, position_rms_m=after_um * 1e-6)
    for limit_m in (None, 10e-6):
        rule = said(decide(before, after, limit_m, rotation=rotation).rule, "de")
        assert not re.search(r"\b(fall|after|limit|the|tables|stay|come|not|within)\b", rule), rule
