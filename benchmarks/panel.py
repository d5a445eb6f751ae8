"""What the page costs beside the same work without it, and how soon it shows what has changed.

A mock rig at time scale 1 in this process, a campaign started through the panel, one page in Chromium, which is a
process of its own: computing time of this process with and without the page, time from a change of state to the frame
that shows it, memory over hours 2 to 8 of readings that are fed in a minute, requests for other hosts, and stops
without and with a page, in pairs (`benchmarks.panel_stops`).

`python -m benchmarks.panel [--seconds S] [--pairs N]` prints one table; exit status 1 where a goal is missed or not
decided, 2 without Chromium.
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import time
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks import panel_stops
from benchmarks.panel_browser import HEAD, Panel, Row, chromium, feed, print_table
from pkm_rig.panel.actions import Action
from tests.kept_results import until_stopped

SEEN_S, CPU_SHARE, GROWTH_MB = 0.5, 0.15, 20.0
CHANGES = 150
READINGS_AN_HOUR, FED_A_SECOND = 720, 120
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
    parser.add_argument("--pairs", type=int, default=12, help="of blocks of stops; `make panel-stops` takes more")
    options = parser.parse_args()
    if chromium() is None:
        print("there is no Chromium on this computer", file=sys.stderr)
        return 2
    with Panel() as panel:
        bench = Bench(panel)
        rows: list[Row] = []
        for part in (lambda: [bench.computing_time(options.seconds)], lambda: [bench.time_to_pixel()], bench.memory):
            rows += part()
            print(*rows[-1], file=sys.stderr, flush=True)  # what follows may be stopped
        with closing(panel_stops.pairs_of(panel.shown, seed=1)) as measured:
            pairs = list(islice(measured, options.pairs))
        rows += panel_stops.lines_of(pairs)[0]
        foreign = [url for url in panel.asked if f"//{panel.host}/" not in url]
        said = f"{len(foreign)} of {len(panel.asked)}"
        rows.append(("requests for other hosts", "", said, said, "0", "missed" if foreign else "ok"))
    print_table(HEAD, rows)
    return 0 if all(row[-1] == "ok" for row in rows) else 1


class Bench:
    """One panel and at most one page."""

    def __init__(self, panel: Panel) -> None:
        self.work, self._open = panel.work, panel.open

    def start(self) -> None:
        """A campaign under way, past its warm-up."""
        self.work.control.take("bench")
        prepared = self.work.press("bench", Action("measure"))
        time.sleep(0.6)
        if prepared is not None:
            self.work.press_again("bench", prepared.secret)
        while self.work.live.snapshot().done < 5:
            time.sleep(0.2)

    def computing_time(self, seconds: float) -> Row:
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
        verdict = "ok" if added <= CPU_SHARE else "missed"
        return (
            "computing time, of one core", f"{without:.1%}", f"{beside:.1%}", f"{added:.1%}", f"{CPU_SHARE:.0%}",
            verdict,
        )  # fmt: skip

    def time_to_pixel(self) -> Row:
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
        seen_all = len(waited) > 0.9 * CHANGES
        what = f"change of state to pixel, 95 % of {len(waited)} of {CHANGES} (median {middle:.2f} s)"
        verdict = "ok" if most <= SEEN_S and seen_all else "missed"
        return what, "", f"{most:.2f} s", f"{most:.2f} s", f"{SEEN_S:g} s", verdict

    def memory(self) -> list[Row]:
        """Growth of the server and of the page's heap from hour 2 to hour 8 of readings."""
        page = self._open()
        session = page.context.new_cdp_session(page)
        sizes = []
        for hour in range(8):
            for _ in range(READINGS_AN_HOUR // 60):
                for number in range(60):
                    feed(self.work, number)
                page.wait_for_timeout(60_000.0 / FED_A_SECOND)
            if hour in (1, 7):
                session.send("HeapProfiler.collectGarbage")
                heap = session.send("Runtime.getHeapUsage")["usedSize"]
                sizes.append((_resident_mb(), heap / 1e6))
        page.context.close()
        (server, heap), (server_later, heap_later) = sizes
        return [
            (
                f"memory of the {what}, hour 8 after hour 2", f"{before:.1f} MB", f"{later:.1f} MB",
                f"{later - before:+.1f} MB", f"{GROWTH_MB:g} MB", "ok" if later - before <= GROWTH_MB else "missed",
            )
            for what, before, later in (("server", server, server_later), ("page", heap, heap_later))
        ]  # fmt: skip


def _computed_s() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    return own.ru_utime + own.ru_stime


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


if __name__ == "__main__":
    sys.exit(until_stopped(main))
