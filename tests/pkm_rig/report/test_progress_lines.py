"""Progress where nobody watches."""

from __future__ import annotations

from pkm_rig.report.terminal import ProgressLines


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
