"""Maintenance windows: local times of day, so that summer time moves them with the shop's clock."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, time, timedelta
from zoneinfo import ZoneInfo

from pkm_rig.rig.recalibration_sections import WindowEntry

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
AHEAD_DAYS = 8  # of which one holds the next window, whatever days it has


def open_until(windows: Sequence[WindowEntry], time_zone: str, now_utc_s: float) -> float | None:
    """When the window that is open now ends (Unix time), the last of several; None if none is open."""
    ends = [end for begin, end in _around(windows, time_zone, now_utc_s) if begin <= now_utc_s < end]
    return max(ends, default=None)


def next_opening(windows: Sequence[WindowEntry], time_zone: str, now_utc_s: float) -> float | None:
    """When the next window begins (Unix time); None if there is none."""
    begins = [begin for begin, _ in _around(windows, time_zone, now_utc_s) if begin > now_utc_s]
    return min(begins, default=None)


def _around(windows: Sequence[WindowEntry], time_zone: str, now_utc_s: float) -> Iterator[tuple[float, float]]:
    """Begin and end (Unix time) of each window from yesterday on."""
    zone = ZoneInfo(time_zone)
    today = datetime.fromtimestamp(now_utc_s, zone).date()
    for offset in range(-1, AHEAD_DAYS + 1):
        day = today + timedelta(days=offset)
        for window in windows:
            if DAYS[day.weekday()] not in window.days:
                continue
            begin, end = time.fromisoformat(window.begin), time.fromisoformat(window.end)
            last = day if end > begin else day + timedelta(days=1)
            yield _utc_s(datetime.combine(day, begin, zone)), _utc_s(datetime.combine(last, end, zone))


def _utc_s(local: datetime) -> float:
    """Unix time; a time that is skipped in spring has the offset of before, one that comes twice is the first."""
    return local.astimezone(UTC).timestamp()
