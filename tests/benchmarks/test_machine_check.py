"""The goals of the check of a machine kind: what is printed of runs whose figures are known."""

from __future__ import annotations

import pytest

from benchmarks.machine_check import summarise


def row(fall=60.0, over=0.5, growth=(5.0, 20.0), predicted=(5.0, 21.0)):
    """A run of prs3, whose x, y and rz no drive commands."""
    bound = [0.3e-6, 3e-6]
    after = [over * (bound[0] + 0.02e-6), over * (bound[1] + 0.1e-6)]
    free = {name: [v * 1e-6 for v in growth] for name in ("x", "y", "rz")}
    payload = {
        "true": {"before": [fall * value for value in after], "after": after},
        "bound": bound,
        "true_by_coordinate": free | {name: [1e-6, 1e-7] for name in ("z", "rx", "ry")},
        "predicted_by_coordinate": {name: [v * 1e-6 for v in predicted] for name in ("x", "y", "z", "rx", "ry", "rz")},
        "before": {"position_rms_m": 1e-5, "orientation_rms_rad": 1e-4},
    }
    floor = {"position_rms_m": 1e-6, "orientation_rms_rad": 1e-5}
    return {"accepted": True, "floor": floor, "payloads": [payload, payload]}


def test_goals_name_what_the_machine_commands():
    lines, reached = summarise("prs3", [row(), row()])
    assert reached
    assert "ok    true position error (z) falls by (median), at least 3: 60.0 times" in lines
    assert "ok    true rotation error (rx, ry) falls by (median), at least 6: 60.0 times" in lines
    assert [line for line in lines if "is not commanded" in line] == [
        f"ok    {name} is not commanded, grows by no more than predicted (um, urad; median): 5.00 -> 20.00, "
        "predicted 5.00 -> 21.00"
        for name in ("x", "y", "rz")
    ]


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({"fall": 2.5}, "true position error"),
        ({"over": 1.4}, "posterior bound"),
        ({"predicted": (5.0, 6.0)}, "x is not commanded"),
    ],
)
def test_a_goal_that_is_missed_says_so_and_fails(changes, missed):
    lines, reached = summarise("prs3", [row(**changes)])
    assert not reached
    assert any(line.startswith("MISS") and missed in line for line in lines)
