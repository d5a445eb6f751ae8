"""What a diagnosis of one drive says beside its figures, on hand-made recordings and evidence."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.axis import diagnose
from calibration.recording.axis_header import AxisFile
from calibration.recording.axis_recording import AxisRecording


def remarks_on(monkeypatch, count: int = 400, **header: object) -> tuple[str, ...]:
    """Remarks on a recording of so many samples, one a millisecond, before anything is searched for in it."""
    time_s = 1e-3 * np.arange(count)
    motor = np.sin(3.0 * time_s)
    units = {"kind": "rotary", "time_unit": "s", "position_unit": "rad", "torque_unit": "Nm", "torque_side": "motor"}
    file = AxisFile(format=1, name="mock", **units | header)
    monkeypatch.setattr(diagnose, "diagnose_signals", lambda _, __, ___, ____, remarks: remarks)
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
