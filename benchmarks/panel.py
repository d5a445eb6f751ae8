"""What the page costs beside the same work without it, and how soon it shows what has changed.

A mock rig at time scale 1 in this process, a campaign started through the panel, one page in Chromium, which is a
process of its own: computing time of this process with and without the page, time from a change of state to the frame
that shows it, memory over hours 2 to 8 of readings that are fed in a minute, requests for other hosts, and the stop
latency of `benchmarks.stop_latency` with and without a page, in turns.

`python -m benchmarks.panel [--seconds S] [--trips N]`; exit status 1 where a goal is missed, 2 without Chromium.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import stop_latency
from pkm_rig.jobs.session import open_rig
from pkm_rig.panel.actions import Action
from pkm_rig.panel.server import Place, serving
from pkm_rig.panel.work import Work
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.rig import Rig

SEEN_S, CPU_SHARE, GROWTH_MB, SLOWER = 0.5, 0.15, 20.0, 1.10
CHANGES = 150
READINGS_AN_HOUR, FED_A_SECOND = 720, 120
WARM = "\n[campaign]\nwarm_up_step_s = 1.0\nwarm_up_rate_k_per_h = 1000.0\n"
WATCH = """() => {
  window.seen = [];
  const lines = document.querySelector(".lines");
  new MutationObserver(() => {
    const first = lines.textContent.split("\\n")[0];
    requestAnimationFrame(() => setTimeout(() => window.seen.push([first, Date.now() / 1000]), 0));
  }).observe(lines, { childList: true, characterData: true, subtree: true });
}"""


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of computing time with, and without the page")
    parser.add_argument("--trips", type=int, default=100, help="stops with, and as many without a page")
    options = parser.parse_args()
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if chromium is None:
        print("there is no Chromium on this computer", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright, ExitStack() as stack:
        path = Path(folder) / "rig.toml"
        path.write_text(embedded_rig_path().read_text(encoding="utf-8") + WARM, encoding="utf-8")
        work = Work(path, Path(folder) / "runs", lambda *a, **k: open_rig(*a, **k, real_time=True))
        stack.callback(work.close)
        said: list[str] = []
        address = stack.enter_context(
            serving(work, Place(port=0), lambda at, token: said.append(f"{at.url}login#{token}"))
        )
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        stack.callback(browser.close)
        asked: set[str] = set()
        bench = Bench(work, lambda: open_page(browser, said, asked))
        good = [
            bench.computing_time(options.seconds),
            bench.time_to_pixel(),
            bench.memory(),
            bench.stops(options.trips),
        ]
        print("\n".join(bench.lines))
        foreign = [url for url in asked if f"//{address.url.split('/')[2]}/" not in url]
        good.append(not foreign)
        print(f"requests for other hosts: {len(foreign)} of {len(asked)}")
    return 0 if all(good) else 1


def open_page(browser: Any, said: list[str], asked: set[str]) -> Any:
    """A page that has logged in."""
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.on("request", lambda request: asked.add(request.url))
    page.goto(said[-1])
    page.get_by_text("has control").wait_for()
    return page


class Bench:
    """One panel and at most one page."""

    def __init__(self, work: Work, open_one: Callable[[], Any]) -> None:
        self.work, self._open = work, open_one
        self.lines: list[str] = []  # printed in the end: while a plan runs nothing is, on stdout

    def start(self) -> None:
        """A campaign under way, past its warm-up."""
        self.work.control.take("bench")
        prepared = self.work.press("bench", Action("measure"))
        time.sleep(0.6)
        if prepared is not None:
            self.work.press_again("bench", prepared.secret)
        while self.work.live.snapshot().done < 5:
            time.sleep(0.2)

    def computing_time(self, seconds: float) -> bool:
        """What the page adds to this process' computing time, in turns of half the time."""
        self.start()
        shares: dict[bool, list[float]] = {True: [], False: []}
        for with_page in (False, True, True, False):
            page = self._open() if with_page else None
            time.sleep(2.0)
            before, begun_s = _computed_s(), time.monotonic()
            end_s = begun_s + seconds / 2.0
            while time.monotonic() < end_s:
                if page is not None:
                    page.wait_for_timeout(500)
                else:
                    time.sleep(0.5)
            shares[with_page].append((_computed_s() - before) / (time.monotonic() - begun_s))
            if page is not None:
                page.context.close()
            time.sleep(6.0)  # until the server has forgotten the page
        without, beside = (float(np.mean(shares[key])) for key in (False, True))
        added = beside - without
        self.lines.append(
            f"computing time of one core: {without:.1%} without a page, {beside:.1%} with one, {added:.1%} added"
        )
        return added <= CPU_SHARE

    def time_to_pixel(self) -> bool:
        """From a change of state to the frame that shows it."""
        page = self._open()
        page.evaluate(WATCH)
        changed: dict[str, float] = {}
        draw = random.Random(1)
        for number in range(CHANGES):
            line = f"change {number}"
            changed[line] = time.time()
            self.work.live.notify(line)
            page.wait_for_timeout(draw.uniform(250.0, 650.0))
        seen: dict[str, float] = {}
        for line, at_s in page.evaluate("window.seen"):
            seen.setdefault(line, at_s)
        page.context.close()
        self.work.stop()
        self.work.wait()
        waited = np.array([seen[line] - at_s for line, at_s in changed.items() if line in seen])
        middle, most = np.percentile(waited, (50, 95))
        self.lines.append(
            f"change to pixel: median {middle:.2f} s, 95 % {most:.2f} s, {len(waited)} of {CHANGES} seen by themselves"
        )
        return bool(most <= SEEN_S) and len(waited) > 0.9 * CHANGES

    def memory(self) -> bool:
        """Growth of the server and of the page's heap from hour 2 to hour 8 of readings."""
        page = self._open()
        session = page.context.new_cdp_session(page)
        sizes = []
        for hour in range(8):
            for _ in range(READINGS_AN_HOUR // 60):
                for number in range(60):
                    _feed(self.work, number)
                page.wait_for_timeout(60_000.0 / FED_A_SECOND)
            if hour in (1, 7):
                session.send("HeapProfiler.collectGarbage")
                heap = session.send("Runtime.getHeapUsage")["usedSize"]
                sizes.append((_resident_mb(), heap / 1e6))
        page.context.close()
        (server, heap), (server_later, heap_later) = sizes
        self.lines.append(
            f"memory from hour 2 to 8: server {server_later - server:+.1f} MB, page {heap_later - heap:+.1f} MB"
        )
        return max(server_later - server, heap_later - heap) <= GROWTH_MB

    def stops(self, trips: int) -> bool:
        """Bit to last stop frame without and with a page that shows the rig, in turns."""
        times: dict[bool, list[float]] = {True: [], False: []}
        for with_page in (False, True, False, True):
            with tempfile.TemporaryDirectory() as folder:
                path = stop_latency.rig_file(Path(folder))
                rows = stop_latency.measure(path, trips // 2, 1, self.shown if with_page else _alone)
                times[with_page] += [row["total_ms"] for row in rows if "total_ms" in row]
        without, beside = (np.array(times[key]) for key in (False, True))
        draw = np.random.default_rng(1)
        medians = [[np.median(draw.choice(of, of.size)) for of in (beside, without)] for _ in range(500)]
        low, high = np.percentile(np.divide(*np.transpose(medians)), (2.5, 97.5))
        self.lines.append(
            f"bit to last stop frame: median {np.median(without):.2f} ms without, {np.median(beside):.2f} ms with: "
            f"{np.median(beside) / np.median(without):.2f} times, 95 % of resampling {low:.2f} to {high:.2f}; "
            f"99 % {np.percentile(without, 99):.1f} and {np.percentile(beside, 99):.1f} ms"
        )
        return bool(low <= SLOWER)

    @contextmanager
    def shown(self, rig: Rig) -> Iterator[None]:
        """A page shows this rig, ten changes a second."""
        page, ended = self._open(), threading.Event()
        self.work.live.watch(rig)

        def change() -> None:
            while not ended.wait(0.1):
                _feed(self.work, 0)

        threading.Thread(target=change, daemon=True).start()
        try:
            yield
        finally:
            ended.set()
            self.work.live.leave()
            page.context.close()


@contextmanager
def _alone(_rig: Rig) -> Iterator[None]:
    yield


def _feed(work: Work, number: int) -> None:
    row = {
        "sequence": work.live.version, "phase": "calibration", "smr": f"P{1 + number % 3}", "pose": number,
        "slope_distance_m": 3.0 + 1e-3 * number, "t_rig_s": float(number),
    }  # fmt: skip
    work.live.reading(row, np.full(3, 1e-6 * number))
    work.live.progress(1, 10_000, "calibration")


def _computed_s() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    return own.ru_utime + own.ru_stime


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


if __name__ == "__main__":
    sys.exit(main())
