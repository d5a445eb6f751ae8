"""Progress where nobody watches."""

from __future__ import annotations

import threading

from pkm_rig.report import terminal
from pkm_rig.report.terminal import LINE_PERIOD_S, ProgressLines, progress_bar


def test_one_line_a_minute_and_one_for_each_phase():
    now_s, said = [0.0], []
    lines = ProgressLines(said.append, lambda: now_s[0])
    lines.advance(100, 500, "stored")
    for _ in range(120):  # two minutes of readings, a nest check after each tenth
        now_s[0] += 1.0
        lines.advance(1, 500, "nests" if now_s[0] % 10.0 == 0.0 else "calibration")
    assert said[0] == "100 of 500 readings: stored"
    assert said[1] == "101 of 500 readings: calibration"
    assert len(said) == 4 or len(said) == 3
    assert all("of 500 readings" in line for line in said)


def test_what_takes_long_and_counts_no_readings_is_said_once_a_minute():
    now_s, said = [0.0], []
    lines = ProgressLines(said.append, lambda: now_s[0])
    for phase in ("", "payload exchange"):
        if phase:
            lines.advance(0, 500, phase)
        for _ in range(150):
            now_s[0] += 1.0
            lines.remind()
    assert said == ["0 of 500 readings: payload exchange"] * 3
    now_s[0] += LINE_PERIOD_S - 31.0  # half a minute had passed since the last line
    lines.advance(1, 500, "payload exchange")
    lines.remind()
    assert len(said) == 3


def test_a_command_that_only_computes_says_so_until_it_ends(monkeypatch):
    said, twice = [], threading.Event()

    def say(line):
        said.append(line)
        if len(said) > 1:
            twice.set()

    monkeypatch.setattr(terminal, "print_message", say)
    monkeypatch.setattr(terminal, "LINE_PERIOD_S", 0.0)
    monkeypatch.setattr(terminal, "LOOK_S", 0.001)
    with progress_bar() as progress:
        progress(0, 500, "identifying")
        assert twice.wait(30.0)
    assert set(said) == {"0 of 500 readings: identifying"}
    assert "progress" not in {thread.name for thread in threading.enumerate()}
