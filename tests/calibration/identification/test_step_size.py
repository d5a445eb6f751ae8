"""A step distance of the drives that has changed since the calibration before: refused, with the factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.step_size import check_step_size
from tests.calibration.delta_reference import own_printer
from tests.calibration.recording.test_measurement_folder import printer


@pytest.fixture(scope="module")
def own():
    return printer(*own_printer())


@pytest.mark.parametrize(("factor", "named"), [(0.5, "2"), (0.03125, "32"), (2.0, "1/2"), (4.0, "1/4"), (8.0, "1/8")])
def test_a_wrong_step_distance_is_refused_with_the_factor(own, factor, named):
    check_step_size(own)
    wrong = replace(own, visits=replace(own.visits, drives=own.visits.drives * factor))
    with pytest.raises(InputError, match=f"; {named} times the step distance") as caught:
        check_step_size(wrong)
    assert "\n" not in str(caught.value)


def test_readings_of_another_calibration_are_refused_without_a_factor(own):
    wrong = replace(own, visits=replace(own.visits, drives=own.visits.drives + np.array([0.0, 0.004, 0.0])))
    with pytest.raises(InputError, match=r"miss the readings by [\d.]+ mm.*no step distance"):
        check_step_size(wrong)
