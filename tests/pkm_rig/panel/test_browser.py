"""The page in Debian's Chromium: one short campaign on a mock rig, by two pages, through what may happen to it."""

from __future__ import annotations

import os
import re
import shutil

import pytest

from pkm_rig.panel.server import Place, serving
from tests.pkm_rig.panel.bench import LIMIT_S, Bench

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("nicegui", reason="NiceGUI, the extra [ui], is not installed")
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("there is no Chromium on this computer, and none is downloaded", allow_module_level=True)

NARROW, WIDE = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
GUARD = 0
playwright.expect.set_options(timeout=1000.0 * LIMIT_S)


class Pages:
    """Pages of one browser, each with a session of its own; what they ask for and complain of."""

    def __init__(self, browser, bench):
        self.browser, self.bench = browser, bench
        self.said, self.asked, self.complaints = [], set(), []

    def announce(self, address, token):
        self.said.append(f"{address.url}login#{token}")

    def new(self, size):
        return self.open(self.browser.new_context(viewport=size), self.said[-1])

    def open(self, context, address):
        page = context.new_page()
        page.on("request", lambda request: self.asked.add(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("websocket", lambda socket: self.asked.add(socket.url))
        page.goto(address)
        playwright.expect(page.get_by_text("has control")).to_be_visible()
        return page

    def press(self, page, name, again=None):
        """A press, and if `again` names it, the second one, not at once."""
        page.get_by_role("button", name=name, exact=True).click()
        if again is not None:
            playwright.expect(page.get_by_role("button", name=again)).to_be_visible()
            self.bench.clock_s += 1.0
            page.get_by_role("button", name=again).click()


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path / "runs", on_interlock="suspend")
    yield bench
    bench.work.close()


@pytest.fixture
def pages(bench):
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        pages = Pages(browser, bench)
        with serving(bench.work, Place(port=0), pages.announce) as address:
            pages.address = address
            yield pages
            browser.close()


def test_a_campaign_by_two_pages_through_interlock_lost_page_and_knocked_station(bench, pages):
    expect = playwright.expect
    narrow = pages.new(NARROW)
    expect(narrow.get_by_role("button", name="Measure only")).to_be_disabled()
    pages.press(narrow, "Take control")
    expect(narrow.get_by_text("this page has control")).to_be_visible()
    narrow.get_by_role("tab", name="Rig").click()
    pages.press(narrow, "Check")
    expect(narrow.get_by_text("fit for a campaign", exact=True).first).to_be_visible()
    fits_its_width(narrow)
    narrow.get_by_role("tab", name="Measure").click()

    bench.at[18] = lambda: bench.mock.plc.set_interlock(GUARD, good=False)
    pages.press(narrow, "Measure only", "Yes, measure")
    expect(narrow.get_by_text("Put right at the machine: guard closed")).to_be_visible()
    expect(narrow.get_by_role("button", name="Go on")).to_be_disabled()
    expect(narrow.locator(".light-bad").first).to_be_visible()
    fits_its_width(narrow)
    assert not any(drive.axis.powered for drive in bench.mock.drives)

    context = narrow.context
    narrow.close()  # the page is lost while it waits
    wide = pages.new(WIDE)
    bench.mock.plc.set_interlock(GUARD, good=True)
    expect(wide.get_by_text("All guards are good")).to_be_visible()
    assert bench.work.operator.waits
    assert not any(drive.axis.powered for drive in bench.mock.drives)
    narrow = pages.open(context, pages.address.url)  # and opened again, with the cookie of its session
    pages.press(wide, "Take control")
    expect(narrow.get_by_text("another page has control")).to_be_visible()
    expect(narrow.get_by_role("button", name="Go on")).to_be_disabled()

    bench.at[35] = lambda: bench.mock.plant.move_station((0.001, 0.0, 0.0), 0.0)
    pages.press(wide, "Go on", "Yes, go on")
    ended = re.compile("a floor nest moved .* secure the station's stand")
    go_on = wide.get_by_role("button", name="Go on", exact=True)
    while not bench.work.wait(0.1):
        if bench.work.operator.waits and go_on.is_visible() and go_on.is_enabled():
            pages.press(wide, "Go on", "Yes, go on")
    expect(wide.get_by_text(ended).first).to_be_visible()
    expect(narrow.get_by_text(ended).first).to_be_visible()
    expect(wide.get_by_role("button", name="Go on in a new set-up")).to_be_enabled()
    expect(narrow.get_by_role("button", name="Go on in a new set-up")).to_be_disabled()
    wide.get_by_role("tab", name="History").click()
    expect(wide.get_by_role("button", name="Go on, the station stands anew")).to_be_enabled()
    fits_its_width(wide)
    assert int(wide.evaluate("document.querySelectorAll('canvas').length")) <= 1
    assert pages.complaints == []
    host = pages.address.url.removeprefix("http://")
    assert {re.sub(r"^(https?|wss?)://", "", url).split("/")[0] + "/" for url in pages.asked} == {host}


def fits_its_width(page):
    wide, seen = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide <= seen
