"""Parts that warm along a course which no formula of the catalogue has: over time, or over a recorded temperature."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.effects.api import BasisSet, BasisSets
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.test_context import SWING, inputs_of

RISE_K = 8.0


@pytest.fixture(scope="module")
def inputs():
    recording = recorded(plant(60, temperature_programme=SWING))
    return inputs_of(recording.machine, context_of_recording(recording))


def nearest(built: BasisSets, channel: str, wanted: np.ndarray) -> tuple[BasisSet, np.ndarray, float]:
    """The set whose main columns come nearest to what a channel does (n,): set, coefficients, share that is left."""

    def fitted(basis_set: BasisSet) -> tuple[BasisSet, np.ndarray, float]:
        columns = [dict(built.contributions[c]).get(channel, np.zeros_like(wanted)) for c in basis_set.main]
        coefficients, *_ = np.linalg.lstsq(np.column_stack(columns), wanted, rcond=1e-2)
        left = wanted - np.column_stack(columns) @ coefficients
        return basis_set, coefficients, float(np.linalg.norm(left) / np.linalg.norm(wanted))

    return min((fitted(basis_set) for basis_set in built.sets if basis_set.size), key=lambda found: found[2])


def size(basis_set: BasisSet, coefficients: np.ndarray) -> float:
    assert len(basis_set.size) == len(coefficients)
    return float(np.dot(basis_set.size, coefficients))


def rise_k() -> float:
    """Of a straight line (ordinary least squares) through the curve."""
    course = np.linspace(0.0, 1.0, 1001)
    return float(np.polyfit(course, RISE_K * bent(course), 1)[0])


def bent(x: np.ndarray) -> np.ndarray:
    """A curve (n,) over [0, 1] that rises from 0 to 1 by way of 0.4 and 0.6."""
    return x + 0.15 * np.sin(2.0 * np.pi * x)


@pytest.mark.parametrize("held", [0.0, 0.5, 1.0])
def test_a_screw_may_warm_along_any_course_of_time_about_any_point_of_it(inputs, held):
    context, machine = inputs.context, inputs.machine
    x, span = context.drives[:, 0] - machine.travel[0, 0], float(np.ptp(machine.travel[0]))
    t = context.elapsed_s / np.ptp(context.elapsed_s)
    wanted = machine.expansion_per_k["drives"] * RISE_K * bent(t) * (x - held * span)
    found = nearest(load_catalogue().effect("screw_thermal_growth").forms(inputs, 0), "travel.left", wanted)
    assert found[2] < 0.1
    assert size(*found[:2]) == pytest.approx(rise_k(), rel=0.25)


def test_a_column_may_follow_a_temperature_along_a_curve(inputs):
    context, machine = inputs.context, inputs.machine
    follows = context.temperatures_c[machine.sensors["base"]]
    course = (follows - follows.min()) / np.ptp(follows)
    wanted = machine.expansion_per_k["base"] * RISE_K * bent(course) * inputs.height_m(0)
    found = nearest(load_catalogue().effect("column_thermal_growth").forms(inputs, 0), "travel.left", wanted)
    assert found[2] < 0.25
    assert size(*found[:2]) == pytest.approx(rise_k(), rel=0.25)


def test_a_screw_that_warms_from_the_beginning_is_a_form_with_a_name(inputs):
    """So that a departure from it is looked for, as of a drive that creeps, and that it can be left out."""
    built = load_catalogue().effect("screw_thermal_growth").forms(inputs, 0)
    warming = [s for s in built.sets if {built.named[c] for c in s.main} == {"warming"}]
    assert len(warming) == 6
    t = inputs.context.elapsed_s
    for basis_set in warming:
        rise = 1.0 - np.exp(-t / basis_set.parameters["tau_s"])
        first = dict(built.contributions[basis_set.main[0]])["travel.left"]
        lower = inputs.context.drives[:, 0] - inputs.machine.travel[0, 0]
        assert np.allclose(first, inputs.machine.expansion_per_k["drives"] * rise * lower, rtol=0.0, atol=1e-15)
    left = built.without_forms({"warming"})
    assert not any("tau_s" in s.parameters and len(s.main) == 2 and len(s.columns) == 2 for s in left.sets)
