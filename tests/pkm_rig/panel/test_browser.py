"""The page in Debian's Chromium: one short campaign on a mock rig, by two pages, through what may happen to it."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from mock_devices.faults import parse_fault
from pkm_rig.panel.server import Place, serving
from pkm_rig.store.store import open_existing_store
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

    def require_nothing_else(self):
        """No complaint of a browser, and no request for another host."""
        assert self.complaints == []
        host = self.address.url.removeprefix("http://")
        assert {re.sub(r"^(https?|wss?)://", "", url).split("/")[0] + "/" for url in self.asked} == {host}

    def press(self, page, name, again=None):
        """A press, and if `again` names it, the second one, not at once."""
        page.get_by_role("button", name=name, exact=True).click()
        if again is not None:
            playwright.expect(page.get_by_role("button", name=again)).to_be_visible()
            self.bench.clock_s += 1.0
            page.get_by_role("button", name=again).click()


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    bench = Bench(tmp_path_factory.mktemp("panel") / "runs", on_interlock="suspend", on_unseen="suspend")
    yield bench
    bench.work.close()


@pytest.fixture(scope="module")
def pages(bench):  # one panel a process
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
    expect(narrow.get_by_text("Close the door of the guard", exact=True)).to_be_visible()
    expect(narrow.get_by_role("button", name="Go on")).to_be_hidden()
    expect(narrow.locator(".light-bad").first).to_be_visible()
    fits_its_width(narrow)
    names_stand_apart(narrow)
    assert not any(drive.axis.powered for drive in bench.mock.drives)

    context = narrow.context
    narrow.close()  # the page is lost while it waits
    wide = pages.new(WIDE)
    bench.mock.plc.set_interlock(GUARD, good=True)
    expect(wide.get_by_text("See that nobody is at the machine, then press Go on")).to_be_visible()
    assert bench.work.operator.waits
    assert not any(drive.axis.powered for drive in bench.mock.drives)
    narrow = pages.open(context, pages.address.url)  # and opened again, with the cookie of its session
    pages.press(wide, "Take control")
    expect(narrow.get_by_text("another page has control")).to_be_visible()
    expect(narrow.get_by_role("button", name="Go on")).to_be_disabled()

    bench.at[28] = lambda: bench.mock.faults.arm([parse_fault("tracker-no-target@1")])
    pages.press(wide, "Go on", "Yes, go on")
    expect(
        wide.get_by_text(re.compile("^Clean reflector [A-Z][0-9], see that nothing stands in its beam"))
    ).to_be_visible()
    expect(wide.get_by_text("Close the door of the guard", exact=True)).to_be_hidden()
    bench.at[45] = lambda: bench.mock.plant.move_station((0.001, 0.0, 0.0), 0.0)
    pages.press(wide, "Go on", "Yes, go on")
    ended = re.compile("a floor nest moved .* secure the station's stand, then press Go on in a new set-up")
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
    pages.require_nothing_else()


def test_other_poses_are_uploaded_and_measured_and_tables_switched_off_and_back(bench, pages, tmp_path):
    expect = playwright.expect
    page = pages.new(NARROW)
    pages.press(page, "Take control")
    page.get_by_role("tab", name="Rig").click()
    spoilt, good = tmp_path / "spoilt.toml", tmp_path / "two.csv"
    spoilt.write_text("[campaign]\nvisits = []\npath = '/etc/passwd'\n", encoding="utf-8")
    good.write_text("target_x_m,target_y_m\n0.1,0.1\n-0.1,0.2\n", encoding="utf-8")
    page.locator("input[type=file]").set_input_files(spoilt)
    expect(page.get_by_text(re.compile("spoilt.toml: unknown key 'campaign.path'"))).to_be_visible()
    assert page.get_by_role("button", name="Measure these").count() == 0
    page.locator("input[type=file]").set_input_files(good)
    expect(page.get_by_text("two.csv: 2 visits")).to_be_visible()
    fits_its_width(page)
    pages.press(page, "Measure these", "Yes, measure")
    page.get_by_role("tab", name="Measure").click()
    expect(page.get_by_text("Measure: done")).to_be_visible()
    with open_existing_store(bench.work.out) as store:
        campaign = bench.work.job.result.campaign
        recording = store.recording(campaign)
    rows = np.asarray(recording["phase"]) == "calibration"
    assert set(zip(recording["target_x_m"][rows], recording["target_y_m"][rows], strict=True)) == {
        (0.1, 0.1),
        (-0.1, 0.2),
    }

    for press, second, done in (
        ("Switch compensation off", "Yes, tables off", "tables: off on all drives"),
        ("Undo the last change", "Yes, tables rollback", "tables: off on all drives"),
    ):
        page.get_by_role("tab", name="Rig").click()
        pages.press(page, press, second)
        page.get_by_role("tab", name="Measure").click()
        expect(page.get_by_text(done).first).to_be_visible()
        assert bench.work.wait(LIMIT_S)
        assert bench.work.job.result.good
    with open_existing_store(bench.work.out) as store:
        assert [step.data["purpose"] for step in store.table_changes() if step.kind == "begun"][-2:] == [
            "off",
            "rollback",
        ]
    pages.require_nothing_else()


def test_over_tls_by_the_command(pages, tmp_path):
    """As a user starts it: a certificate, a page that is only asked for by https, a cookie that only goes over it."""
    trustme = pytest.importorskip("trustme")
    issued = trustme.CA().issue_cert("127.0.0.1", "localhost")
    issued.private_key_pem.write_to_path(str(tmp_path / "key.pem"))
    issued.cert_chain_pems[0].write_to_path(str(tmp_path / "cert.pem"))
    words = [
        sys.executable,
        "-m",
        "pkm_rig.cli",
        "panel",
        "--rig",
        "embedded",
        "--out",
        str(tmp_path / "runs"),
        "--port",
        "0",
    ]
    words += ["--certificate", str(tmp_path / "cert.pem"), "--key", str(tmp_path / "key.pem")]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as panel:
        try:
            address = next(found[0] for line in panel.stderr if (found := re.search(r"https://\S+login#\S+", line)))
            context = pages.browser.new_context(
                viewport=NARROW, ignore_https_errors=True
            )  # nobody here knows its issuer
            page, sockets = context.new_page(), []
            page.on("websocket", lambda socket: sockets.append(socket.url))
            page.goto(address)
            page.get_by_role("button", name="Take control").click()
            playwright.expect(page.get_by_text("this page has control")).to_be_visible()
            assert sockets
            assert all(url.startswith("wss://") for url in sockets)
            (cookie,) = [c for c in context.cookies() if c["name"].startswith("__Host-pkm-rig")]
            assert cookie["secure"]
            assert cookie["httpOnly"]
            assert cookie["sameSite"] == "Strict"
            context.close()
        finally:
            panel.send_signal(signal.SIGINT)
            panel.communicate(timeout=LIMIT_S)


def names_stand_apart(page):
    """Names in the picture of the machine: left, base line and width of each."""
    page.wait_for_function("document.querySelector('canvas').dataset.labels")
    named = json.loads(page.evaluate("document.querySelector('canvas').dataset.labels"))
    assert len(named) >= 2
    for number, (left, base, wide) in enumerate(named):
        for other_left, other_base, other_wide in named[:number]:
            beside = left >= other_left + other_wide or other_left >= left + wide
            assert beside or abs(base - other_base) >= 12


def fits_its_width(page):
    wide, seen = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide <= seen
