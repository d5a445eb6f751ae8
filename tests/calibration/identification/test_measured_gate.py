"""The row of a measurement folder that does not fit: named by file and line, left out where the rest agrees."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from calibration.base.errors import InputError
from calibration.identification.measured_gate import without_wrong_readings
from pkm_rig.jobs.measured_machine import identify_measurements
from pkm_rig.report import measured_text
from tests.calibration.delta_reference import Rows, own_printer
from tests.calibration.recording.test_measurement_folder import hexapod, printer


def spoiled(row, mm):
    """The test's own printer, 13 heights and 6 distances, one of the nineteen off."""
    delta, rows = own_printer()
    heights, distances = list(rows.heights), list(rows.distances)
    if row < len(heights):
        heights[row] = (heights[row][0] + mm, heights[row][1])
    else:
        k = row - len(heights)
        distances[k] = (distances[k][0] + mm, *distances[k][1:])
    return printer(delta, Rows(heights, distances)), rows


@pytest.mark.parametrize("row", range(19))
def test_one_row_of_nineteen_is_named_and_the_rest_identified(row):
    measured, rows = spoiled(row, 2.9)
    rest, left_out = without_wrong_readings(measured)
    n = len(rows.heights)
    line = f"coordinates.csv line {row + 2}" if row < n else f"distances.csv line {row - n + 2}"
    assert [reading.name for reading in left_out] == [line]
    assert left_out[0].size == pytest.approx(2.9e-3, rel=0.05)
    assert left_out[0].unit == "m"
    assert left_out[0].visit == (row if row < n else None)  # a distance has two
    assert left_out[0].t_rig_s is None
    assert sum(len(part) for part in rest.readings()) == 18


def test_nothing_is_left_out_of_good_folders():
    assert without_wrong_readings(printer(*own_printer()))[1] == ()
    assert without_wrong_readings(hexapod(2)[0])[1] == ()


def test_the_result_is_that_of_a_folder_without_the_row(monkeypatch):
    measured, rows = spoiled(15, -2.9)
    result = identify_measurements(measured, "map")
    alone = identify_measurements(printer(own_printer()[0], rows.without(15)), "map")
    assert result["parameters"] == alone["parameters"]
    assert result["held_out"] == alone["held_out"]
    assert result["former"]["quantities"] == alone["former"]["quantities"]
    assert [entry["name"] for entry in result["left_out"]] == ["distances.csv line 4"]
    assert alone["left_out"] == []
    out = io.StringIO()
    monkeypatch.setattr(measured_text, "results", Console(file=out, width=200))
    measured_text.print_measurements(result)
    assert "left out: distances.csv line 4 (distance, visit " in out.getvalue()
    assert "does not fit the model that fits all others" in out.getvalue()


def test_an_angle_that_is_wrong_has_its_size_in_radians():
    measured, _ = hexapod(2)
    measured.coordinates[4, 5] += 1e-3
    (reading,) = without_wrong_readings(measured)[1]
    assert (reading.name, reading.of, reading.unit) == ("coordinates.csv line 6", "visit 12", "rad")
    assert reading.size == pytest.approx(1e-3, rel=0.1)


def test_a_folder_whose_rest_does_not_agree_is_refused():
    """Three of nineteen wrong, of several kinds: that is no slip of one line."""
    delta, rows = own_printer()
    heights = [(h + (2.9 if i in (0, 4, 8) else 0.0), steps) for i, (h, steps) in enumerate(rows.heights)]
    with pytest.raises(InputError, match="do not belong to the same calibration") as caught:
        without_wrong_readings(printer(delta, Rows(heights, rows.distances)))
    assert "\n" not in str(caught.value)


def test_a_missed_row_that_the_others_do_not_disown_refuses_the_folder_by_name(monkeypatch):
    """Were the gate blind, a row that the stored parameters miss by 2.9 mm would not pass either."""
    monkeypatch.setattr("calibration.identification.gate.GATE_SIGMAS", 1e6)
    with pytest.raises(InputError, match=r"own: distances\.csv line 4: the stored parameters miss it by 2\.9"):
        without_wrong_readings(spoiled(15, 2.9)[0])
