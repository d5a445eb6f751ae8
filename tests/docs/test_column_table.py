"""The page of the recording has the columns that the code has."""

from __future__ import annotations

from tests.docs.column_table import PAGE, table, write


def test_the_page_has_exactly_the_table_of_the_code():
    text = PAGE.read_text(encoding="utf-8")
    assert table() in text
    assert text == write(text), "run `python -m tests.docs.column_table` and read what changed"
