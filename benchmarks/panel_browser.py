"""A panel on an embedded mock rig and a browser for it, for the benchmarks of the page; and how these print."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pkm_rig.jobs.session import open_rig
from pkm_rig.panel.server import Place, serving
from pkm_rig.panel.work import Work
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.rig import Rig

WARM = "\n[campaign]\nwarm_up_step_s = 1.0\nwarm_up_rate_k_per_h = 1000.0\n"
HEAD = ("added by one page", "without", "with", "added", "goal", "")

Row = tuple[str, str, str, str, str, str]


def chromium() -> str | None:
    """Where Chromium is; None where there is none."""
    return os.environ.get("CHROMIUM") or shutil.which("chromium")


def print_table(head: Row, rows: Iterable[Row]) -> None:
    """Print a table with columns as wide as they need to be."""
    lines = [head, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    for line in lines:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip(), flush=True)


class Panel:
    """A panel on an embedded mock rig, and a browser for it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._said: list[str] = []
        self.asked: set[str] = set()

    def __enter__(self) -> Panel:
        from playwright.sync_api import sync_playwright  # noqa: PLC0415

        stack = self._stack
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        path = folder / "rig.toml"
        path.write_text(embedded_rig_path().read_text(encoding="utf-8") + WARM, encoding="utf-8")
        playwright = stack.enter_context(sync_playwright())
        self.work = Work(path, folder / "runs", lambda *a, **k: open_rig(*a, **k, real_time=True))
        stack.callback(self.work.close)
        address = stack.enter_context(
            serving(self.work, Place(port=0), lambda at, token: self._said.append(f"{at.url}login#{token}"))
        )
        self.host = address.url.split("/")[2]
        self._browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox", "--disable-gpu"])
        stack.callback(self._browser.close)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(Exception) if error is not None else nullcontext():  # a browser that Ctrl-C has ended too
            self._stack.__exit__(kind, error, trace)

    def open(self) -> Any:
        """A page that has logged in."""
        page = self._browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
        page.on("request", lambda request: self.asked.add(request.url))
        page.goto(self._said[-1])
        page.get_by_text("has control").wait_for()
        return page

    @contextmanager
    def shown(self, rig: Rig) -> Iterator[None]:
        """A page shows this rig, ten changes a second."""
        page, ended = self.open(), threading.Event()
        self.work.live.watch(rig)

        def change() -> None:
            while not ended.wait(0.1):
                feed(self.work, 0)

        changes = threading.Thread(target=change, daemon=True)
        changes.start()
        try:
            yield
        finally:
            ended.set()
            changes.join()
            self.work.live.leave()
            with suppress(Exception):  # of a browser that Ctrl-C has ended too
                page.context.close()
            time.sleep(6.0)  # until the server has forgotten the page


def feed(work: Work, number: int) -> None:
    """Another reading, and how far the campaign is."""
    row = {
        "sequence": work.live.version, "phase": "calibration", "smr": f"P{1 + number % 3}", "pose": number,
        "slope_distance_m": 3.0 + 1e-3 * number, "t_rig_s": float(number),
    }  # fmt: skip
    work.live.reading(row, np.full(3, 1e-6 * number))
    work.live.progress(1, 10_000, "calibration")
