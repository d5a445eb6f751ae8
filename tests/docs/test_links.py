"""Links and paths of the documentation lead to something."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, TOP_FOLDERS, anchors, links, paths_in_code

SOURCES = ("*.py", "*.toml", "*.c", "*.cjs", "*.eds", "*.html")
OWN_PLACE = re.compile(r"(?<![\w.:/])/(?:home|root|work|workspace|Users)/\S*")  # of whoever wrote a page
DOCUMENT = re.compile(r"\bdocs/[\w./-]+\.(?:md|json|png)")

every_page = pytest.mark.parametrize("page", PAGES, ids=str)


def test_the_pages_are_found():
    assert {Path("README.md"), Path("docs/README.md"), Path("docs/reference/machine.md")} <= set(PAGES)


@every_page
def test_every_relative_link_leads_to_a_file_and_a_heading(page):
    for target, anchor in links(page):
        assert target.exists(), f"{page}: {target.relative_to(ROOT)} does not exist"
        if anchor:
            assert anchor in anchors(target.relative_to(ROOT)), f"{page}: {target.name} has no heading '{anchor}'"


@every_page
def test_every_path_in_code_exists(page):
    missing = [path for path in paths_in_code(page) if not any(ROOT.glob(path))]
    assert not missing, f"{page}: {missing}"


@every_page
def test_no_page_knows_where_it_was_written(page):
    assert OWN_PLACE.findall((ROOT / page).read_text(encoding="utf-8")) == []


def test_every_page_is_reached_from_the_index():
    reached, ahead = set(), [ROOT / "README.md"]
    while ahead:
        page = ahead.pop().relative_to(ROOT)
        if page.suffix == ".md" and page not in reached:
            reached.add(page)
            ahead += [target for target, _ in links(page) if target.is_file()]
    assert set(PAGES) - reached == set()


def test_the_index_lists_every_decision_in_order():
    listed = [target.name for target, _ in links(Path("docs/README.md")) if target.parent.name == "decisions"]
    assert listed == sorted(path.name for path in (ROOT / "docs" / "decisions").glob("*.md"))


def test_pages_that_the_code_names_exist():
    sources = [ROOT / "Makefile", *ROOT.glob("*.toml")]
    sources += [p for top in TOP_FOLDERS for pattern in SOURCES for p in (ROOT / top).rglob(pattern)]
    missing = {
        (str(source.relative_to(ROOT)), name)
        for source in sources
        if (ROOT / "tests" / "data") not in source.parents
        for name in DOCUMENT.findall(source.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    }
    assert not missing
