"""Signs of columns that the plant has no counterpart of: which way a slider goes, by what mechanics says."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.diagnosis.periodogram import MAX_PEAKS, Periodogram
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.test_context import SWING, inputs_of


@pytest.fixture(scope="module")
def inputs():
    recording = recorded(plant(60, temperature_programme=SWING))
    return inputs_of(recording.machine, context_of_recording(recording))


def shapes(inputs, name):
    """Functions (n,) of all columns at the first drive's travel that are the first of a basis set."""
    built = load_catalogue().effect(name).forms(inputs, 0)
    firsts = {basis_set.columns[0] for basis_set in built.sets}
    return [dict(built.contributions[k])["travel.left"] for k in sorted(firsts)]


def test_friction_holds_a_slider_back_and_the_more_the_heavier_its_load(inputs):
    side, mass = inputs.context.direction[:, 0], inputs.machine.moving_mass_kg + inputs.context.payload_kg
    expected = -side * mass / mass.max()
    approached = side != 0.0  # unlike at nests
    alike = [np.corrcoef(shape[approached], expected[approached])[0, 1] for shape in shapes(inputs, "friction_windup")]
    assert max(alike) > 1.0 - 1e-9


def test_a_warm_screw_that_is_held_below_lifts_its_slider_the_more_the_higher_it_stands(inputs):
    context, travel = inputs.context, inputs.machine.travel
    sensor = inputs.machine.sensors["drives"]
    rise = context.temperatures_c[sensor] - context.temperatures_c[sensor][np.argmin(context.t_s)]
    lifted = rise * (context.drives[:, 0] - travel[0, 0])
    correlations = [np.corrcoef(shape, lifted)[0, 1] for shape in shapes(inputs, "screw_thermal_growth")]
    assert max(correlations) > 1.0 - 1e-9


def test_the_strongest_peaks_of_each_octave_are_tried_however_many_aliases_outdo_them():
    frequency = np.arange(1.0, 40_001.0)
    power = np.ones(len(frequency))
    power[20_000 : 20_000 + 40 * MAX_PEAKS : 20] = 50.0  # at periods below 50 um
    power[399] = 30.0  # at 2.5 mm
    position_m = np.linspace(0.0, 1.0, 50)
    found = Periodogram(frequency, power, position_m, np.zeros(50), 1.0).strongest_periods(1e-5, 4e-3)
    assert any(abs(1.0 / period_m - 400.0) < 1.0 for period_m, _ in found)
