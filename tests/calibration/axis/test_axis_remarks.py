"""What a diagnosis of one drive says beside its figures, on hand-made recordings and evidence."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.axis import diagnose
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.diagnosis.verdict import verdict_probabilities
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording
from calibration.recording.axis_wrong_samples import WrongSamples


def remarks_on(monkeypatch, count: int = 400, **header: object) -> tuple[str, ...]:
    """Remarks on a recording of so many samples, one a millisecond, before anything is searched for in it."""
    time_s = 1e-3 * np.arange(count)
    motor = np.sin(3.0 * time_s)
    units = {"kind": "rotary", "time_unit": "s", "position_unit": "rad", "torque_unit": "Nm", "torque_side": "motor"}
    file = AxisFile(format=1, name="mock", **units | header)
    monkeypatch.setattr(diagnose, "diagnose_signals", lambda _, __, ___, ____, remarks, _____: remarks)
    return diagnose.diagnose_axis(AxisRecording(file, time_s, motor, motor + 1e-5, torque=np.cos(time_s)))


@pytest.mark.parametrize(
    ("header", "said"),
    [({}, True), ({"ratio": 1.0}, False), ({"ratio": 100.0}, False), ({"torque_side": "load"}, False)],
)
def test_a_ratio_that_is_stated_as_one_is_stated(monkeypatch, header, said):
    assert any("the ratio is not stated" in remark for remark in remarks_on(monkeypatch, **header)) is said


def test_samples_that_are_averaged_are_told_with_how_many_they_become(monkeypatch):
    (said,) = remarks_on(monkeypatch, 13_000, ratio=1.0)
    assert "to save time the 13000 samples were averaged to 4333, 3 at a time, one every 0.003 s" in said
    assert remarks_on(monkeypatch, 6_000, ratio=1.0) == ()


def test_five_places_of_wrong_samples_are_told():
    wrong = [WrongSamples(10 * i, 2, 0.1 * i, -3e-4, of_motor=i == 1) for i in range(7)]
    said = diagnose._left_out_remark(tuple(wrong), "m")
    assert said.startswith(
        "14 wrong samples left out: at 0 s (0.0003 m off, second position), at 0.1 s (0.0003 m off, motor)"
    )
    assert said.endswith("at 0.4 s (0.0003 m off, second position), and at 2 more")


def searched(
    *logs: tuple[str, float], causes: int = 0, speed: float = 50.0, torque: float = 0.0, in_place: float = 0.0
) -> SimpleNamespace:
    """A search: evidence of effects by name, how many of them are causes, and evidence of arbitrary functions."""
    ranking = tuple(SimpleNamespace(effect=SimpleNamespace(name=name), log_evidence=log) for name, log in logs)
    more = in_place - ranking[0].log_evidence if causes else speed - max((log for _, log in logs), default=0.0)
    return SimpleNamespace(
        ranking=ranking,
        causes=ranking[:causes],
        log_evidence=sum(log for _, log in logs[:causes]),
        excess_log_evidence=max(0.0, more, *((speed, torque) if causes else ())),
        alternatives={"speed": speed, "torque": torque},
        in_place={"acceleration": in_place, "torque": 0.0},
    )


@pytest.mark.parametrize(
    ("search", "said"),
    [
        (
            searched(("backlash", 300.0), ("ripple", 20.0), causes=2),
            "most like backlash (300 of log evidence beside ripple), but something that depends on speed remains "
            "(50 more)",
        ),
        (
            searched(("backlash", 300.0), causes=1, in_place=349.0),
            "most like backlash (300 of log evidence alone), but something that depends on speed remains (50 more)",
        ),
        (
            searched(("backlash", 300.0), causes=1, in_place=351.0),
            "most like backlash (300 of log evidence alone), but an arbitrary function of acceleration in its place "
            "explains more (51 more)",
        ),
        (
            searched(("delay", 2.5), ("ripple", -1.0)),
            "nearest comes delay, with 2.5 of log evidence of the 6 that an effect needs; an arbitrary function of "
            "speed explains 48 more",
        ),
        (searched(("delay", -0.5)), "no effect explains any of it; an arbitrary function of speed does"),
        (searched(torque=60.0), "no effect explains any of it; an arbitrary function of torque does"),
    ],
)
def test_unknown_says_what_it_is_most_like_and_why_not_that(search, said):
    assert diagnose._remarks(search, UNKNOWN) == (said,)


@pytest.mark.parametrize(("speed", "verdict", "said"), [(9.9, "delay", 0), (10.1, "delay", 1), (10.1, NONE, 0)])
def test_what_remains_beside_a_named_effect_is_told_from_ten_of_log_evidence_on(speed, verdict, said):
    remarks = diagnose._remarks(searched(("delay", 300.0), causes=1, speed=speed), verdict)
    assert len(remarks) == said
    assert all("depends on speed remains (10 of log evidence, 300 explained)" in remark for remark in remarks)


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_unknown_on_one_drive_has_even_odds_at_twelve_and_a_tenth_of_what_is_explained(side):
    """However strong: no share of it is granted twice."""
    p = verdict_probabilities({"delay": 9000.0}, 9000.0, 912.0 + side, diagnose.AXIS_VERDICT)
    assert (p[UNKNOWN] > p["delay"]) is (side > 0.0)


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_an_effect_on_one_drive_is_as_likely_as_none_at_seven(side):
    """With this constant one drive alone was judged; that of a machine is another."""
    p = verdict_probabilities({"delay": 7.0 + side}, 7.0 + side, 0.0, diagnose.AXIS_VERDICT)
    assert (p[NONE] < 0.5) is (side > 0.0)
