"""All campaigns of a store in one picture: a line a rig, a mark a campaign, by what became of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from pkm_rig.report.notation import literal
from pkm_rig.report.pictures import AFTER, BEFORE, NEUTRAL
from pkm_rig.store.stored_rows import CampaignSummary

MOST_RIGS = 40  # with a line of their own, those with the most campaigns; the others share one
GROUPS = {  # states that are one kind of mark: colour, shape
    "accepted": (AFTER, "o"),
    "refused": (BEFORE, "v"),
    "interrupted or failed": ("#e69f00", "X"),
    "measured or imported": (NEUTRAL, "."),
    "running": ("#009e73", "D"),
    "damaged": ("#000000", "P"),
}
_GROUP_OF = {
    "interrupted": "interrupted or failed",
    "failed": "interrupted or failed",
    "measured": "measured or imported",
    "imported": "measured or imported",
}


def draw_campaigns(rows: Sequence[CampaignSummary]) -> tuple[Figure, int]:
    """The picture, and how many campaigns are not in it since they state no date that can be read."""
    dated = [(row, date) for row in rows if (date := _date(row.created)) is not None]
    often = [rig for rig, _ in Counter(row.rig for row, _ in dated).most_common(MOST_RIGS)]
    names = sorted(often)
    others = len({row.rig for row, _ in dated} - set(often))
    lines = [*names, *([f"{others} other rigs"] if others else [])]
    place = {name: number for number, name in enumerate(reversed(lines))}
    figure = Figure(figsize=(10.0, 1.4 + 0.26 * max(len(lines), 3)))
    axes = figure.add_subplot()
    for group, (colour, mark) in GROUPS.items():
        chosen = [(row, date) for row, date in dated if _group(row) == group]
        if chosen:
            dates: Any = [date for _, date in chosen]
            heights = [place[row.rig if row.rig in place else lines[-1]] for row, _ in chosen]
            axes.scatter(dates, heights, s=14, c=colour, marker=mark, linewidths=0, label=f"{group}: {len(chosen)}")
    axes.set_yticks(range(len(lines)), [literal(name) for name in reversed(lines)], fontsize=8)
    axes.set_ylim(-0.7, max(len(lines), 1) - 0.3)
    axes.grid(axis="y", color="0.92")
    axes.set_axisbelow(True)
    locator = AutoDateLocator(minticks=2, maxticks=9)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.set_xlabel("begun, UTC")
    if dated:
        axes.legend(frameon=False, fontsize=8, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    figure.tight_layout()
    return figure, len(rows) - len(dated)


def _group(row: CampaignSummary) -> str:
    return "damaged" if row.damage else _GROUP_OF.get(row.state, row.state)


def _date(created: str) -> datetime | None:
    try:
        date = datetime.fromisoformat(created)
        return date.replace(tzinfo=UTC) if date.tzinfo is None else date.astimezone(UTC)
    except (ValueError, OverflowError):
        return None
