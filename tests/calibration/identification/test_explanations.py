"""What else may explain a fit's residual, and which explanations the readings cannot tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.identification.estimators import identify
from calibration.identification.explanations import explanations, group_indistinguishable
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from tests.calibration.delta_reference import TRUE, Rows, own_printer
from tests.calibration.recording.test_measurement_folder import printer


def spoiled(arm_mm, count):
    """A machine whose arms are longer than stored, without noise: what it reads, under the stored arms."""
    real = replace(TRUE, arm=TRUE.arm + arm_mm)
    turns = np.radians(np.linspace(0.0, 360.0, count - 1, endpoint=False) + 30.0)
    points = [(0.0, 0.0), *((100.0 * np.cos(t), 100.0 * np.sin(t)) for t in turns)]
    rows = Rows([(0.0, real.steps((x, y, 0.0))) for x, y in points], [])
    start = replace(TRUE, endstop=real.endstop - 0.1)
    return printer(start, rows)


def explained(measured):
    kinds = measured.file.former.unknowns
    model = Model(ParameterSet.of(measured.machine, kinds))
    fit = identify(model, measured.visits, measured.readings(instrument_unknowns=False), "least_squares")
    return explanations(fit, Model(measured.parameters()), measured.readings())


def test_longer_arms_leaning_rails_drive_scale_and_a_bowl_are_one_class():
    """Seven heights, six parameters: one pattern is left, and whatever moves it explains it.

    Arms 3 mm longer look like rails leaning by some milliradians and like a drive scale of -1 %.
    """
    result = explained(spoiled(3.0, 7))
    by_kind = {e.kind: e for e in result}
    assert set(by_kind) == {"strut_length", "axis_tilt", "drive_scale", "bed.bowl"}
    # Exact up to what the readings are not linear in over 3 mm.
    np.testing.assert_allclose(by_kind["strut_length"].value, 3e-3, rtol=0.1)
    np.testing.assert_allclose(by_kind["drive_scale"].value, -0.01, rtol=0.1)
    assert 1e-3 < by_kind["axis_tilt"].size < 4e-3
    for one in result:
        assert one.share == pytest.approx(1.0, abs=1e-6), one.kind
        assert one.absorbed > 0.99, one.kind
    assert [len(group) for group in group_indistinguishable(result, 7)] == [4]


def exact_rows(scale):
    """Readings of the true machine without noise, by a calliper that reads too long by a factor."""
    _, rows = own_printer()
    true = [(scale * np.linalg.norm(TRUE.tool(p) - TRUE.tool(q)), p, q) for _, p, q in rows.distances]
    return Rows([(TRUE.tool(p)[2], p) for _, p in rows.heights], true)


def test_scale_of_the_calliper_and_of_the_drives_are_one_class():
    rows = exact_rows(1.01)
    result = explained(printer(TRUE, rows))
    by_kind = {e.kind: e for e in result}
    assert by_kind["bar.scale"].value == pytest.approx(0.01, rel=0.01)
    np.testing.assert_allclose(by_kind["drive_scale"].value, 0.01, rtol=0.1)
    together = [{e.kind for e in group} for group in group_indistinguishable(result, 19)]
    assert any({"bar.scale", "drive_scale"} <= group for group in together)


def test_an_outlier_is_explained_by_nothing_and_kinds_differ_on_it():
    rows = exact_rows(1.0)
    height, steps = rows.heights[8]
    rows.heights[8] = (height + 0.5, steps)
    result = explained(printer(TRUE, rows))
    assert result[0].share < 0.9
    assert len(group_indistinguishable(result, 19)) > 1
