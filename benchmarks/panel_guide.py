"""From an empty folder to an accepted calibration of the mock rig by the page alone, at 390 and at 1280 px.

Everything that a person would press is pressed in Chromium: take control, check, calibrate, go on behind each payload,
report, diagnose. Screens are written to a folder. `python -m benchmarks.panel_guide [FOLDER] [--widths 390,1280]`; exit
status 1 if a campaign is not accepted, 2 without Chromium.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pkm_rig.jobs.session import open_rig
from pkm_rig.panel.server import Place, serving
from pkm_rig.panel.work import Work
from pkm_rig.rig.config import embedded_rig_path

HEIGHTS = {390: 844, 1280: 900}
LIMIT_S = 1800.0


def main() -> int:
    """Guide through a calibration at each width."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/panel-screens"))
    parser.add_argument("--widths", default="390,1280")
    options = parser.parse_args()
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if chromium is None:
        print("there is no Chromium on this computer", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    options.folder.mkdir(parents=True, exist_ok=True)
    accepted = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        work = Work(embedded_rig_path(), Path(folder) / "runs", open_rig)
        said: list[str] = []
        with serving(work, Place(port=0), lambda at, token: said.append(f"{at.url}login#{token}")):
            for width in (int(text) for text in options.widths.split(",")):
                page = browser.new_context(viewport={"width": width, "height": HEIGHTS.get(width, 900)}).new_page()
                page.goto(said[-1])
                guide = Guide(page, options.folder, width)
                accepted.append(guide.calibrate())
                print(f"{width} px: {guide.result()}, {guide.presses} presses")
                guide.diagnose()
                page.context.close()
        work.close()
        browser.close()
    return 0 if all(accepted) else 1


class Guide:
    """One page, and a person who does what it asks for."""

    def __init__(self, page: Any, folder: Path, width: int) -> None:
        self.page, self._folder, self._width = page, folder, width
        self.presses = 0
        page.set_default_timeout(120_000)

    def press(self, name: str, again: str | None = None) -> None:
        """A press, and the second one if there is one."""
        self.page.get_by_role("button", name=name, exact=True).first.click()
        self.presses += 1
        if again is not None:
            self.page.get_by_role("button", name=again).wait_for()
            self.page.wait_for_timeout(700)
            self.page.get_by_role("button", name=again).click()
            self.presses += 1

    def shoot(self, name: str) -> None:
        """A screen of the whole page."""
        self.page.evaluate("window.scrollTo(0, 0)")
        self.page.screenshot(path=self._folder / f"{name}-{self._width}.png", full_page=True)

    def result(self) -> str:
        """What the page says of the job that has ended."""
        return str(self.page.get_by_text("accepted:").or_(self.page.get_by_text("refused:")).first.text_content())

    def calibrate(self) -> bool:
        """Control, check, calibration and everything that it asks for."""
        page = self.page
        self.press("Take control")
        page.get_by_role("tab", name="Rig").click()
        self.press("Check")
        page.get_by_text("fit for a campaign", exact=True).first.wait_for()
        self.shoot("rig")
        page.get_by_role("tab", name="Measure").click()
        self.press("Calibrate", "Yes, calibrate")
        asked = page.get_by_role("button", name="Go on", exact=True)
        ended = page.get_by_text("Calibrate: done").or_(page.get_by_text("Calibrate: ended"))
        end_s, shot = time.monotonic() + LIMIT_S, False
        while not ended.is_visible():
            if time.monotonic() > end_s:
                return False
            if asked.is_visible() and asked.is_enabled():
                self.shoot("asked")
                self.press("Go on", "Yes, go on")
            elif not shot and page.get_by_text("The model so far").is_visible() and page.locator("circle").count() > 2:
                self.shoot("measuring")
                shot = True
            page.wait_for_timeout(300)
        self.shoot("ended")
        page.get_by_role("link", name="Report").wait_for()
        return bool(page.get_by_text("Calibrate: done").is_visible())

    def diagnose(self) -> None:
        """The campaign of the history: its diagnosis, with pictures and what to measure next."""
        page = self.page
        page.get_by_role("tab", name="History").click()
        self.press("Diagnose")
        page.get_by_role("tab", name="Measure").click()
        page.get_by_text("Diagnose: done").wait_for()
        page.get_by_role("tab", name="History").click()
        self.press("Details")
        page.get_by_role("button", name="Measure next").first.wait_for()
        page.wait_for_timeout(1500)
        self.shoot("history")


if __name__ == "__main__":
    sys.exit(main())
