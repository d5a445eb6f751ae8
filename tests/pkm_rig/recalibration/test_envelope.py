"""How far new tables are from the former ones, whatever the grids of the two."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.drives.table_image import TableImage, machine_id_of
from pkm_rig.recalibration.envelope import largest_difference_m


def table(own: int, partner: int, height_m=lambda x, y: 0.0 * x * y, start_m: float = 0.0) -> TableImage:
    """A table over 0.6 m by 0.4 m with a correction that is a function of both positions."""
    x, y = start_m + np.linspace(0.0, 0.6, own), np.linspace(0.0, 0.4, partner)
    values = height_m(x[:, None], y[None, :]) + np.zeros((own, partner))
    return TableImage(
        1, 1, 0.0, 20.0, machine_id_of("planar4"), start_m, 0.6 / (own - 1), 0.0, 0.4 / (partner - 1), values
    )


def bilinear(x, y):
    return 1e-5 + 3e-5 * x - 2e-5 * y + 4e-5 * x * y


def test_the_same_correction_on_a_finer_grid_is_no_change():
    assert largest_difference_m(table(3, 4, bilinear), table(9, 5, bilinear)) == pytest.approx(0.0, abs=1e-18)


def test_the_largest_difference_is_found_at_a_node_of_either():
    coarse, fine = table(3, 3, bilinear), table(9, 9, bilinear)
    fine.corrections_m[5, 2] += 7e-6
    assert largest_difference_m(coarse, fine) == pytest.approx(7e-6)
    assert largest_difference_m(fine, coarse) == pytest.approx(7e-6)
    coarse.corrections_m[1, 1] -= 2e-5
    dense = [np.linspace(0.0, 0.6, 241), np.linspace(0.0, 0.4, 241)]
    hat = 2e-5 * np.minimum.outer(*(np.clip(1.0 - np.abs(x - x[120]) / x[120], 0.0, None) for x in dense))
    assert largest_difference_m(coarse, fine) >= 0.99 * np.max(hat)


def test_beyond_its_grid_a_table_holds_its_edge():
    ramp = table(3, 3, lambda x, y: 1e-4 * x + 0.0 * y)
    further = table(3, 3, lambda x, y: 1e-4 * x + 0.0 * y, start_m=0.1)
    assert largest_difference_m(ramp, further) == pytest.approx(1e-5)
