"""The pages of keys are those that the models give."""

from __future__ import annotations

import pytest

from tests.docs.key_tables import FOLDER, PAGES, write


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_page_says_what_the_models_say(page):
    text = (FOLDER / page.name).read_text(encoding="utf-8")
    assert text == write(page), "run `python -m tests.docs.key_tables` and read what changed"
