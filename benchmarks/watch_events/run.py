"""`make watch-events`: what `recalibrate watch` does, over the wire, when something happens, and which tables then act.

    python -m benchmarks.watch_events.run [--out FOLDER] [--only WORDS] [--fresh]

A mock serves in a process of its own, the watcher is the command as it is typed. Each event begins with a copy of one
calibrated machine. Results are kept as they come: stopped, the same command goes on. Status 1 if anything was wrong.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.results_file import code_digest
from benchmarks.watch_events.events import Event, events
from benchmarks.watch_events.scene import Scene, make_baseline
from benchmarks.watch_events.tables import wrong_tables
from tests.kept_results import KeptResults, key_of, until_stopped

INTERRUPTED = 3
CODE = ("benchmarks/watch_events", "pkm_rig/recalibration", "pkm_rig/jobs", "calibration/intervals", "mock_devices")


def main() -> int:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/watch-events"))
    parser.add_argument("--only", default="", help="events whose names contain this")
    parser.add_argument("--fresh", action="store_true", help="forget former results")
    options = parser.parse_args()
    out = options.out.resolve()
    kept = KeptResults(out / "results.jsonl", fresh=options.fresh)
    code, results = code_digest(*CODE), []
    for number, event in enumerate(events()):
        if options.only not in event.name:
            continue
        key = key_of(event.name, code)
        if key not in kept:
            kept.add({"key": key, **run_event(event, out / f"{number:02d}", make_baseline(out / "baseline"))})
        results.append(kept[key])
    return print_table(results)


def run_event(event: Event, folder: Path, baseline: Path) -> dict[str, Any]:
    """One event; what was done, the tables before and after, and what was wrong."""
    begin_s = time.monotonic()
    print(f"{event.name} ...", file=sys.stderr, flush=True)
    scene = Scene(folder, baseline, event.top)
    try:
        lines = event.act(scene)
        scene.end_watch()
        after = scene.held()
        wrong = wrong_tables(after, scene.out, folder / "template.toml")
        problems = [*wrong, *problems_of(event, scene, lines, after)]
    finally:
        scene.close()
    return {
        "event": event.name,
        "did": [line["done"] for line in lines],
        "why": lines[-1]["why"],
        "before": str(scene.before),
        "after": str(after),
        "drives_before": scene.before.drives,
        "drives_after": after.drives,
        "wrong_tables": wrong,
        "problems": problems,
        "seconds": round(time.monotonic() - begin_s, 1),
    }


def problems_of(event: Event, scene: Scene, lines: list[dict[str, Any]], after: Any) -> list[str]:
    """What is not as it has to be, beside the tables' identities."""
    found = []
    if tuple(line["done"] for line in lines) != event.done:
        found.append(f"did {', '.join(line['done'] for line in lines)}; expected {', '.join(event.done)}")
    if event.says not in lines[-1]["why"]:
        found.append(f"does not say '{event.says}': {lines[-1]['why']}")
    if not scene.before.used or not after.used:
        found.append("the drives do not use their tables")
    if (after.tables == scene.before.tables) is not (event.tables == "former"):
        found.append(f"the tables in use are not the {event.tables} ones")
    if scene.statuses != [INTERRUPTED]:
        found.append(f"the watcher ended with status {scene.statuses}, not {INTERRUPTED}")
    return found


def print_table(results: list[dict[str, Any]]) -> int:
    """The events, one a line; the status."""
    print(f"{'event':32s} {'what the watcher did':24s} {'tables before':>14s} {'after':>10s}  verdict")
    for result in results:
        verdict = "; ".join(result["problems"]) or "right"
        did = ", ".join(result["did"])
        print(f"{result['event']:32s} {did:24s} {result['before']:>14s} {result['after']:>10s}  {verdict}")
    wrong = sum(bool(result["wrong_tables"]) for result in results)
    print(
        f"\n{sum(not result['problems'] for result in results)} of {len(results)} right; tables in use whose identity, "
        f"CRC, machine or generation is wrong: {wrong}"
    )
    return int(any(result["problems"] for result in results))


if __name__ == "__main__":
    sys.exit(until_stopped(main))
