"""A campaign under way as text at a terminal."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest

from pkm_rig.report.terminal import PeopleConsole
from pkm_rig.report.terminal_live import left_in_words, shown
from pkm_rig.results.estimate import Estimate
from pkm_rig.rig.live import Guard, LastReading, Live, Snapshot
from pkm_rig.rig.observer import Request


def drawn(seen, estimates=(), **options):
    console = PeopleConsole(file=io.StringIO(), width=100)
    console.print(shown(seen, estimates, **options))
    return console.file.getvalue()


def snapshot(**changes):
    seen = {
        "campaign": "c", "phase": "calibration", "done": 30, "total": 141, "left_s": 400.0, "t_rig_s": 10.0,
        "request": None, "guards": (Guard("guard closed", "bad", "open"), Guard("nest shift", "good", "21 of 80 um")),
        "readings": (LastReading(29, "calibration", "P1", 3, 3.2, 41e-6, 9.0),), "lines": (), "drives": None,
        "pose": np.array([0.1, -0.2, 0.0, 0.0, 0.0, 0.0]), "target": np.array([0.3, 0.2, 0.0, 0.0, 0.0, 0.0]),
        "target_number": 3, "aim": "P1",
    }  # fmt: skip
    return Snapshot(**{**seen, **changes})


def test_where_it_is_what_is_left_and_what_is_not_good():
    text = drawn(snapshot())
    assert "30 of 141 readings" in text
    assert "about 7 min left" in text
    assert "tool at 100.0, -200.0, 0.0 mm, target 3 at 300.0, 200.0, 0.0 mm" in text
    assert "! guard closed: open" in text
    assert "nest shift 21 of 80 µm" in text
    assert "41" in text.split("residual")[1]


def test_how_the_uncertainty_of_the_parameters_has_fallen():
    nowhere = np.zeros((0, 3))
    estimates = [
        Estimate(n, share, f"after {n}: 12 um", nowhere, nowhere[:, 0], 9) for n, share in ((30, 0.81), (90, 0.4))
    ]
    text = drawn(snapshot(), estimates)
    assert "uncertainty of the parameters, of that before: 81% 40%" in text
    assert "after 90: 12 µm" in text
    assert "after 30" not in text


GOOD = (Guard("guard closed", "good", "good"), Guard("nest shift", "good", "21 of 80 um"))


@pytest.mark.parametrize(
    ("kind", "of", "guards", "what"),
    [
        ("payload", "'plate [bold]200' (200 kg)", (), "Exchange the payload: put 'plate [bold]200' (200 kg) on"),
        ("payload", "", (), "Take the payload off"),
        ("go on", "", GOOD, "See that nobody is at the machine, then press Enter"),
        ("go on", "", None, "Close the door of the guard"),
        ("go on", "", (Guard("gate 7 shut", "bad", "open"),), "Put right at the machine: gate 7 shut"),
        ("reflector", "P2", GOOD, "Clean reflector P2, see that nothing stands in its beam, then press Enter"),
        ("reflector", "P2", None, "Close the door of the guard"),
    ],
)
def test_one_thing_to_do_comes_first(kind, of, guards, what):
    shown_guards = {} if guards is None else {"guards": guards}
    text = drawn(snapshot(request=Request(kind, "why [bold]it waits", of), **shown_guards))
    assert what in text
    assert text.index(what) < text.index("why [bold]it waits") < text.index("readings")
    others = ("Exchange", "Take", "Clean", "Close the door", "See that nobody", "Put right")
    assert sum(text.count(other) for other in others) == 1


def test_a_pause_that_was_asked_for_is_shown():
    assert "pausing after this reading; Ctrl-C again stops" in drawn(snapshot(), pausing=True)


def test_before_anything_is_known():
    text = drawn(Live().snapshot())
    assert "connecting" in text
    assert "not known yet" in text


@pytest.mark.parametrize(("seconds", "words"), [(12.0, "12 s"), (400.0, "7 min"), (9000.0, "2.5 h")])
def test_durations(seconds, words):
    assert left_in_words(seconds) == words


def test_time_left_goes_by_the_last_readings():
    now = [0.0]
    live = Live(lambda: now[0])
    for _ in range(20):
        now[0] += 2.0
        live.progress(1, 100, "calibration")
    assert live.snapshot().left_s == pytest.approx(160.0)


def test_a_residual_is_from_the_mean_of_its_reflector():
    live = Live()
    row = {"sequence": 0, "phase": "calibration", "smr": "P1", "pose": 0, "slope_distance_m": 3.0, "t_rig_s": 0.0}
    live.reading(row, np.full(3, np.nan))
    for away in (1e-3, 1e-3, 1e-3, 1.4e-3):
        live.reading(row, np.array([away, 0.0, 0.0]))
    residuals = [reading.residual_m for reading in live.snapshot().readings]
    assert all(math.isnan(value) for value in residuals[:-1])
    assert residuals[-1] == pytest.approx(0.3e-3)
