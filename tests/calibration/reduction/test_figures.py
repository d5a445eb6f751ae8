from __future__ import annotations

import numpy as np
import pytest

from calibration.machine.description import load_machine, shipped_machine
from calibration.reduction.figures import figures


def test_rms_and_maximum_are_of_the_free_coordinates():
    machine = load_machine(shipped_machine("planar4"))
    position = np.array([[3e-6, 4e-6, 1.0], [0.0, 0.0, 1.0]])
    rotation = np.array([[1.0, 1.0, 6e-6], [1.0, 1.0, 8e-6]])
    error_figures = figures(machine, position, rotation, 0.0, 0.0)
    assert error_figures.position_rms_m == pytest.approx(5e-6 / np.sqrt(2.0))
    assert error_figures.position_max_m == pytest.approx(5e-6)
    assert error_figures.orientation_rms_rad == pytest.approx(np.sqrt(50.0) * 1e-6)


def test_uncertainty_of_an_rms_matches_its_scatter():
    machine = load_machine(shipped_machine("planar4"))
    rng = np.random.default_rng(7)
    rms, stated = [], []
    for _ in range(400):
        error_figures = figures(machine, rng.normal(0.0, 5e-6, (30, 3)), np.zeros((30, 3)), 0.0, 0.0)
        rms.append(error_figures.position_rms_m)
        stated.append(error_figures.u_position_rms_m)
    assert np.mean(stated) == pytest.approx(np.std(rms), rel=0.12)


def test_scale_does_not_average_out():
    machine = load_machine(shipped_machine("planar4"))
    error_figures = figures(machine, np.full((50, 3), 1e-6), np.zeros((50, 3)), 3e-6, 0.3)
    assert error_figures.u_position_rms_m == pytest.approx(0.9e-6)
