"""Maintenance windows, in the shop's own time."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_rig.recalibration.windows import DAYS, next_opening, open_until
from pkm_rig.rig.recalibration_sections import RecalibrationSettings, WindowEntry

BERLIN = "Europe/Berlin"


def utc_s(text, zone="UTC"):
    return datetime.fromisoformat(text).replace(tzinfo=ZoneInfo(zone)).timestamp()


def test_a_night_window_is_open_until_the_next_morning():
    window = WindowEntry(days=("fri",), begin="22:00", end="05:30")
    for text, is_open in (
        ("2026-11-20T21:59", False),
        ("2026-11-20T22:00", True),
        ("2026-11-21T05:29", True),
        ("2026-11-21T05:30", False),
        ("2026-11-21T23:00", False),  # a Saturday
    ):
        end = open_until([window], BERLIN, utc_s(text, BERLIN))
        assert end == (utc_s("2026-11-21T05:30", BERLIN) if is_open else None)
    assert next_opening([window], BERLIN, utc_s("2026-11-21T06:00", BERLIN)) == utc_s("2026-11-27T22:00", BERLIN)
    assert next_opening([], BERLIN, 0.0) is None


def test_summer_time_moves_a_window_with_the_shop_s_clock():
    window = WindowEntry(begin="01:00", end="04:00")
    assert open_until([window], BERLIN, utc_s("2026-03-29T00:30")) == utc_s("2026-03-29T02:00")  # two hours long
    assert open_until([window], BERLIN, utc_s("2026-10-25T00:30")) == utc_s("2026-10-25T03:00")  # four hours long
    assert open_until([window], BERLIN, utc_s("2026-07-01T01:00")) == utc_s("2026-07-01T02:00")
    assert open_until([window], BERLIN, utc_s("2026-01-01T01:00")) == utc_s("2026-01-01T03:00")


TIMES = st.times().map(lambda t: f"{t.hour:02}:{t.minute:02}")


@given(
    days=st.sets(st.sampled_from(DAYS), min_size=1),
    begin=TIMES,
    end=TIMES,
    minutes=st.integers(min_value=0, max_value=10 * 24 * 60),
)
def test_a_window_is_open_where_a_clock_that_is_read_minute_by_minute_says_so(days, begin, end, minutes):
    """In UTC: the day's own window, or yesterday's that goes past midnight."""
    window = WindowEntry(days=tuple(sorted(days)), begin=begin, end=end)
    now = datetime(2026, 11, 2, tzinfo=UTC) + timedelta(minutes=minutes)
    clock, today, yesterday = f"{now:%H:%M}", DAYS[now.weekday()], DAYS[now.weekday() - 1]
    expected = (today in days and begin <= clock and (end <= begin or clock < end)) or (
        yesterday in days and end <= begin and clock < end
    )
    end_s = open_until([window], "UTC", now.timestamp())
    assert (end_s is not None) == expected
    opening = next_opening([window], "UTC", now.timestamp())
    assert now.timestamp() < opening <= now.timestamp() + 7 * 86400.0
    assert open_until([window], "UTC", opening) is not None


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"time_zone": "Mars/Base"}, "'Mars/Base' is no time zone"),
        ({"windows": [{"begin": "25:00", "end": "05:00"}]}, "begin"),
        ({"windows": [{"days": [], "begin": "22:00", "end": "05:00"}]}, "days"),
        ({"check": {"looks": [6, 4]}}, "looks"),
        ({"envelope": {"table_m": 0.0}}, "table_m"),
    ],
)
def test_settings_that_cannot_be_are_refused(change, complaint):
    with pytest.raises(ValueError, match=complaint):
        RecalibrationSettings.model_validate(change)
